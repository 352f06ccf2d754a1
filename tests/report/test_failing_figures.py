"""A figure that cannot be drawn costs no result: a warning in the manifest and on standard error, all else as ever."""

import json
import re
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result
from repository import SAMPLE_RUNS, tree

import automarine_cli as am
from automarine_cli.errors import SettingError
from automarine_cli.report.figures.style import FIGURE_WRITERS, drawn

Run = Callable[..., Result]
SENTENCE = "The figure {} could not be drawn (RuntimeError: no ink); everything else was written."
pytestmark = pytest.mark.usefixtures("lenient_figures")


def boom(*of: object, **more: object) -> Any:
    """What every figure does here that is to fail."""
    raise RuntimeError("no\nink")


def warning_lines(result: Result) -> list[str]:
    return [line.removeprefix("Warning: ") for line in result.stderr.splitlines() if line.startswith("Warning: ")]


def test_a_figure_that_fails_warns(small_day: Path, run: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """One that is not drawn, then all of a format, which are not saved."""
    steps, good, bad = small_day / "pool" / "steps", tmp_path / "good", tmp_path / "bad"
    assert run("fit-yaw", steps, "-o", good).exit_code == 0
    monkeypatch.setattr("automarine_cli.report.figures.runs.drag_figure", boom)
    result = run("fit-yaw", steps, "-o", bad)
    warnings = json.loads((bad / "manifest.json").read_text())["warnings"]
    assert (result.exit_code, warning_lines(result), warnings) == (0, [SENTENCE.format("drag")], warning_lines(result))
    assert " drag.png" not in result.stdout  # of the files that are listed
    expected = {name: data for name, data in tree(good).items() if name not in ("drag.png", "manifest.json")}
    assert {name: data for name, data in tree(bad).items() if name != "manifest.json"} == expected
    assert run("verify", bad).exit_code == 0

    monkeypatch.setitem(FIGURE_WRITERS, "png", boom)  # type: ignore[arg-type]
    result = run("fit-yaw", steps, "-o", tmp_path / "out", "-q")
    assert warning_lines(result) == [
        SENTENCE.format(name) for name in ("half_turns", "drag", "inertia", "collapse", "residuals")
    ]
    assert result.exit_code == 0 and not list((tmp_path / "out").rglob("*.png"))


@pytest.mark.parametrize(
    ("problem", "words"),
    [
        (ValueError(), "ValueError"),
        (KeyError("a\x1b[31m"), "KeyError: 'a\\x1b[31m'"),
        (KeyboardInterrupt(), None),
        (MemoryError(), None),
    ],
)
def test_what_an_exception_says_stands_on_one_line(problem: BaseException, words: str | None) -> None:
    """An interrupt and a want of memory pass."""

    def fail() -> None:
        raise problem

    if words is None:
        with pytest.raises(type(problem)):
            drawn(("png",), ("drag", fail))  # type: ignore[arg-type]
    else:
        sentence = f"The figure drag could not be drawn ({words}); everything else was written."
        assert drawn(("png",), ("drag", fail)) == sentence  # type: ignore[arg-type]


@pytest.mark.parametrize(("command", "settings"), [(am.fit_yaw, {}), (am.validate, {"model": "none.json"})])
def test_an_unknown_format_is_refused_before_any_work(command: Callable[..., object], settings: dict[str, str]) -> None:
    with pytest.raises(SettingError, match=r"^figure format 'gif' is not known; known are png, svg, pdf, slides$"):
        command("nowhere", **settings, figure_formats=("png", "gif"))


def test_kinds_of_figures_are_named_on_the_command_line(tmp_path: Path, run: Run) -> None:
    out = tmp_path / "my day"
    fit = ("fit-thrusters", SAMPLE_RUNS / "thrusters", "--overwrite", "-o", out, "--figures")
    for kinds, suffixes in (("svg,slides", {".svg", ".png"}), ("none", set())):
        result = run(*fit, kinds)
        assert result.exit_code == 0, result.stderr
        (line,) = re.findall(r"^Next: (.*)$", result.stdout, flags=re.MULTILINE)
        assert shlex.split(line)[4] == f"{out}/thrusters.json"
        assert {path.suffix for path in out.iterdir()} - {".json", ".csv", ".md"} == suffixes
        assert ("thrusters.svg" in result.stdout) == bool(suffixes) and "thrusters.png" not in result.stdout
    assert "figure format 'gif' is not known; known are png, svg, pdf" in run(*fit, "gif").stderr
