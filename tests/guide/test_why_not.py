"""The page *Why not ...?* and the README show the numbers of tests/benchmarks/peers.json."""

import importlib
import json
import sys
from types import ModuleType
from typing import Any

import pytest
from repository import ROOT


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
