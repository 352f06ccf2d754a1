"""Learned curves in a fit: how likely a curve is before the data, and how smooth it should be.

A Gaussian prior on the values of a curve says as much as readings of them would, so it enters a fit of runs that are
simulated whole as one more run of KNOTS readings (data augmentation; Theil and Goldberger 1961, Int. Econ. Rev. 2:65),
and everything that a fit does with runs holds for it; fits by innovations have priors anyway. Its spread is where
the marginal likelihood is largest, by the curvature of the fit that was made (Laplace's approximation; Wood 2011, J. R.
Stat. Soc. B 73:3).
"""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from automarine_cli import effects
from automarine_cli.effects.learned import DRAG, FIRST, GAIN, KNOTS, MOMENT, PREFIX, Learned, kind_of, roughness
from automarine_cli.fits.innovations import DrivenProblem, InnovationsFit
from automarine_cli.fits.linear_mixed import Gram, Grams, RunEffects
from automarine_cli.fits.mixed_model import MixedFit, Problem, fit_mixed
from automarine_cli.models.yaw_model import Term, YawModel
from automarine_cli.quantities import Floats

Fit = MixedFit | InnovationsFit

SPREADS = np.geomspace(3e-4, 1.0, 15)  # spreads that are tried
LEAST = 1e-4  # least noise that is expected [the sensor's unit]
FIRM = 100.0  # times the spread's own precision with which a curve keeps away from what other terms of the model are


def learned_term(model: YawModel) -> int | None:
    """Place of the model's learned term among its terms; None without one."""
    return next((i for i, term in enumerate(model.terms) if term.name.startswith(PREFIX)), None)


def places(model: YawModel) -> NDArray[np.int64]:
    """Places of a learned curve's values in theta, (KNOTS,); none without a curve."""
    at = learned_term(model)
    if at is None:
        return np.arange(0)
    return 1 + sum(len(term.values) for term in model.terms[:at]) + FIRST + np.arange(KNOTS)


def precision(model: YawModel, spread: float) -> Floats:
    """Prior precision of the values of the model's learned curve, (KNOTS, KNOTS), at a spread."""
    at = learned_term(model)
    assert at is not None
    term = model.terms[at]
    own = elsewhere(model, term)
    firm = FIRM**2 * own.T @ own
    return (roughness(_closed(term)) + firm) / spread**2


def _closed(term: Term) -> bool:
    effect = effects.get(term.name)
    assert isinstance(effect, Learned)
    return bool(effect.variable.turn)


def elsewhere(model: YawModel, term: Term) -> Floats:
    """Curves (n, KNOTS) of unit length that other terms of the model are already: drag over the speed, a gain common to
    all runs, a constant force, linear drag; and what would jump at a standstill."""
    effect = effects.get(term.name)
    assert isinstance(effect, Learned)
    kind, sized = kind_of(term.values), effect.variable.sized
    present = {one.name for one in model.terms}
    at = np.linspace(0.0, 1.0, KNOTS)
    rows = []
    level = {DRAG: "linear-drag", MOMENT: "bias-moment"}
    if kind == GAIN or (not sized and level[kind] in present):
        rows.append(np.ones(KNOTS))
    elif sized:
        powers = {"linear-drag": 1, "quadratic-drag": 2, "cubic-drag": 3}
        rows += [np.eye(KNOTS)[0], *(at**power for name, power in powers.items() if name in present)]
    return np.array([row / np.linalg.norm(row) for row in rows]).reshape(-1, KNOTS)


def fit_smooth(
    model: YawModel, floor: float, problem: Problem, theta: Floats, run_effects: Floats | None = None, **settings: Any
) -> MixedFit:
    """`fit_mixed` of `problem`, that of a `model` with a learned curve, under the curve's prior, where noise of `floor`
    is expected; the likelihood that it tells is that of the readings alone."""
    at = places(model)
    root = max(floor, LEAST) * np.linalg.cholesky(known_of(model)).T
    effects_of = _with_row(problem.effects)
    width, part = problem.seen.shape[1], problem.counted[0].part
    row = np.arange(width)[part][:KNOTS]
    seen = np.zeros((1, width), dtype=bool)
    seen[0, row] = True

    def response(theta: Floats, b: Floats) -> Floats:
        readings = problem.response(theta, b[..., :-1, :])
        more = np.zeros((len(readings), 1, width))
        more[:, 0, row] = theta[:, at] @ root.T
        return np.concatenate([readings, more], axis=1)

    wider = replace(
        problem, response=response, measured=np.concatenate([problem.measured, np.zeros((1, width))]),
        seen=np.concatenate([problem.seen, seen]), effects=effects_of,
    )  # fmt: skip
    b = None if run_effects is None else np.concatenate([run_effects, np.zeros((1, run_effects.shape[1]))])
    fit = fit_mixed(wider, theta, run_effects=b, **settings)
    return _without_row(fit, problem, root @ fit.theta[at])


