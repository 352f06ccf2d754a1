"""A figure that cannot be drawn costs no result: a warning in the manifest and on standard error, all else as ever."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result

import automarine_cli as am
from automarine_cli.errors import SettingError, attempted
from automarine_cli.report.figures.style import FORMATS

Run = Callable[..., Result]
SENTENCE = "The figure {} could not be drawn (RuntimeError: no ink); everything else was written."


def boom(*of: object, **more: object) -> Any:
    """What every figure does here that is to fail."""
    raise RuntimeError("no\nink")


CASES = [
    ("fit-yaw pool/steps", "figures.runs.drag_figure", "drag"),
    (
        "validate pool/validation --model yaw/yaw_model.json", "validation_report.validation_figure",
        "validation_there_and_back",
    ),
]  # fmt: skip
"""A command on the campaign below, what draws one of its figures, and that figure's name."""


@pytest.fixture(scope="module")
def campaign(small_day: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the logs of a small campaign, and results that other commands take."""
    place = tmp_path_factory.mktemp("failing")
    for name in ("pool", "out/thrusters", "out/yaw"):
        shutil.copytree(small_day / name, place / Path(name).name)
    return place


@pytest.fixture
def place(campaign: Path, monkeypatch: pytest.MonkeyPatch, lenient_figures: None) -> Path:
    """The working directory of a test, with the campaign in it."""
    monkeypatch.chdir(campaign)
    return campaign


def warnings_of(folder: Path) -> list[str]:
    warnings: list[str] = json.loads((folder / "manifest.json").read_text()).get("warnings", [])
    return warnings


def warning_lines(result: Result) -> list[str]:
    """Lines on standard error that are warnings; no others but of runs set aside, and of steps."""
    return [line.removeprefix("Warning: ") for line in result.stderr.splitlines() if line.startswith("Warning: ")]


@pytest.mark.parametrize(("command", "draws", "figure"), CASES, ids=[figure for *_, figure in CASES])
def test_a_figure_that_fails_is_a_warning(
    command: str, draws: str, figure: str, place: Path, run: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    trees = []
    for out in (tmp_path / "good", tmp_path / "bad"):
        result = run(*command.split(), "-o", out)
        assert result.exit_code == 0, result.output
        trees.append({p.relative_to(out).as_posix(): p.read_bytes() for p in out.rglob("*") if p.is_file()})
        monkeypatch.setattr(f"automarine_cli.report.{draws}", boom)
    assert warnings_of(tmp_path / "good") == []
    assert warning_lines(result) == warnings_of(tmp_path / "bad") == [SENTENCE.format(figure)]
    assert f" {figure}.png" not in result.stdout  # of the files that are listed
    good, bad = trees
    del good[f"{figure}.png"], good["manifest.json"], bad["manifest.json"]
    assert bad == good
    assert run("verify", tmp_path / "bad").exit_code == 0


def test_so_is_one_that_cannot_be_saved(place: Path, run: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(FORMATS, "png", boom)  # type: ignore[arg-type]
    result = run("fit-yaw", "pool/steps", "-o", tmp_path / "out", "-q")
    expected = [SENTENCE.format(name) for name in ("half_turns", "drag", "inertia", "collapse")]
    assert (result.exit_code, warnings_of(tmp_path / "out"), warning_lines(result)) == (0, expected, expected)
    assert not list((tmp_path / "out").rglob("*.png"))
    assert (tmp_path / "out" / "yaw_model.json").is_file()


def test_a_campaign_tells_of_it_each_time(
    place: Path, run: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name in ("one", "two"):
        shutil.copytree(place / "pool", tmp_path / name)
    monkeypatch.setattr("automarine_cli.report.thruster_tables.thruster_figure", boom)
    files = [tmp_path / name / "campaign.toml" for name in ("one", "two")]
    for _ in range(2):
        result = run("run", *files, "--until", "fit-thrusters", "-o", tmp_path / "out")
        assert result.exit_code == 0, result.stderr
        sentence = SENTENCE.format("thrusters")
        assert warning_lines(result) == [f"{name}: fit-thrusters: {sentence}" for name in ("one", "two")]


@pytest.mark.parametrize("end", [KeyboardInterrupt, MemoryError])
def test_an_interrupt_and_a_want_of_memory_pass(
    end: type[BaseException], place: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def ends(*of: object) -> None:
        raise end

    monkeypatch.setattr("automarine_cli.report.thruster_tables.thruster_figure", ends)
    with pytest.raises(end):
        am.fit_thrusters("pool/thrusters", out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("problem", "words"), [(ValueError(), "ValueError"), (KeyError("a\x1b[31m"), "KeyError: 'a\\x1b[31m'")]
)
def test_what_an_exception_says_stands_on_one_line(problem: Exception, words: str) -> None:
    def fail() -> None:
        raise problem

    assert attempted("It failed", fail)[1] == f"It failed ({words}); everything else was written."


@pytest.mark.parametrize(("command", "settings"), [(am.fit_yaw, {}), (am.validate, {"model": "none.json"})])
def test_a_format_that_there_is_not_is_refused_before_any_work(
    command: Callable[..., object], settings: dict[str, str]
) -> None:
    with pytest.raises(SettingError, match=r"^figure format 'gif' is not known; known are png, svg, pdf$"):
        command("nowhere", **settings, figure_formats=("png", "gif"))
