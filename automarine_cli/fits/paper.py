"""The paper's method: steady rate and velocity error of each half-turn's tail, drag from the rates, inertia
from the errors.

Tail: the straight end of a half-turn. Its line has the steady rate as slope; its intercept at the instant of
the step, less the start heading, is the velocity error (equation 5). Inertia follows by equation 7 (model
1), 9 (model 3) or their common generalisation (model 2) with the drag of Table 1. All tails start at one angle, where
drag and inertia are expected to be off least. What is known to bias them is taken off: the closed form
of a rough model says by how much a line through this tail misses the steady one, the noise of the rates what it
dilutes.
"""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import special

from automarine_cli.dofs import Dof
from automarine_cli.errors import FitError, SettingError
from automarine_cli.estimate import Estimate
from automarine_cli.fits.linear_mixed import solve_scaled
from automarine_cli.fits.steps import StepData
from automarine_cli.models.model import (
    Model,
    base_roles,
    inertia_from_velocity_error,
    main_drag,
    response,
    steady_rate,
    velocity_error,
)
from automarine_cli.quantities import Floats

MODEL_NUMBERS: tuple[str, ...] = ("1", "2", "3")
MIN_A_WAY = 3  # runs each way from which on it is asked whether drag differs
MAX_DILUTED = 0.5  # share of a sum that is taken off as noise at most: where more is noise, what is left says little


@dataclass(frozen=True)
class DragFit:
    """Least squares of one drag model, `curve` with any inertia: estimates by name; SSE [moment²], AICc and
    residuals (R,) [moment] of the plain least squares.

    `variance` (R,) [rad²/s²] is that of the rates whose dilution was taken off, `dilution` by how much that moved each
    estimate from the plain least squares, `explained` [moment²] what of the moments' squares the model explains;
    `influence` (R, p) is how far each run moves the estimates. `powers` are the regressors'.
    """

    model: str
    curve: Model
    powers: Mapping[str, int]
    estimates: dict[str, Estimate]
    sse: float
    aicc: float
    residuals: Floats
    variance: Floats
    dilution: Mapping[str, float]
    explained: float
    influence: Floats

    def acting(
        self, moment: Floats, values: Iterable[float] | None = None
    ) -> tuple[Floats, Floats | float, Floats | float]:
        """What each run (R,) moves by: the moment with the constant one, linear and quadratic drag on its way; with
        other `values` than those of the estimates, in their order."""
        return (self.curve if values is None else self.curve.with_theta([1.0, *values])).acting(moment)

    @property
    def drag(self) -> tuple[float, float]:
        return self.curve.drag()


def powers_of(model: str, dof: Dof, sided: bool = False) -> dict[str, int]:
    """The power of the rate that each parameter of a drag model stands before, by what it is."""
    powers = {"quadratic": 2, "linear": 1, "constant": 0, "difference": 1 if model == "1" else 2}
    return {role: powers[role] for role in base_roles(model, dof, sided)[1:]}


def regressors(rate: Floats, powers: Mapping[str, int]) -> Floats:
    """Regressor columns (R, p) of a drag model for steady rates (R,) [rad/s]."""
    signs = {"constant": -np.ones_like(rate), "difference": np.ones_like(rate)}
    return np.stack([signs.get(role, np.sign(rate)) * np.abs(rate) ** power for role, power in powers.items()], axis=1)


@dataclass(frozen=True)
class Sums:
    """Each run's part of the normal equations of a drag model, noise of the rates taken off: squares (R, p, p), their
    products with the moment (R, p)."""

    squares: Floats
    products: Floats

    def solve(self) -> tuple[Floats, Floats]:
        """Values (p,) and the inverse (p, p) of the sum of squares."""
        inverse = np.linalg.inv(self.squares.sum(axis=0))
        return inverse @ self.products.sum(axis=0), inverse


