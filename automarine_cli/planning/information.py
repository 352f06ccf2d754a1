"""Fisher information of runs that are not yet made, and the intervals that a fit to them would report.

About the model, run i adds  J_i' R_i^-1 J_i  to the information on the parameters, with J_i the derivatives of its
headings and R_i = s² 1 + V_i D_i V_i' the covariance of its noise and of all that differs from run to run: start
heading, gain of the thrust, instants of the changes (fits/linear_mixed.py). Nothing of it needs a measurement, and it
adds up over runs (Fedorov 1972, Theory of Optimal Experiments, chapter 2).
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from automarine_cli import effects
from automarine_cli.fits import linear_mixed
from automarine_cli.fits.influence import runs_that_carry
from automarine_cli.fits.mixed_model import Problem, derivatives
from automarine_cli.fits.mixed_problem import SWITCH
from automarine_cli.fits.output_error import ENOUGH_RUNS
from automarine_cli.fits.run_effects import SWITCHES
from automarine_cli.planning.candidates import Candidate
from automarine_cli.planning.fitting import Fitting, alike
from automarine_cli.quantities import Floats
from automarine_cli.results.estimate import Estimate

OFFSET = "switch offset"
ANGLE = "inertial turn angle"
FEWEST = 3
"""Runs below which no interval is told."""
NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(3)
"""Where in its sample interval a command changes is averaged over, for fits that confine it to that interval."""
LOOSE = 3.0
"""Standard deviation of a parameter before any run, in its own size: it keeps the first choices from dividing by
zero."""


def names_of(fitting: Fitting) -> tuple[str, ...]:
    """Names of the parameters that the fit is free to choose, the common instant of the switches last."""
    return tuple(name for name, free in zip((*labels(fitting), OFFSET), free_in(fitting)) if free)


def labels(fitting: Fitting) -> tuple[str, ...]:
    """Names of all parameters: those of an effect beside the drag begin with the effect's."""
    dof = fitting.model.dof
    own = [dof.symbols.inertia]
    for i, term in enumerate(fitting.model.terms):
        prefix = "" if i < len(fitting.base.terms) else f"{term.name} "
        own += [f"{prefix}{name}" for name in effects.get(term.name).names_in(dof)]
    return tuple(own)


def free_in(fitting: Fitting) -> NDArray[np.bool_]:
    """Which entries of theta, and the offset after them, are fitted."""
    held = [h for term in fitting.model.terms for h in effects.get(term.name).held(term.values)]
    return ~np.array([False, *held, False])


def information(fitting: Fitting, candidates: Sequence[Candidate]) -> Floats:
    """Information of each candidate on the free parameters, in the coordinates of the search, (K, p, p).

    Where a share of the runs is held out of the fit, each counts for what it tells on average.
    """
    free = np.flatnonzero(free_in(fitting))
    if fitting.random:
        return fitting.fitted * _by_innovations(fitting, candidates, free)
    found = np.zeros((len(candidates), len(free), len(free)))
    for places in alike(candidates).values():
        problem = fitting.problem([candidates[i] for i in places])
        found[places] = _of_problem(problem, fitting, free)
    return fitting.fitted * found


def _by_innovations(fitting: Fitting, candidates: Sequence[Candidate], free: NDArray[np.int64]) -> Floats:
    """The same where something is random, whose sizes are fitted too: what is left when all runs together have told
    these (the efficient score), so that it adds up over runs."""
    own, each = len(fitting.model.theta), []
    for places in alike(candidates).values():
        problem, phi = fitting.driven([candidates[i] for i in places])
        (slopes,) = problem.slopes(phi[None])
        each.append((places, slopes.information))
    runs = np.zeros((len(candidates), *each[0][1].shape[1:]))
    for places, told in each:
        runs[places] = told
    names = [problem.names[i] for i in problem.free]
    at = [names.index(name) for name in (*fitting.model.parameter_names, SWITCH) if name in names]
    rest = [i for i in range(len(names)) if i not in at]
    total = runs.sum(axis=0) + problem.prior_information
    project = -np.linalg.solve(total[np.ix_(rest, rest)], total[np.ix_(rest, at)]).T
    back = np.zeros((len(at), len(names)))
    back[np.arange(len(at)), at] = 1.0
    back[:, rest] = project
    natural = phi[: own + 1].copy()
    natural[-1] = 1.0
    positive = np.append(problem.positive[:own], False)
    scale = np.where(np.array(fitting.on_log) & ~positive, natural, 1.0)[free]
    back *= scale[:, None]
    found = back @ runs @ back.T
    found[:, -1, :-1] = found[:, :-1, -1] = 0.0  # such fits confine the switches to their interval
    return np.asarray(found)


