"""Where the tails of a campaign start: where drag and inertia are expected to be off least.

A line through a turn that is not steady yet is too flat, one through a short tail scatters with the heading's noise.
Both follow from a rough model of the vehicle by its closed form, before any tail is chosen by its result.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from automarine_cli.dofs import Dof
from automarine_cli.errors import FitError
from automarine_cli.fits.drag import DragFit, fit_drag_by_way
from automarine_cli.fits.step_response import AT_ONCE, StepData
from automarine_cli.fits.tails import TailLines, first_past, lines_to_the_end, tail_lines
from automarine_cli.models.closed_form import inertia_from_velocity_error, response, velocity_error
from automarine_cli.models.yaw_model import steady_rate
from automarine_cli.quantities import Floats

SHARES = np.arange(30.0, 166.0, 5.0) / 180.0
"""Of half a turn, or of the way of the run that went least: where a tail may start."""

BIAS_LIMIT = 0.005
"""Bias of the last of these tails up to which a campaign counts as steady."""

LEFT = 0.25
"""Share of a bias that is taken to be left when it has been taken off by the rough model."""

STEP = 1e-4
TINY = 1e-300


@dataclass(frozen=True)
class Reference:
    """A model good enough to say when a turn is steady: moment that acts on each run (R,), its drag, inertia."""

    inertia: float
    fit: DragFit
    acting: tuple[Floats, Floats | float, Floats | float]

    def answer(self, time: Floats) -> Floats:
        """Noise-free headings (R, N)."""
        moment, k_r, k_rr = (np.broadcast_to(x, len(time))[:, None] for x in self.acting)
        parts = [slice(i, i + AT_ONCE) for i in range(0, len(time), AT_ONCE)]
        return np.concatenate([response(time[p], moment[p], self.inertia, k_r[p], k_rr[p])[0] for p in parts])

    def balance(self, rate: Floats) -> tuple[Floats, Floats]:
        """Moment of the drag of each run at rates (R, A), and its slope on the rate."""
        k_r, k_rr = (np.asarray(x)[..., None] for x in self.acting[1:])
        return k_r * rate + k_rr * np.abs(rate) * rate, k_r + 2.0 * k_rr * np.abs(rate)

    def moved(self, inertia: float, drag: float) -> "Reference":
        """The same with more inertia and drag by these factors."""
        moment, k_r, k_rr = self.acting
        return replace(self, inertia=inertia * self.inertia, acting=(moment, drag * k_r, drag * k_rr))

    def read(self, tails: TailLines) -> tuple[Floats, Floats]:
        """Logarithms of inertia and of the factor of the drag by the tails, and the influence of each run on them
        (R, 2)."""
        drag, _ = (x[:, 0] for x in self.balance(tails.rate[:, None]))
        moment, k_r, k_rr = self.acting
        squares = drag @ drag
        factor = float(drag @ moment / squares)

        def inertia(drag: float) -> Floats:
            return inertia_from_velocity_error(tails.error, moment, drag * k_r, drag * k_rr)

        each = inertia(factor)
        by_drag = (inertia(factor * (1.0 + STEP)).mean() / each.mean() - 1.0) / STEP
        of_drag = drag * (moment - factor * drag) / (factor * squares)
        of_inertia = (each / each.mean() - 1.0) / len(each) + by_drag * of_drag
        return np.log([each.mean(), factor]), np.stack([of_inertia, of_drag], axis=1)

    def thrust_scatter(self, rate: Floats, variance: Floats) -> float:
        """Relative scatter of the moment from run to run that the rates (R,), of this variance by themselves, show."""
        moment, (drag, slope) = self.acting[0], (x[:, 0] for x in self.balance(rate[:, None]))
        spare = len(rate) / max(len(rate) - len(self.fit.estimates), 1)
        left = spare * np.sum((moment - drag) ** 2) - np.sum(slope**2 * variance)
        return float(np.sqrt(max(left, 0.0) / np.sum(moment**2)))

    def thrust_variance(self, thrust: float) -> Floats:
        """Variance (R,) of the steady rates by a relative scatter of the moment."""
        slope = self.balance(steady_rate(*self.acting)[:, None])[1][:, 0]
        return np.asarray((thrust * self.acting[0] / slope) ** 2)

    def like(self, other: "Reference", share: float) -> bool:
        """Whether the two differ by less than that share of inertia and drag."""
        mine, others = (np.array([one.inertia, *one.fit.drag]) for one in (self, other))
        return bool(np.abs(mine - others).max() <= share * np.abs(others).max())

    def steady(self, tails: TailLines, time: Floats) -> TailLines:
        """The tails without the part that is not steady yet: what a line through as much of the noise-free turn
        lacks."""
        lines = tail_lines(time, self.answer(time), np.zeros(len(time)), tails.used, self.fit.dof)
        rate = tails.rate * steady_rate(*self.acting) / lines.rate
        moment, *drag = self.acting
        return TailLines(rate, tails.error + velocity_error(moment, self.inertia, *drag) - lines.error, tails.used)


def reference(
    moment: Floats, tails: TailLines, variance: Floats | float, dof: Dof, models: Sequence[str] = ("1", "2", "3")
) -> Reference:
    """That of the models of Table 1 that explains both rates and velocity errors best for its number of terms.

    Thrust that scatters bends Table 1, but hardly moves the velocity errors: of model 3 they are the same at all
    moments, of model 1 they grow. Raises FitError where the best has no positive drag and inertia.
    """
    found = []
    for model in models:
        try:
            fit = fit_drag_by_way(moment, tails.rate, model, dof.units.forces[0], dof, variance)
        except FitError:
            if model != "2":
                raise
            continue
        acting = fit.acting(moment)
        each = inertia_from_velocity_error(tails.error, *acting)
        inertia = float(each.mean())
        left = float(np.sum((tails.error * (1.0 - inertia / each)) ** 2))
        if np.isfinite(left) and (model != "2" or min(fit.drag) > 0 or len(models) == 1):
            loss = fit.aicc + len(moment) * np.log(max(left, TINY))
            found.append((loss, Reference(inertia, fit, acting)))
    best = min(found, key=lambda one: one[0], default=(0.0, None))[1]
    if best is None or not best.inertia > 0 or max(best.fit.drag) <= 0:
        raise FitError(
            dof.fill(
                "the {step}s give a negative {inertia} or drag: the {position} runs ahead of its steady line or "
                "against the {force}; "
                "check the sign of the {force} and of the {position} (--columns), and that each step starts from rest"
            )
        )
    return best


@dataclass(frozen=True)
class Expected:
    """What tails from A places, `start` (A,) [rad or m], are expected to give: relative bias of inertia and drag
    (2, A) of lines through turns that are not steady yet, of drag by dilution (A,), and relative standard error of
    inertia and drag (2, A)."""

    start: Floats
    bias: Floats
    dilution: Floats
    noise: Floats

    @property
    def error(self) -> Floats:
        """Root mean square error (2, A) to be expected of inertia and drag, the known bias taken off."""
        bias = self.bias + np.stack([0.0 * self.dilution, self.dilution])
        return np.hypot(LEFT * bias, self.noise)

    def best(self) -> int:
        """The place where inertia and drag together are off least."""
        return int(np.argmin(np.sum(self.error**2, axis=0)))

    def told(self, dof: Dof, given: bool) -> str:
        """Where the tails start and why, of one place."""
        bias = 100.0 * self.bias + np.array([0.0, 100.0 * float(self.dilution)])
        parts = [
            f"{100 * error:.2g} % in {name} (noise {100 * noise:.2g} %, bias {own:+.2g} %)"
            for name, error, noise, own in zip((dof.symbols.inertia, "drag"), self.error, self.noise, bias)
        ]
        why = "as asked; errors to be expected there" if given else "where the errors to be expected are smallest"
        return (
            f"Tails start at {dof.shown(float(self.start)):.0f} {dof.units.shown}, {why}: {parts[1]}, {parts[0]}. "
            "The bias, of what is not steady yet and of noise that dilutes Table 1, is known and was taken off; a "
            "quarter of it counts as error."
        )

    def to_json(self, dof: Dof) -> dict[str, object]:
        """For the result file, of one place; shares of the value."""
        return {
            name: {"error": float(error), "noise": float(noise), "bias": float(own)}
            for name, error, noise, own in zip((dof.symbols.inertia, "drag"), self.error, self.noise, self.bias)
        } | {"dilution": float(self.dilution)}

    def at(self, i: int) -> "Expected":
        """One of the places alone."""
        return Expected(self.start[i], self.bias[:, i], self.dilution[i], self.noise[:, i])


def starts(data: StepData) -> Floats:
    """Where a tail may start [rad or m]."""
    ways = np.abs(np.where(data.seen, data.heading, 0.0)).max(axis=1)
    return np.asarray(SHARES * (data.dof.limits.trim if np.isfinite(data.dof.limits.trim) else ways.min()))


def expected(time: Floats, data: StepData, model: Reference, noise: float, thrust: float, start: Floats) -> Expected:
    """Bias and noise of tails that start at `start` (A,); `noise` [rad] of the heading, relative scatter of `thrust`.

    Drag is the factor of the reference's drag, by least squares of the moment on it; inertia the mean over the runs.
    """
    exact = model.answer(time)
    lines = lines_to_the_end(time, exact, data.seen, first_past(exact, time, data.seen, start), data.dof)
    moment, k_r, k_rr = (np.asarray(x)[..., None] for x in model.acting)
    drag, slope = model.balance(lines.rate)
    squares = (drag**2).sum(axis=0)
    factor = (moment * drag).sum(axis=0) / squares

    def inertia(more: float) -> Floats:
        known = factor * (1.0 + more)
        return np.asarray(inertia_from_velocity_error(lines.error, moment, known * k_r, known * k_rr))

    each = inertia(0.0)
    mean = each.mean(axis=0)
    by_drag = (inertia(STEP).mean(axis=0) / mean - 1.0) / STEP
    of_rate, of_error, shared = _of_lines(lines.count, lines.mean, lines.spread, noise)
    of_error = of_error + (lines.rate**2 * data.interval[:, None] ** 2 / 12.0) + _of_start(data, time, noise)
    of_rate = of_rate + (thrust * moment / slope) ** 2
    rate_moves = -drag * slope / squares  # the logarithm of drag
    error_moves = each / lines.error / (mean * len(time))  # that of inertia
    of_drag = np.sum(rate_moves**2 * of_rate, axis=0)
    cross = np.sum(error_moves * rate_moves * shared, axis=0)
    of_inertia = np.sum(error_moves**2 * of_error, axis=0) + 2.0 * by_drag * cross + by_drag**2 * of_drag
    return Expected(
        start,
        np.stack([mean / model.inertia, factor]) - 1.0,
        -np.sum(slope**2 * of_rate, axis=0) / squares,
        np.sqrt(np.stack([of_inertia, of_drag])),
    )


def rate_variance(time: Floats, tails: TailLines, noise: float) -> Floats:
    """Variance (R,) of the steady rates by the heading's noise alone."""
    count = tails.used.sum(axis=1)
    mean = np.sum(time * tails.used, axis=1) / count
    return np.asarray(noise**2 / np.sum((time - mean[:, None]) ** 2 * tails.used, axis=1))


def _of_lines(count: Floats, mean: Floats, spread: Floats, noise: float) -> tuple[Floats, Floats, Floats]:
    """Variances of slope and intercept of lines, and their covariance, by the heading's noise."""
    return noise**2 / spread, noise**2 * (1.0 / count + mean**2 / spread), -(noise**2) * mean / spread


def _of_start(data: StepData, time: Floats, noise: float) -> Floats:
    """Variance (R, 1) of the start headings by the rest before the steps; none where they are known without it."""
    rest = np.sum(data.seen & (time < 0), axis=1, keepdims=True)
    return np.where(rest > 0, noise**2 / np.maximum(rest, 1), 0.0)