def sums(moment: Floats, rate: Floats, variance: Floats | float, powers: Mapping[str, int]) -> Sums:
    """The normal equations of moments (R,) on the regressors of rates (R,) of that variance [rad²/s²]."""
    power, sign = np.array([*powers.values()]), regressors(np.sign(rate), powers)
    hermite = without_noise(rate, variance)
    products = sign * hermite[:, power] * moment[:, None]
    return Sums(sign[:, :, None] * sign[:, None, :] * hermite[:, power[:, None] + power], products)


def without_noise(rate: Floats, variance: Floats | float) -> Floats:
    """Powers 0 to 4 of the size of rates (R,) without what noise of this variance adds to their means, (R, 5)."""
    w, v = np.abs(rate), np.broadcast_to(variance, rate.shape)
    powers = [np.ones_like(w), w, w**2 - v, w**3 - 3.0 * v * w, w**4 - 6.0 * v * w**2 + 3.0 * v**2]
    return np.stack(powers, axis=1)


def fit_drag_by_way(
    moment: Floats, rate: Floats, model: str, moment_unit: str, dof: Dof, variance: Floats | float = 0.0
) -> DragFit:
    """`fit_drag`; of a motion whose drag may differ between its two ways with that, where the points show it."""
    if dof.directional and min(np.sum(rate > 0), np.sum(rate < 0)) >= MIN_A_WAY:
        with suppress(FitError):
            apart = fit_drag(moment, rate, model, moment_unit, dof, sided=True, variance=variance)
            low, high = apart.estimates[dof.symbols.difference].ci95
            if low > 0 or high < 0:
                return apart
    return fit_drag(moment, rate, model, moment_unit, dof, variance=variance)


def fit_drag(
    moment: Floats, rate: Floats, model: str, moment_unit: str, dof: Dof, sided: bool = False,
    variance: Floats | float = 0.0,
) -> DragFit:  # fmt: skip
    """Fit one drag model to steady points: moments (R,) and rates (R,) [rad/s] of known variance [rad²/s²], 0 or (R,).

    Raises FitError for fewer points than the model needs or points that cannot tell its terms apart.
    """
    powers = powers_of(model, dof, sided)
    x = regressors(rate, powers)
    points, count = x.shape
    if points < count + 1 or np.linalg.matrix_rank(x / np.abs(x).max(axis=0)) < count:
        sizes = len(np.unique(np.round(np.abs(moment), 9)))
        raise FitError(
            f"model {model} of Table 1 needs at least {count + 1} runs and as many sizes of {dof.words.force} as it "
            f"has drag terms ({count}); there are {points} at {sizes}: run more {dof.words.force}s"
        )
    plain = sums(moment, rate, 0.0, powers)
    variance = np.broadcast_to(variance, rate.shape) * _credible(plain, sums(moment, rate, variance, powers))
    corrected = sums(moment, rate, variance, powers)
    values, inverse = corrected.solve()
    without = plain.solve()[0]
    residuals = moment - x @ without
    leverage = np.einsum("rp,pk,rk->r", x, inverse, x)
    score = (corrected.products - corrected.squares @ values) / np.maximum(1.0 - leverage, 1e-6)[:, None]
    influence = score @ inverse
    stderr = np.sqrt(np.sum(influence**2, axis=0))
    sse = float(residuals @ residuals)
    estimates = {
        dof.parameters[role]: Estimate.from_stderr(
            v, e, points - count, dof.unit_of(main_drag(model) if role == "difference" else role, moment_unit)
        )
        for role, v, e in zip(powers, values, stderr)
    }
    dilution = dict(zip(estimates, (values - without).tolist()))
    explained = float(corrected.products.sum(axis=0) @ values)
    k = count + 1  # the noise variance is a parameter; corrected for few points (Hurvich and Tsai 1989)
    correction = 2.0 * k * (k + 1) / (points - k - 1) if points > k + 1 else np.inf
    aicc = float(points * np.log(max(sse, 1e-300) / points) + 2.0 * k + correction)
    curve = Model.base(model, 1.0, values, moment_unit, dof)
    return DragFit(model, curve, powers, estimates, sse, aicc, residuals, variance, dilution, explained, influence)


