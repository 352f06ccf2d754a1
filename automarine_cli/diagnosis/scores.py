"""How much each candidate would gain, from one linearisation; and what chance alone would seem to gain.

At a fitted model the headings' response to each candidate is simulated once, freed of what the model's own
parameters and the run effects can follow, and compared with what is left of the headings: Rao's score test, with the
runs' own covariance. Under "nothing is missing" all scores together are Gaussian with a known covariance, so the
distribution of the best of all candidates costs a few thousand draws and no refit. Where the scores of runs scatter by
more than that, their scatter says what chance gains.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np

from automarine_cli import effects
from automarine_cli.diagnosis.study import DiagnosisProblem, Fit
from automarine_cli.effects import State
from automarine_cli.fits import linear_mixed
from automarine_cli.fits.innovations import InnovationsFit, Slopes, filtered, innovations_of
from automarine_cli.fits.mixed_model import MixedFit, derivatives
from automarine_cli.fits.stepwise import Chance
from automarine_cli.models.model import COMMAND_DELAY, Model
from automarine_cli.pipeline.parallel import Each, alone
from automarine_cli.quantities import Floats


@dataclass(frozen=True)
class CandidateShape:
    """One shape of a candidate: parameter values (m, k) whose responses span what it can do at that shape; `sized` are
    the parameters that the rows differ in."""

    effect: str
    values: Floats
    sized: tuple[int, ...]
    one_sided: bool


def score_information(
    study: DiagnosisProblem, model: Model, fit: Fit, names: Sequence[str], shapes: Sequence[CandidateShape],
    map_fn: Each,
) -> tuple[Floats, Floats]:  # fmt: skip
    """Each run's information (R, m, m) on a model's parameters and, after them, the sizes of probes of the effects
    `names`, and its score (R, m), at a fit; `map_fn` maps a function over these effects."""
    work = [(name, np.concatenate([probe.values for probe in shapes if probe.effect == name])) for name in names]
    if fit.driven:
        return _of_driven(study, model, fit, work)
    problem = study.problem(model)
    fitted, by_phi, by_run = derivatives(problem, fit.phi, fit.run_effects)
    columns = np.concatenate(map_fn(partial(_responses, study, model, fit), work, "looking at effects")) - fitted
    columns = np.where(problem.observed, columns, 0.0)
    sane = np.isfinite(columns).all(axis=(1, 2), keepdims=True)
    columns = np.where(sane, columns, 0.0)  # a probe that runs away says nothing
    j = np.concatenate([by_phi, np.moveaxis(columns, 0, 2)], axis=2)
    data = problem.residual(fitted) + np.einsum("rnq,rq->rn", by_run, fit.run_effects)
    weighted = linear_mixed.weigh(problem.inner(j, by_run, data), problem.effects, fit.variances)
    return weighted.hessian, weighted.gradient


def _of_driven(
    study: DiagnosisProblem, model: Model, fit: InnovationsFit, work: Sequence[tuple[str, Floats]]
) -> tuple[Floats, Floats]:
    """The same of driven runs: what each probe changes in the innovations and in their variances."""
    problem = study.driven_problem(model)
    model_size, problems, phis = len(fit.of_model), [problem], [problem.moved(fit.phi)]
    for name, values in work:
        wider = study.driven_problem(model.with_effect(name, values[0]))
        theta = np.tile(fit.theta, (len(values), 1))
        theta = np.concatenate([theta[:, :model_size], values, theta[:, model_size:]], axis=1)
        if len(wider.parameters.nuisance) > len(problem.parameters.nuisance):
            # what an effect may let vary has a score of its own
            theta = np.concatenate([theta, np.full((len(values), 1), 1e-9)], axis=1)
        problems.append(wider)
        phis.append(wider.parameters.search(theta))
    of_model, *of_probes = filtered(problems, phis)
    base = innovations_of(of_model, slice(None), problem.steps(fit.phi))
    slopes = Slopes.of([base, *(innovations_of(of_probe, slice(None), 1.0, base) for of_probe in of_probes)])
    free, count = problem.free, len(fit.phi)
    places = np.concatenate([free, np.arange(count, count + slopes.gradient.shape[1] - len(free))])
    hessian = np.zeros((len(study.runs), places[-1] + 1, places[-1] + 1))
    gradient = np.zeros(hessian.shape[:2])
    hessian[:, places[:, None], places] = slopes.information
    gradient[:, places] = slopes.gradient
    return hessian, gradient


def _responses(study: DiagnosisProblem, model: Model, fit: MixedFit, candidate: tuple[str, Floats]) -> Floats:
    """Headings (m, R, N) of the fitted model with a candidate added at each of its values (m, k)."""
    name, values = candidate
    problem = study.problem(model.with_effect(name, values[0]))
    count, run_effects = len(values), fit.effects.carried(fit.run_effects, problem.effects)
    delay = np.full((count, 1), fit.value(COMMAND_DELAY))
    theta = np.concatenate([np.tile(fit.of_model, (count, 1)), values, delay], axis=1)
    return problem.response(theta, np.tile(run_effects, (count, 1, 1)))


RATES = 50  # rates at which drag is asked for its sign, either way round


def drag_drives(model: Model, fastest: float) -> bool:
    """Whether the drag of `model` would speed the vehicle up at some rate up to `fastest` [rad/s], either way round.

    Such a model follows the runs it was fitted to and runs away on others: the asymmetry of a quadratic drag beside a
    linear one alone, say."""
    rates = fastest * np.linspace(-1.0, 1.0, 2 * RATES + 1)[:, None]
    zeros = np.zeros_like(rates)
    state = State(zeros, zeros, rates, rates, zeros, zeros, {})
    total, sizes = zeros, zeros
    for term in model.terms:
        effect = effects.get(term.name)
        if effect.power is not None:
            values = tuple(np.full((1, 1), value) for value in term.values)
            moment = effect.moment(state, values)
            total, sizes = total + moment, sizes + np.abs(moment)
    return bool(np.any(total * rates > 1e-9 * sizes * np.abs(rates)))


CLAIM_LEVEL = 0.005  # share of campaigns with nothing missing in which something may still be claimed
DRAWS = 2000
LAW_SCORE_SHARE = 0.5  # share of an effect's best score from which another of its laws is worth a fit
ROUNDING = 1e-10  # share of a column's information below which what is left is rounding
TRIAL_SIZE = 0.03  # size at which a parameter without a start of its own is tried


@dataclass(frozen=True)
class Score:
    """A candidate's best shape: expected drop in deviance, the same less its penalty, where a full fit should start
    (k,), the size of its first parameter at which the drop would be one, and `other_starts` in its other laws."""

    effect: str
    drop: float
    penalised: float
    start: Floats
    unit_size: float
    other_starts: tuple[Floats, ...] = ()


@dataclass(frozen=True)
class Scores(Chance):
    """All candidates, best first, beside what chance reaches: the best penalised drop of each of `null` draws."""

    ranked: tuple[Score, ...]


def penalty(parameters: float, runs: int) -> float:
    """Schwarz's penalty with the run as the unit, in deviance."""
    return float(parameters * np.log(max(runs, 2)))


