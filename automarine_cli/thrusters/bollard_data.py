"""Bollard-test points made ready for a diagnosis: levels, directions, run order, and the noise apart from any model."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from automarine_cli.errors import FitError
from automarine_cli.quantities import Floats
from automarine_cli.thrusters.contradictions import flag_contradictions, left_out
from automarine_cli.thrusters.fit import Side, sides_of
from automarine_cli.thrusters.forms import SIDES
from automarine_cli.thrusters.plateaus import reduce_series
from automarine_cli.thrusters.points import Ints, Points, groups_of, levels_of, voltage_steps
from automarine_cli.thrusters.records import ThrusterLogs
from automarine_cli.thrusters.tare import subtract_tare

FEWEST_LEVELS = 5
"""Levels in a direction from which a curve with a second parameter can be told from chance."""
FEWEST_TO_HOLD_OUT = 10
"""Levels in a direction from which a quarter of them is held out."""
REPEATS = 6
"""Degrees of freedom among repeats from which their own scatter is the noise level."""
BINS = 4
ROBUST = 1.4826
SAME = 1e-6
"""Commands that differ by less than this share of full scale are the same command."""
ALONG = 0.8
"""Share of the run order that the levels explain from which a drift cannot be told from the curve."""


@dataclass(frozen=True)
class BollardData:
    """Measured points of one thruster, without those at zero command; all arrays have shape (P,).

    `step` numbers the voltage steps (None with one voltage or none), `level` numbers commands (signed) at one
    voltage: the unit of chance; `group` what cross-validation leaves out together. `order` runs from 0 for the first
    reading to 1 for the last. `places` are file and run of each record; `zero` [N] are the readings at rest.
    """

    points: Points
    step: Ints | None
    level: Ints
    group: Ints
    order: Floats
    tare_stderr: float
    n_unit: str
    places: tuple[str, ...]
    zero: Floats

    @property
    def full_scale(self) -> float:
        """Largest thrust measured [N]."""
        return self.points.full_scale

    @property
    def voltage(self) -> Floats | None:
        """Supply voltage [V] where it was varied in steps, else None."""
        return None if self.step is None else self.points.voltage

    @property
    def sides(self) -> tuple[str, ...]:
        """The directions that were measured."""
        return tuple(name for name, sign in SIDES if np.any(self.points.n * sign > 0))

    @property
    def levels(self) -> int:
        """How many independent levels."""
        return len(np.unique(self.level))

    def where(self, mask: NDArray[np.bool_]) -> "BollardData":
        """The points that `mask` keeps, as bollard data."""
        step = None if self.step is None else self.step[mask]
        own = {name: getattr(self, name)[mask] for name in ("level", "group", "order")}
        return replace(self, points=self.points.where(mask), step=step, **own)

    def parts(self, tied: bool) -> dict[str, tuple[Ints, Side]]:
        """Point numbers and `Side` of each direction, or of both together as one curve of |n| (`tied`)."""
        points = self.points
        if not tied:
            return {
                name: (np.flatnonzero(points.n * side.sign > 0), side)
                for name, side in sides_of(points, self.step, self.tare_stderr).items()
            }
        size = np.abs(points.n)
        thrust = np.sign(points.n) * points.force
        own = np.nan_to_num(points.stderr)
        side = Side("both", 1.0, size, thrust, points.weight, groups_of(size), None, own, self.tare_stderr)
        return {"both": (np.arange(len(points)), side)}

    def drifts_apart(self) -> bool:
        """Whether the run order can be told from the command: then a drift with it can be a candidate."""
        size = np.abs(self.points.n)
        columns = [np.ones(len(size)), self.points.n, size, self.points.n**2, self.points.n * size]
        if self.step is not None:
            columns.append(self.points.voltage)
        matrix = np.stack(columns, axis=1)
        rest = self.order - matrix @ np.linalg.lstsq(matrix, self.order, rcond=None)[0]
        return bool(np.ptp(self.order) > 0 and 1.0 - rest.var() / self.order.var() < ALONG)

    def place(self, index: int) -> str:
        """File and run of one point."""
        return self.places[int(self.points.record[index])]


def bollard_data(
    loaded: ThrusterLogs, thrusters: int, n_unit: str, sides: tuple[str, ...], fewest: int = FEWEST_LEVELS
) -> BollardData:
    """Logs -> bollard data: plateaus, one thruster, contradictions flagged, tare taken off, directions in `sides` only.

    A direction with fewer than `fewest` levels is left out.

    Raises FitError where no direction has enough levels, or thrust opposes the command.
    """
    points = reduce_series(list(loaded.records)).points.divided(thrusters)
    step = voltage_steps(points.voltage)
    points, tare = subtract_tare(flag_contradictions(points, step))
    order = np.arange(len(points), dtype=float) / max(len(points) - 1, 1)
    keep = np.zeros(len(points), dtype=bool)
    for name, sign in SIDES:
        here = points.n * sign > 0
        if name in sides and len(np.unique(levels_of(points.n[here]))) >= fewest:
            keep |= here
    if not np.any(keep):
        raise FitError(
            f"no direction of the map has {fewest} different commands in the logs; a diagnosis needs a curve: "
            "pull at more levels, or give a map of the direction that was measured"
        )
    if float(points.weight[keep] @ (points.n * np.abs(points.n) * points.force)[keep]) <= 0.0:
        raise FitError(
            "thrust has the opposite sign of the control signal; if ahead is logged as negative force, write "
            'force_N = { from = "NAME", sign = -1 } under [columns] in the --columns file'
        )
    kept_step = None if step is None or step.max() == 0 else step[keep]
    kept = points.where(keep)
    level = levels_of(kept.n)
    if kept_step is not None:
        level = np.unique(np.stack([level, kept_step]), axis=1, return_inverse=True)[1].ravel()
    places = tuple(record.place for record in loaded.records)
    stderr = tare.stderr if tare.subtracted else 0.0
    values = (kept, kept_step, level.astype(np.int64), _groups(kept.n), order[keep], stderr, n_unit, places)
    return BollardData(*values, points.force[points.n == 0.0])


def _groups(n: Floats) -> Ints:
    """Groups of both directions, numbered apart."""
    group = np.zeros(len(n), dtype=np.int64)
    for offset, sign in ((0, 1.0), (1000, -1.0)):
        here = n * sign > 0
        group[here] = groups_of(np.abs(n[here])) + offset
    return group


def held_out_levels(data: BollardData, seed: int) -> np.ndarray:
    """Points of the quarter of the levels that is held out, (P,): one level drawn from every four neighbours.

    Never an end of the range; none where a direction has fewer than FEWEST_TO_HOLD_OUT levels.
    """
    random, out = np.random.default_rng(seed), np.zeros(len(data.points), dtype=bool)
    number = levels_of(data.points.n)
    for sign in (1.0, -1.0):
        own = np.unique(number[data.points.n * sign > 0])
        inner = own[1:-1]
        if 0 < len(own) < FEWEST_TO_HOLD_OUT:
            return np.zeros(len(data.points), dtype=bool)
        for start in range(0, len(inner) - 3, 4):
            out |= number == inner[start + int(random.integers(4))]
    return out


def noise_level(data: BollardData) -> tuple[float, str]:
    """Noise of a point [N] estimated without a model, and where it was read.

    Repeats at one command where there are enough; else what the neighbouring levels do not say: each level against a
    smooth local curve through the three levels on either side, freed of that curve's own error. Never less than the
    standard errors of the plateaus.
    """
    points = data.points
    own = points.stderr[np.isfinite(points.stderr)]
    samples = float(np.sqrt(np.mean(own**2))) if len(own) else 0.0
    squares, freedom = 0.0, 0
    for number in np.unique(data.level):
        here = (data.level == number) & (points.flag == "")
        # A measured speed is never the same twice: its neighbours are no repeats.
        if np.count_nonzero(here) > 1 and np.ptp(points.n[here]) <= SAME * np.max(np.abs(points.n)):
            squares += float(np.sum((points.force[here] - points.force[here].mean()) ** 2))
            freedom += int(np.count_nonzero(here)) - 1
    if freedom >= REPEATS:
        repeats = float(np.sqrt(squares / freedom))
        if repeats >= samples:
            return repeats, "repeats at one command"
        return samples, "the samples of each plateau"
    rough = _roughness(data)
    if rough >= samples:
        return rough, "neighbouring levels"
    return samples, "the samples of each plateau"


def _roughness(data: BollardData) -> float:
    """Root mean square over ranges of |n| of the robust scatter [N] about the neighbours' smooth curve."""
    points = data.points
    off, size = [], []
    for step in [0] if data.step is None else np.unique(data.step):
        for _, sign in SIDES:
            here = (points.n * sign > 0) & (points.flag == "")
            here &= True if data.step is None else data.step == step
            n = np.abs(points.n[here])
            numbers = levels_of(n)
            place = np.array([np.mean(n[numbers == k]) for k in np.unique(numbers)])
            thrust = np.array([np.mean(sign * points.force[here][numbers == k]) for k in np.unique(numbers)])
            scale = np.array([_leaning(place, j) for j in range(len(place))])
            found = (thrust - left_out(place, thrust)) / scale
            known = np.isfinite(found)
            off.append(found[known])
            size.append(place[known])
    every, at = np.abs(np.concatenate(off)), np.concatenate(size)
    if len(every) == 0:
        return 0.0
    order = np.argsort(at, kind="stable")
    parts = np.array_split(every[order], BINS if len(every) >= 5 * BINS else 1)
    return float(np.sqrt(np.mean([(ROBUST * np.median(part)) ** 2 for part in parts])))


def _leaning(place: Floats, j: int) -> float:
    """Factor by which a level less its neighbours' parabola scatters more than the level alone."""
    near = np.array([k for k in range(j - 3, j + 4) if k != j and 0 <= k < len(place)])
    if len(near) < 4:
        return np.nan
    x = (place[near] - place[j]) / max(np.ptp(place[near]), 1e-300)
    rows = np.stack([np.ones_like(x), x, x**2], axis=1)
    return float(np.sqrt(1.0 + np.linalg.pinv(rows.T @ rows)[0, 0]))
