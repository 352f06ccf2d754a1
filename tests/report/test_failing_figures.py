"""A figure that cannot be drawn costs no result: a warning in the manifest and on standard error, all else as ever."""

import json
import shutil
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from click.testing import Result
from few_candidates import few_candidates

import automarine_cli as am
from automarine_cli.errors import SettingError, attempted
from automarine_cli.report.figures.style import FORMATS
from automarine_cli.simulation.specification import SCHEMA

Run = Callable[..., Result]
SENTENCE = "The figure {} could not be drawn (RuntimeError: no ink); everything else was written."


def boom(*of: object, **more: object) -> Any:
    """What every figure does here that is to fail."""
    raise RuntimeError("no\nink")


class Case(NamedTuple):
    """A command on the campaign below, what draws one of its figures, and that figure's name."""

    command: str
    draws: str
    figure: str


REPORT = "automarine_cli.report"
CASES = {
    "fit-thrusters": Case(
        "fit-thrusters pool/thrusters --thrusters-per-test 2", f"{REPORT}.thruster_tables.thruster_figure", "thrusters"
    ),
    "fit-yaw": Case("fit-yaw pool/steps", f"{REPORT}.figures.runs.drag_figure", "drag"),
    "fit-yaw, whole runs": Case(
        "fit-yaw pool/driving pool/steps --fit-to whole-runs", f"{REPORT}.figures.runs.whole_runs_figure", "whole_runs"
    ),
    "fit-surge": Case("fit-surge forces/surge", f"{REPORT}.figures.runs.half_turns_figure", "steps"),
    "fit-heave": Case("fit-heave forces/heave", f"{REPORT}.figures.runs.inertia_figure", "inertia"),
    "validate": Case(
        "validate pool/validation --model yaw/yaw_model.json",
        f"{REPORT}.validation_report.validation_figure",
        "validation_there_and_back",
    ),
    "diagnose": Case(
        "diagnose pool/steps --model yaw/yaw_model.json", f"{REPORT}.figures.diagnosis.where_figure", "where"
    ),
    "diagnose thrusters": Case(
        "diagnose pool/thrusters --model thrusters/thrusters.json", f"{REPORT}.figures.diagnosis.why_figure",
        "why",
    ),
    "compare": Case("compare yaw driven", f"{REPORT}.compare_report.compare_figure", "comparison"),
    "plan": Case("plan yaw/yaw_model.json", f"{REPORT}.plan_report.plan_figure", "plan"),
}  # fmt: skip


def force_steps(motion: str) -> dict[str, object]:
    """A specification of six steps of surge or heave."""
    of = {"surge": {"m_u": 17.0, "X_uu": 24.0}, "heave": {"m_w": 22.0, "Z_ww": 50.0, "constant_force": 2.0}}
    forces = [s * force for force in (8.0, 15.0, 30.0) for s in (1.0, -1.0)]
    return {
        "schema": SCHEMA,
        "seed": 2,
        "vehicle": {"motion": motion, **of[motion], "force_unit": "N"},
        "logger": {"rate_hz": 5, "noise_m": 0.01},
        "runs": [{"kind": "step", "forces": forces, "duration_s": 8.0}],
    }


