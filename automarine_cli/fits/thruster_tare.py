"""Points that contradict their neighbours, and the load cell's zero reading."""

from dataclasses import dataclass, replace

import numpy as np

from automarine_cli.fits.thruster_levels import levels_of
from automarine_cli.fits.thruster_points import Floats, Points

# A thrust curve rises: outside its neighbours by more than this share of full scale is a contradiction.
BRACKET = 0.03
LOCAL = 0.05  # the same for a point off the smooth curve through its neighbours
END = 0.20  # the highest command has one neighbour only, and thrust may really sag there
REPEAT_MADS, LOCAL_MADS = 6.0, 8.0


@dataclass(frozen=True)
class Tare:
    """Zero reading of the load cell, per thruster [N]: mean, standard error, whether it was subtracted."""

    value: float
    stderr: float
    readings: int
    drift: float
    subtracted: bool

    @property
    def says(self) -> str:
        """One sentence for the terminal and the report."""
        if self.readings == 0:
            return "No reading at zero command: thrust is taken as logged, without a tare."
        where = f"{self.readings} zero-command reading{'s' if self.readings > 1 else ''}"
        if self.value == 0.0:
            return f"The {where} say exactly 0 N: there is no tare."
        if not self.subtracted:
            return (
                f"The tare of {self.value:.4g} N from {where} is within its scatter and was not subtracted."
            )
        drift = f", drifting by {self.drift:.3g} N" if self.drift else ""
        return f"A tare of {self.value:.4g} N from {where}{drift} was subtracted."


def flag_contradictions(points: Points, step: np.ndarray | None) -> Points:
    """The same points with weights and reasons: readings that contradict their neighbours weigh less, none is
    dropped.

    Works inside each voltage step. The weight is Cauchy's, 1 / (1 + (deviation / scale)^2), with the scale a
    third of the limit: a reading at the limit weighs 0.1, and every reading inside it weighs 1.
    """
    weight, flag = points.weight.copy(), points.flag.copy()
    for number in np.unique(step) if step is not None else [0]:
        here = np.arange(len(points)) if step is None else np.flatnonzero(step == number)
        worst = _contradictions(points.n[here], points.force[here])
        for index, (deviation, limit, reason) in worst.items():
            weight[here[index]] = 1.0 / (1.0 + (3.0 * deviation / limit) ** 2)
            flag[here[index]] = reason
    return replace(points, weight=weight, flag=flag)