def _credible(plain: Sums, corrected: Sums) -> float:
    """The share of the variance whose dilution can be taken off: all, but where it would be most of some sum."""
    squares = plain.squares.sum(axis=0)
    noise = squares - corrected.squares.sum(axis=0)
    worst = float(np.linalg.eigvals(np.linalg.solve(squares, noise)).real.max())
    return min(1.0, MAX_DILUTED / worst) if worst > 0 else 1.0


def nested_test(small: DragFit, large: DragFit) -> dict[str, Any] | None:
    """F test, `f` with `dof` and `p_value`: does the larger of two nested models explain more than chance would? Both
    with the same noise taken off. None where they are not nested: one has a drag that differs between the ways."""
    if not small.powers.items() < large.powers.items():
        return None
    more = len(large.estimates) - len(small.estimates)
    freedom = len(large.residuals) - len(large.estimates)
    f = max(large.explained - small.explained, 0.0) / more / max(large.sse / freedom, 1e-300)
    return {"f": float(f), "dof": (more, freedom), "p_value": float(special.fdtrc(more, freedom, f))}


Mask = NDArray[np.bool_]

MIN_TAIL_SAMPLES = 3
EARLIEST, LATEST = 15.0, 165.0  # of half a turn, [degrees]: before it nothing is steady, after it nothing is left


@dataclass(frozen=True)
class TailLines:
    """Straight ends of R half-turns: steady rate (R,) [rad/s], velocity error (R,) [rad], samples used (R, N), their
    number, mean time [s] and sum of squared times about it [s²], all (R,)."""

    rate: Floats
    error: Floats
    used: Mask
    count: Floats
    mean: Floats
    spread: Floats

    def rate_variance(self, noise: float) -> Floats:
        """Variance (R,) of the steady rates by the heading's noise alone."""
        return np.asarray(noise**2 / self.spread)


def tail_lines(time: Floats, heading: Floats, start_heading: Floats, used: Mask, dof: Dof) -> TailLines:
    """Least-squares line through the used samples of each run (R, N): slope and intercept at time 0."""
    count = used.sum(axis=-1)
    if np.any(count < MIN_TAIL_SAMPLES):
        raise FitError(
            f"only {count.min()} samples in the steady tail of a {dof.words.step} where {MIN_TAIL_SAMPLES} are "
            f"needed; log the {dof.words.position} faster, or drop the highest {dof.words.force}s"
        )
    mean_t = np.sum(time * used, axis=-1) / count
    mean_h = np.sum(heading * used, axis=-1) / count
    times = (time - mean_t[..., None]) * used
    spread = np.sum(times**2, axis=-1)
    rate = np.sum(times * (heading - mean_h[..., None]), axis=-1) / spread
    return TailLines(rate, mean_h - rate * mean_t - start_heading, used, count, mean_t, spread)


def first_past(turned: Floats, time: Floats, observed: Mask, starts: Floats) -> NDArray[np.int64]:
    """First sample (R, A) of each run whose noise-free turn (R, N) is past each start (A,) [rad]; a few remain."""
    last = observed.shape[1] - 1 - np.argmax(observed[:, ::-1], axis=1)
    begun = np.argmax(observed & (time > 0), axis=1)
    few = np.maximum(last - MIN_TAIL_SAMPLES + 1, begun)
    # noise-free turns go one way: what is past an angle is what comes after the first sample past it
    past = [np.searchsorted(np.abs(psi[: n + 1]), starts) for psi, n in zip(turned, last)]
    return np.minimum(past, few[:, None])


def noise_about_lines(time: Floats, heading: Floats, used: Mask, dof: Dof) -> float:
    """Root mean square [rad] of the headings about the line of each run."""
    lines = tail_lines(time, heading, np.zeros(len(time)), used, dof)
    off = (heading - lines.error[:, None] - lines.rate[:, None] * time)[used]
    return float(np.sqrt(off @ off / max(used.sum() - 2 * len(time), 1)))


