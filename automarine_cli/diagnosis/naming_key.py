"""The naming key: how each run's own drag and inertia drift with the moment, and what that says (PHYSICS 3.1).

Half-turns of a vehicle with quadratic drag alone fall on one curve of t sqrt|tau|, so its k and I are the same at
every moment. What is missing makes them drift with a power of |tau|: -1 what has a moment of its own (dead-band,
bias, Coulomb, spring), -1/2 linear drag, 0 thrust that differs by sign, +1/2 cubic drag (in k) and lags (in I), +1 a
supply that sags under load. Each run's k and I are generalised least squares about the base fit, with the run's
start heading, start rate and switch instants free and its thrust gain held: a gain moves both together. I is
therefore looked at as I / k, in which the run's own gain cancels and what is left is a time.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import special

from automarine_cli.diagnosis.study import Study, without_scatter
from automarine_cli.diagnosis.trials import Trial
from automarine_cli.dofs import Dof
from automarine_cli.fits import linear_mixed
from automarine_cli.fits.mixed_model import derivatives
from automarine_cli.fits.mixed_problem import SWITCH, MixedFit
from automarine_cli.fits.run_effects import GAIN
from automarine_cli.quantities import Floats

CLASSES = {
    (-1.0, "even"): "a {force} of its own size: dead-band, Coulomb drag, tether spring",
    (-1.0, "odd"): "a {force} with a {way}: bias",
    (-0.5, "even"): "a {speed} of its own size: linear drag, swirl",
    (-0.5, "odd"): "a {speed} with a {way}: {rate_sensor} drift",
    (0.0, "odd"): "thrust that differs by {way}: asymmetry",
    (0.5, "even"): "cubic drag",
    (0.5, "odd"): "a time that differs by {way}",
    (1.0, "even"): "a load: supply that sags, saturation",
    (1.0, "odd"): "a load that differs by {way}",
    (2.0, "even"): "tilt or saturation at the largest {forces}",
    (2.0, "odd"): "tilt or saturation on one {way}",
}
"""What effects drift with a power of |moment| and a parity, in the words of a motion."""
TIMES = "a time of its own: lag, delay"
"""What makes I / k rise with the moment."""
ROUNDS = 4
FEWEST = 6
CERTAIN = 0.05
"""Standard error of a run's log k beyond which that run says little, unless most runs are no better."""


@dataclass(frozen=True)
class Drift:
    """How well a power of |moment| with a parity explains one drift: `share` of its weighted variance, F-test p; and
    what effects drift like that."""

    quantity: str
    power: float
    parity: str
    slope: float
    share: float
    p_value: float
    means: str


@dataclass(frozen=True)
class NamingKey:
    """Each run's own k and I, (R,), as logarithms less the base's, with standard errors.

    `moment` is the run's first moment, NaN where it was too short; `log_ratio` is log I less log k;
    `predicted_k`, `predicted_ratio` are the same estimates made of headings that the final model simulates.
    `drifts` holds every power and parity, best first.
    """

    moment: Floats
    unit: str
    log_k: Floats
    log_k_error: Floats
    log_ratio: Floats
    log_ratio_error: Floats
    predicted_k: Floats
    predicted_ratio: Floats
    drifts: tuple[Drift, ...]

    def best(self, quantity: str) -> Drift | None:
        """The power and parity that explain the drift of "k" or "I/k" best, None where nothing could be told."""
        return next((drift for drift in self.drifts if drift.quantity == quantity), None)


