"""The page *Why not ...?* and the README show the numbers of tests/benchmarks/peers.json."""

import importlib
import json
import re
import sys
from types import ModuleType
from typing import Any

import pytest
from repository import ROOT

NUMBER = re.compile(r"\d+(?:\.\d+)?")


@pytest.fixture
def shown(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(ROOT / "tests" / "benchmarks"))
    monkeypatch.delitem(sys.modules, "peers_page", raising=False)
    return importlib.import_module("peers_page")


@pytest.fixture
def found(shown: ModuleType) -> dict[str, Any]:
    return dict(json.loads(shown.RESULTS.read_text(encoding="utf-8")))


def test_page_and_readme_show_the_measured_numbers(shown: ModuleType, found: dict[str, Any]) -> None:
    page, readme = shown.PAGE.read_text(encoding="utf-8"), shown.README.read_text(encoding="utf-8")
    assert shown.written(page, readme, found) == (page, readme)
    assert {heading for heading, block in shown.blocks(found).items() if not block} == set()


def test_a_number_that_was_not_measured_would_fail(shown: ModuleType, found: dict[str, Any]) -> None:
    page, readme = shown.PAGE.read_text(encoding="utf-8"), shown.README.read_text(encoding="utf-8")
    (table,) = (block for heading, block in shown.blocks(found).items() if heading == "Map a thruster")
    wrong = page.replace(table, NUMBER.sub("7.77", table))
    assert wrong != page and shown.written(wrong, readme, found)[0] == page


def test_what_is_missing_is_a_dash(shown: ModuleType, found: dict[str, Any]) -> None:
    for row in found["thrusters"]:
        row.pop("monotone spline", None)
    assert all(line.endswith("|-|") for line in shown.thrusters_table(found).splitlines()[2:])
    assert shown.number(None) == shown.number(float("inf")) == "-"