def parse_tail(tail: float | None, dof: Dof) -> float | None:
    """The place [rad or m] where a person wants the tails to start, given as logs hold positions: degrees or metres.

    Raises SettingError where no tail could be.
    """
    if tail is None:
        return None
    low, high = (EARLIEST, LATEST) if dof.wraps else (1e-300, np.finfo(float).max)
    if not low <= tail <= high:
        expected = f"{EARLIEST:g} to {LATEST:g} degrees" if dof.wraps else "metres above 0"
        raise SettingError(f"tail is {tail:g}; expected {expected}")
    return float(dof.inner(tail))


@dataclass(frozen=True)
class InertiaTable:
    """Table 2 for one model: inertia of each run (R,), mean at each moment, overall with its interval."""

    per_run: Floats
    per_moment: Mapping[float, float]
    overall: Estimate


MAX_RUNS_REFITTED = 200


def _without_each(moment: Floats, tails: TailLines, drag: DragFit) -> Floats:
    """Mean inertia (R,) without each run in turn, by the drag refitted without it: from its normal equations, of many
    runs to first order in the drag."""
    unit = np.abs(regressors(tails.rate, drag.powers)).max(axis=0)
    every = sums(moment, tails.rate, drag.variance, drag.powers)
    squares, products = every.squares / (unit[:, None] * unit), every.products / unit
    refitted = solve_scaled(squares.sum(axis=0) - squares, products.sum(axis=0) - products) / unit

    def inertias(values: Floats, keep: NDArray[np.bool_]) -> Floats:
        return inertia_from_velocity_error(tails.error[keep], *drag.acting(moment[keep], values.tolist()))

    runs, every_run = len(moment), np.ones(len(moment), dtype=bool)
    if runs <= MAX_RUNS_REFITTED:
        return np.array([inertias(values, np.arange(runs) != i).mean() for i, values in enumerate(refitted)])
    middle = solve_scaled(squares.sum(axis=0), products.sum(axis=0)) / unit
    per_run = inertias(middle, every_run)
    slope = [(inertias(middle + step, every_run) - per_run).mean() / step.sum() for step in LOG_STEP * np.diag(middle)]
    return np.asarray((per_run.sum() - per_run) / (runs - 1) + (refitted - middle) @ slope)


TAIL_SHARES = np.arange(30.0, 166.0, 5.0) / 180.0
"""Of half a turn, or of the way of the run that went least: where a tail may start."""

BIAS_LIMIT = 0.005  # bias of the last of these tails up to which a campaign counts as steady
BIAS_LEFT = 0.25  # share of a bias that is taken to be left when it has been taken off by the rough model
LOG_STEP = 1e-4
MIN_MISFIT = 1e-300


