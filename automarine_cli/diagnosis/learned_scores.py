"""Which curves these runs could show, and how much each would gain, from one linearisation."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from automarine_cli import effects
from automarine_cli.diagnosis.pull import Probe, pull_of
from automarine_cli.diagnosis.scores import DRAWS, penalty
from automarine_cli.diagnosis.smooth import SPREADS, precision
from automarine_cli.diagnosis.study import Study
from automarine_cli.diagnosis.trials import Trial
from automarine_cli.dofs import Dof
from automarine_cli.effects.learned import FIRST, KINDS, KNOTS, PREFIX, TIME, Learned, hyphened, kind_of
from automarine_cli.effects.learned import GAIN as OF_THRUST
from automarine_cli.fits import linear_mixed
from automarine_cli.fits.run_effects import GAIN
from automarine_cli.fits.stepwise import Chance
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.pipeline.parallel import Each, alone
from automarine_cli.quantities import CLOCK, SINCE, Floats
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import signals_of

TRIED = 0.02
"""Value at which each knot is tried, a share of the largest moment or of the thrust."""
FEWEST_RUNS = 10
"""Runs from which their gains may be compared with a column."""
STANDS_FOR = 0.9
"""Correlation with the campaign's clock from which a column only stands for time."""
FOLLOWS = 0.01
"""Chance below which the gains of runs follow a column."""
POWERS = (1, 3, 6, 9)
"""Highest powers of a column by which gains are then explained: from a line to two waves."""
DEALS = 2000
"""Orders in which runs are dealt to tell what chance explains."""


@dataclass(frozen=True)
class Curve:
    """A candidate: the model with its curve at nothing, and what the score says of it: the evidence that it gains, in
    deviance, with its parameters counted, and where a fit should start."""

    model: YawModel
    gain: float

    @property
    def name(self) -> str:
        """The effect's name."""
        return self.model.terms[-1].name

    @property
    def of_thrust(self) -> bool:
        """Whether it is a gain on the thrust."""
        return kind_of(self.model.terms[-1].values) == OF_THRUST


def scored(study: Study, base: Trial, seed: int, each: Each = alone) -> tuple[list[Curve], Chance]:
    """All curves that these runs can show, best first, and what the best of them gains by chance, (DRAWS,)."""
    models = candidates(study, base.model)
    if not models:
        return [], Chance(np.zeros(DRAWS))
    probes = [_probe(model) for model in models]
    names = list(dict.fromkeys(model.terms[-1].name for model in models))
    ordered = [(m, p) for name in names for m, p in zip(models, probes) if p.effect == name]
    weighted = pull_of(study, base.model, base.fit, names, [p for _, p in ordered], each)
    own = len(base.fit.phi)
    free = np.setdiff1d(np.arange(own), base.fit.at_bound)
    hessian, gradient = weighted.hessian.sum(axis=0), weighted.gradient.sum(axis=0)
    across = hessian[own:][:, free]
    inverse = linear_mixed.covariance_of(hessian[np.ix_(free, free)])
    information = (hessian[own:, own:] - across @ inverse @ across.T) / TRIED**2
    pull = (gradient[own:] - across @ inverse @ gradient[free]) / TRIED
    values, vectors = np.linalg.eigh(0.5 * (information + information.T))
    random = np.random.default_rng(seed)
    draws = random.standard_normal((DRAWS, len(values))) @ (vectors * np.sqrt(np.maximum(values, 0.0))).T
    found, null = [], np.full(DRAWS, -np.inf)
    for number, (model, _) in enumerate(ordered):
        here = slice(number * KNOTS, (number + 1) * KNOTS)
        pulls = np.concatenate([pull[None, here], draws[:, here]])
        gain, curve, spread = _gains(information[here, here], pulls, model, len(study.runs))
        null = np.maximum(null, gain[1:])
        found.append(Curve(with_curve(model, spread, np.clip(curve, -1.0, 1.0)), float(gain[0])))
    return sorted(found, key=lambda one: -one.gain), Chance(null)


def _gains(information: Floats, pulls: Floats, model: YawModel, runs: int) -> tuple[Floats, Floats, float]:
    """Evidence gained (n,) by a curve of each score in `pulls` (n, KNOTS), each at its own likeliest spread; the first
    one's values and spread."""
    likely, gains, curves = [], [], []
    for spread in SPREADS:
        prior = precision(model, float(spread))
        inverse = np.linalg.inv(information + prior)
        curve = pulls @ inverse
        log_det = np.linalg.slogdet(prior)[1] + np.linalg.slogdet(inverse)[1]
        likely.append((pulls * curve).sum(axis=1) + log_det)
        drop = 2.0 * (pulls * curve).sum(axis=1) - np.einsum("nk,kj,nj->n", curve, information, curve)
        gains.append(drop - float(np.trace(inverse @ information)) * penalty(1, runs))
        curves.append(curve[0])
    at = np.argmax(likely, axis=0)
    return np.stack(gains)[at, np.arange(len(pulls))], curves[at[0]], float(SPREADS[at[0]])


