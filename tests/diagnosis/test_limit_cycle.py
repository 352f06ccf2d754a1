"""Limit cycles of controllers: found where a loop with a delay swings by itself, and not where it follows setpoints."""

import numpy as np
import pytest

from automarine_cli.diagnosis.study import limit_cycle
from automarine_cli.dofs import YAW
from automarine_cli.runs.run import Run

STEP = 0.05


def relay_loop(sign: float, late: float, seed: int, waves: float = 0.0, relay: bool = True) -> Run:
    """A bang-bang (or, without `relay`, a soft PD) controller round an inertia with linear drag and a dead time [s]."""
    random = np.random.default_rng(seed)
    count, delay = int(90.0 / STEP), int(late / STEP)
    heading, rate, command = np.zeros(count), 0.0, np.zeros(count)
    for k in range(1, count):
        acting = command[k - 1 - delay] if k - 1 >= delay else 0.0
        push = waves * np.sin(2.0 * np.pi * k * STEP / 4.0 + seed)
        rate += STEP * (acting + push - 0.8 * rate)
        heading[k] = heading[k - 1] + STEP * rate
        setpoint = 0.5 * sign * ((k * STEP // 20.0) % 2)
        error = setpoint - heading[k] - 0.002 * random.standard_normal()
        wanted = error - 0.4 * rate
        command[k] = sign * np.sign(sign * wanted) if relay else 0.6 * wanted
    time = STEP * np.arange(count)
    every = slice(None, None, 2)
    return Run(f"run_{seed}", "loop", time[every], heading[every], command[every], "nu", dof=YAW)


@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["starboard", "port"])
def test_a_relay_with_a_dead_time_swings(sign: float) -> None:
    cycle = limit_cycle([relay_loop(sign, 0.4, seed) for seed in range(4)])
    assert cycle is not None
    heading = relay_loop(sign, 0.4, 0).position[500:]
    swings = np.flatnonzero(np.diff(np.sign(np.gradient(heading))))
    period = 2.0 * 2.0 * STEP * float(np.median(np.diff(swings)))
    assert cycle.period == pytest.approx(period, rel=0.15)
    assert cycle.holds(period) and not cycle.holds(2.0 * period)
    assert 0.5 * np.pi < cycle.phase < 1.5 * np.pi  # an inertia and a dead time behind the command
    assert "a limit cycle of the controller" in cycle.sentence(YAW)


def test_mirrored_loops_have_the_same_cycle() -> None:
    found = [limit_cycle([relay_loop(sign, 0.4, seed) for seed in range(4)]) for sign in (1.0, -1.0)]
    assert found[0] is not None and found[1] is not None
    assert found[0].period == pytest.approx(found[1].period, rel=0.1)


def test_a_quiet_loop_that_follows_its_setpoint_has_none() -> None:
    assert limit_cycle([relay_loop(1.0, 0.0, seed, relay=False) for seed in range(4)]) is None


def test_runs_too_short_for_a_spectrum_have_none() -> None:
    run = relay_loop(1.0, 0.4, 0)
    assert limit_cycle([run.cut(0, 100)]) is None