@dataclass(frozen=True)
class Reference:
    """A model good enough to say when a turn is steady: moment that acts on each run (R,), its drag, inertia."""

    inertia: float
    fit: DragFit
    acting: tuple[Floats, Floats | float, Floats | float]

    def answer(self, time: Floats) -> Floats:
        moment, k_r, k_rr = (np.broadcast_to(x, len(time))[:, None] for x in self.acting)
        return response(time, moment, self.inertia, k_r, k_rr)[0]

    def balance(self, rate: Floats) -> tuple[Floats, Floats]:
        """Moment of the drag of each run at rates (R, A), and its slope on the rate."""
        k_r, k_rr = (np.asarray(x)[..., None] for x in self.acting[1:])
        return k_r * rate + k_rr * np.abs(rate) * rate, k_r + 2.0 * k_rr * np.abs(rate)

    def moved(self, inertia: float, drag: float) -> "Reference":
        moment, k_r, k_rr = self.acting
        return replace(self, inertia=inertia * self.inertia, acting=(moment, drag * k_r, drag * k_rr))

    def told_by(self, rate: Floats, error: Floats) -> tuple[Floats, Floats, Floats]:
        """What steady rates and velocity errors (R, A) tell: the factor of this drag (A,) by least squares of the
        moment, each run's inertia (R, A), and how the logarithm of its mean moves with that of the factor (A,)."""
        moment, k_r, k_rr = (np.broadcast_to(x, len(rate))[:, None] for x in self.acting)
        drag, _ = self.balance(rate)
        factor = (moment * drag).sum(axis=0) / (drag**2).sum(axis=0)
        inertias, more = (
            inertia_from_velocity_error(error, moment, scale * k_r, scale * k_rr)
            for scale in (factor, factor * (1.0 + LOG_STEP))
        )
        return factor, inertias, (more.mean(axis=0) / inertias.mean(axis=0) - 1.0) / LOG_STEP

    def read(self, tails: TailLines) -> tuple[Floats, Floats]:
        """Logarithms of inertia and the drag's factor by the tails, and each run's influence on them (R, 2)."""
        rate, moment = tails.rate[:, None], self.acting[0]
        (factor,), inertias, by_drag = self.told_by(rate, tails.error[:, None])
        drag, mean = self.balance(rate)[0][:, 0], inertias.mean()
        of_drag = drag * (moment - factor * drag) / (factor * (drag @ drag))
        of_inertia = (inertias[:, 0] / mean - 1.0) / len(inertias) + by_drag * of_drag
        return np.log([mean, factor]), np.stack([of_inertia, of_drag], axis=1)

    def thrust_scatter(self, rate: Floats, variance: Floats) -> float:
        """Relative scatter of the moment from run to run that the rates (R,), of this variance by themselves, show."""
        moment, (drag, slope) = self.acting[0], (x[:, 0] for x in self.balance(rate[:, None]))
        spare = len(rate) / max(len(rate) - len(self.fit.estimates), 1)
        unexplained = spare * np.sum((moment - drag) ** 2) - np.sum(slope**2 * variance)
        return float(np.sqrt(max(unexplained, 0.0) / np.sum(moment**2)))

    def thrust_variance(self, thrust: float) -> Floats:
        """Variance (R,) of the steady rates by a relative scatter of the moment."""
        slope = self.balance(steady_rate(*self.acting)[:, None])[1][:, 0]
        return np.asarray((thrust * self.acting[0] / slope) ** 2)

    def like(self, other: "Reference", share: float) -> bool:
        mine, theirs = (np.array([model.inertia, *model.fit.drag]) for model in (self, other))
        return bool(np.abs(mine - theirs).max() <= share * np.abs(theirs).max())

    def steady(self, tails: TailLines, time: Floats) -> TailLines:
        """The tails less what is not steady yet: what a line through as much of the noise-free turn lacks."""
        lines = tail_lines(time, self.answer(time), np.zeros(len(time)), tails.used, self.fit.curve.dof)
        rate = tails.rate * steady_rate(*self.acting) / lines.rate
        moment, *drag = self.acting
        error = tails.error + velocity_error(moment, self.inertia, *drag) - lines.error
        return replace(tails, rate=rate, error=error)


def reference(
    moment: Floats, tails: TailLines, variance: Floats | float, dof: Dof, models: Sequence[str] = MODEL_NUMBERS
) -> Reference:
    """That of the models of Table 1 that explains both rates and velocity errors best for its number of terms.

    Thrust that scatters bends Table 1, but hardly moves the velocity errors: of model 3 they are the same at all
    moments, of model 1 they grow. Raises FitError where the best has no positive drag and inertia.
    """
    candidates = []
    for model in models:
        try:
            fit = fit_drag_by_way(moment, tails.rate, model, dof.units.forces[0], dof, variance)
        except FitError:
            if model != "2":
                raise
            continue
        acting = fit.acting(moment)
        inertias = inertia_from_velocity_error(tails.error, *acting)
        inertia = float(inertias.mean())
        misfit = float(np.sum((tails.error * (1.0 - inertia / inertias)) ** 2))
        if np.isfinite(misfit) and (model != "2" or min(fit.drag) > 0 or len(models) == 1):
            loss = fit.aicc + len(moment) * np.log(max(misfit, MIN_MISFIT))
            candidates.append((loss, Reference(inertia, fit, acting)))
    best = min(candidates, key=lambda candidate: candidate[0], default=(0.0, None))[1]
    if best is None or not best.inertia > 0 or max(best.fit.drag) <= 0:
        says = (
            "the {step}s give a negative {inertia} or drag: the {position} runs ahead of its steady line or against "
            "the {force}; check the sign of the {force} and of the {position} (--columns), and that each step starts "
            "from rest"
        )
        raise FitError(dof.fill(says))
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
        bias = self.bias + np.stack([np.zeros_like(self.dilution), self.dilution])
        return np.hypot(BIAS_LEFT * bias, self.noise)

    def sentence(self, dof: Dof, by_user: bool) -> str:
        inertia, drag = (f"{100 * error:.2g} %" for error in self.error)
        why = "as given" if by_user else "where the expected error is smallest"
        return (
            f"Steady part: from {dof.shown(float(self.start)):.0f} {dof.units.shown} on, {why}. Expected error: {drag} "
            f"(drag), {inertia} ({dof.words.inertia}); known bias subtracted."
        )


