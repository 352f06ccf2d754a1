"""`fit-surge` and `fit-heave`: the truth is in their intervals, mirrored too, and what only translations have."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from identified import identify
from made_driven import turned
from repository import SAMPLE_RUNS

from automarine_cli.commands.fit_motion import FITS
from automarine_cli.dofs import DOFS, HEAVE, SURGE
from automarine_cli.errors import FitError, SettingError
from automarine_cli.estimate import Estimate
from automarine_cli.fits.identify import YawFit
from automarine_cli.fits.whole_runs import directional_drag
from automarine_cli.runs.half_turn import Trim, start_at_rest
from automarine_cli.runs.load import load_runs

TRUTH = {
    "surge": {"m_u": 17.0, "X_uu": 24.0, "half_difference": -3.0},
    "heave": {"m_w": 26.0, "Z_ww": 45.0, "constant_force": -2.0, "half_difference": 6.0},
}
EACH_WAY = {"surge": {"ahead": 21.0, "astern": 27.0}, "heave": {"down": 51.0, "up": 39.0}}
LOGS = {motion: [SAMPLE_RUNS / motion] for motion in TRUTH}
Fits = dict[str, tuple[YawFit, Path]]
MOTIONS = pytest.mark.parametrize("motion", TRUTH)


@pytest.fixture(scope="module")
def fits(tmp_path_factory: pytest.TempPathFactory) -> Fits:
    """Fit and folder of results of both campaigns."""
    out = tmp_path_factory.mktemp("forces")
    return {
        "surge": (FITS["surge"](LOGS["surge"], within=3.0, out=out / "surge"), out / "surge"),
        "heave": (FITS["heave"](LOGS["heave"], depths=(0.0, 3.6), out=out / "heave"), out / "heave"),
    }


def holds(estimate: Estimate, truth: float, precise: float = 0.05) -> bool:
    """Whether the truth is in the 99 % interval, and that of 95 % is no wider than so much of it (or than 0.5)."""
    low, high = estimate.ci95
    wide = max(4.0 * precise * abs(truth), 0.5 if abs(truth) < 5 else 0.0)
    return abs(estimate.value - truth) <= 1.31 * 0.5 * (high - low) and high - low < wide


@MOTIONS
def test_the_truth_is_recovered_and_the_drag_of_each_way(fits: Fits, motion: str) -> None:
    fit, _ = fits[motion]
    assert fit.dof is DOFS[motion] and fit.preference.number == "3" and len(fit.used_runs) == 20
    mass, *drag = TRUTH[motion]
    for name, truth in TRUTH[motion].items():
        assert holds(fit.preferred.estimates[name], truth, 0.1), name
    assert fit.velocity_error_fit is not None
    assert holds(fit.velocity_error_fit.inertia["3"].overall, TRUTH[motion][mass])
    if motion == "surge":
        assert fit.warnings == () and {turn.cut_by for turn in fit.turns} == {"the way allowed"}
        assert max(abs(turn.turned) for turn in fit.turns) < 3.03
        assert max(np.ptp(turn.step.run.position[: turn.ends]) for turn in fit.turns) < 3.1
    for name in drag if motion == "surge" else ["constant_force"]:
        precise = {"constant_force": 0.2, "half_difference": 0.1}.get(name, 0.05)
        assert holds(fit.velocity_error_fit.drag["3"].estimates[name], TRUTH[motion][name], precise), name
    ways = fit.preferred.ways
    assert ways is not None and ways.differ and ways.p_value < 1e-6
    for way, truth in EACH_WAY[motion].items():
        assert holds(ways.drag[way], truth), way
        assert holds(ways.distance[way], TRUTH[motion][mass] / truth), way


@MOTIONS
def test_the_drag_of_each_way_does_not_depend_on_the_scale_of_the_search(fits: Fits, motion: str) -> None:
    """Driven fits search drags by themselves, steps on the logarithm; intervals were wider there by the drag itself."""
    fit = fits[motion][0].preferred
    mixed, i = fit.mixed, list(fit.estimates).index(fit.model.dof.parameters["quadratic"])
    entries = tuple(replace(entry, log=entry.log and k != i) for k, entry in enumerate(mixed.parameters))
    change = np.ones(len(mixed.theta))
    change[i] = mixed.theta[i]
    information = mixed.information / np.outer(change, change)
    plain = replace(mixed, parameters=replace(mixed.parameters, entries=entries), information=information)
    ways = directional_drag(replace(fit, mixed=plain, covariance=fit.covariance * np.outer(change, change)))
    assert fit.ways is not None and mixed.parameters.log[i] and ways.p_value == pytest.approx(fit.ways.p_value)
    for of, before in ((ways.drag, fit.ways.drag), (ways.distance, fit.ways.distance)):
        assert [*of] == [*before] and all(of[way].ci95 == pytest.approx(before[way].ci95) for way in of)


@MOTIONS
def test_a_mirrored_campaign_has_the_mirrored_vehicle(fits: Fits, motion: str) -> None:
    dof, here = DOFS[motion], fits[motion][0].preferred.estimates
    runs = [turned(run) for run in load_runs(LOGS[motion], dof=dof).runs]
    trim = Trim(3.0) if motion == "surge" else Trim(None, -3.6, 0.0)
    there = identify(runs, trim=trim).preferred.estimates
    for name, estimate in here.items():
        sign = -1.0 if name in (dof.symbols.constant, dof.symbols.difference) else 1.0
        assert there[name].value == pytest.approx(sign * estimate.value, rel=2e-4, abs=1e-4), name


def test_drag_that_is_the_same_both_ways_is_pooled() -> None:
    """Each way of the same runs mirrored: no difference is left."""
    runs = [run for run in load_runs(LOGS["surge"], dof=SURGE).runs if run.command.max() > 0]
    both = [*runs, *(replace(turned(run), name=f"{run.name}_back") for run in runs)]
    fit = identify(both, trim=Trim(3.0)).preferred
    assert fit.ways is not None and not fit.ways.differ and "half_difference" not in fit.estimates
    assert holds(fit.estimates["X_uu"], 21.0)
    assert [term.name for term in fit.model.terms] == ["quadratic-drag"]


@pytest.mark.slow
def test_whole_runs_forecast_from_the_moment_at_which_the_vehicle_is_let_go() -> None:
    """Before, it is held against its buoyancy, which a filter would take for thrust and rate: 31 cm after 5 s."""
    use = FITS["heave"](LOGS["heave"], fit_to="whole-runs").use
    assert use is not None
    (ahead,) = (score for score in use.worth["depth"] if score.horizon == 5.0)
    assert ahead.error < 0.03  # m, with a noise of 0.01


@pytest.mark.slow
def test_a_floating_vehicle_that_drifts_has_a_start_speed_of_its_own() -> None:
    """Let go at the start of the log it already rises when the step comes; whole runs take that."""
    runs = []
    for run in load_runs(LOGS["heave"], dof=HEAVE).runs:
        first = int(np.flatnonzero(run.command)[0])
        runs.append(run.cut(first + 8, len(run)))
    assert not start_at_rest(runs).any()
    fit = identify(runs, "whole-runs").output_error["3"]
    for name, truth in TRUTH["heave"].items():
        assert holds(fit.estimates[name], truth, 0.2), name


def test_options_that_make_no_sense_are_refused() -> None:
    with pytest.raises(SettingError, match="smaller one first"):
        FITS["heave"](LOGS["heave"], depths=(3.0, 1.0))
    with pytest.raises(SettingError, match="not in the range x>0"):
        FITS["surge"](LOGS["surge"], within=0.0)
    with pytest.raises(FitError, match=r"the tails are to start at 290 cm, but X_\S+ ends at 2\d\d cm; let them"):
        FITS["surge"](LOGS["surge"], within=3.0, tail=2.9)