def candidates(study: DiagnosisProblem, model: Model) -> list[str]:
    """Effects of its motion that the model lacks and the logs can drive."""
    present = {term.name for term in model.terms}
    absent = [effects.get(name) for name in effects.names() if name not in present]
    return [
        effect.name for effect in absent
        if effect.acts_in(model.dof) and set(effect.needs) <= set(study.signals)
        and not (model.steered and effect.steered is False)
        # velocities alone show neither where the vehicle is nor the sensor of that
        and (study.position_counts or not (effect.place is effects.Place.SENSOR or effect.uses_absolute))
        and (study.commanded or effect.acts_on or effect.place is not effects.Place.ACTUATOR)
        and (study.commands_return or not effect.returning)
    ]  # fmt: skip


def fitted_parameters(name: str, values: Sequence[float] | Floats | None = None) -> int:
    """Number of parameters of an effect that a fit estimates: the free ones, and the amplitude of what varies."""
    effect = effects.get(name)
    parameter_values = tuple(float(v) for v in (effect.off if values is None else values))
    return sum(not fixed for fixed in effect.held(parameter_values)) + effect.varies(parameter_values)


def candidate_shapes(study: DiagnosisProblem, name: str) -> list[CandidateShape]:
    """The shapes in which a candidate is tried; how it varies from run to run is no shape of its own."""
    effect = effects.get(name)
    parameters = effect.parameters
    laws = [effect.laws_of(effect.needs) if p.choices and not effect.per_run else (None,) for p in parameters]
    shapes = []
    for law in product(*laws):
        fixed = [
            float(choice) if choice is not None
            else study.reference(p.reference) if p.reference
            else p.start if p.laws
            else p.off
            for p, choice in zip(parameters, law)
        ]  # fmt: skip
        fixed_flags = effect.held(tuple(fixed))
        scans = [() if is_fixed else effect.scan(p, tuple(fixed)) for p, is_fixed in zip(parameters, fixed_flags)]
        fixed = [p.off if p.laws and not is_fixed else v for p, v, is_fixed in zip(parameters, fixed, fixed_flags)]
        sized = tuple(i for i in range(len(parameters)) if not scans[i] and not fixed_flags[i])
        one_sided = not sized or (len(sized) == 1 and parameters[sized[0]].lower == parameters[sized[0]].off)
        for shape in product(*(scan or (None,) for scan in scans)):
            at = [v if s is None else p.scaled(s, study.largest) for p, v, s in zip(parameters, fixed, shape)]
            rows = []
            for i in sized:
                start = parameters[i].start if parameters[i].start != parameters[i].off else TRIAL_SIZE
                rows.append([*at[:i], parameters[i].scaled(start, study.largest), *at[i + 1 :]])
            shapes.append(CandidateShape(name, np.array(rows or [at]), sized, one_sided))
    return shapes


