"""`import automarine_cli as am`: light to import, easy to call, results that show themselves; the README's lines."""

import doctest
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from figures import drawn
from repository import ROOT, SAMPLE_RUNS
from small_campaign import make_small_campaign

import automarine_cli as am
from automarine_cli.commands.fit_motion import fit_yaw
from automarine_cli.errors import LogError, SettingError
from automarine_cli.pipeline.results_folder import read_manifest
from automarine_cli.report.figures.style import FORMATS
from automarine_cli.report.sections import sections
from automarine_cli.report.tables import interval


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_small_campaign(tmp_path_factory.mktemp("small") / "logs").parent


@pytest.fixture(scope="module")
def results(logs: Path) -> dict[str, Any]:
    """One result of each kind but a diagnosis of yaw, which takes its time."""
    thrusters = am.fit_thrusters(logs / "thrusters", thrusters_per_test=2)
    fit = am.fit_yaw(str(logs / "steps"))
    folders = []
    for name in ("monday", "tuesday"):
        folders.append(logs.parent / name)
        am.fit_thrusters([logs / "thrusters"], thrusters_per_test=2, out=str(folders[-1]))
    return {
        "check": am.check(logs),
        "thrusters": thrusters,
        "fit": fit,
        "validation": am.validate(logs / "validation", model=fit),
        "diagnosis": am.diagnose(logs / "thrusters", model=thrusters),
        "simulation": am.simulate(str(SAMPLE_RUNS / "hidden_one.toml")),
        "comparison": am.compare(folders),
    }


def test_importing_costs_nothing_until_something_is_asked_for() -> None:
    heavy = "{'numpy', 'scipy', 'pandas', 'matplotlib', 'click'}"
    code = f"import sys, automarine_cli as am; dir(am); assert not {heavy} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", f"{code}; am.fit_yaw; am.effects.get"], check=True, cwd=ROOT)


def test_names_offered_are_there() -> None:
    assert set(am.__all__) <= set(dir(am))
    assert all(callable(getattr(am, name)) for name in am.__all__ if name not in ("__version__", "effects"))
    assert am.fit_yaw.__doc__ == fit_yaw.__doc__
    with pytest.raises(AttributeError, match="has no attribute 'fit_roll'"):
        _ = am.fit_roll  # type: ignore[attr-defined]


def test_the_result_is_the_workflows_own(logs: Path, results: dict[str, Any]) -> None:
    assert results["fit"].to_json() == fit_yaw([logs / "steps"]).to_json()


def test_a_prompt_shows_what_the_terminal_prints(results: dict[str, Any]) -> None:
    for name, result in results.items():
        assert max(map(len, repr(result).splitlines())) <= 110, name
        assert "array(" not in repr(result)
    estimate = results["fit"].output_error["3"].estimates["I_r"]
    assert interval(estimate) in repr(results["fit"])
    assert "no difference shown" in repr(results["comparison"])


def test_frames_hold_the_numbers(results: dict[str, Any]) -> None:
    frame = results["fit"].to_frame()
    own = frame[(frame.model == "3") & (frame.method == "maximum likelihood")].set_index("parameter")
    inertia = results["fit"].output_error["3"].estimates["I_r"]
    assert own.loc["I_r", ["value", "low", "high"]].tolist() == [inertia.value, *inertia.ci95]
    scores = results["validation"].to_frame()
    assert set(scores.run) == {"there_and_back"} and np.isfinite(scores.rmse_deg).all()
    assert results["comparison"].to_frame().verdict.tolist() == ["no difference shown"] * 2
    assert set(results["check"].to_frame().kind) == {"yaw run", "thruster test"}
    assert len(results["simulation"].to_frame()) == 23


@pytest.mark.parametrize("name", ["thrusters", "fit", "validation", "diagnosis", "comparison"])
def test_every_figure_is_drawn(results: dict[str, Any], name: str) -> None:
    listed = sections(results[name]).figures
    with drawn():
        assert listed and all(FORMATS["png"](results[name].plot(what)).startswith(b"\x89PNG") for what in listed)
    with pytest.raises(SettingError, match=f"there is no figure 'x'; known are {next(iter(listed))}"):
        results[name].plot("x")


def test_what_has_no_figure_says_so(results: dict[str, Any]) -> None:
    with pytest.raises(SettingError, match="this result has no figure"):
        results["check"].plot()


def test_notebooks_get_tables(results: dict[str, Any]) -> None:
    assert all("<table>" in result._repr_html_() for result in results.values())
    assert "<var>k</var><sub>r|r|</sub>" in results["fit"]._repr_html_()


