"""Does a velocity sensor agree with the position? What all runs of a campaign say of it, before any model is fitted.

Over a stretch of a run the position is  x(t) = c + b t + s V(t + d) + noise, with V the sum of the velocities read, b
the sensor's bias, s its scale and d how late it is. c and b are each stretch's own; s and d are the sensor's, and are
told robustly: a stretch with a slipping compass has no more say than another.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from automarine_cli.quantities import Floats
from automarine_cli.runs.noise import median, position_noise
from automarine_cli.runs.run import Run
from automarine_cli.runs.velocity_sensor import noise_followed

LONGEST = 20.0
"""s; longer runs are cut up, for biases wander."""
FEWEST = 12
"""Samples of a stretch."""
FEWEST_STRETCHES = 3
"""Stretches whose scatter tells anything."""
MOST = 200
"""Stretches that are looked at, evenly over the campaign."""
GAP = 3.0
"""Sample periods; a longer hole parts two stretches."""
MOVES, SEEN = 5.0, 2.0
"""A stretch tells of scale and clock if its motion, less a line, is so many times what noise makes of the summed
velocities, and of the position: the former would bias the scale, the latter only blurs it."""
LATEST = 5.0
"""s; clocks are not looked at further apart."""
GRID, FINE = 60, 40
"""Delays tried to either side: first over all, then between neighbours of the best."""
OF_ONE = np.log(1.5)
"""Scales this near to one, as a logarithm, may be those of a sensor whose clock is off."""
DRAWS = 200
"""Resamples of the stretches for the doubt of a delay."""
REPEATS = 0.8
"""Share of one exact reading from which on a sensor is stuck where the position goes elsewhere."""
BENDS = 0.04
"""Share of all its way by which a position then leaves a straight line."""


@dataclass(frozen=True)
class Stretch:
    """Samples of a run in which both sensors read: arrays (n,), times since the first [s]; `summed` is the sum of the
    velocities."""

    time: Floats
    position: Floats
    velocity: Floats
    summed: Floats
    period: float
    position_noise: float
    velocity_noise: float


@dataclass(frozen=True)
class Agreement:
    """What `moving` stretches say of a velocity sensor: `correlation` of its sum with the position, both less a line;
    `scale` and `late` [s] by which it reads too small and too late, with standard errors, and whether the `clock`
    explains more of what is left than the scale; `period` [s] of the slower
    of the two sensors; `follows` the share of its power, where the position is noise, that is this noise filtered
    (None: not to be told); `stuck` names the runs in which it repeats one value while the vehicle moves.
    """

    moving: int
    correlation: float
    scale: float
    scale_error: float
    late: float
    late_error: float
    clock: bool
    period: float
    follows: float | None
    stuck: tuple[str, ...]
    stuck_at: float = 0.0


def agreement(runs: Sequence[Run], quantity: str) -> Agreement:
    """Compare the channel `quantity`, a velocity, with the positions of the runs that have both."""
    both = [run for run in runs if run.channel(quantity) is not None and not run.summed_up and len(run) >= FEWEST]
    stuck = [(run.name, at) for run in both if (at := _stuck_at(run, quantity)) is not None]
    names = tuple(name for name, _ in stuck)
    at = median(np.array([one for _, one in stuck])) if stuck else 0.0
    free = [run for run in both if run.name not in names]
    every = [one for run in free for one in stretches(run, quantity)]
    if len(every) > MOST:
        every = [every[i] for i in np.linspace(0, len(every) - 1, MOST).astype(int)]
    follows = noise_followed([(one.position, one.velocity) for one in every])
    nothing = Agreement(0, 0.0, 1.0, np.inf, 0.0, np.inf, False, 0.0, follows, names, at)
    rough = _rough(every)
    if rough is None:
        return nothing
    correlation, scale = rough
    moving = [one for one in every if _moves(one, abs(scale))]
    if len(moving) < FEWEST_STRETCHES:
        return replace(nothing, moving=len(every), correlation=correlation, scale=scale)
    fixed = 1.0 if abs(np.log(max(scale, 1e-9))) < OF_ONE else None
    late, late_error, left = _delay(moving, fixed)
    correlation, scale, scale_error = _scale(moving, 0.0 if fixed else late)
    clock = fixed is None or left < float(_misfit(moving, np.zeros(1), None).sum())
    period = max(_pace(moving, "position"), _pace(moving, "velocity"))
    return Agreement(len(moving), correlation, scale, scale_error, late, late_error, clock, period, follows, names, at)


def stretches(run: Run, quantity: str) -> list[Stretch]:
    """The parts of a run in which both sensors read without a hole."""
    read = run.channel(quantity)
    if read is None:
        return []
    here = np.flatnonzero(np.isfinite(read))
    if len(here) < FEWEST:
        return []
    steps = np.diff(run.time[here])
    period = median(steps)
    clock = run.time[here] - run.time[here[0]]
    part = np.concatenate([[0], np.cumsum(steps > GAP * period)]) * 1000.0
    part += np.floor(clock / max(LONGEST, FEWEST * period))
    found = []
    for chosen in np.split(here, np.flatnonzero(np.diff(part)) + 1):
        if len(chosen) < FEWEST:
            continue
        time, position, velocity = run.time[chosen], run.position[chosen], read[chosen]
        summed = np.concatenate([[0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * np.diff(time))])
        found.append(
            Stretch(
                time - time[0], position, velocity, summed, period,
                position_noise(time, position), position_noise(time, velocity),
            )
        )  # fmt: skip
    return found


def _stuck_at(run: Run, quantity: str) -> float | None:
    """The one value that the sensor repeats while the position goes elsewhere, or None.

    A steady turn repeats a coarse reading, and rightly so: the position has to bend meanwhile.
    """
    read = run.channel(quantity)
    assert read is not None
    good = np.isfinite(read)
    if good.sum() < FEWEST or np.ptp(run.position) < max(run.dof.limits.still, 5.0 * run.noise):
        return None
    values, counts = np.unique(read[good], return_counts=True)
    if counts.max() < REPEATS * good.sum():
        return None
    at = float(values[counts.argmax()])
    here = read == at
    (bent,) = _freed(run.time[here], run.position[here])
    return at if np.ptp(bent) > max(5.0 * run.noise, BENDS * np.ptp(run.position)) else None


def _freed(time: Floats, *columns: Floats) -> list[Floats]:
    """Columns (..., n) less the line that fits each best."""
    centred = time - time.mean()
    square = float(centred @ centred)
    return [c - c.mean(axis=-1, keepdims=True) - (c @ centred / square)[..., None] * centred for c in columns]


def _rough(every: Sequence[Stretch]) -> tuple[float, float] | None:
    """Correlation and scale as if no sensor had a bias worth the name, from all stretches in which the position goes
    anywhere; None for none. Good for signs and units."""
    found = []
    for one in every:
        position, summed = one.position - one.position.mean(), one.summed - one.summed.mean()
        whole = float(position @ position)
        square = max(float(summed @ summed), 1e-12 * whole)
        drift = (one.velocity_noise * one.period * len(one.time)) ** 2 / 6.0  # of a sum of noise, less its mean
        if whole > (MOVES * one.position_noise) ** 2 * len(one.time) and max(square, whole) > MOVES**2 * drift:
            across = float(summed @ position)
            found.append((across / np.sqrt(square * whole), across / square, whole))
    if not found:
        return None
    correlations, slopes, weights = np.array(found).T
    return _reached(correlations, weights), _weighted_median(slopes, weights)


def _moves(one: Stretch, scale: float) -> bool:
    """By the position alone: chosen by the sum itself, those would be told of in which its noise adds to the motion."""
    (position,) = _freed(one.time, one.position)
    wander = (scale * one.velocity_noise * one.period) ** 2 * len(one.time) / 15.0  # of a sum of noise, less a line
    moved = float(position @ position) / len(one.time)
    return moved > MOVES**2 * wander and moved > SEEN**2 * one.position_noise**2


def _ahead(one: Stretch, delays: Floats) -> Floats:
    """The summed velocities read `delays` (k,) later, (k, n); beyond the ends they go on as there."""
    edge = max(3, min(8, len(one.time) // 4))
    first, last = np.median(one.velocity[:edge]), np.median(one.velocity[-edge:])
    far = 2.0 * LATEST
    time = np.concatenate([[-far], one.time, [one.time[-1] + far]])
    summed = np.concatenate([[-far * first], one.summed, [one.summed[-1] + far * last]])
    return np.interp((one.time + delays[:, None]).ravel(), time, summed).reshape(len(delays), -1)


def _misfit(moving: Sequence[Stretch], delays: Floats, scale: float | None) -> Floats:
    """What each delay leaves of each stretch's positions, as half its log likelihood (stretches, delays); the scale is
    the stretch's own where it is None."""
    rows = []
    for one in moving:
        position, summed = _freed(one.time, one.position, _ahead(one, delays))
        across, square = summed @ position, (summed**2).sum(axis=1)
        slope = across / np.maximum(square, 1e-300) if scale is None else scale
        left = position @ position - 2.0 * slope * across + slope**2 * square
        least = len(one.time) * max(one.position_noise, 1e-9) ** 2
        rows.append(0.5 * len(one.time) * np.log(np.maximum(left, 0.0) + 0.1 * least))
    return np.array(rows)


