"""How much each candidate would gain, from one linearisation; and what chance alone would seem to gain.

At a fitted model the headings' response to each candidate is simulated once, freed of what the model's own
parameters and the run effects can follow, and compared with what is left of the headings: Rao's score test, with the
runs' own covariance. Under "nothing is missing" all scores together are Gaussian with a known covariance, so the
distribution of the best of all candidates costs a few thousand draws and no refit.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from automarine_cli import effects
from automarine_cli.diagnosis.study import Study
from automarine_cli.fits import linear_mixed
from automarine_cli.fits.mixed_model import MixedFit, derivatives
from automarine_cli.models.yaw_model import YawModel

Floats = NDArray[np.float64]

DRAWS = 2000
SMALL = 0.03  # size at which a parameter without a start of its own is tried


@dataclass(frozen=True)
class Probe:
    """One shape of a candidate: parameter values (m, k) whose responses span what it can do at that shape."""

    effect: str
    values: Floats
    one_sided: bool


@dataclass(frozen=True)
class Score:
    """A candidate's best shape: expected drop in deviance, the same less its penalty, where a full fit should start
    (k,), and the size of its first parameter at which the drop would be one."""

    effect: str
    drop: float
    penalised: float
    start: Floats
    unit_size: float


@dataclass(frozen=True)
class Scores:
    """All candidates, best first, and the null distribution (draws,) of the best penalised drop."""

    ranked: tuple[Score, ...]
    null: Floats

    def threshold(self, level: float) -> float:
        """Penalised drop that chance reaches in a share `level` of campaigns."""
        return float(np.quantile(self.null, 1.0 - level))

    def p_value(self, penalised: float) -> float:
        """Share of null campaigns whose best candidate would gain as much."""
        return float((1 + np.sum(self.null >= penalised)) / (1 + len(self.null)))


def penalty(parameters: int, runs: int) -> float:
    """Schwarz's penalty with the run as the unit, in deviance."""
    return float(parameters * np.log(max(runs, 2)))


def candidates(study: Study, model: YawModel) -> list[str]:
    """Effects that the model lacks and the logs can drive."""
    present = {term.name for term in model.terms}
    return [
        name for name in effects.names()
        if name not in present and set(effects.get(name).needs) <= set(study.signals)
    ]  # fmt: skip


def fitted_parameters(name: str) -> int:
    """Number of parameters of an effect that a fit estimates."""
    return sum(not parameter.reference for parameter in effects.get(name).parameters)


def probes(study: Study, name: str) -> list[Probe]:
    """The shapes in which a candidate is tried."""
    own = effects.get(name).parameters
    found = []
    for shape in product(*(p.scan or (None,) for p in own)):
        fixed = [
            study.reference(p.reference)
            if p.reference
            else p.off
            if s is None
            else p.scaled(s, study.largest)
            for p, s in zip(own, shape)
        ]
        sizes = [i for i, p in enumerate(own) if not p.scan and not p.reference]
        rows = []
        for i in sizes:
            start = own[i].start if own[i].start != own[i].off else SMALL
            rows.append([*fixed[:i], own[i].scaled(start, study.largest), *fixed[i + 1 :]])
        one_sided = not sizes or (len(sizes) == 1 and own[sizes[0]].lower == own[sizes[0]].off)
        found.append(Probe(name, np.array(rows or [fixed]), one_sided))
    return found


def score(study: Study, model: YawModel, fit: MixedFit, names: Sequence[str], seed: int) -> Scores:
    """Score the candidates `names` at a fit of `model`."""
    problem = study.problem(model)
    every = [probe for name in names for probe in probes(study, name)]
    fitted, by_phi, by_run = derivatives(problem, fit.phi, fit.run_effects)
    columns = np.concatenate([_responses(study, model, fit, name, every) for name in names]) - fitted
    columns = np.where(problem.seen, columns, 0.0)
    sane = np.isfinite(columns).all(axis=(1, 2), keepdims=True)
    columns = np.where(sane, columns, 0.0)  # a probe that runs away says nothing
    j = np.concatenate([by_phi, np.moveaxis(columns, 0, 2)], axis=2)
    residual = np.where(problem.seen, problem.measured - fitted, 0.0)
    data = residual + np.einsum("rnq,rq->rn", by_run, fit.run_effects)
    gram = linear_mixed.Gram.of(j, by_run, data, problem.seen.sum(axis=1))
    variances = np.append(np.log(fit.noise), np.log(np.maximum(fit.factors, linear_mixed.SMALLEST_FACTOR)))
    weighted = linear_mixed.weigh(gram, problem.effects, variances)
    hessian, gradient = weighted.hessian.sum(axis=0), weighted.gradient.sum(axis=0)
    free = np.setdiff1d(np.arange(len(fit.phi)), fit.at_bound)
    information, pull = _project(hessian, gradient, free, len(fit.phi))
    information, pull = study.independent * information, study.independent * pull
    draws = _draw(information, seed)
    runs, at = len(problem.measured), 0
    best: dict[str, Score] = {}
    null = np.full(DRAWS, -np.inf)
    for probe in every:
        here = slice(at, at + len(probe.values))
        at = here.stop
        block = information[here, here]
        drop, size = _drop(block, pull[None, here], probe.one_sided)
        cost = penalty(fitted_parameters(probe.effect), runs)
        null = np.maximum(null, _drop(block, draws[:, here], probe.one_sided)[0] - cost)
        found = Score(
            probe.effect, float(drop[0]), float(drop[0]) - cost, _start(probe, size[0]), _unit_size(probe, block)
        )  # fmt: skip
        if probe.effect not in best or found.drop > best[probe.effect].drop:
            best[probe.effect] = found
    ranked = sorted(best.values(), key=lambda s: -s.penalised)
    return Scores(tuple(ranked), null)


