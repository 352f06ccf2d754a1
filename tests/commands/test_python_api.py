"""`import automarine_cli as am`: light to import, easy to call, results that show themselves; the guide's session."""

import doctest
import inspect
import subprocess
import sys
import typing
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from figures import drawn
from repository import ROOT, SAMPLE_RUNS

import automarine_cli as am
from automarine_cli.commands.fit_motion import fit_yaw
from automarine_cli.errors import LogError, SettingError
from automarine_cli.pipeline.results_folder import read_manifest
from automarine_cli.report.figures.style import FIGURE_WRITERS
from automarine_cli.report.sections import sections
from automarine_cli.report.tables import interval


@pytest.fixture(scope="module")
def logs(small_day: Path) -> Path:
    return small_day / "pool"


@pytest.fixture(scope="module")
def results(logs: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """One result of each kind but a diagnosis of yaw, which takes its time."""
    folder, fit = tmp_path_factory.mktemp("days"), am.fit_yaw(str(logs / "steps"))
    for name in ("monday", "tuesday"):
        thrusters = am.fit_thrusters([logs / "thrusters"], thrusters_per_test=2, out=str(folder / name))
    return {
        "check": am.check(logs),
        "thrusters": thrusters,
        "fit": fit,
        "validation": am.validate(logs / "validation", model=fit),
        "diagnosis": am.diagnose(logs / "thrusters", model=thrusters),
        "simulation": am.simulate(str(SAMPLE_RUNS / "hidden_one.toml")),
        "comparison": am.compare([folder / "monday", folder / "tuesday"]),
    }


def test_importing_costs_nothing_until_something_is_used() -> None:
    heavy = "{'numpy', 'scipy', 'pandas', 'matplotlib', 'click'}"
    code = f"import sys, automarine_cli as am; dir(am); assert not {heavy} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", f"{code}; am.fit_yaw; am.effects.get"], check=True, cwd=ROOT)


def test_names_offered_are_there() -> None:
    assert set(am.__all__) <= set(dir(am))
    assert all(callable(getattr(am, name)) for name in am.__all__ if name not in ("__version__", "effects"))
    assert am.fit_yaw.__doc__ == fit_yaw.__doc__
    with pytest.raises(AttributeError, match="has no attribute 'fit_list'"):
        _ = am.fit_list  # type: ignore[attr-defined]


def test_signatures_have_types_and_defaults() -> None:
    """What an editor or `help` shows: a value left out is the one that the signature names."""
    for name in {*am.__all__} - {"__version__", "effects"}:
        command = getattr(am, name)
        first, *others = inspect.signature(command).parameters.values()
        assert all(param.annotation is not inspect.Parameter.empty for param in (first, *others))
        assert all(param.kind is inspect.Parameter.KEYWORD_ONLY for param in others)
        left_out = {param.name: param.default for param in others if param.default is not inspect.Parameter.empty}
        assert {"logs", "model", "results", "specification", "folder"} & {first.name} and (
            left_out or name == "samples"
        )
    seed = inspect.signature(am.diagnose).parameters["seed"]
    assert (seed.annotation, seed.default) == (int, 0)
    parameters = inspect.signature(am.fit_yaw).parameters
    assert parameters["strict"].annotation is bool and parameters["out"].default is None
    assert "half-turns" in typing.get_args(parameters["fit_to"].annotation)
    assert parameters["arm"].annotation == float | None
    assert inspect.signature(am.diagnose).parameters["model"].default is inspect.Parameter.empty


def test_a_prompt_and_a_notebook_show_tables(results: dict[str, Any]) -> None:
    for name, result in results.items():
        assert max(map(len, repr(result).splitlines())) <= 110, name
        assert "array(" not in repr(result) and "<table>" in result._repr_html_()
    assert interval(results["fit"].output_error["3"].estimates["I_r"]) in repr(results["fit"])
    assert "<var>k</var><sub>r|r|</sub>" in results["fit"]._repr_html_()