def _delay(moving: Sequence[Stretch], scale: float | None) -> tuple[float, float, float]:
    """How late the velocity is [s], the standard error of that over stretches, and the misfit that it leaves."""
    longest = min(LATEST, median(np.array([one.time[-1] for one in moving])) / 3.0)
    step = longest / GRID
    coarse = np.asarray(step * np.arange(-GRID, GRID + 1), dtype=np.float64)
    best = coarse[_misfit(moving, coarse, scale).sum(axis=0).argmin()]
    fine = best + 2.0 * step * np.arange(-FINE, FINE + 1) / FINE
    misfit = _misfit(moving, fine, scale)
    whole = misfit.sum(axis=0)
    late = _lowest(fine, whole)
    if len(moving) < FEWEST_STRETCHES:
        return late, np.inf, float(whole.min())
    count = len(moving)
    drawn = np.random.default_rng(0).multinomial(count, np.full(count, 1.0 / count), DRAWS)
    again = np.array([_lowest(fine, row) for row in drawn @ misfit])
    return late, float(max(again.std() * np.sqrt(count / (count - 1)), 0.1 * step / FINE)), float(whole.min())


def _lowest(at: Floats, values: Floats) -> float:
    """Where values on an even grid are lowest, by the parabola through the lowest three."""
    i = int(np.clip(values.argmin(), 1, len(at) - 2))
    before, here, after = values[i - 1 : i + 2]
    bend = before - 2.0 * here + after
    return float(at[i] + (0.5 * (before - after) / bend if bend > 0 else 0.0) * (at[1] - at[0]))