def score(
    study: DiagnosisProblem, model: Model, fit: Fit, names: Sequence[str], seed: int, map_fn: Each = alone
) -> Scores:
    """Score the candidates `names` at a fit of `model`; `map_fn` maps a function over them."""
    every = [probe for name in names for probe in candidate_shapes(study, name)]
    hessian, gradient = score_information(study, model, fit, names, every, map_fn)
    informations, pulls = project(hessian, gradient, fit)
    information, pull = informations.sum(axis=0), pulls.sum(axis=0)
    # columns of which only rounding is left are nothing: what a model follows wholly, or what these runs do not stir
    of_size = np.diagonal(hessian.sum(axis=0))[len(fit.phi) :]
    informative = np.diagonal(information) > ROUNDING * np.maximum(of_size, ROUNDING * of_size.max(initial=0.0))
    information, pull = information * np.outer(informative, informative), pull * informative
    random = np.random.default_rng(seed)
    draws = _draw(information, random)
    runs, at = len(study.runs), 0
    scored, null, tried = list[Score](), np.full(DRAWS, -np.inf), list[_Tried]()
    for probe in every:
        probe_columns = slice(at, at + len(probe.values))
        at = probe_columns.stop
        block = information[probe_columns, probe_columns]
        drop, size = _drop(block, pull[None, probe_columns], probe.one_sided)
        start, unit_size = _start(probe, size[0]), _unit_size(probe, block)
        cost = penalty(fitted_parameters(probe.effect, start), runs)
        tried.append(_Tried(probe, probe_columns, float(drop[0]) - cost, cost, size[0]))
        scored.append(Score(probe.effect, float(drop[0]), float(drop[0]) - cost, start, unit_size))
        effect = effects.get(probe.effect)
        period = next((v for p, v in zip(effect.parameters, probe.values[0]) if p.scan), np.inf)
        if effect.per_run and period <= study.slowest:
            columns = slice(len(fit.phi) + probe_columns.start, len(fit.phi) + at)
            rise, chance = _varying(hessian[:, columns, columns], gradient[:, columns], random)
            # no common coefficients, the probe's shape
            shape = [1.0 if p.choices else value for p, value in zip(effect.parameters, probe.values[0])]
            start = np.array([0.0 if i in probe.sized else value for i, value in enumerate(shape)])
            cost = penalty(fitted_parameters(probe.effect, start), runs)
            null = np.maximum(null, chance - cost)
            scored.append(Score(probe.effect, rise, rise - cost, start, unit_size))

    def reached(draws: Floats) -> Floats:
        """What the best probe would gain in each draw of all scores."""
        blocks = ((trial, information[trial.columns, trial.columns]) for trial in tried)
        gains = [_drop(block, draws[:, t.columns], t.probe.one_sided)[0] - t.cost for t, block in blocks]
        return np.asarray(np.max(gains, axis=0, initial=-np.inf))

    if tried:
        null = np.maximum(null, reached(draws))
    if tried and not study.driven:
        best = max(tried, key=lambda trial: trial.penalised)
        signed = signed_scores(informations, pulls, best.columns, best.size, random)
        null = larger(null, reached(signed * informative))
    laws: dict[tuple[object, ...], Score] = {}
    for law in sorted(scored, key=lambda law: -law.drop):
        laws.setdefault(law_of(law.effect, law.start), law)
    return Scores(null, _by_effect(list(laws.values())))