def _of_problem(problem: Problem, fitting: Fitting, free: NDArray[np.int64]) -> Floats:
    variances, phi = fitting.variances(problem), fitting.phi(problem)
    if fitting.fit == "whole-runs":  # instants may leave their interval, and the headings are linear in them
        return _at(problem, phi, np.zeros_like(problem.effects.scale), variances, free)
    weights = WEIGHTS / WEIGHTS.sum()
    places = []
    for node in NODES:
        b = np.zeros_like(problem.effects.scale)
        problem.effects.of(b, SWITCHES)[...] = node
        places.append(b * (problem.effects.scale > 0))
    return np.asarray(sum(w * _at(problem, phi, b, variances, free) for w, b in zip(weights, places)))


def _at(problem: Problem, phi: Floats, b: Floats, variances: Floats, free: NDArray[np.int64]) -> Floats:
    headings, by_phi, by_run = derivatives(problem, phi, b)
    gram = problem.inner(by_phi, by_run, 0.0 * headings).keep(free)
    return linear_mixed.weigh(gram, problem.effects, variances).hessian


def excursions(fitting: Fitting, candidates: Sequence[Candidate]) -> Floats:
    """How far each run turns from its start heading at most [rad], (K,)."""
    found = np.zeros(len(candidates))
    for places in alike(candidates).values():
        problem = fitting.problem([candidates[i] for i in places])
        readings = problem.readings(fitting.phi(problem), np.zeros_like(problem.effects.scale))
        position = fitting.model.dof.position
        headings, seen = problem.of(readings, position), problem.of(problem.seen, position)
        found[places] = np.where(seen, np.abs(headings - headings[:, :1]), 0.0).max(axis=1)
    return found


def reported_covariance(per_run: Floats) -> Floats:
    """Covariance (p, p) that a fit to runs of these informations (R, p, p) reports, on average.

    From ENOUGH_RUNS on fits report the jackknife over runs: run i moves the solution by (A - A_i)^-1 g_i, and g_i at
    the solution has covariance A_i - A_i A^-1 A_i, so that on average it is  (R - 1)/R sum (A - A_i)^-1 A_i A^-1.
    With fewer runs they report the larger of it and the likelihood's.
    """
    whole = per_run.sum(axis=0)
    inverse = linear_mixed.covariance_of(whole)
    runs = len(per_run)
    if runs < FEWEST:
        return inverse
    without = np.array([linear_mixed.covariance_of(whole - one) for one in per_run])
    jackknife = (runs - 1) / runs * np.sum(without @ per_run, axis=0) @ inverse
    jackknife = 0.5 * (jackknife + jackknife.T)
    if runs >= ENOUGH_RUNS:
        return np.asarray(jackknife)
    grow = np.sqrt(np.maximum(np.diagonal(jackknife) / np.maximum(np.diagonal(inverse), 1e-300), 1.0))
    return np.asarray(inverse * np.outer(grow, grow))


def predicted(fitting: Fitting, per_run: Floats) -> dict[str, Estimate]:
    """The estimates that a fit would report: the model's values, with the intervals of these runs (R, p, p)."""
    per_run = moving(per_run)
    covariance = reported_covariance(per_run)
    dof = {}
    for name, direction in directions(fitting).items():
        many = len(per_run) >= ENOUGH_RUNS
        dof[name] = runs_that_carry(per_run, direction) if many else float(max(len(per_run) - 1, 1))
    return estimates_of(fitting, covariance, dof)


def moving(per_run: Floats) -> Floats:
    """Without the runs that say nothing of the parameters: fits set rest records aside."""
    return per_run[np.any(per_run != 0.0, axis=(1, 2))]


def directions(fitting: Fitting) -> dict[str, Floats]:
    """What is wanted, each as a direction (p,) of the search's coordinates: every parameter, and inertia over
    quadratic drag."""
    names = names_of(fitting)
    axes = np.eye(len(names))
    found = {name: axes[i] for i, name in enumerate(names) if name != OFFSET}
    own = fitting.model.dof.symbols
    if own.quadratic in found:
        found[ANGLE] = found[own.inertia] - found[own.quadratic]
    return found


def relative_directions(fitting: Fitting) -> dict[str, Floats]:
    """The same, in shares of the parameter's value where it is not told on the logarithm (in ones where it is zero)."""
    values, logarithms, _ = _parameters(fitting)
    return {
        name: direction if logarithms[name] else direction / (abs(values[name]) or 1.0)
        for name, direction in directions(fitting).items()
    }