def _scale(moving: Sequence[Stretch], late: float) -> tuple[float, float, float]:
    """Correlation, scale and its standard error, each stretch counting by its motion."""
    products = []
    for one in moving:
        position, summed = _freed(one.time, one.position, _ahead(one, np.array([late]))[0])
        own, step = float(summed @ summed), one.velocity_noise * one.period
        whole = float(position @ position)
        square = max(own - (step * len(one.time)) ** 2 / 15.0, 0.5 * own, 1e-12 * whole)
        wander = np.cumsum(summed[::-1])[::-1]  # of a sum of noise, by the noise of each sample
        doubt = one.position_noise**2 * own + step**2 * float(wander @ wander)
        products.append((float(summed @ position), square, whole, doubt))
    across, squares, wholes, doubts = np.array(products).T
    slopes, weights = across / squares, wholes / wholes.sum()
    correlation = _reached(across / np.sqrt(squares * wholes), weights)
    scale = _weighted_median(slopes, weights)
    if len(slopes) < FEWEST_STRETCHES:
        return correlation, scale, np.inf
    spread = 1.4826 * _weighted_median(np.abs(slopes - scale), weights) * np.sqrt((weights**2).sum())
    least = np.sqrt((weights**2 * doubts / squares**2).sum())
    return correlation, scale, 1.2533 * float(max(spread, least))


def _reached(correlations: Floats, weights: Floats) -> float:
    """The correlation that four of five stretches reach, to the side of most: sums of anything look alike in one."""
    most = _weighted_median(correlations, weights)
    least = _weighted_median(correlations, weights, 0.2 if most > 0 else 0.8)
    return least if least * most > 0 else 0.0


def _weighted_median(values: Floats, weights: Floats, share: float = 0.5) -> float:
    order = np.argsort(values)
    below = np.cumsum(weights[order]) / weights.sum()
    return float(values[order][np.searchsorted(below, share)])


def _pace(moving: Sequence[Stretch], name: str) -> float:
    """Median time between new values of a sensor [s] while the vehicle moves: a slow one is held between readings."""
    times = []
    for one in moving:
        values = getattr(one, name)
        fast = np.abs(one.velocity - np.median(one.velocity)) > 0.25 * np.abs(one.velocity).max()
        fresh = np.flatnonzero(np.diff(values) != 0)
        spans = np.diff(one.time[fresh])
        chosen = spans[fast[fresh[1:]]] if len(spans) else spans
        times.append(median(chosen) if len(chosen) > 3 else one.period)
    return median(np.array(times))