def _contradictions(n: Floats, force: Floats) -> dict[int, tuple[float, float, str]]:
    """Index -> deviation [N], limit [N] and reason; the worst is taken out first and the rest judged anew."""
    found: dict[int, tuple[float, float, str]] = {}
    level = levels_of(n)
    good = np.ones(len(n), dtype=bool)
    for _ in range(len(n) // 4):
        # One wild reading must not set the scale by which the others are judged.
        scale = float(np.sort(np.abs(force[good]))[-2:].min(initial=np.inf))
        if not np.isfinite(scale) or scale == 0.0:
            break
        excess, deviation, limit = _excess(n, force, level, good, scale)
        worst = int(np.argmax(excess))
        if excess[worst] <= 1.0:
            break
        good[worst] = False
        found[worst] = (
            float(deviation[worst]),
            float(limit[worst]),
            _reason(n[worst], force[worst], deviation[worst], scale),
        )
    return found


def _reason(n: float, force: float, deviation: float, scale: float) -> str:
    if n == 0.0:
        return f"{deviation:.3g} N of thrust at zero control signal: tachometer drop-out"
    if abs(force) <= 0.01 * scale:
        return "no thrust although its neighbours pull: load cell or thruster dropped out"
    return f"{deviation:.3g} N off what its neighbours say: faulty run"


def _excess(
    n: Floats, force: Floats, level: np.ndarray, good: np.ndarray, scale: float
) -> tuple[Floats, Floats, Floats]:
    """Largest ratio of deviation to limit over three tests, with deviation and limit [N], shape (P,)."""
    numbers = np.unique(level[good])
    members = [np.flatnonzero(good & (level == number)) for number in numbers]
    middle = np.array([np.median(force[index]) for index in members])
    place = np.array([np.median(n[index]) for index in members])
    smooth = _left_out(place, middle)
    rough = 1.4826 * float(np.nanmedian(np.abs(middle - smooth))) if np.any(np.isfinite(smooth)) else 0.0
    inside = [np.abs(force[index] - np.median(force[index])) for index in members if len(index) >= 3]
    repeat = max(
        BRACKET * scale, REPEAT_MADS * 1.4826 * float(np.median(np.concatenate(inside))) if inside else 0.0
    )
    excess, deviations, limits = np.zeros(len(n)), np.zeros(len(n)), np.full(len(n), np.inf)
    for j, index in enumerate(members):
        for p in index:
            others = index[index != p]
            tests = [(abs(force[p] - np.median(force[others])), repeat)] if len(others) >= 2 else []
            if not np.any(
                np.abs(force[others] - force[p]) <= repeat
            ):  # a repeat that agrees: the curve is like that
                tests.append(_bracket(j, force[p], middle, scale))
                if np.isfinite(smooth[j]):
                    tests.append((abs(force[p] - smooth[j]), max(LOCAL * scale, LOCAL_MADS * rough)))
            for deviation, limit in tests:
                if deviation / limit > excess[p]:
                    excess[p], deviations[p], limits[p] = deviation / limit, deviation, limit
    return excess, deviations, limits


def _bracket(j: int, value: float, middle: Floats, scale: float) -> tuple[float, float]:
    """How far a reading lies outside its two neighbouring levels, and how far it may."""
    if 0 < j < len(middle) - 1:
        low, high = sorted((middle[j - 1], middle[j + 1]))
        return max(value - high, low - value, 0.0), BRACKET * scale
    if len(middle) < 2:
        return 0.0, BRACKET * scale
    sag = middle[1] - value if j == 0 else value - middle[-2]
    return max(-sag, 0.0), END * scale


def _left_out(place: Floats, middle: Floats) -> Floats:
    """Each level predicted by the parabola through three levels on each side; NaN near zero and the ends."""
    predicted = np.full(len(place), np.nan)
    for j in range(len(place)):
        if place[j] == 0.0:
            continue
        side = np.flatnonzero(place * np.sign(place[j]) >= 0)
        low, high = side[(side < j)][-3:], side[(side > j)][:3]
        if len(low) < 2 or len(high) < 2:
            continue
        near = np.concatenate([low, high])
        scaled = (place[near] - place[j]) / np.ptp(place[near])
        predicted[j] = np.polynomial.polynomial.polyfit(scaled, middle[near], 2)[0]
    return predicted


def subtract_tare(points: Points) -> tuple[Points, Tare]:
    """Thrust with the zero reading taken off, and what it was.

    A record with its own zero readings uses them, linear in time between them; another record uses the mean
    of all. Zero plateaus of a raw series are always subtracted; single zero readings of a table only when
    their mean is over twice its standard error, because a table is usually tared already and one more noisy
    reading would then be added to every point.
    """
    zero = (points.n == 0.0) & (points.flag == "")
    if not np.any(zero):
        return points, Tare(0.0, 0.0, 0, 0.0, False)
    values = points.force[zero]
    mean = float(np.mean(values))
    raw = bool(np.all(points.raw[zero]))
    stderr = _tare_error(points, zero, raw)
    if not raw and abs(mean) <= 2.0 * stderr:
        return points, Tare(mean, stderr, len(values), 0.0, False)
    offset, drift = np.full(len(points), mean), 0.0
    for record in np.unique(points.record):
        own = zero & (points.record == record)
        if not np.any(own):
            continue
        order = np.argsort(points.when[own], kind="stable")
        knots, readings = points.when[own][order], points.force[own][order]
        here = points.record == record
        if raw:
            offset[here] = np.interp(points.when[here], knots, readings)
            drift = max(drift, float(np.ptp(readings)))
        else:
            offset[here] = np.mean(readings)
    return replace(points, force=points.force - offset), Tare(mean, stderr, len(values), drift, mean != 0.0)


def _tare_error(points: Points, zero: np.ndarray, raw: bool) -> float:
    """Standard error of the zero reading [N]: from samples, repeats, or the table's own roughness."""
    values = points.force[zero]
    if raw:
        return float(np.sqrt(np.mean(points.stderr[zero] ** 2) / len(values)))
    if len(values) >= 3:
        return float(np.std(values, ddof=1) / np.sqrt(len(values)))
    good = points.flag == ""
    order = np.argsort(points.n[good], kind="stable")
    residual = points.force[good][order] - _left_out(points.n[good][order], points.force[good][order])
    rough = 1.4826 * float(np.nanmedian(np.abs(residual))) if np.any(np.isfinite(residual)) else 0.0
    return rough / np.sqrt(len(values))
