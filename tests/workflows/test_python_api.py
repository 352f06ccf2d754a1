"""`import automarine_cli as am`: light to import, easy to call, results that show themselves; the README's lines."""

import doctest
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from repository import ROOT, SAMPLE_RUNS
from small_campaign import make_small_campaign

import automarine_cli as am
from automarine_cli.errors import SettingError
from automarine_cli.workflows.fit_yaw import fit_yaw


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
        "diagnosis": am.diagnose(logs / "thrusters", model=thrusters, thrusters_per_test=2),
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


def test_reprs_are_a_few_lines_with_the_numbers(results: dict[str, Any]) -> None:
    for name, result in results.items():
        lines = repr(result).splitlines()
        assert 1 <= len(lines) <= 12 and max(map(len, lines)) <= 110, name
        assert "array(" not in repr(result) and "\n" not in lines[0]
    inertia = results["fit"].preferred.estimates["I_r"]
    (line,) = (line for line in repr(results["fit"]).splitlines() if line.startswith("  I_r "))
    value, low, high = map(float, re.findall(r"-?\d+\.\d+", line)[:3])
    assert (value, low, high) == pytest.approx((inertia.value, *inertia.ci95), abs=1e-2)
    assert repr(results["check"]).startswith("Look at 10 logs") or "set aside" in repr(results["check"])


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
    drawn = results[name].view.figures(results[name])
    assert drawn and all(isinstance(results[name].plot(what), Figure) for what in drawn)
    with pytest.raises(SettingError, match=f"there is no figure 'x'; known are {next(iter(drawn))}"):
        results[name].plot("x")


def test_what_has_no_figure_says_so(results: dict[str, Any]) -> None:
    with pytest.raises(SettingError, match="a Check has no figure"):
        results["check"].plot()


def test_notebooks_get_tables(results: dict[str, Any]) -> None:
    assert all("<table>" in result._repr_html_() for result in results.values())
    assert "<var>k</var><sub>r|r|</sub>" in results["fit"]._repr_html_()


def test_more_than_one_argument_without_a_name_is_refused(logs: Path) -> None:
    with pytest.raises(TypeError, match="give logs alone so, as a list if they are many"):
        am.fit_yaw(logs / "steps", logs / "driving")


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
