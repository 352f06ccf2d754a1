"""How far loops are from oscillating: disk, gain, phase and delay margin on a grid of frequencies, delays exact.

A formula for margins is satisfied by loops that are unstable already: what is unstable is found first, by counting how
often 1 + L goes round the origin along a line slightly to the left of the imaginary axis (Nyquist's criterion, which
thus calls what rings on and on unstable too), and has no margin.

Sources: Seiler, Packard and Gahinet (2020), An introduction to disk margins, IEEE Control Systems 40(5):78; Nyquist
(1932), Bell System Technical Journal 11:126.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from automarine_cli.quantities import Complexes, Floats

Loop = Callable[[Complexes], Complexes]
TILT = 0.02
"""Damping ratio below which a closed loop counts as unstable."""
LOWEST = 1e-4
"""Frequency [rad/s] below which a pole counts as an integrator."""


@dataclass(frozen=True)
class Margins:
    """Of S loops, (S,) each: `disk` (balanced, the diameter alpha), `gain` [dB], the smaller way, `phase` [deg],
    `delay` [s], and `stable`; zero where a loop is not."""

    disk: Floats
    gain: Floats
    phase: Floats
    delay: Floats
    stable: NDArray[np.bool_]


def frequencies(highest: float, count: int, lowest: float = LOWEST) -> Floats:
    """Frequencies [rad/s] up to `highest`, denser where loops cross over."""
    few = max(count // 6, 8)
    start = highest * 1e-4
    if lowest >= start:
        return np.geomspace(lowest, highest, count)
    return np.concatenate([np.geomspace(lowest, start, few, endpoint=False), np.geomspace(start, highest, count - few)])


def stable_along(ratio: Complexes, poles: Complexes, integrators: int) -> NDArray[np.bool_]:
    """Which of S closed loops are stable, by L (S, W) at frequencies times (1j - TILT).

    `poles` (S or 1, n) are those of the vehicle, `integrators` how many the controller adds.
    """
    curve = 1.0 + ratio
    turned = np.sum(np.angle(curve[:, 1:] / curve[:, :-1]), axis=1)
    origin = np.abs(poles) < LOWEST
    ahead = (np.abs(np.angle(poles)) < np.pi / 2 + np.arctan(TILT)) & ~origin
    count = integrators + origin.sum(axis=1)
    expected = count * (np.pi / 2 + np.arctan(TILT)) + np.pi * ahead.sum(axis=1)
    right = np.round((expected - turned) / np.pi)
    return np.asarray((right == 0) & (np.abs(ratio[:, -1]) < 1.0) & np.all(np.isfinite(ratio), axis=1))


def disk_margin(ratio: Complexes) -> Floats:
    """2 / max |S - T| of loops L (S, W), (S,)."""
    return np.asarray(2.0 / np.max(np.abs((1.0 - ratio) / (1.0 + ratio)), axis=1))


def margins(loop: Loop, omega: Floats, poles: Complexes, integrators: int) -> Margins:
    """All margins of S loops, where `loop` gives L (S, W) at s (W,); see `stable_along` for the rest."""
    good = stable_along(loop(omega * (1j - TILT)), poles, integrators)
    ratio = loop(1j * omega)
    disk, gain = disk_margin(ratio), _gain_margin(ratio)
    phase, delay = _phase_margin(ratio, omega)
    disk, gain, phase, delay = (np.where(good, one, 0.0) for one in (disk, gain, phase, delay))
    return Margins(disk, gain, phase, delay, good)


def _gain_margin(ratio: Complexes) -> Floats:
    """Smallest change of gain, up or down [dB], that brings a loop to -1."""
    side, real = ratio.imag, ratio.real
    crosses = side[:, 1:] * side[:, :-1] < 0
    share = np.where(crosses, side[:, :-1] / np.where(crosses, side[:, :-1] - side[:, 1:], 1.0), 0.0)
    at = real[:, :-1] + share * (real[:, 1:] - real[:, :-1])
    with np.errstate(divide="ignore"):
        size = np.where(crosses & (at < 0), np.abs(20.0 * np.log10(np.abs(np.where(at < 0, at, 1.0)))), np.inf)
    return np.asarray(np.min(size, axis=1))


def _phase_margin(ratio: Complexes, omega: Floats) -> tuple[Floats, Floats]:
    """Smallest phase [deg], and smallest delay [s], that brings a loop to -1."""
    size, turn = np.log(np.maximum(np.abs(ratio), np.finfo(float).tiny)), np.unwrap(np.angle(ratio), axis=1)
    crosses = size[:, 1:] * size[:, :-1] < 0
    share = np.where(crosses, size[:, :-1] / np.where(crosses, size[:, :-1] - size[:, 1:], 1.0), 0.0)
    angle = turn[:, :-1] + share * np.diff(turn, axis=1) + np.pi
    at = np.exp(np.log(omega[:-1]) + share * np.diff(np.log(omega)))
    both = np.abs((angle + np.pi) % (2.0 * np.pi) - np.pi)
    phase = np.where(crosses, both, np.inf)
    delay = np.where(crosses, (angle % (2.0 * np.pi)) / at, np.inf)
    return np.rad2deg(np.min(phase, axis=1)), np.asarray(np.min(delay, axis=1))
