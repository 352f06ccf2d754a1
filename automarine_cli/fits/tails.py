"""The straight ends of half-turns: lines through them, which samples they are of, and what noise does to them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from automarine_cli.dofs import Dof
from automarine_cli.errors import FitError, SettingError
from automarine_cli.quantities import Floats

Mask = NDArray[np.bool_]

FEWEST_TAIL_SAMPLES = 3

EARLIEST, LATEST = 15.0, 165.0
"""Of half a turn, [degrees]: before it nothing is steady, after it nothing is left."""


@dataclass(frozen=True)
class TailLines:
    """Straight ends of R half-turns: steady rate (R,) [rad/s], velocity error (R,) [rad], samples used (R,
    N)."""

    rate: Floats
    error: Floats
    used: Mask


@dataclass(frozen=True)
class Lines:
    """Lines through the ends of R runs from A places each, all (R, A): rate [rad/s], intercept at time 0 [rad],
    samples, their mean time [s] and their sum of squared times about it [s²]."""

    rate: Floats
    error: Floats
    count: Floats
    mean: Floats
    spread: Floats


def tail_lines(time: Floats, heading: Floats, start_heading: Floats, used: Mask, dof: Dof) -> TailLines:
    """Least-squares line through the used samples of each run: shapes (..., R, N); slope and intercept at
    time 0."""
    count = used.sum(axis=-1)
    if np.any(count < FEWEST_TAIL_SAMPLES):
        raise _too_few(int(count.min()), dof)
    mean_t = np.sum(time * used, axis=-1) / count
    mean_h = np.sum(heading * used, axis=-1) / count
    spread = (time - mean_t[..., None]) * used
    rate = np.sum(spread * (heading - mean_h[..., None]), axis=-1) / np.sum(spread**2, axis=-1)
    return TailLines(rate, mean_h - rate * mean_t - start_heading, used)


def lines_to_the_end(time: Floats, heading: Floats, seen: Mask, first: NDArray[np.int64], dof: Dof) -> Lines:
    """Least-squares lines from the samples `first` (R, A) of each run to its last, by sums from behind."""
    runs = np.arange(len(time))[:, None]
    last = last_sample(seen)[:, None]

    def summed(x: Floats) -> Floats:
        return np.asarray(np.cumsum(x[:, ::-1], axis=1)[:, ::-1][runs, first])

    t, h = (np.where(seen, x - np.take_along_axis(x, last, axis=1), 0.0) for x in (time, heading))
    count, sum_t, sum_h = summed(seen.astype(float)), summed(t), summed(h)
    sum_tt, sum_th = summed(t * t), summed(t * h)
    if np.any(count < FEWEST_TAIL_SAMPLES):
        raise _too_few(int(count.min()), dof)
    spread = sum_tt - sum_t**2 / count
    rate = (sum_th - sum_t * sum_h / count) / spread
    mean = sum_t / count + np.take_along_axis(time, last, axis=1)
    mean_h = sum_h / count + np.take_along_axis(heading, last, axis=1)
    return Lines(rate, mean_h - rate * mean, count, mean, spread)


def first_past(turned: Floats, time: Floats, seen: Mask, starts: Floats) -> NDArray[np.int64]:
    """First sample (R, A) of each run whose noise-free turned angle (R, N) is past each start (A,) [rad]; at most so
    late that a few samples are left."""
    last, begun = last_sample(seen), np.argmax(seen & (time > 0), axis=1)
    few = np.maximum(last - FEWEST_TAIL_SAMPLES + 1, begun)
    # noise-free turns go one way: what is past an angle is what comes after the first sample past it
    past = [np.searchsorted(np.abs(psi[: n + 1]), starts) for psi, n in zip(turned, last)]
    return np.minimum(past, few[:, None])


def last_share(time: Floats, seen: Mask, share: float) -> Mask:
    """Samples in the last share of the time since the step."""
    end = np.where(seen, time, -np.inf).max(axis=1)
    return seen & (time >= (1.0 - share) * end[:, None])


def last_sample(seen: Mask) -> NDArray[np.int64]:
    """Index of the last sample of each run, (R,)."""
    return np.asarray(seen.shape[1] - 1 - np.argmax(seen[:, ::-1], axis=1))


def noise_about_lines(time: Floats, heading: Floats, used: Mask, dof: Dof) -> float:
    """Root mean square [rad] of the headings about the line of each run."""
    lines = tail_lines(time, heading, np.zeros(len(time)), used, dof)
    off = heading - lines.error[:, None]
    off -= lines.rate[:, None] * time
    off = off[used]
    return float(np.sqrt(off @ off / max(used.sum() - 2 * len(time), 1)))


def asked_tail(tail: float | None, dof: Dof) -> float | None:
    """The place [rad or m] where a person wants the tails to start, given as logs hold positions: degrees or metres.

    Raises SettingError where no tail could be.
    """
    if tail is None:
        return None
    if dof.wraps and not EARLIEST <= tail <= LATEST:
        raise SettingError(f"tail is {tail:g}; expected {EARLIEST:g} to {LATEST:g} degrees")
    if not (tail > 0 and np.isfinite(tail)):
        raise SettingError(f"tail is {tail:g}; expected metres above 0")
    return float(dof.inner(tail))


def checked_tail(tail: float, names: Sequence[str], heading: Floats, seen: Mask, dof: Dof) -> None:
    """Raises FitError where a run, of headings (R, N) less their start, does not get as far as `tail` [rad or m]."""
    far = np.abs(np.where(seen, heading, 0.0)).max(axis=1)
    short = int(np.argmin(far))
    if far[short] <= tail:
        raise FitError(
            f"the tails are to start at {dof.shown(tail):.0f} {dof.units.shown}, but {names[short]} ends at "
            f"{dof.shown(float(far[short])):.0f} {dof.units.shown}; let them start earlier, or leave that run out"
        )


def _too_few(samples: int, dof: Dof) -> FitError:
    return FitError(
        f"only {samples} samples in the steady tail of a {dof.words.step} where {FEWEST_TAIL_SAMPLES} are needed; "
        f"log the {dof.words.position} faster, or drop the highest {dof.words.force}s"
    )
