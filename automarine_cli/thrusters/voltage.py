"""How thrust grows with the supply voltage: at a fixed control signal, and in the square law's a."""

from dataclasses import dataclass

import numpy as np

from automarine_cli.estimate import Estimate
from automarine_cli.quantities import Floats
from automarine_cli.thrusters.bollard_data import levels_of
from automarine_cli.thrusters.fit import Side
from automarine_cli.thrusters.forms import SIDES

PLACES = 20
FAINT = 0.02  # thrust below this share of full scale is too near the dead band for a logarithm


@dataclass(frozen=True)
class VoltageExponent:
    """p of F ~ V^p in one direction at fixed n: overall, between neighbouring steps, by n; drift of a."""

    exponent: Estimate | None
    between: tuple[tuple[float, float, float], ...]
    places: tuple[tuple[float, float], ...]
    coefficient: Estimate | None
    drift_percent: float

    def to_json(self) -> dict[str, object]:
        """Plain data: exponents, and the drift of a from the lowest to the highest voltage."""
        return {
            "thrust_at_fixed_n": None if self.exponent is None else self.exponent.to_json(),
            "between": [{"from_V": low, "to_V": high, "exponent": value} for low, high, value in self.between],
            "at_n": [{"n": n, "exponent": value} for n, value in self.places],
            "a": None if self.coefficient is None else self.coefficient.to_json(),
            "a_drift_percent": self.drift_percent,
        }


def voltage_exponents(
    voltages: Floats, steps: list[dict[str, Side]], laws: list[dict[str, float]]
) -> dict[str, VoltageExponent | None]:
    """Exponents in both directions from the sides and square-law coefficients of each step, V rising."""
    return {
        name: _direction(voltages, [step.get(name) for step in steps], [law.get(name) for law in laws])
        for name, _ in SIDES
    }


def _direction(voltages: Floats, sides: list[Side | None], laws: list[float | None]) -> VoltageExponent | None:
    if len(sides) < 2 or any(side is None for side in sides) or any(not law or law <= 0 for law in laws):
        return None
    present = [side for side in sides if side is not None]
    coefficients = np.array(laws, dtype=float)
    log_v = np.log(voltages)
    places = _places(present)
    table = np.array([_at(side, places) for side in present])  # (steps, places)
    full = max(float(np.max(side.thrust)) for side in present)
    clear = np.all(table > FAINT * full, axis=0)
    drift = 100.0 * (float(coefficients[-1] / coefficients[0]) - 1.0)
    a_slope = _slope(log_v, np.log(coefficients)[:, None])
    if np.count_nonzero(clear) < 2:
        return VoltageExponent(None, (), (), a_slope, drift)
    logs = np.log(table[:, clear])
    between = np.diff(logs.mean(axis=1)) / np.diff(log_v)
    pairs = tuple((float(low), float(high), float(p)) for low, high, p in zip(voltages, voltages[1:], between))
    centred = log_v - log_v.mean()
    each = centred @ logs / (centred @ centred)
    at_n = tuple((float(n), float(p)) for n, p in zip(places[clear], each))
    return VoltageExponent(_slope(log_v, logs), pairs, at_n, a_slope, drift)


def _places(sides: list[Side]) -> Floats:
    """Commands |n| to compare at: those measured at every voltage, else evenly over the range they share."""
    everything = np.concatenate([side.magnitude for side in sides])
    owner = np.repeat(np.arange(len(sides)), [len(side.magnitude) for side in sides])
    level = levels_of(everything)
    shared = [number for number in np.unique(level) if len(np.unique(owner[level == number])) == len(sides)]
    # A measured speed meets itself by chance; a command is met nearly everywhere.
    if len(shared) >= max(2, 0.5 * len(np.unique(level))):
        return np.array([np.median(everything[level == number]) for number in shared])
    low, high = max(side.magnitude.min() for side in sides), min(side.magnitude.max() for side in sides)
    return np.linspace(low, high, PLACES) if high > low else np.empty(0)


def _at(side: Side, places: Floats) -> Floats:
    """Thrust [N] of one voltage at |n|, repeats averaged, straight lines between levels."""
    level = levels_of(side.magnitude)
    numbers = np.unique(level)
    n = np.array([np.mean(side.magnitude[level == number]) for number in numbers])
    force = np.array(
        [np.average(side.thrust[level == number], weights=side.weight[level == number]) for number in numbers]
    )
    return np.interp(places, n, force)


def _slope(x: Floats, y: Floats) -> Estimate | None:
    """Slope of y, shape (steps, places), on x, shape (steps,), each place with its own level.

    The voltage step is the unit: what moves one step moves all its places. With two steps only, the spread
    over places.
    """
    centred = x - x.mean()
    slopes = centred @ y / (centred @ centred)
    value = float(slopes.mean())
    if len(x) >= 3:
        mean = y.mean(axis=1)
        rest = mean - mean.mean() - value * centred
        stderr = float(np.sqrt(rest @ rest / (len(x) - 2) / (centred @ centred)))
        return Estimate.from_stderr(value, stderr, len(x) - 2, "1")
    if len(slopes) < 2:
        return None
    return Estimate.from_stderr(value, float(np.std(slopes, ddof=1) / np.sqrt(len(slopes))), len(slopes) - 1, "1")
