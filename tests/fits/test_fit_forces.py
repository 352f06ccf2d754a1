"""`fit-surge` and `fit-heave`: the truth is in their intervals, mirrored too, and what only translations have."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from identified import identify
from repository import SAMPLE_RUNS
from specified import read_specification

from automarine_cli.commands.fit_motion import FITS
from automarine_cli.dofs import HEAVE, SURGE
from automarine_cli.errors import FitError, SettingError
from automarine_cli.estimate import Estimate
from automarine_cli.fits.identify import YawFit, starts_at_rest
from automarine_cli.models.store import load_yaw_models
from automarine_cli.models.yaw_model import steady_rate
from automarine_cli.runs.half_turn import Trim, half_turns
from automarine_cli.runs.load import load_runs
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import make_batch
from automarine_cli.simulation.rollout import simulate

SURGE_TRUTH = {"m_u": 17.0, "X_uu": 24.0, "half_difference": -3.0}
HEAVE_TRUTH = {"m_w": 26.0, "Z_ww": 45.0, "constant_force": -2.0, "half_difference": 6.0}
LOGS = {"surge": [SAMPLE_RUNS / "surge"], "heave": [SAMPLE_RUNS / "heave"]}


@pytest.fixture(scope="module")
def surge(tmp_path_factory: pytest.TempPathFactory) -> tuple[YawFit, Path]:
    out = tmp_path_factory.mktemp("surge") / "fit"
    return FITS["surge"](LOGS["surge"], within=3.0, out=out), out


@pytest.fixture(scope="module")
def heave(tmp_path_factory: pytest.TempPathFactory) -> tuple[YawFit, Path]:
    out = tmp_path_factory.mktemp("heave") / "fit"
    return FITS["heave"](LOGS["heave"], depths=(0.0, 3.6), out=out), out


def holds(estimate: Estimate, truth: float, precise: float = 0.05) -> bool:
    """Whether the truth is in the 95 % interval, and that is no wider than so much of it (or than 0.5)."""
    low, high = estimate.ci95
    return low <= truth <= high and high - low < max(4.0 * precise * abs(truth), 0.5 if abs(truth) < 5 else 0.0)


def test_surge_is_recovered(surge: tuple[YawFit, Path]) -> None:
    fit, _ = surge
    assert fit.dof is SURGE and fit.preference.number == "3" and len(fit.read) == 20 and fit.warnings == ()
    for name, truth in SURGE_TRUTH.items():
        assert holds(fit.preferred.estimates[name], truth, 0.1), name
    assert fit.seed_method is not None
    assert holds(fit.seed_method.inertia["3"].overall, 17.0)
    assert holds(fit.seed_method.drag["3"].estimates["X_uu"], 24.0)
    assert holds(fit.seed_method.drag["3"].estimates["half_difference"], -3.0, 0.1)
    assert {turn.cut_by for turn in fit.turns} == {"the way allowed"}
    assert max(abs(turn.turned) for turn in fit.turns) < 3.03


def test_heave_is_recovered_with_its_buoyancy(heave: tuple[YawFit, Path]) -> None:
    fit, _ = heave
    assert fit.dof is HEAVE and fit.preference.number == "3" and len(fit.read) == 20
    for name, truth in HEAVE_TRUTH.items():
        assert holds(fit.preferred.estimates[name], truth, 0.1), name
    assert fit.seed_method is not None
    assert holds(fit.seed_method.inertia["3"].overall, 26.0)
    assert holds(fit.seed_method.drag["3"].estimates["constant_force"], -2.0, 0.2)
    assert fit.buoyancy is not None and fit.buoyancy.ballast is not None
    assert fit.buoyancy.ballast.value == pytest.approx(2.0 / 9.81, rel=0.06)
    assert "up: to balance it add 0.2" in fit.buoyancy.says


def test_the_drag_of_each_way_is_that_of_the_truth(surge: tuple[YawFit, Path], heave: tuple[YawFit, Path]) -> None:
    for fit, mass, drag in (
        (surge[0], 17.0, {"ahead": 21.0, "astern": 27.0}),
        (heave[0], 26.0, {"down": 51.0, "up": 39.0}),
    ):
        ways = fit.preferred.ways
        assert ways is not None and ways.differ and ways.p_value < 1e-6
        for way, truth in drag.items():
            assert holds(ways.drag[way], truth), way
            assert holds(ways.distance[way], mass / truth), way


def mirrored(run: Run) -> Run:
    """The run with ahead and astern, down and up, exchanged."""
    return replace(run, position=-run.position, moment=-run.command)


@pytest.mark.parametrize("motion", ["surge", "heave"])
def test_a_mirrored_campaign_has_the_mirrored_vehicle(
    motion: str, surge: tuple[YawFit, Path], heave: tuple[YawFit, Path]
) -> None:
    fit, dof = (surge[0], SURGE) if motion == "surge" else (heave[0], HEAVE)
    runs = [mirrored(run) for run in load_runs(LOGS[motion], dof=dof).runs]
    trim = Trim(3.0) if motion == "surge" else Trim(None, -3.6, 0.0)
    there, here = identify(runs, trim=trim).preferred.estimates, fit.preferred.estimates
    signed = (dof.symbols.constant, dof.symbols.difference)
    for name, one in here.items():
        sign = -1.0 if name in signed else 1.0
        assert there[name].value == pytest.approx(sign * one.value, rel=2e-4, abs=1e-4), name


def test_drag_that_is_the_same_both_ways_is_pooled() -> None:
    """Each way of the same runs mirrored: no difference is left."""
    runs = [run for run in load_runs(LOGS["surge"], dof=SURGE).runs if run.command.max() > 0]
    both = [*runs, *(replace(mirrored(run), name=f"{run.name}_back") for run in runs)]
    fit = identify(both, trim=Trim(3.0)).preferred
    assert fit.ways is not None and not fit.ways.differ and "half_difference" not in fit.estimates
    assert holds(fit.estimates["X_uu"], 21.0)
    assert [term.name for term in fit.model.terms] == ["quadratic-drag"]


def test_the_result_file_is_read_back(surge: tuple[YawFit, Path], heave: tuple[YawFit, Path]) -> None:
    for (fit, out), letters in ((surge, ("m_u", "X_uu")), (heave, ("m_w", "Z_ww"))):
        path = out / f"{fit.dof.name}_model.json"
        data = json.loads(path.read_text(encoding="utf-8"))
        assert data["schema"] == f"automarine/{fit.dof.name}-model/1" and data["motion"] == fit.dof.name
        assert set(letters) <= set(data["models"]["3"]) and data["force_unit"] == "N"
        assert data["models"]["3"][letters[0]]["unit"] == "kg"
        assert data["inertial_distance_m"]["unit"] == "m"
        text = path.read_text(encoding="utf-8")
        assert not any(word in text for word in ("heading", "moment", "_deg", "I_r", "k_r", "yaw"))
        stored = load_yaw_models(path)
        assert stored.dof is fit.dof
        for number, one in fit.output_error.items():
            assert stored.models[number] == one.model
    assert json.loads((heave[1] / "heave_model.json").read_text())["buoyancy"]["ballast_in_water"]["unit"] == "kg"


def test_tables_state_signs_and_speak_of_force(heave: tuple[YawFit, Path]) -> None:
    one, two = ((heave[1] / f"table{i}.md").read_text(encoding="utf-8") for i in (1, 2))
    assert "Down is positive" in one and "Fossen" in one and "negative" in one
    assert "drag down, maximum likelihood" in one and "constant force" in one
    for text in (one, two):
        assert not any(word in text for word in ("yaw", "heading", "moment", "inertia:", "°", "k_r", "I_r"))
    assert {path.name for path in heave[1].iterdir()} >= {"steps.png", "drag.png", "inertia.png", "collapse.png"}


def test_a_held_vehicle_stays_until_its_command_changes() -> None:
    """A vehicle that floats up stands still in the simulation as it does in the log, and moves with the step."""
    runs = load_runs(LOGS["heave"], dof=HEAVE).runs[:4]
    assert all(starts_at_rest(run) for run in runs)
    model = load_model()
    found = simulate(model, make_batch(runs, 0.05)).position[0]
    for run, depth in zip(runs, found):
        first = int(np.flatnonzero(run.command)[0])
        assert np.ptp(depth[:first]) == 0.0
        net = run.command[-1] - 2.0
        assert np.sign(depth[len(run) - 1]) == np.sign(net)
        rate = np.diff(depth[: len(run)])[-1] / np.diff(run.time)[-1]
        way = 6.0 if net > 0 else -6.0
        assert rate == pytest.approx(float(steady_rate(net, 0.0, 45.0 + way)), rel=0.03)


def load_model():  # type: ignore[no-untyped-def]
    return read_specification(SAMPLE_RUNS / "heave.toml").model()


@pytest.mark.slow
def test_a_floating_vehicle_that_drifts_has_a_start_speed_of_its_own() -> None:
    """Let go at the start of the log it already rises when the step comes; whole runs take that."""
    runs = []
    for run in load_runs(LOGS["heave"], dof=HEAVE).runs:
        first = int(np.flatnonzero(run.command)[0])
        runs.append(run.cut(first + 8, len(run)))
    assert not any(starts_at_rest(run) for run in runs)
    fit = identify(runs, "whole-runs").output_error["3"]
    for name, truth in HEAVE_TRUTH.items():
        assert holds(fit.estimates[name], truth, 0.2), name


def test_a_depth_window_ends_a_step_where_it_ends() -> None:
    runs = load_runs(LOGS["heave"], dof=HEAVE).runs
    turns, _ = half_turns(runs, Trim(None, 1.0, 2.4))
    assert turns == ()  # they begin outside
    turns, _ = half_turns(runs, Trim(None, 0.0, 2.4))
    assert turns and all(turn.position.max() < 2.45 for turn in turns)
    assert {turn.cut_by for turn in turns} == {"the window"}


def test_options_that_make_no_sense_are_refused() -> None:
    with pytest.raises(SettingError, match="smaller one first"):
        FITS["heave"](LOGS["heave"], depths=(3.0, 1.0))
    with pytest.raises(SettingError, match="not in the range x>0"):
        FITS["surge"](LOGS["surge"], within=0.0)


def test_a_tail_that_is_asked_for_is_metres_from_the_start() -> None:
    fit = FITS["surge"](LOGS["surge"], within=3.0, tail=1.5)
    entry = fit.to_json()["models"]["3"]["velocity_error"]  # type: ignore[index]
    assert entry["tail_from_cm"] == pytest.approx(150.0)
    assert entry["tail_because"].startswith("Tails start at 150 cm, as asked; errors to be expected there: ")
    assert set(entry["tail_expected"]) == {"m_u", "drag", "dilution"}
    with pytest.raises(FitError, match=r"the tails are to start at 290 cm, but X_\S+ ends at 2\d\d cm; let them"):
        FITS["surge"](LOGS["surge"], within=3.0, tail=2.9)


def test_results_show_themselves_in_the_words_of_their_motion(surge: tuple[YawFit, Path]) -> None:
    said = repr(surge[0])
    assert said.startswith("Table 1. Identified surge models: drag")
    assert "X_u|u|" in said and "m_u/X_u|u|" in said and "distance noise 1.0" in said
    frame = surge[0].to_frame()
    assert {"m_u", "X_uu", "half_difference"} <= set(frame["parameter"])