def test_more_than_one_argument_without_a_name_is_refused(logs: Path) -> None:
    with pytest.raises(TypeError, match="give logs alone so, a list if many"):
        am.fit_yaw(logs / "steps", logs / "driving")


@pytest.fixture(scope="module")
def frames(logs: Path) -> list[pd.DataFrame]:
    """The step runs as a notebook holds them."""
    return [pd.read_csv(path, comment="#") for path in sorted((logs / "steps").glob("*.csv"))]


def _told(fit: Any) -> list[object]:
    return [fit.to_json()["models"], fit.to_json()["preferred"], fit.to_json()["runs"]["used"]]


@pytest.mark.slow
def test_tables_in_memory_are_runs(logs: Path, frames: list[pd.DataFrame]) -> None:
    """DataFrames, columns by name, Arrow tables, and tables by name: the same fit as from the files."""
    files = _told(am.fit_yaw(logs / "steps"))
    lists = [{name: column.tolist() for name, column in frame.items()} for frame in frames]
    named = {f"run {chr(97 + i)}": frame for i, frame in enumerate(frames)}
    for given in (frames, lists, named, [pa.table(frame) for frame in frames]):
        assert _told(am.fit_yaw(given)) == files
    assert [run.run for run in am.check(named).runs] == list(named)
    assert am.check(frames[0]).runs[0].samples == len(frames[0])
    assert am.check([*frames, frames[0]]).logs == len(frames), "a table given twice is one log"


def test_tables_are_told_by_their_hash(frames: list[pd.DataFrame], tmp_path: Path) -> None:
    hashes = []
    for name in ("one", "two"):
        am.fit_yaw(frames, out=tmp_path / name)
        hashes.append([(one.file, one.sha256) for one in read_manifest(tmp_path / name / "manifest.json").inputs])
    assert hashes[0] == hashes[1] and len({sha for _, sha in hashes[0]}) == len(frames)
    assert hashes[0][0][0] == f"logs_{1:0{len(str(len(frames)))}d}"


def test_columns_may_be_said_in_place(frames: list[pd.DataFrame]) -> None:
    mirrored = [
        frame.assign(compass=-frame.heading_deg, moment=frame.tau)[["time_s", "compass", "moment"]] for frame in frames
    ]
    columns = {"heading_deg": {"from": "compass", "sign": -1}, "tau": "moment"}
    assert _told(am.fit_yaw(mirrored, columns=columns)) == _told(am.fit_yaw(frames))


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        (5, "logs: found int; give a file, a folder, a glob, a DataFrame"),
        (None, "logs: found NoneType; give a file"),
        (np.zeros((3, 3)), "logs: found ndarray; give a file"),
        ({"time_s": [1.0, 2.0], "tau": [1.0]}, "logs: no table of columns of numbers .*columns of one length"),
        (pd.DataFrame({"time_s": [object()]}), "logs: no table of columns of numbers "),
        (pd.DataFrame(), "logs: a header without rows"),
        ([{"time_s": [1.0], "heading_deg": ["x"], "tau": [0.0]}], "logs_1, row 1, column heading_deg: found 'x'"),
    ],
)
def test_what_is_no_log_is_refused_in_our_words(given: Any, sentence: str) -> None:
    with pytest.raises(LogError, match=sentence):
        am.fit_yaw(given)


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"thrusters": 3}, "thrusters: found int, expected a file or a result"),
        ({"columns": 3}, "columns: found int, expected a file or a result"),
        ({"fit_to": "thirds"}, "fit_to is 'thirds'; .* is not one of 'auto', 'half-turns', 'whole-runs'"),
    ],
)
def test_settings_of_a_wrong_kind_are_refused(logs: Path, settings: dict[str, Any], sentence: str) -> None:
    with pytest.raises(SettingError, match=sentence):
        am.fit_yaw(logs / "steps", **settings)
    with pytest.raises(TypeError, match="fit_yaw has no setting 'tails'; it has arm, channels, columns, "):
        am.fit_yaw(logs / "steps", tails=1)  # type: ignore[call-arg]


@pytest.mark.parametrize(
    ("page", "heading", "least"),
    [
        ("README.md", "Your own logs", 2),
        ("automarine_cli/guide/python.md", "A session", 6),
        ("automarine_cli/guide/developers.md", "Planar motion", 12),
    ],
)
def test_sections_do_what_they_show(page: str, heading: str, least: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    text = (ROOT / page).read_text(encoding="utf-8")
    section = text.partition(f"\n## {heading}\n")[2].partition("\n## ")[0]
    test = doctest.DocTestParser().get_doctest(section, {}, heading, page, 0)
    assert len(test.examples) >= least
    told: list[str] = []
    doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE).run(test, out=told.append)
    assert not told, "".join(told)
