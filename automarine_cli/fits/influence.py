"""How far each run pulls the parameters of a mixed regression: covariance with the run as the unit, to first order.

The fit solves  sum over runs of g_i(phi, b_i) = 0,  where g_i is the weighted gradient of run i and its run effects b_i
are at their likeliest values for that phi, m_i(phi, b_i) = 0 (see mixed_model.py). Without run i the solution moves by
(A - A_i)^-1 g_i, where A_i = -dg_i/dphi with b_i following phi. The linearised problem takes its Hessian for A_i, as
if the derivatives by the run effects stayed what they are while phi moves. They do not for the instant of a step, which
cannot leave its sample interval: it follows phi in the middle of the interval and hardly at its ends, and errors from
that Hessian come out too large by up to a factor of two. Here A_i is the derivative itself, by differences and the
implicit function theorem. That is the sandwich of an M-estimator in its jackknife form (Huber 1967, Proc. 5th Berkeley
Symposium 1:221; MacKinnon and White 1985, J. Econometrics 29:305); noise and scatter are held.
Shapes: runs R, parameters p, run effects q.
"""

import numpy as np
from numpy.typing import NDArray

from automarine_cli.fits import linear_mixed
from automarine_cli.fits.gram import Grams
from automarine_cli.fits.mixed_model import MixedFit, Problem, derivatives
from automarine_cli.fits.outcome import Outcome
from automarine_cli.quantities import Floats

STEP = 0.1
"""Of the differences, in standard errors of a parameter or posterior standard deviations of a run effect."""

FARTHEST = 1.0
"""Longest of these steps on a logarithm: nothing is known of a parameter that may be further off."""

LEAST_STIFFNESS = 1e-8
"""Smallest eigenvalue, with every parameter in units of its own curvature, of equations that fix a solution."""


def left_out_changes(problem: Problem, fit: MixedFit) -> Floats:
    """Change of phi when each run is left out, (R, p); zero for parameters at a bound.

    `problem` is the one that was fitted. Where the equations do not fix the solution, the changes are those of the
    linearised problem. Raises FitError where the response is not finite beside the solution.
    """
    variances = fit.variances
    runs, count = fit.left_out.shape
    shown = np.flatnonzero(np.diagonal(fit.covariance) > 0.0)  # what no sample shows stays where it is
    free = np.setdiff1d(shown, fit.at_bound)
    moved = np.zeros((runs, count))
    if not len(free):
        return moved
    pull, stiffness = _pull_and_stiffness(problem, fit, variances, free)
    whole = stiffness.sum(axis=0)
    if problem.prior is not None:
        whole = whole + problem.prior[1][np.ix_(free, free)]
    scale = linear_mixed.curvature_scale(whole)
    if np.linalg.eigvals(whole / np.outer(scale, scale)).real.min() <= LEAST_STIFFNESS:
        return fit.left_out - fit.phi
    rest = np.linalg.pinv((whole - stiffness) / np.outer(scale, scale), rcond=1e-9)
    moved[:, free] = -(rest @ (pull / scale)[:, :, None])[:, :, 0] / scale
    return moved


def covariance_of_changes(moved: Floats) -> Floats:
    """Jackknife covariance (p, p) from the changes (R, p) when each run is left out."""
    count, spread = len(moved), moved - moved.mean(axis=0)
    return np.asarray((count - 1) / count * spread.T @ spread)


def degrees_of_freedom(fit: Outcome, direction: Floats) -> float:
    """Of the jackknife's variance along `direction` (p,) of phi: about how many runs carry it, less one.

    Satterthwaite's approximation for runs that pull by their expected variances v_i, (sum v_i)²/sum v_i² (Bell and
    McCaffrey 2002, Survey Methodology 28:169). Where two runs show a parameter, their own spread says little of it.
    """
    free = np.setdiff1d(np.arange(len(fit.phi)), fit.at_bound)
    return runs_that_carry(fit.information[:, free[:, None], free], direction[free])


def runs_that_carry(information: Floats, direction: Floats) -> float:
    """The same of runs whose information (R, p, p) is known, along `direction` (p,)."""
    reach = linear_mixed.covariance_of(information.sum(axis=0)) @ direction
    share = np.einsum("p,rpk,k->r", reach, information, reach)
    runs = len(share)
    square = float((share**2).sum())
    carried = float(share.sum()) ** 2 / square if square > 0.0 else float(runs)
    return max(carried * (runs - 1) / runs, 1.0)


def _pull_and_stiffness(
    problem: Problem, fit: MixedFit, variances: Floats, free: NDArray[np.int64]
) -> tuple[Floats, Floats]:
    """g_i (R, p) and A_i (R, p, p) of the free parameters at the solution."""
    scale = problem.effects.deviation(variances)
    acts = np.flatnonzero(scale.any(axis=0))
    gram = _about(problem, fit.phi, fit.run_effects)
    weighted = linear_mixed.weigh(gram, problem.effects, variances)
    aside = STEP * np.sqrt(np.diagonal(fit.covariance))[free]
    aside = np.where(fit.positive[free], np.minimum(aside, FARTHEST), aside)
    reach = STEP * np.sqrt(np.maximum(weighted.left, 1e-6))  # in prior standard deviations
    none = np.zeros_like(scale)

    def slope(phi: Floats, b: Floats) -> tuple[Floats, Floats]:
        """Central differences of g and m for a change of phi and of the run effects, (R, free) and (R, acts)."""
        sides = []
        for sign in (1.0, -1.0):
            near = _about(problem, fit.phi + sign * phi, fit.run_effects + sign * b)
            pull = linear_mixed.weigh(near, problem.effects, variances).gradient
            here = near.at(variances)
            mean = scale * here.vw / np.exp(2.0 * variances[0])
            mean -= np.divide(here.present, scale, out=np.zeros_like(scale), where=scale > 0)
            sides.append((pull[:, free], mean[:, acts]))
        return 0.5 * (sides[0][0] - sides[1][0]), 0.5 * (sides[0][1] - sides[1][1])

    axes = np.eye(len(fit.phi))[free]
    by_phi = [slope(h * dof, none) for h, dof in zip(aside, axes)]
    pull_phi, mean_phi = (np.stack(part, axis=2) / aside for part in zip(*by_phi))
    if not len(acts):
        return weighted.gradient[:, free], -pull_phi
    by_run = [slope(0.0 * fit.phi, reach * scale * (np.arange(scale.shape[1]) == k)) for k in acts]
    pull_run, mean_run = (np.stack(part, axis=2) / reach[:, None, acts] for part in zip(*by_run))
    absent = scale[:, acts] == 0.0  # such an effect stays where it is
    mean_run -= absent[:, :, None] * np.eye(len(acts))
    follows = -np.linalg.solve(mean_run, mean_phi)  # d b_i / d phi, in prior standard deviations
    return weighted.gradient[:, free], -(pull_phi + pull_run @ follows)


def _about(problem: Problem, phi: Floats, b: Floats) -> Grams:
    """The problem linearised about (phi, b)."""
    fitted, by_phi, by_run = derivatives(problem, phi, b)
    return problem.gram(by_phi, by_run, fitted, b, phi)
