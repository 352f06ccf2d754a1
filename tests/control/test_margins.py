"""Margins against python-control, closed forms, and what flights do at their edge."""

from typing import Any

import numpy as np
import pytest
from made_vehicles import vehicle

from automarine_cli.control.design import all_margins, fly, frequencies, margins, stable_along
from automarine_cli.control.targets import TARGETS, get
from automarine_cli.control.targets.base import Gains, NominalPlant, Target
from automarine_cli.dofs import YAW

control: Any = pytest.importorskip("control", reason="the oracle of margins is in the dev group")


def rational(random: np.random.Generator) -> tuple[Any, np.ndarray[Any, Any]]:
    """A loop as vehicles have them: an integrator, two lags, a zero, and a delay as a rational function of high order,
    which is what the oracle can take; and its poles but for those of the delay."""
    gain = np.exp(random.uniform(-2.0, 2.5))
    lags = np.exp(random.uniform(-3.0, 1.0, 2))
    zero, delay = np.exp(random.uniform(-1.0, 1.5)), random.uniform(0.0, 0.3)
    s = control.tf("s")
    loop = gain * (zero * s + 1) / (s * (lags[0] * s + 1) * (lags[1] * s + 1))
    return loop * control.tf(*control.pade(delay, 6)), np.array([0.0, *(-1 / lags)])


@pytest.mark.parametrize("seed", range(2))
def test_margins_are_those_of_python_control(seed: int) -> None:
    random = np.random.default_rng(seed)
    for _ in range(10):
        whole, poles = rational(random)
        omega = frequencies(300.0, 3000)
        found = margins(lambda s, whole=whole: whole(s)[None], omega, poles[None].astype(complex), 0)
        closed = control.feedback(whole, 1).poles()
        good = bool(np.all(closed.real < 0))
        damped = good and bool(np.all(-closed.real > 0.02 * np.abs(closed)))
        if good == damped:  # between the two lies what rings too long to be called stable
            assert bool(found.stable[0]) == good
        if not found.stable[0]:
            assert found.disk[0] == found.gain[0] == found.phase[0] == found.delay[0] == 0.0
            continue
        _, phase, *_ = control.margin(whole)
        disk = control.disk_margins(whole, omega)[0]
        assert found.disk[0] == pytest.approx(disk, rel=2e-3)
        if np.isfinite(phase):
            assert found.phase[0] <= abs(phase) + 0.05
        ups = [size for size in control.stability_margins(whole, returnall=True)[0] if np.isfinite(size)]
        if ups:
            assert found.gain[0] == pytest.approx(min(abs(20 * np.log10(size)) for size in ups), abs=0.05)


def test_a_double_integrator_with_lead_has_the_margins_of_the_closed_form() -> None:
    """L = k (T s + 1)/s²: stable for every k, phase margin atan(T w_c), and no gain that makes it unstable."""
    k, lead = 2.0, 1.5
    omega = frequencies(2000.0, 6000)
    found = margins(lambda s: (k * (lead * s + 1.0) / s**2)[None], omega, np.zeros((1, 2), complex), 0)
    square = 0.5 * (k**2 * lead**2 + np.sqrt(k**4 * lead**4 + 4.0 * k**2))
    crossover = np.sqrt(square)
    assert found.stable[0]
    assert found.phase[0] == pytest.approx(np.rad2deg(np.arctan(lead * crossover)), abs=0.02)
    assert found.delay[0] == pytest.approx(np.arctan(lead * crossover) / crossover, rel=1e-3)
    assert np.isinf(found.gain[0])


def test_a_margin_is_not_told_of_an_unstable_loop() -> None:
    """L = 8/(s + 1)³ is at its edge at 8: beyond, the distance to -1 grows again, and means nothing; and L = k/(s - 1)
    is stable for k above 1 only."""
    omega = frequencies(500.0, 3000)
    for gain, good in ((4.0, True), (6.5, True), (8.6, False), (80.0, False)):
        at_edge = margins(lambda s, k=gain: (k / (s + 1.0) ** 3)[None], omega, -np.ones((1, 3), complex), 0)
        assert bool(at_edge.stable[0]) == (at_edge.disk[0] > 0.0) == good
    for gain, good in ((0.5, False), (2.0, True)):
        ratio = (gain / (omega * (1j - 0.02) - 1.0))[None]
        assert bool(stable_along(ratio, np.ones((1, 1), complex), 0)[0]) == good


def tuned(target: Target) -> Gains:
    """Gains of some target, neither the boldest nor the most careful."""
    nominal = NominalPlant(YAW, 0.59 / 30, 0.15, (30 / 1.5) ** 0.5, np.pi / 2, 30.0, "N m")
    target.beyond = True
    return {key: value[:, None] for key, value in target.propose(np.full((1, target.numbers), 0.5), nominal).items()}


@pytest.mark.slow
@pytest.mark.parametrize("name", TARGETS)
def test_flights_begin_to_swing_where_the_delay_margin_says(name: str) -> None:
    """The stack in time and the stack in frequency are one: a delay just short of the margin dies out, beyond grows."""
    target = get(name)
    own = tuned(target)
    base = vehicle(drag=0.0, linear=0.6)
    omega = frequencies(np.pi / target.period, 2000)
    margin = all_margins(target, own, base, omega).delay[0]
    assert 0.02 < margin < 5.0
    loops = round(max(20.0, (25.0 if target.period < 0.01 else 60.0) * margin) / target.period)
    small = np.full((1, 1, loops), 0.01)  # rad: no limit is met
    sizes = []
    for share in (0.85, 1.15):
        late = vehicle(drag=0.0, linear=0.6, delay=0.05 + share * margin)
        flight = fly(target, own, late, small, np.zeros((1, 1)))
        swing = np.abs(flight.position[0, 0] - flight.position[0, 0, -1])
        third = len(swing) // 3
        sizes.append(np.ptp(flight.position[0, 0, -third:]) / np.ptp(flight.position[0, 0, third : 2 * third]))
        assert np.all(np.isfinite(swing))
    assert sizes[0] < 0.7
    assert sizes[1] > 1.05