def _probe(model: YawModel) -> Probe:
    """Each value of a curve in turn."""
    term = model.terms[-1]
    rows = np.tile(term.values, (KNOTS, 1))
    rows[np.arange(KNOTS), FIRST + np.arange(KNOTS)] = TRIED
    return Probe(term.name, rows, tuple(range(FIRST, FIRST + KNOTS)), False)


def candidates(study: Study, model: YawModel) -> list[YawModel]:
    """The model with a flat curve over each variable that the runs show, of each kind."""
    found = []
    for name, (low, high) in ranges(study).items():
        effect = effects.get(PREFIX + name)
        assert isinstance(effect, Learned)
        if effect.acts_in(model.dof) and (study.position_counts or not effect.placed):
            for kind in effect.variable.kinds:
                values = [low, high, study.largest, 1.0, *[0.0] * KNOTS, float(KINDS.index(kind))]
                found.append(model.with_effect(effect.name, values))
    return found


def ranges(study: Study) -> dict[str, tuple[float, float]]:
    """Every variable over which a curve may run, with its ends."""
    dof, batch = study.base.dof, study.batch
    way = np.where(batch.seen, batch.position - batch.position[:, :1], 0.0)
    found = {
        hyphened(dof.words.rate): (0.0, study.fastest),
        hyphened(dof.words.force): (0.0, study.largest),
        hyphened(dof.words.travelled): (float(way.min()), float(way.max())),
        TIME: (0.0, float(batch.time.max())),
    }
    if dof.wraps:
        found[dof.words.position] = (0.0, dof.turn)
    clock = np.concatenate(signals_of(study.runs, CLOCK))
    for name in (CLOCK, SINCE, *_columns(study.runs, dof)):
        values = np.concatenate(signals_of(study.runs, name))
        if len(study.runs) >= FEWEST_RUNS or not _alike(values, clock):
            found[name] = (float(values.min()), float(values.max()))
    return {name: (low, high) for name, (low, high) in found.items() if high - low > 1e-9 * max(abs(high), 1e-9)}


def _alike(values: Floats, clock: Floats) -> bool:
    """Whether a column only stands for time: what changes from run to run of a few goes with the clock by chance."""
    spread = float(np.std(values) * np.std(clock))
    return spread > 0 and abs(float(np.mean((values - values.mean()) * (clock - clock.mean())))) > STANDS_FOR * spread


def all_signals(study: Study) -> tuple[str, ...]:
    """What curves over columns and clocks need."""
    return tuple(sorted({*study.signals, CLOCK, SINCE, *_columns(study.runs, study.base.dof)}))


def _columns(runs: Sequence[Run], dof: Dof) -> list[str]:
    """Logged columns with a value in every row of every run, but for those that measure the motion itself."""
    shared = set.intersection(*(set(run.extras) for run in runs)) - {dof.velocity, dof.command, *dof.thrusters}
    return sorted(n for n in shared if all(np.isfinite(run.extras[n]).all() for run in runs))


def with_curve(model: YawModel, spread: float, curve: Floats) -> YawModel:
    """The model with other values and another spread of its last term, a curve."""
    *terms, last = model.terms
    values = (*last.values[: FIRST - 1], spread, *(float(v) for v in curve), last.values[-1])
    return replace(model, terms=(*terms, replace(last, values=values)))


def gains_follow(study: Study, trial: Trial, seed: int) -> str:
    """The column that the runs' own gains follow; empty where they follow none beyond a chance of FOLLOWS.

    Its mean in each run counts: least squares of the gains on its powers up to each of POWERS, the best of all columns
    by Fisher's test, compared with that of runs dealt in another order (`seed`).
    """
    gains, runs = trial.fit.own(GAIN)[:, 0], study.runs
    if len(runs) < FEWEST_RUNS or np.ptp(gains) < 1e-9:
        return ""
    random, follows = np.random.default_rng(seed), ""
    dealt = np.array([gains, *(random.permutation(gains) for _ in range(DEALS))]) - gains.mean()
    whole, best = float((dealt[0] ** 2).sum()), np.ones(1 + DEALS)
    for name in _columns(runs, study.base.dof):
        means = np.array([float(np.mean(values)) for values in signals_of(runs, name)])
        if np.ptp(means) > 1e-9 * max(float(np.abs(means).max()), 1e-9):
            powers = np.vander(2.0 * (means - means.min()) / np.ptp(means) - 1.0, POWERS[-1] + 1, increasing=True)
            axes = np.linalg.qr(powers)[0][:, 1:]  # its powers less what lower ones are already
            share = np.cumsum((dealt @ axes) ** 2, axis=1) / whole
            for count in [count for count in POWERS if 3 * count < len(runs)]:
                free = len(runs) - count - 1
                explained, left = share[:, count - 1] / count, np.maximum(1.0 - share[:, count - 1], 1e-12) / free
                chance = special.fdtrc(count, free, explained / left)
                follows = name if chance[0] < best[0] else follows
                best = np.minimum(best, chance)
    return follows if (best[1:] <= best[0]).mean() < FOLLOWS else ""
