"""Every number of README and guide stands in a golden output, a sample, the code or a record of what was measured."""

import ast
import importlib
import json
import re
import sys
import tomllib
from functools import cache
from pathlib import Path

import pytest
from golden import OUTPUTS
from repository import ROOT, SAMPLE_RUNS
from test_readme import PAGES, without_fences

RECORDS = tomllib.loads((Path(__file__).parent / "numbers.toml").read_text(encoding="utf-8"))
MEASURED = "how-good.md"  # the page of measurements: a number that the code has by chance is no record of one
OF_OTHER_TESTS = ("why-not.md", "hidden-walk.md", "references.md")  # peers.json; a simulation; years and volumes
NUMBER = re.compile(r"(?<![\w.,/#-])[-−+]?(\d+(?:,\d{3})*(?:\.\d+)?(?:e-?\d+)?)(?![\w/]|\.\d|-\d)")
YEAR = re.compile(r"(19|20)\d\d")
CHECKED = [
    page for page in PAGES if page.startswith(("README", "automarine_cli/")) and Path(page).name not in OF_OTHER_TESTS
]


def numbers(text: str) -> set[str]:
    """Numbers of two figures and more in a text; neither years nor what stands in code, links, formulas and tags."""
    for left_out in (r"\$[^$]*\$", r"\]\([^)]*\)", r"<[^>]*>", r"`[^`]*`"):
        text = re.sub(left_out, "", text)
    digits = {match.group(1).replace(",", "") for match in NUMBER.finditer(text)}
    return {number for number in digits if len(number) > 1 and not YEAR.fullmatch(number)}


@cache
def printed() -> frozenset[str]:
    """Numbers of golden outputs, samples and the results of other tools."""
    results = [*OUTPUTS.iterdir(), *SAMPLE_RUNS.rglob("*.toml"), *SAMPLE_RUNS.rglob("*.json")]
    text = "".join(
        path.read_text(encoding="utf-8") for path in (*results, ROOT / "tests" / "benchmarks" / "peers.json")
    )
    return frozenset(re.findall(r"\d+(?:\.\d+)?(?:e-?\d+)?", text))


@cache
def coded() -> frozenset[str]:
    """Numbers of the code, also as per cent."""
    trees = (ast.parse(path.read_text(encoding="utf-8")) for path in (ROOT / "automarine_cli").rglob("*.py"))
    constants = (node.value for tree in trees for node in ast.walk(tree) if isinstance(node, ast.Constant))
    plain = [abs(value) for value in constants if isinstance(value, (int, float)) and not isinstance(value, bool)]
    return frozenset(f"{value * unit:.6g}" for value in plain for unit in (1.0, 100.0))


def unknown(page: str, text: str) -> set[str]:
    """Numbers of a page's text that nothing bears out."""
    recorded = {number for record in RECORDS.get(Path(page).name, {}).values() for number in record.split()}
    known = recorded if page.endswith(MEASURED) else recorded | printed() | coded()
    return {n for n in numbers(text) - known if page.endswith(MEASURED) or f"{float(n):.6g}" not in known}


@pytest.mark.parametrize("page", CHECKED)
def test_every_number_of_a_page_has_its_source(page: str) -> None:
    assert unknown(page, without_fences(page)) == set()


@pytest.mark.parametrize("page", RECORDS)
def test_every_record_is_of_a_number_on_its_page(page: str) -> None:
    (text,) = (without_fences(path) for path in PAGES if Path(path).name == page)
    recorded = {number for record in RECORDS[page].values() for number in record.split()}
    assert recorded - numbers(text) == set()


def test_a_number_without_a_source_is_noticed() -> None:
    assert unknown("README.md", "It is 87.6543 % right, see `12.34` and [a page](x.md#56.7).") == {"87.6543"}
    assert unknown(MEASURED, "An error of 0.05.") == {"0.05"}


def test_page_and_readme_show_the_measured_numbers_of_other_tools(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "tests" / "benchmarks"))
    monkeypatch.delitem(sys.modules, "peers_page", raising=False)
    peers = importlib.import_module("peers_page")
    measured = json.loads(peers.RESULTS.read_text(encoding="utf-8"))
    page, readme = peers.PAGE.read_text(encoding="utf-8"), peers.README.read_text(encoding="utf-8")
    assert peers.written(page, readme, measured) == (page, readme)
    assert {heading for heading, block in peers.blocks(measured).items() if not block} == set()
