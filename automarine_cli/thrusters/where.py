"""Where a thruster map and its measurements disagree: regions that stand out, and stretches of faulty data."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from automarine_cli.quantities import Floats
from automarine_cli.thrusters.bollard_data import BollardData
from automarine_cli.thrusters.forms import SIDES
from automarine_cli.thrusters.points import Ints
from automarine_cli.thrusters.shapes import Fitted

BINS = 10
IN_A_BIN = 4
"""Points that a bin should hold: one point never stands out against shuffling."""
SHUFFLES = 999
CHANCE = 0.05
SWEEP = 0.98
"""Correlation of run order and command from which they are one variable."""
SHORTEST = 3
"""Readings in sequence that make a stretch."""
STEP, STEPS = 0.03, 6.0
"""How sharply a faulty stretch begins and ends: share of full scale, and multiples of the noise level."""
COMPUTED, DEGREE = 2e-4, 4
"""A direction that a polynomial of this degree meets to this share of full scale was computed, not measured."""


@dataclass(frozen=True)
class Region:
    """A range of one variable in which the gap stands out: its root mean square [N], share of all squares, p."""

    variable: str
    low: float
    high: float
    unit: str
    gap: float
    share: float
    p_value: float
    runs: tuple[str, ...]

    def to_json(self) -> dict[str, object]:
        """The contract's form."""
        return {
            "variable": self.variable, "from": self.low, "to": self.high, "unit": self.unit, "gap_N": self.gap,
            "share": self.share, "p_value": self.p_value, "runs": list(self.runs),
        }  # fmt: skip


@dataclass(frozen=True)
class Fault:
    """A stretch of the data that is not to be trusted: kind, place, readings, size of the gap [N], in words."""

    kind: str
    place: str
    first: int
    last: int
    low: float
    high: float
    points: int
    gap: float
    says: str

    def to_json(self) -> dict[str, object]:
        """Plain data; readings are counted from 1 in each record."""
        return {
            "kind": self.kind, "file": self.place, "readings": [self.first, self.last], "from_n": self.low,
            "to_n": self.high, "points": self.points, "gap_N": self.gap, "says": self.says,
        }  # fmt: skip


def variables(data: BollardData) -> dict[str, tuple[Floats, str]]:
    """What the gap is looked at against: values (P,) and unit, by name."""
    found = {"n": (data.points.n, data.n_unit or "as logged")}
    if data.step is not None:
        found["voltage"] = (data.points.voltage, "V")
    # In a single sweep the run order is the command once more.
    if abs(np.corrcoef(data.order, data.points.n)[0, 1]) < SWEEP:
        found["run-order"] = (np.arange(1.0, len(data.order) + 1.0), "reading")
    return found


def gap_against(found: Fitted, variable: str) -> Floats:
    """The residuals (P,) [N] as they are looked at: signed against n, else positive where it pulls more than the map.

    What weakens or strengthens thrust both ways would cancel over the directions otherwise.
    """
    return found.residual if variable == "n" else found.residual * np.sign(found.data.points.n)