@pytest.fixture(scope="module")
def made(small_day: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the logs of small campaigns, and results that other commands take."""
    place = tmp_path_factory.mktemp("failing")
    for name in ("pool", "out/thrusters", "out/yaw"):
        shutil.copytree(small_day / name, place / Path(name).name)
    for motion in ("surge", "heave"):
        specification = place / f"{motion}.json"
        specification.write_text(json.dumps(force_steps(motion)))
        am.simulate(specification, out=place / "forces" / motion)
    am.fit_yaw([place / "pool/driving", place / "pool/steps"], fit_to="whole-runs", out=place / "driven")
    return place


FEW = ("dead-band", "bias-moment")  # will do for a diagnosis here


@pytest.fixture
def place(made: Path, monkeypatch: pytest.MonkeyPatch, lenient_figures: None) -> Iterator[Path]:
    """The working directory of a test, with the campaign in it."""
    monkeypatch.chdir(made)
    with few_candidates(FEW):
        yield made


def content(folder: Path) -> dict[str, bytes]:
    """Every file of a result but its manifest."""
    found = {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}
    del found["manifest.json"]
    return found


def warned(folder: Path) -> list[str]:
    """What the manifest warns of."""
    found: list[str] = json.loads((folder / "manifest.json").read_text()).get("warnings", [])
    return found


def without(stderr: str) -> list[str]:
    """Lines on standard error but for the runs set aside."""
    return [line for line in stderr.splitlines() if not line.startswith(("Set aside", " "))]


DEAR = ("fit-yaw, whole runs", "fit-surge", "fit-heave", "diagnose", "plan")


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.slow) if n in DEAR else n for n in CASES])
def test_a_figure_that_fails_is_a_warning(
    name: str, place: Path, run: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    case, good, bad = CASES[name], tmp_path / "good", tmp_path / "bad"
    assert run(*case.command.split(), "-o", good).exit_code == 0 and warned(good) == []
    monkeypatch.setattr(case.draws, boom)
    found = run(*case.command.split(), "-o", bad, "-q")
    assert (found.exit_code, without(found.stderr)) == (0, [f"Warning: {SENTENCE.format(case.figure)}"])
    assert warned(bad) == [SENTENCE.format(case.figure)]
    expected = content(good)
    del expected[f"{case.figure}.png"]
    assert content(bad) == expected
    assert run("verify", bad).exit_code == 0


def test_so_is_one_that_cannot_be_saved(place: Path, run: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(FORMATS, "png", boom)  # type: ignore[arg-type]
    found = run("fit-yaw", "pool/steps", "-o", tmp_path / "out")
    expected = [SENTENCE.format(name) for name in ("half_turns", "drag", "inertia", "collapse")]
    assert (found.exit_code, warned(tmp_path / "out")) == (0, expected)
    assert without(found.stderr) == [f"Warning: {sentence}" for sentence in expected]
    assert not list((tmp_path / "out").rglob("*.png")) and ".png" not in found.stdout
    assert (tmp_path / "out" / "yaw_model.json").is_file()


def test_the_files_told_of_are_those_that_are_there(
    place: Path, run: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(CASES["fit-yaw"].draws, boom)
    found = run("fit-yaw", "pool/steps", "-o", tmp_path / "out")
    assert "half_turns.png, inertia.png, collapse.png\n" in found.stdout and "drag.png" not in found.stdout


@pytest.mark.parametrize("several", [False, True], ids=["one campaign", "several"])
def test_a_campaign_tells_of_it_each_time(
    several: bool, place: Path, run: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    names = ("one", "two") if several else ("one",)
    for name in names:
        shutil.copytree(place / "pool", tmp_path / name)
    files = [tmp_path / name / "campaign.toml" for name in names]
    monkeypatch.setattr(CASES["fit-thrusters"].draws, boom)
    begins = [f"{name}: fit-thrusters: " if several else "fit-thrusters: " for name in names]
    expected = [f"Warning: {begin}{SENTENCE.format('thrusters')}" for begin in begins]
    first, again = (run("run", *files, "--until", "fit-thrusters", "-o", tmp_path / "out") for _ in range(2))
    for found in (first, again):
        assert found.exit_code == 0, found.stderr
        assert [line for line in without(found.stderr) if line.startswith("Warning")] == expected
    if not several:
        assert "inputs, settings and versions unchanged" in again.stdout


@pytest.mark.parametrize("end", [KeyboardInterrupt, MemoryError])
def test_an_interrupt_and_a_want_of_memory_pass(
    end: type[BaseException], place: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def ends(*of: object) -> None:
        raise end

    monkeypatch.setattr(CASES["fit-thrusters"].draws, ends)
    with pytest.raises(end):
        am.fit_thrusters("pool/thrusters", out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_what_an_exception_says_stands_on_one_line() -> None:
    def bare() -> None:
        raise ValueError

    def long() -> None:
        raise KeyError("a\x1b[31m")

    assert attempted("It failed", bare)[1] == "It failed (ValueError); everything else was written."
    assert attempted("It failed", long)[1] == ("It failed (KeyError: 'a\\x1b[31m'); everything else was written.")


CALLS: Sequence[Callable[[], object]] = (
    lambda: am.fit_thrusters("nowhere", figure_formats=("gif",)),
    lambda: am.fit_yaw("nowhere", figure_formats=("png", "gif")),
    lambda: am.fit_surge("nowhere", figure_formats=("gif",)),
    lambda: am.fit_heave("nowhere", figure_formats=("gif",)),
    lambda: am.validate("nowhere", model="none.json", figure_formats=("gif",)),
    lambda: am.diagnose("nowhere", model="none.json", figure_formats=("gif",)),
    lambda: am.diagnose("nowhere", model="thrusters/thrusters.json", figure_formats=("gif",)),
    lambda: am.compare(["nowhere"], figure_formats=("gif",)),
    lambda: am.plan("none.json", figure_formats=("gif",)),
)


@pytest.mark.parametrize("call", CALLS)
def test_a_format_that_there_is_not_is_refused_before_any_work(call: Callable[[], object], place: Path) -> None:
    with pytest.raises(SettingError, match=r"^figure format 'gif' is not known; known are png, svg, pdf$"):
        call()
