"""The notebooks of the site: each cell runs here as it stands, and shows what it should, without Sphinx and Jupyter."""

import ast
import re
import sys
from pathlib import Path
from typing import Any

import pytest
from repository import ROOT

NOTEBOOKS = sorted((ROOT / ".docs" / "notebooks").glob("*.md"))
TRUTH = {"I_r": 1.018, "k_rr": 1.257}  # nu s²


def shown_by(notebook: Path, monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The values that the cells of a notebook show, each figure as its picture, None of what is printed."""
    values, names = list[Any](), dict[str, Any]()
    monkeypatch.setattr(sys, "displayhook", lambda value: values.append(getattr(value, "_repr_png_", lambda: value)()))
    cells = re.findall(r"^```\{code-cell\}\n(.*?)^```$", notebook.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    for cell in cells:
        exec(compile(ast.Interactive(ast.parse(cell).body), notebook.name, "single"), names)
    assert len(cells) >= 5
    return values


def test_the_first_walk_finds_the_truth(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    samples, look, numbers, *figures, end = shown_by(NOTEBOOKS[1], monkeypatch)
    assert len(samples.files) > 100 and all(low < TRUTH[name] < high for name, _, low, high, _ in numbers.itertuples())
    assert len(figures) == 4 and end.heading_deg_low.iloc[-1] < end.heading_deg.iloc[-1] < end.heading_deg_high.iloc[-1]
    for picture, settings in (look, *figures):
        assert picture.startswith(b"\x89PNG") and settings["width"] == pytest.approx(720.0)


@pytest.mark.slow
def test_the_driven_log_stays_in_its_band(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    *_, (picture, _), nothing = shown_by(NOTEBOOKS[0], monkeypatch)
    assert picture.startswith(b"\x89PNG") and nothing is None
    first, last = capsys.readouterr().out.splitlines()
    assert "predicts 5 s ahead to 21.3 deg" in first and last == "inside the band for 94 % of the run"
