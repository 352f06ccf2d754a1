"""Positions predicted from filtered states: what a model is worth to somebody who looks some seconds ahead.

From every reading on, the filtered state is carried forward with the commands as they were logged and no further
reading; the disturbance fades as its process says. The filter knows only what was read until then.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from automarine_cli.filters.course import Course
from automarine_cli.filters.kalman import Followed, Noises, follow
from automarine_cli.filters.states import Step
from automarine_cli.models.vehicle import Vehicle
from automarine_cli.quantities import Floats
from automarine_cli.simulation.batch import Channel

HORIZONS = (2.0, 5.0, 15.0)
"""Seconds ahead."""
SETTLING = 2.0
"""Time [s] that a filter has before its first prediction counts."""
LOOKS_BACK = (0.5, 1.0, 2.0)
"""Lengths [s] over which a constant rate may be taken; the best of them counts, for it is the rival of the model."""


@dataclass(frozen=True)
class Predicted:
    """Predictions of one channel over one horizon [s]: from node `origin` (A,) of run `run` (A,) to its node `target`
    (A,), with the `error` (A,) measured less predicted, and those of a constant rate and a constant position."""

    horizon: float
    run: NDArray[np.int64]
    origin: NDArray[np.int64]
    target: NDArray[np.int64]
    error: Floats
    constant_rate: Floats
    constant: Floats

    def rmse(self, error: Floats | None = None) -> float:
        """Root mean square over all predictions; not a number where there are none."""
        of = self.error if error is None else error
        return float(np.sqrt(np.mean(of**2))) if len(of) else float("nan")

    def by_run(self, error: Floats, runs: int) -> Floats:
        """Mean square of each run (R,), not a number where a run has none."""
        total, count = np.zeros(runs), np.zeros(runs)
        np.add.at(total, self.run, error**2)
        np.add.at(count, self.run, 1.0)
        return np.divide(total, count, out=np.full(runs, np.nan), where=count > 0)


def predict(
    model: Vehicle,
    course: Course,
    theta: Floats,
    noises: Noises,
    horizons: Sequence[float] = HORIZONS,
    channel: int = 0,
    followed: Followed | None = None,
) -> tuple[Predicted, ...]:
    """Predictions of a channel under one parameter set theta (p,), with the sizes of what is random, from the states
    that were `followed`."""
    followed = followed or follow(model, course.unthinned, theta[None], noises, keep=True)
    assert followed.states is not None
    of, time = shown_channel(course, channel), course.time
    run, origin = np.nonzero(of.seen & (time >= SETTLING))
    targets = {h: targets_of(of.seen, time, run, origin, h) for h in horizons}
    last = np.max([np.where(at >= 0, at, 0) for at in targets.values()], axis=0)
    path = carried(model, course, theta, noises, followed.states[:, 0], of, run, origin, last)
    rates = _rates(of, time, run, origin, targets)
    here = of.values[run, origin]
    found = []
    for h, target in targets.items():
        have = target >= 0
        r, o, t = run[have], origin[have], target[have]
        measured = of.values[r, t]
        found.append(
            Predicted(
                h, r, o, t,
                error=measured - path[have, t - o],
                constant_rate=measured - here[have] - rates[have] * (time[r, t] - time[r, o]),
                constant=measured - here[have],
            )
        )  # fmt: skip
    return tuple(found)


def shown_channel(course: Course, channel: int = 0) -> Channel:
    """The positions of a channel: its own readings, or the sum of its velocities by the trapezoidal rule; velocities in
    axes that turn have none."""
    of = course.channels[channel]
    if not of.velocity or course.motion.turns:
        return of
    summed = np.zeros_like(of.values)
    for row, values, seen, time in zip(summed, of.values, of.seen, course.time):
        steps = 0.5 * (values[seen][1:] + values[seen][:-1]) * np.diff(time[seen])
        row[seen] = np.concatenate([[0.0], np.cumsum(steps)])
    position = course.motion.positions[of.dof]
    return replace(of, quantity=position, velocity=False, values=summed, counts=False)


def free_run(model: Vehicle, course: Course, theta: Floats, noises: Noises, channel: int = 0) -> Floats:
    """A channel of each run simulated from its first filtered state on, (R, K + 1), with the logged commands and no
    further reading; not a number before that."""
    followed = follow(model, course.unthinned, theta[None], noises, keep=True)
    assert followed.states is not None
    of, time = shown_channel(course, channel), course.time
    late = of.seen & (time >= SETTLING)
    run = np.flatnonzero(late.any(axis=1))
    origin = late[run].argmax(axis=1)
    last = late.shape[1] - 1 - late[run, ::-1].argmax(axis=1)
    path = carried(model, course, theta, noises, followed.states[:, 0], of, run, origin, last)
    out = np.full(late.shape, np.nan)
    for r, begin, end, shown in zip(run, origin, last, path):
        out[r, begin : end + 1] = shown[: end - begin + 1]
    return out


def targets_of(
    seen: NDArray[np.bool_], time: Floats, run: NDArray[np.int64], origin: NDArray[np.int64], horizon: float
) -> NDArray[np.int64]:
    """The node with a reading nearest to `horizon` after each origin, (A,), -1 where none is within a fifth of it."""
    out = np.full(len(run), -1)
    for r in np.unique(run):
        own, read = run == r, np.flatnonzero(seen[r])
        wanted = time[r, origin[own]] + horizon
        after = np.clip(np.searchsorted(time[r, read], wanted), 1, len(read) - 1)
        nearer = np.where(
            wanted - time[r, read[after - 1]] < time[r, read[after]] - wanted, read[after - 1], read[after]
        )
        close = np.abs(time[r, nearer] - wanted) < 0.2 * horizon
        out[own] = np.where(close & (nearer > origin[own]), nearer, -1)
    return out


def carried(
    model: Vehicle,
    course: Course,
    theta: Floats,
    noises: Noises,
    states: Floats,
    channel: Channel,
    run: NDArray[np.int64],
    origin: NDArray[np.int64],
    last: NDArray[np.int64],
) -> Floats:
    """What the channel shows from each origin on, (A, longest + 1), every prediction being a run of its own.

    A channel that does not count is a sum of velocities, to which no filter is tied: how far it goes is told from where
    the sum is at the origin.
    """
    return carried_by(model, course, theta[None], noises, states, (channel,), run, origin, last)[0, 0]


def carried_by(
    model: Vehicle,
    course: Course,
    theta: Floats,
    noises: Noises,
    states: Floats,
    channels: Sequence[Channel],
    run: NDArray[np.int64],
    origin: NDArray[np.int64],
    last: NDArray[np.int64],
) -> Floats:
    """The same of C channels by each of P parameter sets (P, p): (C, P, A, longest + 1)."""
    longest = int(np.max(last - origin, initial=0))
    at = np.minimum(origin[:, None] + np.arange(longest), course.length.shape[1] - 1)
    step = Step(model, course, theta, noises.late)
    cut = replace(
        course,
        names=tuple(course.names[r] for r in run),
        length=course.length[run[:, None], at] * (origin[:, None] + np.arange(longest) < last[:, None]),
    )
    own = step.of_pieces(cut, course.time[run, origin], run, at)
    mean = np.repeat(states[:, run, origin][:, None], len(theta), axis=1)
    spread = np.zeros((len(theta), len(run), len(mean), len(mean)))
    shown = np.zeros((len(channels), len(theta), len(run), longest + 1))
    with np.errstate(over="ignore", invalid="ignore"):
        for m in range(longest + 1):
            for c, channel in enumerate(channels):
                shown[c, ..., m] = own.reading(channel, m, mean, spread)[0]
            if m == longest:
                break
            fade = np.exp(-cut.length[:, m] / noises.time[:, :, None])
            ramp = (1.0 - fade) * noises.time[:, :, None] / np.maximum(cut.length[:, m], 1e-12)
            mean = own.moved(m, mean, ramp)
            for d, place in enumerate(own.places.pushed):
                mean[place] = mean[place] * fade[d]
    for path, channel in zip(shown, channels):
        if not channel.counts:
            path += (channel.values[run, origin] - path[..., 0])[..., None]
    return shown


def _rates(
    channel: Channel,
    time: Floats,
    run: NDArray[np.int64],
    origin: NDArray[np.int64],
    targets: dict[float, NDArray[np.int64]],
) -> Floats:
    """The rate at each origin by a straight line through the readings before it, (A,); of several lengths of that
    line the one that predicts best over the middle horizon."""
    middle = sorted(targets)[(len(targets) - 1) // 2]
    target, best, least = targets[middle], np.zeros(len(run)), np.inf
    have = target >= 0
    for length in LOOKS_BACK:
        rates = np.zeros(len(run))
        for r in np.unique(run):
            read = np.flatnonzero(channel.seen[r])
            t, x = time[r, read], channel.values[r, read]
            own = np.flatnonzero(run == r)
            end = np.searchsorted(read, origin[own], side="right")
            begin = np.minimum(np.searchsorted(t, t[end - 1] - length - 1e-9), np.maximum(end - 2, 0))
            rates[own] = _lines(t, x, begin, end)
        missed = channel.values[run, target] - channel.values[run, origin]
        missed = missed - rates * (time[run, target] - time[run, origin])
        size = float(np.mean(missed[have] ** 2)) if have.any() else 0.0
        if size < least:
            best, least = rates, size
    return best


def _lines(t: Floats, x: Floats, begin: NDArray[np.int64], end: NDArray[np.int64]) -> Floats:
    """Slopes of least-squares lines through t[begin:end], x[begin:end], all at once."""
    t, x = t - t[0], x - x[0]
    sums = [np.concatenate([[0.0], np.cumsum(v)]) for v in (np.ones_like(t), t, x, t * t, t * x)]
    n, st, sx, stt, stx = (s[end] - s[begin] for s in sums)
    below = n * stt - st**2
    return np.divide(n * stx - st * sx, below, out=np.zeros_like(below), where=below > 1e-12)
