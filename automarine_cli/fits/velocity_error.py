"""The paper's method: steady rate and velocity error of each half-turn's tail, drag from the rates, inertia
from the errors.

Tail: the straight end of a half-turn. Its line has the steady rate as slope; its intercept at the instant of
the step, less the start heading, is the velocity error (equation 5). Inertia follows by equation 7 (model
1), 9 (model 3) or their common generalisation (model 2) with the drag of Table 1. A line fitted too early
still sees the transient: the tail starts at the earliest angle where the whole procedure, run on its own
noise-free answer, is off by less than `BIAS_LIMIT` in inertia and drag.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from automarine_cli.dofs import Dof
from automarine_cli.errors import FitError
from automarine_cli.fits.drag import DragFit, fit_drag, fit_drag_by_way
from automarine_cli.fits.inertia_table import InertiaTable, inertia_table
from automarine_cli.fits.step_response import StepData
from automarine_cli.models.closed_form import inertia_from_velocity_error, response

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

BIAS_LIMIT = 0.005
AIM = 0.0045  # leaves room for the bias of the reference itself
FEWEST_TAIL_SAMPLES = 3
ANGLES = np.radians(np.arange(30.0, 169.0, 2.0))


@dataclass(frozen=True)
class TailLines:
    """Straight ends of R half-turns: steady rate (R,) [rad/s], velocity error (R,) [rad], samples used (R,
    N)."""

    rate: Floats
    error: Floats
    used: Mask


@dataclass(frozen=True)
class VelocityErrorFit:
    """Tables 1 and 2 by the paper's method.

    `tail_from` [rad] turned angle at which the tail starts, `bias` its own relative bias (inertia, drag) on
    the noise-free response, which the intervals hold, `steady` whether that is within BIAS_LIMIT. `inertia["2"]` or
    `drag["2"]` is absent where the moments cannot carry model 2, `inertia["2"]` also where its drag has no steady rate.
    """

    tail_from: float
    bias: tuple[float, float]
    steady: bool
    tails: TailLines
    drag: Mapping[str, DragFit]
    inertia: Mapping[str, InertiaTable]


def fit_velocity_error(
    data: StepData,
    start_heading: Floats,
    offset: float = 0.0,
    moment_unit: str = "nu",
    models: Sequence[str] = ("1", "2", "3", "3+c"),
) -> VelocityErrorFit:
    """Run the paper's method on half-turns, for some of the readings of Table 1 (see drag.py).

    `start_heading` (R,) [rad] on the scale of `data.heading`; `offset` moves every instant of a step by that
    share of its switch interval (the logger's convention). Raises FitError where too few runs or samples are
    left.
    """
    time, dof, words = data.time - offset * data.interval[:, None], data.dof, data.dof.words
    if len(data.moment) < 3 or len(np.unique(np.abs(data.moment))) < 2:
        raise FitError(
            f"{len(data.moment)} {words.step}s at {len(np.unique(np.abs(data.moment)))} sizes of {words.force} cannot "
            "carry Table 1; "
            f"run at least 3 steps at 2 {words.force}s"
        )
    used = _last_share(time, data.seen, 0.3)
    noise = _noise_about_lines(time, data.heading, used, dof)
    for _ in range(3):  # the reference that places the tail comes from the tail: two rounds settle it
        tails = tail_lines(time, data.heading, start_heading, used, dof)
        reference = _reference(data.moment, tails, dof)
        tail_from, bias = _choose_tail(time, data, reference, noise)
        before, used = used, _tail_mask(time, data, reference, tail_from)
        if np.array_equal(used, before):
            break
    tails = tail_lines(time, data.heading, start_heading, used, dof)
    drag, inertia = {}, {}
    for model in models:
        if model in ("2", "3+c") and (len(data.moment) < 4 or len(np.unique(np.abs(data.moment))) < 2):
            continue
        if model == "3+c" and dof.has_constant:  # its constant is part of every model there
            continue
        fit = fit_drag_by_way(data.moment, tails.rate, model, moment_unit, dof)
        estimates = {name: one.holding_bias(bias[1]) for name, one in fit.estimates.items()}
        drag[model] = replace(fit, estimates=estimates)
        table = (
            None
            if model == "3+c"
            else inertia_table(data.moment, tails.rate, tails.error, fit, moment_unit, dof)
        )
        if table is not None:
            inertia[model] = replace(table, overall=table.overall.holding_bias(bias[0]))
    return VelocityErrorFit(float(tail_from), bias, max(np.abs(bias)) <= BIAS_LIMIT, tails, drag, inertia)


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


def _too_few(samples: int, dof: Dof) -> FitError:
    return FitError(
        f"only {samples} samples in the steady tail of a {dof.words.step} where {FEWEST_TAIL_SAMPLES} are needed; "
        f"log the {dof.words.position} faster, or drop the highest {dof.words.force}s"
    )


def _last_share(time: Floats, seen: Mask, share: float) -> Mask:
    """Samples in the last share of the time since the step."""
    end = np.where(seen, time, -np.inf).max(axis=1)
    return seen & (time >= (1.0 - share) * end[:, None])


@dataclass(frozen=True)
class _Reference:
    """A model good enough to say when a turn is steady."""

    inertia: float
    drag: DragFit

    def answer(self, time: Floats, moment: Floats) -> Floats:
        """Noise-free headings (R, N)."""
        acting = [np.asarray(x)[..., None] for x in self.drag.acting(moment)]
        return response(time, acting[0], self.inertia, *acting[1:])[0]

    def heading(self, time: Floats, moment: Floats) -> Floats:
        return np.abs(self.answer(time, moment))


def _reference(moment: Floats, tails: TailLines, dof: Dof) -> _Reference:
    """Model 1 or 3, whichever fits the first tails better, with its median inertia."""
    fits = [fit_drag_by_way(moment, tails.rate, model, dof.units.forces[0], dof) for model in ("1", "3")]
    best = min(fits, key=lambda fit: fit.sse)
    inertia = float(np.median(inertia_from_velocity_error(tails.error, *best.acting(moment))))
    if inertia <= 0 or max(best.drag) <= 0:
        raise FitError(
            dof.fill(
                "the {step}s give a negative {inertia} or drag: the {position} runs ahead of its steady line or "
                "against the {force}; "
                "check the sign of the {force} and of the {position} (--columns), and that each step starts from rest"
            )
        )
    return _Reference(inertia, best)


def _tail_mask(time: Floats, data: StepData, model: _Reference, start: float) -> Mask:
    """Samples past the turned angle `start` by the reference model, so that noise does not choose them; at
    least a few."""
    past = data.seen & (model.heading(time, data.moment) >= start)
    few = (
        data.seen & (np.arange(time.shape[1]) > _last(data.seen)[:, None] - FEWEST_TAIL_SAMPLES) & (time > 0)
    )
    return past | few


def _noise_about_lines(time: Floats, heading: Floats, used: Mask, dof: Dof) -> float:
    """Root mean square [rad] of the headings about the line of each run."""
    lines = tail_lines(time, heading, np.zeros(len(time)), used, dof)
    off = (heading - lines.error[:, None] - lines.rate[:, None] * time)[used]
    return float(np.sqrt(off @ off / max(used.sum() - 2 * len(time), 1)))


@dataclass(frozen=True)
class _Lines:
    """Lines through the ends of R runs from A places each, all (R, A): rate [rad/s], intercept at time 0 [rad],
    samples, their mean time [s] and their sum of squared times about it [s²]."""

    rate: Floats
    error: Floats
    count: Floats
    mean: Floats
    spread: Floats


def _lines_to_the_end(
    time: Floats, heading: Floats, seen: Mask, first: NDArray[np.int64], dof: Dof
) -> _Lines:
    """Least-squares lines from the samples `first` (R, A) of each run to its last, by sums from behind."""
    runs = np.arange(len(time))[:, None]
    last = _last(seen)[:, None]
    t, h = (np.where(seen, x - np.take_along_axis(x, last, axis=1), 0.0) for x in (time, heading))
    count, sum_t, sum_h, sum_tt, sum_th = (
        np.cumsum(x[:, ::-1], axis=1)[:, ::-1][runs, first] for x in (seen * 1.0, t, h, t * t, t * h)
    )
    if np.any(count < FEWEST_TAIL_SAMPLES):
        raise _too_few(int(count.min()), dof)
    spread = sum_tt - sum_t**2 / count
    rate = (sum_th - sum_t * sum_h / count) / spread
    mean = sum_t / count + np.take_along_axis(time, last, axis=1)
    mean_h = sum_h / count + np.take_along_axis(heading, last, axis=1)
    return _Lines(rate, mean_h - rate * mean, count, mean, spread)


def _last(seen: Mask) -> NDArray[np.int64]:
    """Index of the last sample of each run, (R,)."""
    return np.asarray(seen.shape[1] - 1 - np.argmax(seen[:, ::-1], axis=1))


def _choose_tail(
    time: Floats, data: StepData, model: _Reference, noise: float
) -> tuple[float, tuple[float, float]]:
    """Earliest tail start whose own bias is within the limit; where none is, the one of least error, bias and
    noise taken together (the least bias alone would always take the last few samples)."""
    exact, like, starts = model.answer(time, data.moment), model.drag, _starts(data)
    last, begun = _last(data.seen), np.argmax(data.seen & (time > 0), axis=1)
    few = np.maximum(last - FEWEST_TAIL_SAMPLES + 1, begun)
    # the reference turns one way: what is past an angle is what comes after the first sample past it
    past = [np.searchsorted(np.abs(psi[: n + 1]), starts) for psi, n in zip(exact, last)]
    lines = _lines_to_the_end(time, exact, data.seen, np.minimum(past, few[:, None]), data.dof)
    linear, quadratic = like.drag
    if data.dof.wraps:
        of_first, moment = quadratic == 0, data.moment[:, None]
        x = lines.rate if of_first else np.abs(lines.rate) * lines.rate
        drag = (x * moment).sum(axis=0) / (x * x).sum(axis=0)
        inertia = inertia_from_velocity_error(
            lines.error, moment, drag * of_first, drag * (not of_first)
        ).mean(axis=0)
    else:
        found = [_like(like, data, rate, error) for rate, error in zip(lines.rate.T, lines.error.T)]
        inertia, drag = np.array(found).T
    biases = np.stack([inertia / model.inertia - 1.0, drag / max(linear, quadratic) - 1.0])
    worst = np.abs(biases).max(axis=0)
    # relative standard error of a mean over the velocity errors
    variance = noise**2 * (1.0 / lines.count + lines.mean**2 / lines.spread) / lines.error**2
    error = np.hypot(worst, np.sqrt(variance.sum(axis=0)) / len(time))
    best = int(np.argmax(worst <= AIM) if np.any(worst <= AIM) else np.argmin(error))
    return float(starts[best]), (float(biases[0, best]), float(biases[1, best]))


def _like(like: DragFit, data: StepData, rate: Floats, error: Floats) -> tuple[float, float]:
    """Inertia and drag of a translation by tails of these rates and velocity errors (R,), in the form of `like`."""
    fit = fit_drag(data.moment, rate, like.model, data.dof.units.forces[0], data.dof, sided=like.sided)
    return float(np.mean(inertia_from_velocity_error(error, *fit.acting(data.moment)))), max(fit.drag)


def _starts(data: StepData) -> Floats:
    """Where a tail may start: angles in yaw, else shares of the way of the run that went least."""
    if data.dof.wraps:
        return ANGLES
    ways = np.abs(np.where(data.seen, data.heading, 0.0)).max(axis=1)
    return np.asarray(np.linspace(0.15, 0.95, 70) * ways.min())