def naming_key(study: Study, base: Trial, final: Trial) -> NamingKey | None:
    """Each run's own k and I about the base fit, measured and as the final model would have them; None for driven
    runs, which hold no steps."""
    if not (isinstance(base.fit, MixedFit) and isinstance(final.fit, MixedFit)):
        return None
    problem = study.problem(base.model)
    b = without_scatter(base.fit)
    # changes in the middle of their intervals: free either way
    phi = np.where([name == SWITCH for name in problem.names], 0.0, base.fit.phi)
    first_step, moment = first_steps(study)
    drag = slice(1, len(study.base.theta))
    weight = np.where(problem.positive[drag], 1.0, base.fit.theta[drag])  # all drag terms by the same factor
    constant = study.base.dof.parameter("constant")
    if constant in study.base.parameter_names:
        weight[study.base.index(constant) - drag.start] = 0.0
    run_effects, variances = problem.effects.with_scale(gain=0.0), base.fit.variances
    inside = problem.seen & np.concatenate([first_step] * len(problem.slots), axis=1)
    within = replace(problem, seen=inside)

    def own(readings: Floats) -> tuple[Floats, Floats]:
        """log k, log I and their difference (R, 3), with errors; a gain of 1/k carries a run to its own k, where
        its response is linearised again."""
        log_k = np.zeros(len(study.runs))
        for _ in range(ROUNDS):
            at = b.copy()
            problem.effects.of(at, GAIN)[:, 0] = -log_k
            fitted, by_phi, by_run = derivatives(problem, phi, at)
            by_log = np.stack([by_phi[:, :, drag] @ weight, by_phi[:, :, 0]], axis=2)
            by_log, by_run = (np.where(inside[:, :, None], d, 0.0) for d in (by_log, by_run))
            gram = within.inner(by_log, by_run, np.where(inside, readings - fitted, 0.0), at)
            weighted = linear_mixed.weigh(gram, run_effects, variances)
            covariance = np.array([linear_mixed.covariance_of(h) for h in weighted.hessian])
            change = np.einsum("rpq,rq->rp", covariance, weighted.gradient)
            log_i = log_k + change[:, 1]
            log_k = log_k + np.clip(change[:, 0], -0.5, 0.5)
        errors = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
        ratio = np.sqrt(np.maximum(errors[:, 0] ** 2 + errors[:, 1] ** 2 - 2.0 * covariance[:, 0, 1], 0.0))
        return np.column_stack([log_k, log_i, log_i - log_k]), np.column_stack([errors, ratio])

    measured, errors = own(problem.measured)
    there = study.problem(final.model).readings(final.fit.phi, without_scatter(final.fit))
    simulated = np.where(problem.seen, there, 0.0)
    predicted, _ = own(simulated)
    certain = max(CERTAIN, 2.0 * float(np.median(errors[:, 0])))
    moment = np.where(errors[:, 0] < certain, moment, np.nan)
    drifts = [
        drift
        for i, quantity, scatter in ((0, "k", final.fit.factor(GAIN)), (2, "I/k", 0.0))
        for drift in drifts_of(quantity, moment, measured[:, i], errors[:, i], scatter, study.base.dof)
    ]
    drifts.sort(key=lambda drift: (drift.p_value, -drift.share))
    return NamingKey(
        moment, study.base.moment_unit, measured[:, 0], errors[:, 0],
        measured[:, 2], errors[:, 2], predicted[:, 0], predicted[:, 2], tuple(drifts),
    )  # fmt: skip


def first_steps(study: Study) -> tuple[NDArray[np.bool_], Floats]:
    """Samples (R, N) up to the end of each run's first constant moment, and that moment (R,), NaN without one."""
    inside = np.zeros(study.batch.seen.shape, dtype=bool)
    moment = np.full(len(study.runs), np.nan)
    for i, run in enumerate(study.runs):
        pushed = np.flatnonzero(run.command)
        if len(pushed):
            moment[i] = run.command[pushed[0]]
            other = np.flatnonzero(run.command[pushed[0] :] != moment[i])
            inside[i, : pushed[0] + other[0] if len(other) else len(run)] = True
    return inside, moment


def drifts_of(quantity: str, moment: Floats, log: Floats, error: Floats, scatter: float, dof: Dof) -> list[Drift]:
    """Weighted straight lines of `log` (R,) against every power of |moment|, even and odd in its sign.

    `scatter` is the runs' standard deviation of the log gain, which moves k.
    """
    have = np.isfinite(moment) & np.isfinite(log) & (error**2 + scatter**2 > 0)  # no error: held at a bound
    if have.sum() < FEWEST:
        return []
    y, tau = log[have], moment[have]
    weight = 1.0 / (error[have] ** 2 + scatter**2)
    around = y - np.average(y, weights=weight)
    total = float((weight * around**2).sum())
    found = []
    for power, parity in CLASSES:
        x = np.abs(tau) ** power * (np.sign(tau) if parity == "odd" else 1.0)
        centred = x - np.average(x, weights=weight)
        spread = float((weight * centred**2).sum())
        if spread < 1e-12 * float((weight * x**2).sum()) or total <= 0:
            continue
        slope = float((weight * centred * around).sum()) / spread
        if parity == "even" and slope <= 0:
            continue  # what falls with the moment has a negative power, what rises a positive one
        gained = slope**2 * spread
        freedom = len(y) - 2
        rest = max((total - gained) / freedom, 1e-300)
        p_value = float(special.fdtrc(1, freedom, gained / rest))
        late = quantity == "I/k" and power > 0 and parity == "even"
        means = TIMES if late else dof.fill(CLASSES[power, parity])
        found.append(Drift(quantity, power, parity, slope, gained / total, p_value, means))
    return found