def _responses(study: Study, model: YawModel, fit: MixedFit, name: str, every: Sequence[Probe]) -> Floats:
    """Headings (m, R, N) of the fitted model with the candidate added at each value of each of its probes."""
    values = np.concatenate([probe.values for probe in every if probe.effect == name])
    problem = study.problem(model.with_effect(name, values[0]))
    count = len(values)
    theta = np.concatenate(
        [np.tile(fit.theta[:-1], (count, 1)), values, np.full((count, 1), fit.theta[-1])], axis=1
    )
    return problem.response(theta, np.tile(fit.run_effects, (count, 1, 1)))


def _project(hessian: Floats, gradient: Floats, free: NDArray[np.int64], own: int) -> tuple[Floats, Floats]:
    """Information (m, m) and score (m,) of the candidates' columns with the model's free parameters projected off."""
    rest = np.arange(own, len(hessian))
    grid = np.ix_(free, free)
    across = hessian[np.ix_(rest, free)]
    inverse = linear_mixed.covariance_of(hessian[grid])
    information = hessian[np.ix_(rest, rest)] - across @ inverse @ across.T
    return 0.5 * (information + information.T), gradient[rest] - across @ inverse @ gradient[free]


def _draw(information: Floats, seed: int) -> Floats:
    """Scores of null campaigns: Gaussian with the information as covariance, (DRAWS, m)."""
    values, vectors = np.linalg.eigh(information)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    return np.random.default_rng(seed).standard_normal((DRAWS, len(values))) @ root.T


def _drop(block: Floats, pull: Floats, one_sided: bool) -> tuple[Floats, Floats]:
    """Drop in deviance (n,) and size in units of the probe (n, m) for scores `pull` (n, m)."""
    scale = np.sqrt(np.maximum(np.diagonal(block), 1e-24))
    inverse = np.linalg.pinv(block / np.outer(scale, scale), rcond=1e-8, hermitian=True) / np.outer(
        scale, scale
    )
    size = pull @ inverse
    drop = np.einsum("nm,nm->n", pull, size)
    return (np.where(size[:, 0] > 0, drop, 0.0) if one_sided else drop), size


def _start(probe: Probe, size: Floats) -> Floats:
    """Parameter values at which a full fit starts: the probe at the size that the score asks for, within reason."""
    own = effects.get(probe.effect).parameters
    values = probe.values[0].copy()
    if len(probe.values) == 1 and probe.one_sided and all(p.scan for p in own):
        return values
    sized = [i for i, p in enumerate(own) if not p.scan and not p.reference]
    for row, i in enumerate(sized):
        step = (probe.values[row, i] - own[i].off) * float(np.clip(size[row], -4.0, 4.0))
        low, high = own[i].lower, own[i].upper
        margin = 1e-3 * abs(probe.values[row, i])
        values[i] = float(np.clip(own[i].off + step, low + margin, high - margin))
    return values


def _unit_size(probe: Probe, block: Floats) -> float:
    """Size of the first fitted parameter, from its off value, whose expected drop in deviance is one."""
    own = effects.get(probe.effect).parameters
    i = next((i for i, p in enumerate(own) if not p.scan and not p.reference), 0)
    step = probe.values[0, i] - own[i].off if np.isfinite(own[i].off) else probe.values[0, i]
    return float(abs(step) / np.sqrt(max(block[0, 0], 1e-24)))