def expected(time: Floats, data: StepData, model: Reference, noise: float, thrust: float, start: Floats) -> Expected:
    """Bias and noise of tails that start at `start` (A,); `noise` [rad] of the heading, relative scatter of `thrust`.

    Drag is the factor of the reference's drag, by least squares of the moment on it; inertia the mean over the runs.
    """
    exact = model.answer(time)
    index, nothing = np.arange(time.shape[1]), np.zeros(len(time))
    ends = [data.observed & (index >= first[:, None]) for first in first_past(exact, time, data.observed, start).T]
    lines = [tail_lines(time, exact, nothing, used, data.dof) for used in ends]
    names = ("rate", "error", "count", "mean", "spread")
    rate, error, count, middle, spread = (np.stack([getattr(line, name) for line in lines], axis=1) for name in names)
    moment, (drag, slope) = model.acting[0][:, None], model.balance(rate)
    factor, inertias, by_drag = model.told_by(rate, error)
    squares, mean = (drag**2).sum(axis=0), inertias.mean(axis=0)
    resting = np.sum(data.observed & (time < 0), axis=1, keepdims=True)  # tells the start; without, that is known
    of_start = np.where(resting > 0, noise**2 / np.maximum(resting, 1), 0.0)
    of_error = noise**2 * (1.0 / count + middle**2 / spread) + rate**2 * data.interval[:, None] ** 2 / 12.0 + of_start
    of_rate = noise**2 / spread + (thrust * moment / slope) ** 2
    shared = -(noise**2) * middle / spread
    rate_moves = -drag * slope / squares  # the logarithm of drag
    error_moves = inertias / error / (mean * len(time))  # that of inertia
    of_drag = np.sum(rate_moves**2 * of_rate, axis=0)
    cross = np.sum(error_moves * rate_moves * shared, axis=0)
    of_inertia = np.sum(error_moves**2 * of_error, axis=0) + 2.0 * by_drag * cross + by_drag**2 * of_drag
    return Expected(
        start,
        np.stack([mean / model.inertia, factor]) - 1.0,
        -np.sum(slope**2 * of_rate, axis=0) / squares,
        np.sqrt(np.stack([of_inertia, of_drag])),
    )


TAIL_FEEDBACK_STEP = 1e-3  # relative change of the model's inertia and drag by which the loop is felt
MAX_GAIN = 0.9  # of the loop: beyond it the correction hardly settles, and its uncertainty has no end


