"""Limits in metres: what vehicles do passes as it is, what none does is told, at any rate and size of vehicle."""

import numpy as np
import pytest
from numpy.typing import NDArray

from automarine_cli.dofs import DOFS, SURGE, Dof
from automarine_cli.logs import LogTable
from automarine_cli.runs.checks import position_trouble
from automarine_cli.runs.load import clean, find_glitches, find_jumps
from automarine_cli.runs.run import Run

Floats = NDArray[np.float64]

RATES, NOISES = (2.0, 10.0, 50.0), (0.01, 0.03, 0.1)
VEHICLES = {"small ROV": (0.4, 0.5), "ROV": (1.0, 1.5), "boat": (10.0, 3.0)}  # m/s, m/s²
TRANSLATIONS = [dof for dof in DOFS.values() if not dof.wraps]


def driven(speed: float, acceleration: float, rate: float, noise: float, seed: int) -> tuple[Floats, Floats, Floats]:
    """Clock, position [m] and command of a vehicle that starts from rest, stops, and comes back, for a minute."""
    time = np.arange(0.0, 60.0, 1 / rate)
    command = np.where(time < 5, 0.0, np.where(time < 30, 1.0, np.where(time < 40, 0.0, -1.0)))
    lag, velocity = speed / acceleration, np.zeros(len(time))
    for i in range(1, len(time)):
        velocity[i] = velocity[i - 1] + (speed * command[i] - velocity[i - 1]) / (lag * rate)
    way = np.cumsum(velocity) / rate
    return time, way + noise * np.random.default_rng(seed).standard_normal(len(time)), command


@pytest.mark.parametrize("vehicle", VEHICLES)
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("noise", NOISES)
def test_what_vehicles_do_is_no_glitch_no_jump_and_no_wrong_unit(vehicle: str, rate: float, noise: float) -> None:
    for seed in range(10):
        time, position, _ = driven(*VEHICLES[vehicle], rate, noise, seed)
        assert position_trouble(time, position, SURGE) is None
        assert not find_glitches(time, position, SURGE).any()
        assert not len(find_jumps(time, position, SURGE))


@pytest.mark.parametrize("vehicle", VEHICLES)
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("noise", NOISES)
def test_what_none_does_is_found(vehicle: str, rate: float, noise: float) -> None:
    """A spike of ten times the noise and twice what the vehicle moves between samples, and a jump much larger."""
    speed, acceleration = VEHICLES[vehicle]
    time, position, _ = driven(speed, acceleration, rate, noise, 1)
    at = int(np.searchsorted(time, 22.0))  # in steady motion
    size = 12 * noise + 2.5 * speed / rate
    spiked = position.copy()
    spiked[at] += size
    assert np.flatnonzero(find_glitches(time, spiked, SURGE)).tolist() == [at]
    jumped = position.copy()
    jumped[at:] += 60 * noise + 8 * speed / rate + SURGE.limits.acceleration / rate**2
    assert find_jumps(time, jumped, SURGE).tolist() == [at - 1]


@pytest.mark.parametrize("dof", TRANSLATIONS, ids=lambda dof: dof.name)
@pytest.mark.parametrize(("unit", "factor"), [("cm", 100.0), ("mm", 1000.0)])
@pytest.mark.parametrize("vehicle", VEHICLES)
def test_centimetres_and_millimetres_are_told(vehicle: str, unit: str, factor: float, dof: Dof) -> None:
    time, position, _ = driven(*VEHICLES[vehicle], 10.0, 0.01, 2)
    why = position_trouble(time, factor * position, dof)
    assert why is not None and why.startswith("units look wrong: ")
    assert why.endswith(f'such as {dof.position}_m = {{ from = "{dof.position}", unit = "mm" }}')


def test_where_a_way_is_measured_from_does_not_matter() -> None:
    """Eastings of half a million metres are ways like others; what a sensor says instead of nothing is dropped."""
    time, position, command = driven(0.4, 0.5, 10.0, 0.01, 3)
    (near,) = cleaned(time, position, command)
    (far,) = cleaned(time, 5e5 + position, command)
    np.testing.assert_allclose(far.position - 5e5, near.position, atol=1e-6)
    lost = 5e5 + position
    lost[50:60] = 65535.0
    (found,) = cleaned(time, lost, command)
    assert found.counts["glitches"] == 10 and len(found) == len(time) - 10


def cleaned(time: Floats, position: Floats, command: Floats) -> tuple[Run, ...]:
    columns = {"time": time, SURGE.position: position, SURGE.command: command}
    table = LogTable("log.csv", columns, np.arange(1, len(time) + 1), units={SURGE.command: "N"}, dof=SURGE)
    return clean(table, np.arange(len(time)), "run")