def _with_row(own: RunEffects) -> RunEffects:
    """The run effects with one more run that has none."""
    wider = [replace(one, scale=np.concatenate([one.scale, 0.0 * one.scale[:1]])) for one in own.blocks]
    return RunEffects(tuple(wider))


def _without_row(fit: MixedFit, problem: Problem, shown: Floats) -> MixedFit:
    """The fit as one to the runs alone: the prior's information is shared out among them, its density `shown` [noise]
    taken out of the likelihood."""
    noise = float(fit.noises[0])
    density = -0.5 * (float(shown @ shown) / noise**2 + KNOTS * np.log(2.0 * np.pi * noise**2))
    return replace(
        fit,
        log_likelihood=fit.log_likelihood - density,
        left_out=fit.left_out[:-1],
        run_effects=fit.run_effects[:-1],
        predictive=fit.predictive[:-1],
        fitted=fit.fitted[:-1],
        gram=Grams(tuple(_shared_out(gram) for gram in fit.gram.channels)),
        effects=problem.effects,
    )


def _shared_out(gram: Gram) -> Gram:
    """The inner products of all runs but the last, which is shared out among them."""
    runs = len(gram.ww) - 1
    scale = gram.log_scale[:-1] if isinstance(gram.log_scale, np.ndarray) else gram.log_scale
    return Gram(
        gram.jj[:-1] + gram.jj[-1] / runs, gram.jv[:-1], gram.vv[:-1], gram.jw[:-1] + gram.jw[-1] / runs,
        gram.vw[:-1], gram.ww[:-1] + gram.ww[-1] / runs, gram.present[:-1], gram.count[:-1], scale,
    )  # fmt: skip


def known_of(model: YawModel) -> Floats:
    """Prior precision of the model's learned curve at its own spread, (KNOTS, KNOTS)."""
    inside = learned_term(model)
    assert inside is not None
    return precision(model, model.terms[inside].values[FIRST - 1])


def prior_of(fit: Fit, model: YawModel, floor: float) -> Floats:
    """The prior's precision (KNOTS, KNOTS) as it entered a fit; in that of runs simulated whole as readings with the
    sensor's noise, of which `floor` was expected."""
    if isinstance(fit, InnovationsFit):
        return known_of(model)
    return known_of(model) * (max(floor, LEAST) / float(fit.noises[0])) ** 2


def with_prior(problem: DrivenProblem, model: YawModel) -> DrivenProblem:
    """The likelihood of driven runs with what is known of the curve of a `model` that has one."""
    count, at = len(problem.names), places(model)
    smooth = np.zeros((count, count))
    smooth[np.ix_(at, at)] = known_of(model)
    return replace(problem, smooth=smooth)


def smoothed(fit: Fit, model: YawModel, floor: float) -> tuple[float, float]:
    """The spread of largest marginal likelihood by the curvature of a fit of `model`, and the curve's effective number
    of parameters at the spread that was fitted."""
    at, fitted = places(model), prior_of(fit, model, floor)
    spread = fit.covariance[np.ix_(at, at)]
    stiff = np.linalg.inv(spread)
    pull = stiff @ fit.theta[at]
    data = stiff - fitted
    likely = [_evidence(data, pull, precision(model, s)) for s in SPREADS]
    return float(SPREADS[int(np.argmax(likely))]), float(KNOTS - np.trace(spread @ fitted))


def _evidence(data: Floats, pull: Floats, prior: Floats) -> float:
    """Twice the log marginal likelihood of a curve under a prior, but for what is the same of all priors."""
    stiff = data + prior
    log_det = np.linalg.slogdet(prior)[1] - np.linalg.slogdet(stiff)[1]
    return float(pull @ np.linalg.solve(stiff, pull) + log_det)
