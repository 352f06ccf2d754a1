"""Readings that contradict their neighbours: tachometer and load cell drop-outs, outliers."""

from dataclasses import replace

import numpy as np

from automarine_cli.quantities import Floats
from automarine_cli.thrusters.points import Ints, Points, levels_of

# Limits in shares of full scale, and in robust standard deviations of the readings; the larger counts.
RISE, RISE_MADS = 0.03, 5.0  # thrust rises with the command: how far it may fall back
SMOOTH, SMOOTH_MADS = 0.05, 8.0  # off the smooth curve through the neighbours
REPEAT_MADS = 6.0  # off the other readings at the same command
END = 0.20  # the highest command has one neighbour only, and thrust may really sag there
SCATTER = 0.15  # share of the thrust itself: two runs may differ by some percent of gain

Found = dict[int, tuple[float, float]]  # index -> deviation [N], limit [N]


def flag_contradictions(points: Points, step: Ints | None) -> Points:
    """The same points with weights and reasons: contradicting readings weigh less, none is dropped.

    Works inside each voltage step. The weight is Cauchy's, 1 / (1 + (deviation / scale)^2), with the scale a
    third of the limit: a reading at the limit weighs 0.1, and every reading inside it weighs 1.
    """
    weight, flag = points.weight.copy(), points.flag.copy()
    for number in np.unique(step) if step is not None else [0]:
        here = np.arange(len(points)) if step is None else np.flatnonzero(step == number)
        n, force = points.n[here], points.force[here]
        for index, (deviation, limit) in _contradictions(n, force).items():
            weight[here[index]] = 1.0 / (1.0 + (3.0 * deviation / limit) ** 2)
            flag[here[index]] = _reason(n[index], force[index], deviation, _scale(force))
    return replace(points, weight=weight, flag=flag)


def _reason(n: float, force: float, deviation: float, scale: float) -> str:
    if n == 0.0:
        return f"{deviation:.3g} N of thrust at zero control signal: tachometer drop-out"
    if abs(force) <= 0.01 * scale:
        return "no thrust although its neighbours pull: load cell or thruster dropped out"
    return f"outlier: {deviation:.3g} N from neighbouring points"


def _scale(force: Floats) -> float:
    """Full scale [N]: the second largest thrust, because one wild reading must not set it."""
    return float(np.sort(np.abs(force))[-2:].min(initial=np.inf))