def estimates_of(fitting: Fitting, covariance: Floats, dof: Mapping[str, float]) -> dict[str, Estimate]:
    """Estimates with this covariance (p, p) of the search's coordinates, as fits tell them."""
    values, logarithms, units = _parameters(fitting)
    found = {}
    for name, direction in directions(fitting).items():
        stderr = stderr_along(covariance, direction)
        form = Estimate.from_log if logarithms[name] else Estimate.from_stderr
        found[name] = form(values[name], stderr, dof[name], units[name])
    return found


def _parameters(fitting: Fitting) -> tuple[dict[str, float], dict[str, bool], dict[str, str]]:
    """Value, whether it is told on the logarithm, and unit, by name."""
    model, unit, names = fitting.model, fitting.model.moment_unit, labels(fitting)
    values = dict(zip(names, map(float, model.theta)))
    logarithms = dict(zip(names, fitting.on_log))
    dof, own = model.dof, model.dof.symbols
    every = [p for term in model.terms for p in effects.get(term.name).card(dof, unit).parameters]
    units = {own.inertia: dof.unit_of("inertia", unit)} | {name: p.unit for name, p in zip(names[1:], every)}
    if own.quadratic in values:
        values[ANGLE], logarithms[ANGLE] = values[own.inertia] / values[own.quadratic], True
        units[ANGLE] = dof.unit_of("ratio")
    return values, logarithms, units


def stderr_along(covariance: Floats, direction: Floats) -> float:
    """Standard error along a direction (p,)."""
    return float(np.sqrt(max(float(direction @ covariance @ direction), 0.0)))


class Objective(ABC):
    """What a campaign is for. Worth is that of `counts` (K,), how often each candidate is run."""

    @abstractmethod
    def scores(self, counts: Floats, extras: NDArray[np.int64]) -> Floats:
        """Worth of the campaign with one more run, each of `extras` (B,) in turn, (B,)."""

    @abstractmethod
    def score(self, counts: Floats) -> float:
        """Worth of the campaign."""

    @abstractmethod
    def reached(self, counts: Floats) -> bool:
        """Whether nothing more is wanted."""


@dataclass(frozen=True)
class Intervals(Objective):
    """Intervals to narrow: worth is the mean logarithm by which the wanted standard errors have come down.

    `information` (K, p, p) of the candidates, `known` (p, p) beforehand, `wanted` (p, m) the directions whose
    intervals count. `goal` is the largest standard error of a wanted direction at which nothing more is wanted, or
    None.
    """

    information: Floats
    known: Floats
    wanted: Floats
    goal: float | None = None

    def scores(self, counts: Floats, extras: NDArray[np.int64]) -> Floats:
        return self._worth(self._spread(counts, extras))

    def score(self, counts: Floats) -> float:
        return float(self._worth(self._spread(counts, None))[0])

    def reached(self, counts: Floats) -> bool:
        if self.goal is None:
            return False
        return bool(np.all(np.sqrt(np.diagonal(self._spread(counts, None)[0])) <= self.goal))

    def _worth(self, spread: Floats) -> Floats:
        unit = np.sqrt(np.diagonal(spread, axis1=1, axis2=2))
        shape = np.linalg.slogdet(spread / unit[:, :, None] / unit[:, None, :])[1]
        return np.asarray(-(np.log(unit).sum(axis=1) + 0.5 * shape) / self.wanted.shape[1])

    def _spread(self, counts: Floats, extras: NDArray[np.int64] | None) -> Floats:
        """Covariance (B, m, m) of the wanted directions as the jackknife over runs tells it: see
        `reported_covariance`. A parameter that hangs on a single run is not known."""
        base = np.tensordot(counts, self.information, axes=1) + self.known
        more = np.zeros((1, *base.shape)) if extras is None else self.information[extras]
        whole = base + more
        inverse = np.linalg.inv(whole)
        ran = np.flatnonzero(counts)
        told = inverse @ self.known
        each = np.linalg.inv(whole[:, None] - self.information[ran]) @ self.information[ran]
        told = told + np.tensordot(each, counts[ran], axes=((1,), (0,)))
        told = told + np.linalg.inv(whole - more) @ more
        covariance = told @ inverse
        covariance = 0.5 * (covariance + np.swapaxes(covariance, 1, 2))
        return np.asarray(self.wanted.T @ covariance @ self.wanted)
