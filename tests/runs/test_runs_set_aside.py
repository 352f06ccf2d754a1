"""Runs that stood still or went against their moment where others moved, and runs moved by what their log does not
hold, are set aside; runs that drift, coast or stand are kept; both ways alike."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from identified import identify
from made_runs import mirrored, step_run, written
from made_sequences import model_file
from repository import DATA

from automarine_cli.commands import automarine
from automarine_cli.dofs import DOFS, YAW, Dof
from automarine_cli.errors import RunError
from automarine_cli.runs.checks import undriven, without_stuck, without_undriven
from automarine_cli.runs.half_turn import without_contrary
from automarine_cli.runs.load import load_runs
from automarine_cli.runs.run import Run

REAL = DATA / "yaw" / "not_connected"
UNLOGGED = "something that this log does not hold moved it"
CLOCK = np.arange(0.0, 120.0, 0.1)
PACE = {"yaw": 0.3, "surge": 0.4, "sway": 0.4, "heave": 0.3}  # rad/s or m/s of somebody who steers
PILOT = [(10, 14, 1.0), (25, 29, -1.5), (45, 50, 1.2), (70, 74, -1.0), (90, 96, 1.0)]  # s, s, pace


def moved(rate: np.ndarray, dof: Dof = YAW, noise: float = 0.005, moment: np.ndarray | None = None) -> Run:
    """A run that goes at `rate` [rad/s or m/s] under no command, or `moment`."""
    position = np.cumsum(rate) * 0.1 + noise * np.random.default_rng(1).standard_normal(len(rate))
    commands = np.zeros(len(rate)) if moment is None else moment
    return Run("run", "run.csv", CLOCK[: len(rate)], position, commands, dof.units.forces[0], dof=dof)


def steered(size: float) -> np.ndarray:
    """Rates of turns and moves that a pilot makes and stops again, drag within a second."""
    wanted = np.zeros_like(CLOCK)
    for begin, end, pace in PILOT:
        wanted[10 * begin : 10 * end] = pace * size
    rate = np.zeros_like(wanted)
    for i in range(1, len(rate)):
        rate[i] = rate[i - 1] + 0.1 * (wanted[i] - rate[i - 1])
    return rate


def both_ways(run: Run) -> list[Run]:
    return [run, replace(run, position=-run.position, moment=-run.command)]


STEERED = [dof for dof in DOFS.values() if not dof.restoring]  # what swings gathers speed by itself


@pytest.mark.parametrize("dof", STEERED, ids=lambda dof: dof.name)
def test_what_is_steered_from_elsewhere_is_told_by_its_motion(dof: Dof) -> None:
    for run in both_ways(moved(steered(PACE[dof.name]), dof)):
        why = undriven(run) or ""
        assert why.startswith(f"the {dof.words.force} commanded is 0 in 100 % of the log")
        parts = (f"{dof.words.moved} over", "gathered speed 5 times", f"{dof.units.shown}/s", UNLOGGED, "--columns")
        assert [part for part in parts if part not in why] == []


def test_turns_that_were_commanded_are_kept() -> None:
    rate = steered(0.3)
    moment = np.gradient(rate, 0.1) + rate
    moment[np.abs(moment) < 1e-3] = 0.0
    assert np.mean(moment == 0) > 0.3  # as in joystick driving
    for run in both_ways(moved(rate, moment=moment)):
        assert undriven(run) is None


QUIET = {
    "rest": 0.0 * CLOCK,
    "a steady current": np.full_like(CLOCK, np.radians(3.0)),
    "a slow current that meanders": np.radians(4.0) * np.sin(2 * np.pi * CLOCK / 40.0),
    "waves": np.radians(20.0) * np.sin(2 * np.pi * CLOCK / 4.0),
    "a coast-down": np.radians(60.0) * np.exp(-CLOCK / 15.0),
    "a hand that turns it once": np.where((CLOCK > 30) & (CLOCK < 40), np.radians(30.0), 0.0),
}


@pytest.mark.parametrize("rate", QUIET.values(), ids=QUIET)
@pytest.mark.parametrize("noise_deg", [0.05, 2.0])
def test_what_drifts_coasts_or_stands_is_kept(rate: np.ndarray, noise_deg: float) -> None:
    for run in both_ways(moved(rate, noise=np.radians(noise_deg))):
        assert undriven(run) is None


def test_a_constant_force_that_takes_it_one_way_is_no_pilot() -> None:
    """A buoyant vehicle that is pulled down slowly and let go, again and again."""
    rate = np.where(CLOCK % 30.0 < 5.0, -0.3, 0.02)
    for run in both_ways(moved(rate, DOFS["heave"])):
        assert undriven(run) is None
    for run in both_ways(moved(rate, DOFS["surge"])):  # nothing pushes it ahead by itself
        assert undriven(run) is not None


def test_such_a_run_is_set_aside_beside_others_and_all_are_refused() -> None:
    """As one is that stood still; neither spoils a fit of whole runs."""
    strange = replace(moved(steered(0.3)), name="strange")
    good = [replace(step_run(m, seed=i), name=f"r{i}") for i, m in enumerate((-1.0, -0.6, -0.3, 0.3, 0.6, 1.0))]
    stuck = still(0.6, "stuck", seed=9)
    for kind, aside in (("half-turns", ["strange"]), ("whole-runs", ["strange", "stuck"])):
        fit = identify([*good, strange, *([stuck] if "stuck" in aside else [])], fit_to=kind)
        assert sorted(run.run for run in fit.set_aside) == aside
        assert any(UNLOGGED in run.why for run in fit.set_aside)
    assert fit.preferred.gain_scatter.value < 0.05
    assert without_undriven([*good, strange])[0] == good
    with pytest.raises(RunError, match=r"none of 1 run can be fitted.*strange: the moment commanded is 0 in 100 %"):
        identify([strange])


def answer(*arguments: object) -> str:
    result = CliRunner().invoke(automarine, [str(argument) for argument in arguments])
    assert result.exit_code == 1 and isinstance(result.exception, SystemExit), result.output
    return result.stderr


def test_every_command_refuses_it(tmp_path: Path) -> None:
    model = model_file(tmp_path / "model.json")
    for i, run in enumerate(both_ways(moved(steered(0.3)))):
        log = written(run, tmp_path / f"steered_{i}.csv")
        for arguments in (("fit-yaw",), ("validate", "--model", model), ("diagnose", "--model", model)):
            assert UNLOGGED in answer(*arguments, log)


@pytest.mark.real_data(REAL)
@pytest.mark.parametrize("dof", STEERED, ids=lambda dof: dof.name)
def test_a_real_vehicle_steered_from_another_console(dof: Dof) -> None:
    (run,) = load_runs([REAL], dof=dof).runs
    assert all(undriven(side) is not None for side in both_ways(run))
    assert f"the {dof.words.force} commanded is 0 in 100 % of the log" in answer(f"fit-{dof.name}", REAL)


@pytest.mark.real_data(REAL)
@pytest.mark.parametrize("folder", ["heavy_rov_sea", "minerva_hil_simulated", "cybership_enterprise"])
@pytest.mark.parametrize("name", ["yaw", "surge", "sway"])
def test_real_vehicles_that_were_driven_are_kept(folder: str, name: str) -> None:
    runs = load_runs([str(DATA / "yaw" / folder / "run_*.csv")], dof=DOFS[name]).runs
    assert [undriven(run) for run in runs] == [None] * len(runs)


def mirrored_too(runs: list[Run]) -> list[list[Run]]:
    return [runs, [replace(mirrored(run), name=run.name) for run in runs]]


def still(moment: float, name: str, seed: int = 0) -> Run:
    """A run whose thrusters did not start: noise about one heading."""
    made = step_run(moment, seed=seed)
    noise = np.radians(1.0) * np.random.default_rng(seed).normal(size=len(made))
    return replace(made, position=0.7 + noise, name=name)


def named(run: Run, name: str) -> Run:
    return replace(run, name=name)


def test_a_run_that_others_outdo_with_less_is_stuck() -> None:
    campaign = [named(step_run(0.5), "moved"), still(0.5, "as much"), still(0.8, "more"), still(0.3, "less")]
    for runs, moment in zip(mirrored_too(campaign), ("0.5", "-0.5")):
        moving, aside = without_stuck(runs)
        assert [run.name for run in moving] == ["moved", "less"]  # 0.3 may lie within a dead band
        assert [run.run for run in aside] == ["as much", "more"]
        assert all("though run moved did under no more; check thrusters" in run.why for run in aside)
        assert f"a moment of {moment} nu" in aside[0].why


def test_a_vehicle_that_holds_its_heading_is_not_stuck() -> None:
    held = still(0.5, "held")
    driven = np.where(np.arange(len(held)) % 7 < 3, 0.5, -0.4)
    moving, aside = without_stuck([replace(held, moment=driven), named(step_run(0.3), "moved")])
    assert len(moving) == 2 and aside == ()


def contrary(run: Run) -> Run:
    """The run with its headings mirrored, not its moment: the log's sign is wrong."""
    return replace(run, position=-run.position, name="contrary")


def test_a_run_that_went_against_its_moment_where_others_went_with_as_little_is_set_aside() -> None:
    others = [named(step_run(0.3), "small"), named(step_run(0.5), "same"), named(mirrored(step_run(0.2)), "back")]
    for runs in mirrored_too([*others, contrary(step_run(0.5, seed=3))]):
        sound, aside = without_contrary(runs)
        assert [run.name for run in sound] == ["small", "same", "back"]
        assert [run.run for run in aside] == ["contrary"]
        assert aside[0].why.startswith("units look wrong: the step of") and "sign = -1" in aside[0].why


@pytest.mark.parametrize(
    "others",
    [
        [step_run(0.7), step_run(0.9)],  # less moment may be turned round by a moment that is always there
        [mirrored(step_run(0.5)), mirrored(step_run(0.3))],  # which is on the other side's steps as well
        [step_run(0.5)],  # one against one: who is to say which?
        [],
    ],
)
def test_a_run_that_went_against_its_moment_is_kept_where_the_vehicle_may_have_done_it(others: list[Run]) -> None:
    for runs in mirrored_too([contrary(step_run(0.5)), *others]):
        assert without_contrary(runs) == (runs, ())