def _contradictions(n: Floats, force: Floats) -> Found:
    """First what breaks the rise of the curve, then, worst first, what lies off its course or repeats."""
    force = force - _rest(n, force)
    scale = _scale(force)
    if not np.isfinite(scale) or scale == 0.0:
        return {}
    level = levels_of(n)
    good = np.ones(len(n), dtype=bool)
    found = _falls(n, force, level, scale)
    good[list(found)] = False
    for _ in range(len(n) // 4):
        deviation, limit = _off_course(n, force, level, good, scale)
        worst = int(np.argmax(deviation / limit))
        if deviation[worst] <= limit[worst]:
            break
        good[worst] = False
        found[worst] = (float(deviation[worst]), float(limit[worst]))
    return found


def _rest(n: Floats, force: Floats) -> float:
    """Zero reading [N], if the readings next to it bear it out; else 0."""
    zero, ahead, astern = n == 0.0, n > 0.0, n < 0.0
    if not (np.any(zero) and np.any(ahead) and np.any(astern)):
        return 0.0
    value = float(np.median(force[zero]))
    below, above = force[astern][np.argmax(n[astern])], force[ahead][np.argmin(n[ahead])]
    return value if below <= value <= above else 0.0


def _falls(n: Floats, force: Floats, level: Ints, scale: float) -> Found:
    """The fewest readings without which thrust rises with the command, but for a tolerance.

    The longest rising chain through the readings stays; a drop-out leaves it, however many stand side by
    side.
    """
    order = np.lexsort((force, n))
    everything = np.ones(len(n), dtype=bool)
    strict = np.zeros(len(n), dtype=bool)
    strict[order[_longest_rise(force[order], RISE * scale)]] = True
    # The strict chain is smoother than the noise, the whole table rougher where it is contaminated.
    rough, smoother = (_roughness(force, *_courses(n, force, level, good)) for good in (everything, strict))
    rough = min(rough, 2.0 * smoother)
    tolerance = max(RISE * scale, RISE_MADS * rough)
    chain = order[_longest_rise(force[order], tolerance)]
    kept = np.isin(order, chain)
    found: Found = {}
    for place in np.flatnonzero(~kept):
        index = order[place]
        before = force[order[:place][kept[:place]]][-1:].tolist()
        after = force[order[place:][kept[place:]]][:1].tolist()
        low, high = min(before + after, default=0.0), max(before + after, default=0.0)
        outside = float(max(low - force[index], force[index] - high))
        limit = max(tolerance, SCATTER * min(abs(low), abs(high))) if before and after else END * scale
        if outside > limit:
            found[int(index)] = (float(abs(force[index] - (low + high) / 2)), limit)
    return found


def _longest_rise(force: Floats, tolerance: float) -> Ints:
    """Indices of the longest chain in which no reading is lower than the one before by over the tolerance."""
    length, parent = np.ones(len(force), dtype=np.int64), np.full(len(force), -1)
    for j in range(1, len(force)):
        reach = np.where(force[:j] <= force[j] + tolerance, length[:j], 0)
        # Of equal chains the one with the nearest step.
        best = np.flatnonzero(reach == reach.max())
        if reach[best[0]] > 0:
            nearest = best[np.argmin(np.abs(force[best] - force[j]))]
            length[j], parent[j] = length[nearest] + 1, nearest
    chain = [int(np.argmax(length))]
    while parent[chain[-1]] >= 0:
        chain.append(int(parent[chain[-1]]))
    return np.array(chain[::-1], dtype=np.int64)


def _courses(n: Floats, force: Floats, level: Ints, good: np.ndarray) -> tuple[list[np.ndarray], Floats, Floats]:
    """Indices of each level's readings, their median [N], and what the levels around it say [N]."""
    members = [np.flatnonzero(good & (level == number)) for number in np.unique(level[good])]
    middle = np.array([np.median(force[index]) for index in members])
    return members, middle, left_out(np.array([np.median(n[index]) for index in members]), middle)


def _roughness(force: Floats, members: list[np.ndarray], middle: Floats, smooth: Floats) -> float:
    """Robust standard deviation [N] of the readings about a smooth curve, or of repeats if that is larger."""
    off = np.abs(middle - smooth)[np.isfinite(smooth)]
    if len(off) == 0:
        return _repeat_noise(force, members)
    # Median and lower quartile of a normal sample; in a coarse table half of the levels may stand by a bad
    # one.
    rough = min(1.4826 * float(np.median(off)), 3.139 * float(np.quantile(off, 0.25)))
    return max(rough, _repeat_noise(force, members))


def _off_course(n: Floats, force: Floats, level: Ints, good: np.ndarray, scale: float) -> tuple[Floats, Floats]:
    """Deviation [N] from repeats at the same command or the smooth curve, and its limit, shape (P,)."""
    members, middle, smooth = _courses(n, force, level, good)
    rough = _roughness(force, members, middle, smooth)
    repeat = max(RISE * scale, REPEAT_MADS * _repeat_noise(force, members))
    deviations, limits = np.zeros(len(n)), np.full(len(n), scale)
    for j, index in enumerate(members):
        for p in index:
            others = index[index != p]
            tests = []
            if len(others) >= 2:
                usual = float(np.median(force[others]))
                tests.append((abs(force[p] - usual), max(repeat, SCATTER * abs(usual))))
            # A repeat that agrees says that the curve is like that.
            if np.isfinite(smooth[j]) and not np.any(np.abs(force[others] - force[p]) <= repeat):
                limit = max(SMOOTH * scale, SMOOTH_MADS * rough, SCATTER * abs(smooth[j]))
                tests.append((abs(force[p] - smooth[j]), limit))
            for deviation, limit in tests:
                if deviation * limits[p] > deviations[p] * limit:
                    deviations[p], limits[p] = deviation, limit
    return deviations, limits


def _repeat_noise(force: Floats, members: list[np.ndarray]) -> float:
    """Standard deviation [N] of repeats about their level's median, where there are three; else 0."""
    inside = [np.abs(force[index] - np.median(force[index])) for index in members if len(index) >= 3]
    # One deviation of each level is the median's own and says nothing.
    left = [np.sort(deviation)[1:] for deviation in inside]
    return 1.4826 * float(np.median(np.concatenate(left))) if left else 0.0


def left_out(place: Floats, middle: Floats) -> Floats:
    """Each level by the parabola through three levels on each side [N]; NaN near zero and the ends.

    The parabola goes through the root of the thrust, which is nearly straight: coarse tables stay smooth.
    """
    predicted = np.full(len(place), np.nan)
    root = np.sign(middle) * np.sqrt(np.abs(middle))
    for j in range(len(place)):
        if place[j] == 0.0:
            continue
        side = np.flatnonzero(place * np.sign(place[j]) >= 0)
        low, high = side[(side < j)][-3:], side[(side > j)][:3]
        if len(low) < 2 or len(high) < 2:
            continue
        near = np.concatenate([low, high])
        scaled = (place[near] - place[j]) / np.ptp(place[near])
        straight = float(np.polynomial.polynomial.polyfit(scaled, root[near], 2)[0])
        predicted[j] = straight * abs(straight)
    return predicted