def bins_of(values: Floats) -> Ints:
    """Number of the bin of each value, (P,): distinct values where few, else ranges of equally many points."""
    distinct, number = np.unique(values, return_inverse=True)
    most = int(np.clip(len(values) // IN_A_BIN, 2, BINS))
    if len(distinct) <= most:
        return np.asarray(number.ravel(), dtype=np.int64)
    rank = np.argsort(np.argsort(values, kind="stable"), kind="stable")
    return np.asarray(rank * most // len(values), dtype=np.int64)


def regions(found: Fitted, seed: int) -> tuple[Region, ...]:
    """Regions in which the residuals of a fit stand out against chance: residuals shuffled over the points.

    The p-value counts the largest bin of each shuffle, so that looking at every bin is paid for.
    """
    data, random = found.data, np.random.default_rng(seed)
    if not np.any(np.abs(found.residual) > 1e-9 * data.full_scale):
        return ()
    result: list[Region] = []
    for name, (values, unit) in variables(data).items():
        rest = np.sqrt(data.points.weight) * gap_against(found, name)
        shuffled = random.permuted(np.tile(rest, (SHUFFLES, 1)), axis=1)
        place = bins_of(values)
        rows = (place[None, :] == np.arange(place.max() + 1)[:, None]).astype(float)
        if len(rows) < 2:
            continue
        size = np.sqrt(rows.sum(axis=1))
        own = (rows @ rest / size) ** 2
        best = np.max((shuffled @ rows.T / size) ** 2, axis=1)
        p = (1.0 + np.sum(best[:, None] >= own[None, :], axis=0)) / (1.0 + SHUFFLES)
        for start, stop in _stretches(p <= CHANCE):
            here = (place >= start) & (place < stop)
            share = float(np.sum(rest[here] ** 2) / np.sum(rest**2))
            gap = float(np.sqrt(np.sum(rest[here] ** 2) / data.points.weight[here].sum()))
            runs = tuple(dict.fromkeys(data.place(int(i)) for i in np.flatnonzero(here)))
            ends = (float(values[here].min()), float(values[here].max()))
            result.append(Region(name, *ends, unit, gap, share, float(p[start:stop].min()), runs))
    return tuple(result)


def faults(data: BollardData, found: Fitted) -> tuple[Fault, ...]:
    """Flagged stretches, exact zeros at a command, and a direction that looks computed; the largest gap first."""
    points = data.points
    result = [
        _fault(data, found, here, "faulty-stretch", str(points.flag[here[0]]))
        for here in _together(data, points.flag != "")
    ]
    zeros = np.flatnonzero((points.force == 0.0) & (points.flag == ""))
    for here in (zeros[points.record[zeros] == record] for record in np.unique(points.record[zeros])):
        why = (
            "exactly zero thrust at a command: a dead-band, or readings that were set to zero or never taken; "
            "how wide the dead-band is rests on them"
        )
        result.append(_fault(data, found, here, "exact-zeros", why))
    rough = {name: _off_polynomial(data, sign) for name, sign in SIDES}
    for name, sign in SIDES:
        other = rough["backward" if name == "forward" else "forward"]
        own = rough[name]
        if own is not None and other is not None and own < COMPUTED * data.full_scale < 0.2 * other:
            here = np.flatnonzero(points.n * sign > 0)
            why = (
                f"the {name} half lies on a polynomial to {own:.2g} N while the other half scatters: it looks "
                "computed, not measured, and its agreement with any map says little"
            )
            result.append(_fault(data, found, here, "computed", why))
    return tuple(sorted(result, key=lambda fault: -fault.gap))


def broken_stretch(found: Fitted, floor: float) -> Ints | None:
    """Points of a stretch of readings that steps off the curve and back again, or None.

    A propeller's curve is continuous: what begins and ends between two neighbouring readings with a jump is the
    measurement. The clearest stretch is given.
    """
    data = found.data
    limit = max(STEP * data.full_scale, STEPS * floor)
    best, clearest = None, 0.0
    for record in np.unique(data.points.record):
        for _, sign in SIDES:
            here = np.flatnonzero((data.points.record == record) & (data.points.n * sign > 0))
            rest = sign * found.residual[here]
            for start in range(1, len(here) - SHORTEST):
                for stop in range(start + SHORTEST, min(start + len(here) // 3, len(here) - 1) + 1):
                    inside = rest[start:stop]
                    around = np.mean(np.concatenate([rest[max(start - 3, 0) : start], rest[stop : stop + 3]]))
                    off = float(np.mean(inside) - around)
                    way = np.sign(off)
                    edges = min(way * (inside[0] - rest[start - 1]), way * (inside[-1] - rest[stop]))
                    steady = np.min(way * (inside - around)) > 0.5 * abs(off)
                    clear = abs(off) * np.sqrt(stop - start)
                    if edges > limit and steady and clear > clearest:
                        best, clearest = here[start:stop], clear
    return best


def _fault(data: BollardData, found: Fitted, here: Ints, kind: str, why: str) -> Fault:
    n = data.points.n[here]
    record = np.flatnonzero(data.points.record == data.points.record[here[0]])
    first = int(np.searchsorted(record, here[0])) + 1
    last = int(np.searchsorted(record, here[-1])) + 1
    gap = float(np.sqrt(np.mean((data.points.force[here] - found.thrust(data)[here]) ** 2)))
    low, high = float(n.min()), float(n.max())
    many = f"{len(here)} readings" if len(here) > 1 else "1 reading"
    at = f"from n = {low:.4g} to {high:.4g}" if len(here) > 1 else f"at n = {low:.4g}"
    says = f"{data.place(int(here[0]))}: {many} {at}: {why}."
    return Fault(kind, data.place(int(here[0])), first, last, low, high, len(here), gap, says)


def _together(data: BollardData, mask: np.ndarray) -> list[Ints]:
    """Points of the mask that follow each other in one record."""
    index = np.flatnonzero(mask)
    if len(index) == 0:
        return []
    new = (np.diff(index) > 1) | (np.diff(data.points.record[index]) != 0)
    return list(np.split(index, np.flatnonzero(new) + 1))


def _stretches(mask: np.ndarray) -> list[tuple[int, int]]:
    """Half-open ranges of neighbouring true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return list(pairwise(edges.tolist()))[::2]


def _off_polynomial(data: BollardData, sign: float) -> float | None:
    """Root mean square [N] of one direction about a polynomial in n; None with too few points."""
    here = data.points.n * sign > 0
    if np.count_nonzero(here) < DEGREE + 7:
        return None
    x = data.points.n[here] / np.max(np.abs(data.points.n[here]))
    matrix = np.vander(x, DEGREE + 1)
    rest = data.points.force[here] - matrix @ np.linalg.lstsq(matrix, data.points.force[here], rcond=None)[0]
    return float(np.sqrt(np.mean(rest**2)))