@dataclass(frozen=True)
class _Tried:
    """A probe with its columns, what it gains, what its parameters cost, and its size, in units of the probe."""

    probe: CandidateShape
    columns: slice
    penalised: float
    cost: float
    size: Floats


def signed_scores(
    informations: Floats, pulls: Floats, columns: slice, size: Floats, random: np.random.Generator
) -> Floats:
    """Draw scores (DRAWS, m) as runs that agree on nothing would have: each run's own, less what probes in `columns`
    of `size` explain of it, with either sign.

    Where all that differs from run to run is the noise of the sensors these spread as the model says; where something
    pushes runs that the model does not know, by more (wild bootstrap: Wu 1986, Ann. Statist. 14:1261)."""
    remaining = pulls - informations[:, :, columns] @ size
    return np.asarray(random.choice([-1.0, 1.0], (DRAWS, len(pulls))) @ remaining)


def larger(*nulls: Floats) -> Floats:
    """Choose of draws of what chance gains those that reach further."""
    return max(nulls, key=lambda null: float(np.quantile(null, 1.0 - CLAIM_LEVEL)))


def law_of(name: str, values: Sequence[float] | Floats) -> tuple[object, ...]:
    return (name, *(v for p, v in zip(effects.get(name).parameters, values) if p.choices))


def _by_effect(scores: Sequence[Score]) -> tuple[Score, ...]:
    """The best law of each effect, with the starts of those near it; best effect first."""
    laws: dict[str, list[Score]] = {}
    for law in sorted(scores, key=lambda s: -s.penalised):
        laws.setdefault(law.effect, []).append(law)
    return tuple(
        replace(first, other_starts=tuple(law.start for law in rest if law.drop > LAW_SCORE_SHARE * first.drop))
        for first, *rest in laws.values()
    )


