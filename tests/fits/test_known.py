"""What the user knows beforehand is a prior of every estimator: known truth, and the amounts of the textbook."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from identified import driven_fit
from made_campaigns import PAPER, campaign
from made_driven import Sea, steered
from made_planar import BARE
from made_planar import campaign as planar_campaign
from repository import SAMPLE_RUNS
from step_fits import fitted_steps

from automarine_cli.commands import automarine
from automarine_cli.commands.fit_motion import fit_yaw
from automarine_cli.dofs import SURGE, YAW
from automarine_cli.errors import SettingError
from automarine_cli.filters.course import make_course
from automarine_cli.fits.known import names_in, parse_known, qualified
from automarine_cli.fits.planar_fit import PlanarLikelihood
from automarine_cli.fits.planar_start import rough_sizes
from automarine_cli.fits.planar_structure import OWN, observed
from automarine_cli.fits.steps import data_of_steps
from automarine_cli.fits.whole_runs import OutputErrorFit, fit_whole_runs, rough_model
from automarine_cli.models.model import COMMAND_DELAY
from automarine_cli.models.parameter import NOTHING_KNOWN, Prior, Priors
from automarine_cli.runs.half_turn import half_turns
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import make_batch


def inertia_known(value: float, stderr: float | None = None) -> Priors:
    return {"yaw.I_r": Prior(value, stderr)}


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (("I_r=915±50", "k_r = 1e2 +- 5"), {"I_r": Prior(915.0, 50.0), "k_r": Prior(100.0, 5.0)}),
        ("I_r=915+/-50,sway.Y_v=.5", {"I_r": Prior(915.0, 50.0), "sway.Y_v": Prior(0.5)}),
        ({"I_r": 915, "k_r": [100, 5]}, {"I_r": Prior(915.0), "k_r": Prior(100.0, 5.0)}),
    ],
)
def test_it_is_read_as_people_write_it(given: object, expected: dict[str, Prior]) -> None:
    assert parse_known(given) == expected
    assert set(names_in(SURGE)) == {"m_u", "X_u", "X_uu", COMMAND_DELAY}


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ("I_r=915kg", "known is 'I_r=915kg'; expected a name, a number and perhaps its standard error"),
        ("I_r=915±0", "expected a finite number, or one and its standard error above 0"),
        ("I_r=1,I_r=2", "I_r is given twice"),
        ("I_r=1,yaw.I_r=2", "yaw.I_r is given twice"),
        ({"I_r": [1, 2, 3]}, "expected a finite number, or one and its standard error"),
        ({"I_r": "heavy"}, "I_r is 'heavy'; expected a finite number"),
        ("I_r=-3", "I_r is -3; expected a number above 0"),
        ("I_z=3", "'I_z' is no parameter of this fit; it has I_r, k_rr, k_r, command_delay_s; did you mean I_r?"),
    ],
)
def test_what_makes_no_sense_is_one_sentence(given: object, sentence: str) -> None:
    with pytest.raises(SettingError) as refused:
        qualified(parse_known(given), names_in(YAW))
    assert sentence in str(refused.value)


def fitted(runs: list[Run], kind: str, known: Priors) -> OutputErrorFit:
    """Model 3 by one of the estimators."""
    rest = np.ones(len(runs), dtype=bool)
    if kind == "half-turns":
        turns, _ = half_turns(runs)
        return fitted_steps(data_of_steps(turns), "3", (1.2, 1.0, 1.0), known)
    if kind == "whole-runs":
        return fit_whole_runs(make_batch(runs, 0.1), "3", rest, priors=known)
    course = make_course(runs, rest)
    return driven_fit(course, rough_model("3", make_batch(runs, 0.1)), "3", known)


@pytest.mark.parametrize(
    ("kind", "within"),
    [("half-turns", 0.03), ("whole-runs", 0.06), pytest.param("driven", 0.06, marks=pytest.mark.slow)],
)
def test_a_known_inertia_sets_the_scale_of_the_drag(kind: str, within: float) -> None:
    """Logs that tell 1.15 times the moments that acted: inertia and drag come out too large, but not their ratio."""
    runs = campaign((0.4, -0.6, 0.8, -1.0), seed=3)
    inertia, drag = PAPER.inertia, PAPER.k_rr
    if kind == "driven":
        runs, inertia, drag = steered(3, 2, Sea(size=0.05), length=20.0), 1.0, Sea.k_rr
    runs = [replace(run, moment=1.15 * run.command) for run in runs]
    free, held = (fitted(runs, kind, prior).estimates for prior in (NOTHING_KNOWN, inertia_known(inertia)))
    if kind == "driven":
        assert free["k_rr"].value > 1.07 * drag
    else:
        assert free["k_rr"].value == pytest.approx(1.15 * drag, rel=0.04)
    assert held["k_rr"].value == pytest.approx(drag, rel=within)
    assert (held["I_r"].value, held["I_r"].stderr) == (inertia, 0.0)
    assert held["I_r"].known and not held["k_rr"].known


@pytest.mark.parametrize("kind", ["half-turns", "whole-runs", pytest.param("driven", marks=pytest.mark.slow)])
def test_a_prior_moves_the_estimate_by_the_textbook_amount(kind: str) -> None:
    """Means weigh by their precisions, and precisions add; of a positive parameter on the logarithm."""
    runs = steered(3, 4, length=20.0) if kind == "driven" else campaign(seed=1, gain_scatter=0.03)
    free = fitted(runs, kind, NOTHING_KNOWN)
    there, error = np.log(free.estimates["I_r"].value), float(np.sqrt(free.mixed.covariance[0, 0]))
    beside = float(np.exp(there + error))
    held = fitted(runs, kind, inertia_known(beside, beside * error))
    assert np.log(held.estimates["I_r"].value) == pytest.approx(there + 0.5 * error, abs=0.12 * error)
    assert 1.0 / held.mixed.covariance[0, 0] == pytest.approx(2.0 / error**2, rel=0.2)
    assert held.estimates["I_r"].known


def test_the_interval_holds_the_error_of_what_was_known() -> None:
    """Runs that say next to nothing beside the prior: the standard error is the prior's, whatever leaving runs out
    shows."""
    runs = campaign(seed=5, gain_scatter=0.05)
    value = fitted(runs, "half-turns", NOTHING_KNOWN).estimates["I_r"].value
    found = fitted(runs, "half-turns", inertia_known(value, 1e-3 * value)).estimates["I_r"]
    assert found.stderr == pytest.approx(1e-3 * value, rel=0.1)


def test_the_plane_takes_what_is_known() -> None:
    runs = tuple(planar_campaign(BARE, 1, 1, 8.0, ("heading", "surge", "sway")))
    seen = observed(runs)
    names = seen.names()
    known = qualified(parse_known("I_r=2.0,m_u=20±0.001"), names, sorted({*names.values()} - {*OWN}))
    model = seen.simplest(rough_sizes(runs))
    found = PlanarLikelihood(runs, seen, known).estimate(model)
    assert found.model.values["yaw.I_r"] == 2.0
    assert found.model.values["surge.m_u"] == pytest.approx(20.0, abs=0.005)
    assert found.by_name["surge.m_u"].stderr == pytest.approx(0.001, rel=0.1)
    with pytest.raises(SettingError, match="'X_uuu' is no parameter of this fit"):
        qualified(parse_known("X_uuu=3"), names)


def test_the_command_tells_it_everywhere(tmp_path: Path) -> None:
    logs = sorted((SAMPLE_RUNS / "steps").glob("tau_*_a.csv"))
    arguments = ["fit-yaw", *map(str, logs), "--known", "I_r=1.0±0.05,k_r=0.1", "-o", str(tmp_path / "out")]
    done = CliRunner().invoke(automarine, arguments)
    assert done.exit_code == 0, done.output
    for sentence in (
        "(known)", "Known beforehand: I_r = 1 ± 0.05 nu s², k_r = 0.1 nu s.", "The preferred model has no k_r",
        "The velocity errors of the paper do not use it.",
    ):  # fmt: skip
        assert sentence in done.output
    model = json.loads((tmp_path / "out" / "yaw_model.json").read_text())["models"]
    assert model["3"]["I_r"]["known"] is True and "known" not in model["3"]["k_rr"]
    assert model["2"]["k_r"]["value"] == 0.1 and model["2"]["k_r"]["known"] is True
    options = json.loads((tmp_path / "out" / "manifest.json").read_text())["options"]
    assert options["known"] == ["I_r=1.0±0.05,k_r=0.1"]
    fit = fit_yaw(logs[:8], known={"I_r": (1.0, 1e-4)})  # as Python says it
    assert fit.preferred.estimates["I_r"].value == pytest.approx(1.0, abs=1e-3)