@dataclass(frozen=True)
class Feedback:
    """The tails when the correcting model has more inertia, or more drag, by `LOG_STEP`; influence of each run on the
    logarithms of both, once round the loop and for ever on, (R, 2)."""

    moved: tuple[TailLines, TailLines]
    influence: Floats

    def tables(self, moment: Floats, tails: TailLines, fit: DragFit) -> tuple[DragFit, InertiaTable | None]:
        """Give the drag `fit` and Table 2 by it, with intervals that know of the correction; Table 2 by the jackknife
        over runs, drag refitted, None where the drag has no steady rate at some moment: the least squares of model 2
        may make k_rr negative."""

        def values_by(tails: TailLines) -> Floats:
            drag = sums(moment, tails.rate, fit.variance, fit.powers).solve()[0]
            inertias = inertia_from_velocity_error(tails.error, *fit.acting(moment, drag.tolist()))
            return np.append(drag, inertias.mean())

        at, left_out, runs = values_by(tails), _without_each(moment, tails, fit), len(moment)
        slopes = np.array([(values_by(moved) - at) / TAIL_FEEDBACK_STEP for moved in self.moved])
        by_runs = np.sqrt((runs - 1) / runs) * (left_out.mean() - left_out)
        total = np.column_stack([fit.influence, by_runs]) + self.influence @ slopes
        *of_drag, of_inertia = np.sqrt(np.sum(total**2, axis=0)).tolist()
        estimates = {
            name: Estimate.from_stderr(e.value, error, runs - len(of_drag), e.unit)
            for (name, e), error in zip(fit.estimates.items(), of_drag)
        }
        fit = replace(fit, estimates=estimates)
        per_run = inertia_from_velocity_error(tails.error, *fit.acting(moment))
        if not (np.all(np.isfinite(per_run)) and np.all(np.isfinite(left_out))):
            return fit, None
        per_moment = {float(level): float(per_run[moment == level].mean()) for level in np.unique(moment)}
        unit = fit.curve.parameters()[0].unit
        overall = Estimate.from_stderr(float(per_run.mean()), of_inertia, runs - 1, unit)
        return fit, InertiaTable(per_run, per_moment, overall)


def feedback(model: Reference, raw: TailLines, time: Floats) -> Feedback:
    estimate, influence = model.read(model.steady(raw, time))
    factors = ((1.0 + TAIL_FEEDBACK_STEP, 1.0), (1.0, 1.0 + TAIL_FEEDBACK_STEP))
    moved = tuple(model.moved(*factor).steady(raw, time) for factor in factors)
    loop = np.stack([(model.read(tails)[0] - estimate) / TAIL_FEEDBACK_STEP for tails in moved], axis=1)
    gain = float(np.abs(np.linalg.eigvals(loop)).max())
    loop *= min(1.0, MAX_GAIN / max(gain, MAX_GAIN))
    return Feedback((moved[0], moved[1]), influence @ np.linalg.inv(np.eye(2) - loop).T)


MAX_ROUNDS = 8
PLACING_ROUNDS = 2  # rounds in which the tails may still move; then only their correction does
SETTLED_CHANGE = 1e-6  # relative change of the correcting model below which it has settled


@dataclass(frozen=True)
class VelocityErrorFit:
    """Tables 1 and 2 by the paper's method.

    `tail_from` [rad] turned angle at which the tail starts, `by_user` whether it was asked for; `expected` what bias
    and noise were expected of it, `steady` whether any tail has a bias within BIAS_LIMIT. `tails` have the bias
    taken off; `variance` (R,) [rad²/s²] is that of their rates by noise and scatter of the thrust. `inertia["2"]` or
    `drag["2"]` is absent where the moments cannot carry model 2, `inertia["2"]` also where its drag has no steady rate.
    """

    tail_from: float
    by_user: bool
    expected: Expected
    steady: bool
    tails: TailLines
    variance: Floats
    drag: Mapping[str, DragFit]
    inertia: Mapping[str, InertiaTable]

    def test_against_2(self, number: str) -> dict[str, Any] | None:
        """The `nested_test` of a model against the second, if there is one."""
        return nested_test(self.drag[number], self.drag["2"]) if "2" in self.drag else None


