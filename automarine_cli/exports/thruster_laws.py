"""Thrust laws of simulators beside a thruster map: coefficients that come nearest to it, and how near that is."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from automarine_cli.errors import SettingError
from automarine_cli.exports.base import MapSubject, number
from automarine_cli.quantities import Floats
from automarine_cli.thrusters.forms import Curve, thrust_both_ways
from automarine_cli.thrusters.map import ThrusterMap

GRID = 2001  # control signals at which a law is compared with the map
CLOSE = 1e-3  # of the full scale: nearer than any bollard test tells
MOST_POINTS = 1025  # of a table, in one direction


@dataclass(frozen=True)
class Side:
    """One direction of a law F = k max(n^2 - d, 0) up to `limit`: k [N/n^2], d [n^2], limit [n]; k is 0 where the
    direction was never measured."""

    k: float
    d: float
    limit: float

    def thrust(self, n: Floats) -> Floats:
        """Size of the thrust [N] for |n| of any shape."""
        return np.asarray(self.k * np.maximum(np.minimum(n, self.limit) ** 2 - self.d, 0.0))


def largest_signal(subject: MapSubject) -> float:
    """The largest control signal: as given, else where the stronger direction reaches the full scale measured.

    Raises SettingError where neither is told.
    """
    if subject.settings.n_max is not None:
        return subject.settings.n_max
    curves = [curve for curve in (subject.map.forward, subject.map.backward) if curve is not None]
    if subject.full_scale is None or subject.full_scale <= 0:
        limits = [curve.n_sat for curve in curves if curve.n_sat is not None]
        if limits:
            return max(limits)
        raise SettingError(f"{subject.origin.file} does not tell how far the thruster was driven; give --n-max")
    return min(_signal(curve, subject.full_scale) for curve in curves)


def _signal(curve: Curve, force: float) -> float:
    """Control signal of a thrust, no more than the saturation."""
    n = curve.n_0 + (force / curve.a) ** (1.0 / curve.p)
    return float(n if curve.n_sat is None else min(n, curve.n_sat))


def square_side(curve: Curve | None, n_max: float, *, with_dead_band: bool) -> Side:
    """The law nearest to a curve by least squares on the thrust; its dead band, if it has one, is the curve's."""
    if curve is None:
        return Side(0.0, 0.0, n_max)
    limit = n_max if curve.n_sat is None else min(curve.n_sat, n_max)
    d = curve.n_0**2 if with_dead_band else 0.0
    n = np.linspace(0.0, limit, GRID)
    rise = np.maximum(n**2 - d, 0.0)
    return Side(float(rise @ curve.thrust(n) / (rise @ rise)), d, limit)


def both_sides(subject: MapSubject, n_max: float) -> Side:
    """One law for both directions, by least squares on the thrust of both."""
    sides = [square_side(c, n_max, with_dead_band=False) for c in (subject.map.forward, subject.map.backward) if c]
    return Side(float(np.mean([side.k for side in sides])), 0.0, n_max)


def table(map_: ThrusterMap, n_max: float) -> tuple[Floats, Floats]:
    """Control signals and thrusts between which straight lines follow the map to CLOSE; nothing beyond n_max."""
    points = 9
    n, force = _points(map_, n_max, points)
    while points < MOST_POINTS and worst(map_, partial(lines, n, force), n_max) >= CLOSE * top(map_, n_max):
        points = 2 * points - 1
        n, force = _points(map_, n_max, points)
    return n, force


def lines(n: Floats, force: Floats, at: Floats) -> Floats:
    """Thrust [N] on the straight lines between the points (n, force)."""
    return np.interp(at, n, force)


def _points(map_: ThrusterMap, n_max: float, points: int) -> tuple[Floats, Floats]:
    backward, forward = (_knots(curve, n_max, points) for curve in (map_.backward, map_.forward))
    n = np.concatenate([-backward[::-1], forward[1:]])
    return n, force_of(map_, n)


def _knots(curve: Curve | None, n_max: float, points: int) -> Floats:
    """Control signals from 0 to n_max, one at each kink of the curve, closer together where it begins."""
    if curve is None:
        return np.array([0.0, n_max])
    limit = n_max if curve.n_sat is None else min(curve.n_sat, n_max)
    rise = curve.n_0 + (limit - curve.n_0) * np.linspace(0.0, 1.0, points) ** 1.5
    return np.unique([float(number(n)) for n in (0.0, *rise, n_max)])  # as the file has them: none twice


def force_of(map_: ThrusterMap, n: Floats) -> Floats:
    """Thrust [N] of the map; nothing in a direction that was never measured."""
    return thrust_both_ways(map_.forward, map_.backward, n, unmeasured=0.0)


def top(map_: ThrusterMap, n_max: float) -> float:
    """The largest thrust [N] of the map up to n_max."""
    return float(np.max(np.abs(force_of(map_, np.array([-n_max, n_max])))))


def worst(map_: ThrusterMap, law: Callable[[Floats], Floats], n_max: float) -> float:
    """The largest difference [N] of a law from the map within n_max."""
    n = np.linspace(-n_max, n_max, GRID)
    return float(np.max(np.abs(law(n) - force_of(map_, n))))