@pytest.mark.parametrize("name", ["validation", "diagnosis", "comparison"])
def test_every_figure_is_drawn(results: dict[str, Any], name: str) -> None:
    listed = sections(results[name]).figures
    with drawn():
        pages = [FIGURE_WRITERS["png"](results[name].plot(figure)) for figure in listed]
        assert pages and all(page.startswith(b"\x89PNG") for page in pages)
    with pytest.raises(SettingError, match=f"there is no figure 'x'; known are {next(iter(listed))}"):
        results[name].plot("x")
    with pytest.raises(SettingError, match="this result has no figure"):
        results["simulation"].plot()


@pytest.fixture(scope="module")
def frames(logs: Path) -> list[pd.DataFrame]:
    """The step runs as a notebook holds them."""
    return [pd.read_csv(path, comment="#") for path in sorted((logs / "steps").glob("*.csv"))]


def numbers(fit: Any) -> list[object]:
    return [fit.to_json()["models"], fit.to_json()["preferred"], fit.to_json()["runs"]["used"]]


@pytest.mark.slow
def test_tables_in_memory_are_runs(results: dict[str, Any], frames: list[pd.DataFrame]) -> None:
    """DataFrames, columns by name, Arrow tables, and tables by name: the same fit as from the files."""
    lists = [{name: column.tolist() for name, column in frame.items()} for frame in frames]
    named = {f"run {chr(97 + i)}": frame for i, frame in enumerate(frames)}
    for tables in (frames, lists, named, [pa.table(frame) for frame in frames]):
        assert numbers(am.fit_yaw(tables)) == numbers(results["fit"])
    assert [run.run for run in am.check(named).runs] == list(named)
    assert am.check([*frames, frames[0]]).logs == len(frames), "a table that comes twice is one log"


def test_tables_by_their_hash_and_columns_in_place(
    results: dict[str, Any], frames: list[pd.DataFrame], tmp_path: Path
) -> None:
    mirrored = [
        frame.assign(compass=-frame.heading_deg, moment=frame.tau)[["time_s", "compass", "moment"]] for frame in frames
    ]
    columns = {"heading_deg": {"from": "compass", "sign": -1}, "tau": "moment"}
    assert numbers(am.fit_yaw(mirrored, columns=columns, out=tmp_path / "yaw")) == numbers(results["fit"])
    entries = read_manifest(tmp_path / "yaw" / "manifest.json").inputs
    assert [entry.file for entry in entries][:2] == [f"logs_{i:0{len(str(len(frames)))}d}" for i in (1, 2)]
    assert len({entry.sha256 for entry in entries}) == len(frames)


@pytest.mark.parametrize(
    ("logs", "sentence"),
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
def test_what_is_no_log_is_refused_in_our_words(logs: Any, sentence: str) -> None:
    with pytest.raises(LogError, match=sentence):
        am.fit_yaw(logs)


@pytest.mark.parametrize(
    ("settings", "error", "sentence"),
    [
        ({"thrusters": 3}, SettingError, "thrusters: found int, expected a file or a result"),
        ({"columns": 3}, SettingError, "columns: found int, expected a file or a result"),
        ({"fit_to": "thirds"}, SettingError, "fit_to is 'thirds'; .* is not one of 'auto', 'half-turns', 'whole-runs'"),
        ({"tails": 1}, TypeError, "fit_yaw has no setting 'tails'; it has arm, channels, columns, "),
    ],
)
def test_settings_of_a_wrong_kind(logs: Path, settings: dict[str, Any], error: type[Exception], sentence: str) -> None:
    with pytest.raises(error, match=sentence):
        am.fit_yaw(logs / "steps", **settings)
    with pytest.raises(TypeError, match="give logs alone so, a list if many"):
        am.fit_yaw(logs / "steps", logs / "driving")


def test_the_guide_s_session_does_what_it_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    page = ROOT / "automarine_cli" / "guide" / "python.md"
    test = doctest.DocTestParser().get_doctest(page.read_text(encoding="utf-8"), {}, page.stem, page.name, 0)
    assert len(test.examples) >= 6
    wrong: list[str] = []
    doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE).run(test, out=wrong.append)
    assert not wrong, "".join(wrong)