def fit_velocity_error(
    data: StepData, start_heading: Floats, delay: float = 0.0, models: Sequence[str] = MODEL_NUMBERS,
    tail: float | None = None,
) -> VelocityErrorFit:  # fmt: skip
    """Run the paper's method on half-turns, for some of the readings of Table 1.

    `start_heading` (R,) [rad] on the scale of `data.heading`; `delay` [s] is by how much every
    command acts after the middle of its switch interval; `tail` [rad or m] is where the tails start, None: where
    they are best. Raises FitError where too few runs or samples are left.
    """
    time, words = data.time - delay, data.dof.words
    sizes = len(np.unique(np.abs(data.moment)))
    if len(data.moment) < 3 or sizes < 2:
        few = f"{len(data.moment)} {words.step}s at {sizes} sizes of {words.force} are too few for Table 1"
        raise FitError(f"{few}; run at least 3 steps at 2 {words.force}s")
    raw, tails, model, noise, thrust, grid, place = _settled(time, data, start_heading, tail)
    variance = tails.rate_variance(noise) + model.thrust_variance(thrust)
    more = feedback(model, raw, time)
    drag, inertia = {}, {}
    for name, fit in _drag(data, tails.rate, variance, models).items():
        drag[name], table = more.tables(data.moment, tails, fit)
        if table is not None:
            inertia[name] = table
    if not inertia.keys() - {"2"}:
        says = "the steady {speed}s of the {step}s fit no drag and give no {inertia}; fit them with --fit-to whole-runs"
        raise FitError(data.dof.fill(says))
    steady = bool(np.abs(grid.bias).max(axis=0).min() <= BIAS_LIMIT)
    expect = Expected(grid.start[place], grid.bias[:, place], grid.dilution[place], grid.noise[:, place])
    return VelocityErrorFit(float(expect.start), tail is not None, expect, steady, tails, variance, drag, inertia)


def _settled(
    time: Floats, data: StepData, start_heading: Floats, tail: float | None
) -> tuple[TailLines, TailLines, Reference, float, float, Expected, int]:
    """Tails, as they are and with the bias taken off, and the model by which, which follows from them: a few rounds
    settle both. Then noise [rad] of the headings, relative scatter of the thrust, what was expected of each place, and
    which was taken."""
    dof, observed = data.dof, data.observed
    ends = np.where(observed, time, -np.inf).max(axis=1, keepdims=True)
    tails = tail_lines(time, data.heading, start_heading, observed & (time >= 0.7 * ends), dof)
    model = reference(data.moment, tails, 0.0, dof)
    far = np.abs(np.where(observed, data.heading, 0.0)).max(axis=1)
    places, kinds = TAIL_SHARES * (dof.limits.trim if np.isfinite(dof.limits.trim) else far.min()), MODEL_NUMBERS
    if tail is not None:
        if far.min() <= tail:
            raise FitError(
                f"the tails are to start at {dof.shown(tail):.0f} {dof.units.shown}, but {data.names[far.argmin()]} "
                f"ends at {dof.shown(far.min()):.0f} {dof.units.shown}; let them start earlier, or leave that run out"
            )
        places = np.append(places, tail)
    for turn in range(MAX_ROUNDS):
        exact = model.answer(time)
        noise = noise_about_lines(time, data.heading - exact, tails.used, dof)
        thrust = model.thrust_scatter(tails.rate, tails.rate_variance(noise))
        if turn < PLACING_ROUNDS:
            grid = expected(time, data, model, noise, thrust, places)
            place = int(np.argmin(np.sum(grid.error**2, axis=0))) if tail is None else len(places) - 1
        else:
            kinds = (model.fit.model,)
        first = first_past(exact, time, observed, places[place : place + 1])
        used = observed & (np.arange(time.shape[1]) >= first) & (time > 0)
        raw = tail_lines(time, data.heading, start_heading, used, dof)
        tails = model.steady(raw, time)
        variance = tails.rate_variance(noise) + model.thrust_variance(thrust)
        before, model = model, reference(data.moment, tails, variance, dof, kinds)
        if turn >= PLACING_ROUNDS and model.like(before, SETTLED_CHANGE):
            break
    return raw, tails, model, noise, thrust, grid, place


def _drag(data: StepData, rate: Floats, variance: Floats, models: Sequence[str]) -> dict[str, DragFit]:
    """Table 1 by the models that the moments can carry, in their order; model 2, whose terms are hardest to tell
    apart, says how much noise all of them take off."""
    fits = {}
    few = len(data.moment) < 4 or len(np.unique(np.abs(data.moment))) < 2
    for model in sorted(models, key=lambda name: name != "2"):
        if not (few and model == "2"):
            fits[model] = fit_drag_by_way(data.moment, rate, model, data.unit, data.dof, variance)
            variance = fits[model].variance
    return {model: fits[model] for model in models if model in fits}