def _varying(information: Floats, score: Floats, random: np.random.Generator) -> tuple[float, Floats]:
    """What a coefficient of its own in every run would gain in deviance, and what chance would (DRAWS,).

    With u = V'R^-1 e and K = V'R^-1 V of a run, in K's axes, coefficients of variance g add to the deviance log(1 + g
    k) - g u²/(1 + g k) an axis, whatever the run; g is the best on a grid."""
    k, turn = np.linalg.eigh(information)
    pull = np.einsum("rm,rmj->rj", score, turn)
    k, square = np.maximum(k, 0.0).ravel(), (pull**2).ravel()
    if not k.any():
        return 0.0, np.zeros(DRAWS)
    luck = random.standard_normal((DRAWS, k.size)) ** 2 * k
    scale = np.geomspace(0.03, 300.0, 15) / np.median(k[k > 0])
    grown = 1.0 + scale[:, None] * k
    share, cost = scale[:, None] / grown, np.log(grown).sum(axis=1)
    gain, chance = share @ square - cost, luck @ share.T - cost
    return float(max(gain.max(), 0.0)), np.asarray(np.maximum(chance.max(axis=1), 0.0))


def project(hessian: Floats, gradient: Floats, fit: Fit) -> tuple[Floats, Floats]:
    """Each run's information (R, m, m) and score (R, m) of the probes, with the model's free parameters projected off:
    those of all runs together."""
    count = len(fit.phi)
    free = np.setdiff1d(np.arange(count), fit.at_bound)
    total = hessian.sum(axis=0)
    projection = total[count:][:, free] @ linear_mixed.covariance_of(total[np.ix_(free, free)])
    across = projection @ hessian[:, free, count:]
    within = projection @ hessian[:, free[:, None], free] @ projection.T
    information = hessian[:, count:, count:] - across - across.swapaxes(1, 2) + within
    information = 0.5 * (information + information.swapaxes(1, 2))
    return information, gradient[:, count:] - gradient[:, free] @ projection.T


def _draw(information: Floats, random: np.random.Generator) -> Floats:
    """Scores of null campaigns: Gaussian with the information as covariance, (DRAWS, m)."""
    deviation = np.sqrt(np.diagonal(information))  # taken out first: large columns would lend small ones their rounding
    unit = np.where(deviation > 0, deviation, 1.0)
    values, vectors = np.linalg.eigh(information / np.outer(unit, unit))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    return random.standard_normal((DRAWS, len(values))) @ root.T * deviation


def _drop(block: Floats, pull: Floats, one_sided: bool) -> tuple[Floats, Floats]:
    """Drop in deviance (n,) and size in units of the probe (n, m) for scores `pull` (n, m)."""
    scale = np.sqrt(np.maximum(np.diagonal(block), 1e-24))
    inverse = np.linalg.pinv(block / np.outer(scale, scale), rcond=1e-8, hermitian=True) / np.outer(scale, scale)
    size = pull @ inverse
    drop = np.einsum("nm,nm->n", pull, size)
    return (np.where(size[:, 0] > 0, drop, 0.0) if one_sided else drop), size


def _start(probe: CandidateShape, size: Floats) -> Floats:
    """Parameter values at which a full fit starts: the probe at the size that the score asks for, within reason."""
    parameters = effects.get(probe.effect).parameters
    values = probe.values[0].copy()
    for row, i in enumerate(probe.sized):
        step = (probe.values[row, i] - parameters[i].off) * float(np.clip(size[row], -4.0, 4.0))
        low, high = parameters[i].lower, parameters[i].upper
        margin = 1e-3 * abs(probe.values[row, i])
        values[i] = float(np.clip(parameters[i].off + step, low + margin, high - margin))
    return values


def _unit_size(probe: CandidateShape, block: Floats) -> float:
    """Size of the first fitted parameter, from its off value, whose expected drop in deviance is one."""
    parameters = effects.get(probe.effect).parameters
    i = probe.sized[0] if probe.sized else 0
    step = probe.values[0, i] - parameters[i].off if np.isfinite(parameters[i].off) else probe.values[0, i]
    return float(abs(step) / np.sqrt(max(block[0, 0], 1e-24)))
