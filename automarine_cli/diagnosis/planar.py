"""What a planar model lacks: couplings, a current, or what stands between command and moment, named by evidence.

Each candidate is added to the model and everything is fitted again by innovations. It counts where its deviance gains
more than a penalty and a head start, run by run beyond chance, and where runs held out are more likely with it.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np
from numpy.typing import NDArray

from automarine_cli import effects
from automarine_cli.diagnosis.diagnose import Diagnosis, NamedEffect, listed_rivals
from automarine_cli.diagnosis.residual_regions import (
    Factor,
    ResidualGrid,
    ResidualRegions,
    find_regions,
    gap_ahead,
    last_side,
    of_run_or_sample,
    since_change,
    stretch,
)
from automarine_cli.diagnosis.scores import penalty
from automarine_cli.diagnosis.search import clear
from automarine_cli.diagnosis.study import judged
from automarine_cli.diagnosis.verdict import NAMED, NOTHING, SUSPECTED, UNEXPLAINED, JudgedRuns, outlook_of
from automarine_cli.dofs import PLANAR, SWAY, YAW, Dof
from automarine_cli.effects import Effect, Place
from automarine_cli.effects.thruster_imbalance import PARTS
from automarine_cli.errors import TooFewRunsError
from automarine_cli.filters.course import Course
from automarine_cli.filters.kalman import Predicted, predict
from automarine_cli.fits.driven import start_of
from automarine_cli.fits.planar_fit import ACTUATORS, PlanarLikelihood, model_content
from automarine_cli.fits.planar_structure import (
    CHANNELS,
    NORTH_EAST,
    PLANE_DRAG_LAWS,
    Candidate,
    Observed,
    candidates,
    inertia_tied,
)
from automarine_cli.fits.stepwise import Judge, NamedRival, stepwise_search
from automarine_cli.fits.whole_runs import OutputErrorFit
from automarine_cli.models.model import Model, Term
from automarine_cli.models.store import StoredModels
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import LOGGED_COMMAND, Run

NEGLIGIBLE_SHARE = 0.02  # share of its usual size at which an effect is as good as none
SAYS = {
    "cross-coupling": "One motion drives another",
    "munk-moment": "Sway takes more water along than surge, which turns a drifting hull",
    "current": "The water moves",
}
SPLIT_BY = {
    "Y_r": "turns on the spot under a moment alone",
    "N_v": "thrust abeam from rest, without way on",
    "N_ur": "turns under one moment at several speeds ahead",
    "Y_uv": "thrust abeam at several speeds ahead",
    "Y_ur": "turns under one rudder angle at several speeds ahead",
    "N_uv": "thrust abeam at several speeds ahead",
    "m_vr": "short pulses of thrust abeam from rest",
    "m_v": "oblique courses at several speeds: its moment grows with surge times sway",
    "north": "drifting without thrust",
}
"""Runs that tell one coupling from others, by the first letter that it adds."""


def base_of(stored: StoredModels, observed: Observed) -> Model:
    """The stored model with the parameters free that its fit had free, and what the logs do not tell tied.

    Without a fit those are free that are not zero. A mass abeam that equals the mass ahead is tied to it."""
    model = stored.undelayed
    names, mass = model.parameter_names, SWAY.parameter("inertia")
    ties = [tie for tie in observed.ties if {*tie[:2]} <= {*names}]
    if mass not in [tied for tied, *_ in ties] and model.masses[1] == model.masses[0]:
        ties.append((mass, "surge.m_u", 1.0))
    fixed, model = model.fixed, replace(model, ties=tuple(ties))
    if not fixed:
        fixed = tuple(name for name, value in zip(names, model.theta) if not value)
    if observed.rudder_alone:
        model = inertia_tied(model, model.masses[2] / model.masses[1])
    tied = [name for name, *_ in model.ties]
    return replace(model, fixed=tuple(name for name in fixed if name not in tied))


def suspects(model: Model, likelihood: PlanarLikelihood) -> Iterator[Candidate]:
    """What a model may lack: what logs tell of a hull, and effects of the library in each motion."""
    observed, course = likelihood.observed, likelihood.course
    yield from candidates(model, observed)
    mass = SWAY.parameter("inertia")
    if mass in [tied for tied, *_ in model.ties]:
        ties = tuple(tie for tie in model.ties if tie[0] != mass)
        yield Candidate("munk-moment", (mass,), replace(model, ties=ties))
    have = {(term.dof, term.name) for term in model.terms}
    for (place, dof), effect in product(enumerate(PLANAR.dofs), sloping(course.signals)):
        may = {Place.ACTUATOR: place in likelihood.commanded, Place.SENSOR: dof is YAW}.get(effect.place, True)
        if may and dof in observed.dofs and effect.acts_in(dof) and (place, effect.name) not in have:
            values = tuple(
                size if p.held else p.off + (p.start != p.off) * NEGLIGIBLE_SHARE * (size - p.off)
                for p, size in zip(effect.parameters, start_of(effect.name, course, place))
            )
            yield Candidate.of_term(model, Term(effect.name, values, dof=place))


def sloping(logged: Collection[str]) -> list[Effect]:
    """Effects of the library that logs of these columns can drive, and of which a slope tells what they gain; none that
    the plane has by another name, or of a rudder."""
    every = [effects.get(name) for name in effects.names() if name not in (*PLANE_DRAG_LAWS, *dict(ACTUATORS))]
    other = {"rudder", *PARTS, *(dof.velocity for dof in PLANAR.dofs)}
    return [
        effect for effect in every
        if {*effect.needs} <= {*logged} - other and not any(p.scan for p in effect.parameters)
    ]  # fmt: skip


def run_to_split(candidate: Candidate) -> str:
    """Say which runs tell a candidate from others."""
    return SPLIT_BY.get(candidate.added[0].rpartition(".")[2]) or effects.get(candidate.name).card(YAW).separated_by


MIN_TO_SPLIT = 4  # runs of which one is held out: those of motion in the plane are few and long
HEAD_START = 10.0  # deviance beyond the penalty that an effect has to gain
MIN_STDERRS = 2.0  # standard errors by which the mean gain of a run has to exceed zero
MIN_NEARER = 0.03  # share by which predictions have to miss less with what is no coupling, drag or current
MAX_CANDIDATES_FITTED = 4  # in a round: those that promise most
LOOK_ITERATIONS = 6  # of each
NOISE_SHARE = 3.0  # times the noise of headings, from which a prediction misses
MAX_EFFECTS_NAMED = 3  # effects that are named at most


@dataclass(frozen=True)
class FittedCandidate:
    """A candidate that was fitted: deviance gained by all runs beyond its penalty, whether run by run beyond chance,
    log likelihood gained by held-out runs, and whether predictions come `nearer` where they have to.

    A hull that follows other laws than the model's asks for many effects beyond chance, each of which changes next to
    nothing: names are those of effects that predictions show."""

    candidate: Candidate
    estimate: OutputErrorFit
    surplus: float
    steady: bool
    held_out: float
    nearer: bool = True

    @property
    def evident(self) -> bool:
        return self.surplus > HEAD_START and self.steady and self.nearer

    def is_rival_of(self, best: "FittedCandidate") -> bool:
        """Whether the best one does not lead by more than the head start, and run by run beyond chance."""
        behind = best.estimate.mixed.density - self.estimate.mixed.density
        return best.surplus - self.surplus < HEAD_START or not clear(behind, MIN_STDERRS)


@dataclass(frozen=True)
class PlanarStep:
    """One look for an effect: the model that was looked at, the surplus that each candidate's score promised, those
    that were fitted, and, if one was taken, the `best` with its rivals."""

    before: OutputErrorFit
    promised: tuple[tuple[Candidate, float], ...]
    tried: tuple[FittedCandidate, ...]
    best: FittedCandidate | None = None
    rivals: tuple[FittedCandidate, ...] = ()


@dataclass(frozen=True)
class PlanarSearch(Judge[OutputErrorFit, PlanarStep]):
    """Candidates judged by innovations of the fitted runs, and by the density of the `other` runs."""

    likelihood: PlanarLikelihood
    other: PlanarLikelihood
    most = MAX_EFFECTS_NAMED

    def look(self, model: OutputErrorFit, number: int) -> PlanarStep:
        likelihood = self.likelihood
        promised = likelihood.promised(model, partial(suspects, likelihood=likelihood))
        leaders = sorted(promised, key=lambda pair: -pair[1].gain)[:MAX_CANDIDATES_FITTED]
        leaders = [(candidate, promise) for candidate, promise in leaders if 2.0 * promise.gain > HEAD_START]
        fits = [*likelihood.tried(leaders, model, LOOK_ITERATIONS), *likelihood.actuated(model, LOOK_ITERATIONS)]
        ranked = sorted((self.fitted_candidate(*pair, model) for pair in fits), key=lambda trial: trial.surplus)
        tried = [*{trial.candidate.label: trial for trial in ranked}.values()]  # of laws and motions the best
        model, tried = self._on_the_best_summit(model, tried)
        good = sorted((t for t in tried if t.evident and t.held_out > 0), key=lambda trial: -trial.surplus)
        runs = len(likelihood.runs)
        surplus = [(c, 2.0 * promise.gain - penalty(len(c.added), runs)) for c, promise in promised]
        surplus += [(t.candidate, t.surplus) for t in tried if t.candidate.name in dict(ACTUATORS)]
        if not good:
            return PlanarStep(model, tuple(surplus), tuple(tried))
        best, *runners_up = good
        estimate = likelihood.estimate(best.candidate.model, best.estimate.mixed.of_chance)
        rivals = tuple(trial for trial in runners_up if trial.is_rival_of(best))
        return PlanarStep(model, tuple(surplus), tuple(tried), replace(best, estimate=estimate), rivals)

    def admissible(self, look: PlanarStep, first: PlanarStep) -> list[OutputErrorFit]:
        return [] if look.best is None else [look.best.estimate]

    def fitted_candidate(self, candidate: Candidate, wide: OutputErrorFit, current: OutputErrorFit) -> FittedCandidate:
        gained = wide.mixed.density - current.mixed.density
        sums = (float(_densities(self.other, estimate).sum()) for estimate in (wide, current))
        after, before = (density if np.isfinite(density) else -np.inf for density in sums)
        surplus = 2.0 * float(gained.sum()) - penalty(len(candidate.added), len(gained))
        trial = FittedCandidate(candidate, wide, surplus, clear(gained, MIN_STDERRS), after - before)
        of_hull = not any(name.count(".") > 1 for name in candidate.added)
        return trial if of_hull or not trial.evident else replace(trial, nearer=self._nearer(trial, current))

    def _nearer(self, trial: FittedCandidate, current: OutputErrorFit) -> bool:
        """Whether predictions of the fitted runs and of the others, over the shortest horizon, miss less by a share;
        also where runs are too short for any."""
        dof = trial.candidate.dof
        ratios = [misses(of, trial.estimate, dof) / misses(of, current, dof) for of in (self.likelihood, self.other)]
        return not any(ratio > 1.0 - MIN_NEARER for ratio in ratios)

    def _on_the_best_summit(
        self, current: OutputErrorFit, tried: list[FittedCandidate]
    ) -> tuple[OutputErrorFit, list[FittedCandidate]]:
        """Refit the model from where the best trial ended, if that is likelier, with the trials beside it: what lets
        the search out of a lesser summit of the likelihood is no evidence for an effect."""
        if not any(trial.evident for trial in tried):
            return current, tried
        estimate = max(tried, key=lambda trial: trial.surplus).estimate
        values = current.model.values | {name: estimate.model.values[name] for name in current.model.free}
        model = current.model.with_theta([*values.values()])
        again = self.likelihood.estimate(model, estimate.mixed.of_chance, LOOK_ITERATIONS)
        if again.mixed.log_likelihood <= current.mixed.log_likelihood:
            return current, tried
        again = self.likelihood.estimate(again.model, again.mixed.of_chance)
        return again, [self.fitted_candidate(trial.candidate, trial.estimate, again) for trial in tried]


def diagnose_planar(
    stored: StoredModels, runs: Sequence[Run], unseen: Sequence[Run], observed: Observed, seed: int = 0,
    goes_on: Callable[[], object] = lambda: None,
) -> Diagnosis:  # fmt: skip
    """Diagnose a model on `runs`, with `unseen` ones that are never fitted; `goes_on` is called after a first look that
    found something. Raises RunError for too few of either."""
    if len(runs) < 2 or not unseen:
        raise TooFewRunsError(f"{len(runs) + len(unseen)} runs are too few for a diagnosis; give three or more")
    base = base_of(stored, observed)
    logged = set.intersection(*({*run.extras} for run in (*runs, *unseen)))
    signals = tuple(sorted({*base.signals, *(need for effect in sloping(logged) for need in effect.needs)}))
    likelihood, other = (
        PlanarLikelihood(tuple(some), observed, signals=signals) for some in (runs, unseen)
    )  # one start is enough for what somebody took for the vehicle
    judge, start = PlanarSearch(likelihood, other), likelihood.estimate(base, stored.random)
    outcome = stepwise_search(judge, start, lambda first: goes_on() is None)
    rounds, before, final = outcome.looks, outcome.looks[0].before, outcome.final
    if rounds[-1].best is not None and final is rounds[-1].before:
        # nothing can be looked for beside the last one: it is not taken
        rounds = (*rounds[:-1], replace(rounds[-1], best=None, rivals=()))
    where = find_planar_where(PlanarLikelihood((*runs, *unseen), observed, signals=signals), before, seed)
    verdict, why = verdict_of(rounds, where)
    added, final = needed(likelihood, [step for step in rounds if step.best is not None], before)
    fitted, held_out = (judged_runs(some, before, final) for some in (likelihood, other))
    if verdict == NOTHING and held_out.misses(NOISE_SHARE * final.mixed.noise_of[YAW.position]):
        verdict, why = UNEXPLAINED, "It predicts the runs held out no better than a constant. No candidate explains it."
    surplus = {trial.candidate.added: trial.surplus for trial in rounds[0].tried}
    gains = [(candidate, surplus.get(candidate.added, promise)) for candidate, promise in rounds[0].promised]
    return Diagnosis(
        motion=PLANAR, dof=YAW, search=rounds, verdict=verdict, why=why, where=where,
        effects=named_effects(added, suspected(rounds), final), fitted=fitted, held_out=held_out,
        candidates=[
            {"name": c.name, "parameters": list(c.added), "gain": gain, "fitted": c.added in surplus}
            for c, gain in sorted(gains, key=lambda pair: -pair[1])
        ],
        threshold=HEAD_START,
        base={name: (e, final.by_name[name]) for name, e in before.by_name.items() if name in final.by_name},
        extended={
            **model_content(final),
            "effects": [step.best.candidate.name for step in added if step.best],
            "random": final.mixed.of_chance,
        },
    )  # fmt: skip


def needed(
    likelihood: PlanarLikelihood, steps: Sequence[PlanarStep], before: OutputErrorFit
) -> tuple[list[PlanarStep], OutputErrorFit]:
    """Drop what a search added first and does not need beside what it added later: the steps that stay, and the model
    with all that they added."""
    stay, final = list(steps), before if not steps or steps[-1].best is None else steps[-1].best.estimate
    for step in steps[:-1]:
        assert step.best is not None
        names = {*step.best.candidate.added}
        terms = tuple(term for term in final.model.terms if not names & {*final.model.names_of(term)})
        if len(terms) == len(final.model.terms):  # no term of the model, as a current
            continue
        reduced = replace(final.model, terms=terms)
        (fit,) = likelihood.brief([(reduced, final.mixed.of_chance)], LOOK_ITERATIONS)
        if fit is None:
            continue
        lost = final.mixed.density - fit.mixed.density
        if 2.0 * float(lost.sum()) - penalty(len(names), len(lost)) < HEAD_START:
            stay.remove(step)
            final = likelihood.estimate(reduced, fit.mixed.of_chance)
    return stay, final


def suspected(rounds: Sequence[PlanarStep]) -> list[FittedCandidate]:
    """List what the fitted runs ask for but others do not bear out."""
    return [trial for trial in rounds[-1].tried if trial.evident and rounds[-1].best is None]


def verdict_of(rounds: Sequence[PlanarStep], where: ResidualRegions) -> tuple[str, str]:
    """Give the verdict, and why effects are suspected only, or where the gap stands out that no effect explains."""
    doubtful, word = suspected(rounds), NAMED if rounds[0].best is not None else SUSPECTED
    if doubtful:
        names = " or ".join(trial.candidate.label for trial in doubtful)
        return word, f"The fitted runs ask for {names}, but the likelihood of held-out runs does not improve with it."
    if word == NAMED:
        return word, ""
    if not where.regions:
        return NOTHING, ""
    passed = "No candidate gains more than chance."
    gaining = [trial for trial in rounds[-1].tried if trial.surplus > HEAD_START]
    if gaining:
        most = max(gaining, key=lambda trial: trial.surplus)
        passed = f"The best candidate, {most.candidate.label}, gains {most.surplus:.0f} in deviance, but " + (
            f"predictions come nearer by less than {100 * MIN_NEARER:g} % with it." if most.steady
            else f"not in the mean of runs by {MIN_STDERRS:g} standard errors."
        )  # fmt: skip
    return UNEXPLAINED, f"The error is beyond chance {stretch(where.regions[0])}. {passed}"


def named_effects(
    added: Sequence[PlanarStep], suspects: Sequence[FittedCandidate], final: OutputErrorFit
) -> tuple[NamedEffect, ...]:
    """List what is named, with its rivals and as large as the `final` model has it, or else what is suspected."""
    steps = [(step.best, step.rivals) for step in added if step.best is not None]
    entries = []
    for trial, others in steps or [(suspect, ()) for suspect in suspects]:
        odds = [(rival.candidate, float(np.exp(0.5 * (rival.surplus - trial.surplus)))) for rival in others]
        weight, rivals = listed_rivals([NamedRival(c.name, odd, run_to_split(c), c.label) for c, odd in odds])
        candidate, estimates = trial.candidate, {**trial.estimate.by_name, **(final.by_name if steps else {})}
        values = {name: estimates[name] for name in candidate.added}
        says = SAYS.get(candidate.name) or effects.get(candidate.name).card(candidate.dof).says.rstrip(".")
        says, law = f"{says} ({', '.join(candidate.added)}).", "surge, sway and yaw"
        entries.append(NamedEffect(candidate.name, law, says, values, weight, None, rivals, label=candidate.label))
    return tuple(entries)


def judged_runs(likelihood: PlanarLikelihood, before: OutputErrorFit, after: OutputErrorFit) -> JudgedRuns:
    """Judge both models on a likelihood's runs by predictions of the heading, and by the density of the runs."""
    (old,), (new,) = (forecasts(likelihood, estimate) for estimate in (before, after))
    gained = _densities(likelihood, after) - _densities(likelihood, before)
    outlook = outlook_of(old, new, float(gained.sum()))
    gap = gap_ahead(likelihood.course, old, new, after.mixed.noise_of[YAW.position])
    return JudgedRuns(likelihood.runs, gap, outlook)


def _densities(likelihood: PlanarLikelihood, estimate: OutputErrorFit) -> Floats:
    problem = likelihood.problem(estimate.model)
    return problem.follow(problem.parameters.search(estimate.mixed.theta)[None]).log_density[0]


def forecasts(
    likelihood: PlanarLikelihood, estimate: OutputErrorFit, quantities: Sequence[str] = (YAW.position,)
) -> Sequence[tuple[Predicted, ...]]:
    """Predict the heading of a likelihood's runs, or other quantities, by an estimate, of these runs or of others."""
    problem, fit = likelihood.problem(estimate.model), estimate.mixed
    every = [channel.quantity for channel in problem.course.channels]
    channels = [every.index(quantity) for quantity in quantities]
    return predict(estimate.model, problem.course, fit.of_model, problem.noises(fit.theta[None]), channels)


def misses(likelihood: PlanarLikelihood, estimate: OutputErrorFit, dof: Dof) -> float:
    """Root mean square of what predictions of a motion miss by over the shortest horizon: of the heading, else of its
    speed, or of the place where no speed is read; not a number where runs are too short."""
    names = likelihood.observed.channels
    speed = [dof.velocity] if dof.velocity in names else [*NORTH_EAST]
    by_channel = forecasts(likelihood, estimate, [YAW.position] if dof is YAW else speed)
    return float(np.hypot.reduce([ahead[0].rmse() for ahead in by_channel]))


def errors_at_nodes(course: Course, prediction: Predicted) -> Floats:
    """Lay out the errors of a prediction at its targets, (R, K), zero elsewhere."""
    errors = np.zeros(course.time.shape)
    errors[prediction.run, prediction.target] = prediction.error
    return errors


STRETCH = 10.0  # length [s] of a stretch: twice the horizon, and several time constants of usual disturbances


def find_planar_where(every: PlanarLikelihood, before: OutputErrorFit, seed: int) -> ResidualRegions:
    """Look at the gap of all runs that the model before anything was added leaves, against every variable; `seed` draws
    the signs. There are none where all runs are too short for predictions."""
    course, runs, fit = every.course, every.runs, before.mixed
    (ahead,) = forecasts(every, before)
    prediction = judged(ahead)
    if not len(prediction.error):
        return ResidualRegions()
    residual = errors_at_nodes(course, prediction)
    observed = residual != 0.0
    problem = every.problem(before.model)
    followed = problem.follow(problem.parameters.search(fit.theta)[None], keep=True)
    assert followed.states is not None
    places, states = followed.places, followed.states[:, 0]
    command = np.stack([_at_nodes(course, [run.command_of(dof) for run in runs], runs) for dof in PLANAR.dofs])
    sign: Floats = np.where(observed, last_side(command[-1]), 0.0)
    (inertia,) = before.model.inertia_matrix(fit.of_model[None])
    pushes = states[list(places.pushed)]
    kinds = {YAW.words.position: (YAW.units.shown, np.asarray(YAW.shown(residual)))}
    for dof, force in zip(PLANAR.dofs, np.einsum("ij,jrk->irk", inertia, pushes)):
        if dof in every.observed.dofs:
            kinds[dof.words.full_force] = (dof.units.forces[1], np.where(observed, force, 0.0))
    floor, columns = float(before.mixed.noise_of[YAW.position]), _columns(runs, course, states, command, observed)
    r, part = _stretches(course, observed)
    off = part * residual[r]
    gap = ResidualGrid(
        names=tuple(course.names[i] for i in r), residual=off, raw=off, sign=np.where(part, sign[r], 0.0),
        observed=part, gain=100.0 * states[places.gain, :, -1][r], floor=floor, convert=YAW.shown,
    )  # fmt: skip
    inside = [replace(column, values=np.where(part, column.values[r], np.nan)) for column in columns]
    return find_regions(inside, {name: (unit, part * x[r]) for name, (unit, x) in kinds.items()}, gap, seed)


def _columns(
    runs: tuple[Run, ...], course: Course, states: Floats, command: Floats, observed: NDArray[np.bool_]
) -> list[Factor]:
    """Motion as filtered, products of velocities, commands, clocks and what else all runs log, at the nodes (R, K)."""
    heading = np.asarray(YAW.shown(states[2]))
    (u, v), turning = states[3:5], np.asarray(YAW.shown(states[5]))
    number = np.any(np.diff(command, axis=2, prepend=0.0) != 0.0, axis=0).cumsum(axis=1).astype(float)
    columns = [
        Factor("surge", "m/s", u),
        Factor("sway", "m/s", v),
        Factor("yaw-rate", "deg/s", turning),
        Factor("surge times yaw-rate", "m/s deg/s", u * turning),
        Factor("surge times sway", "m²/s²", u * v),
        Factor(YAW.words.position, YAW.units.shown, heading % 360.0),
        *(
            Factor(dof.words.full_force.replace(" ", "-"), dof.units.forces[1], force)
            for dof, force in zip(PLANAR.dofs, command)
        ),
        Factor("time-in-run", "s", course.time),
        Factor("time-since-command-change", "s", since_change(number, course.time)),
    ]
    forces = {dof.command for dof in PLANAR.dofs}
    for name in sorted(
        set.intersection(*(set(run.extras) for run in runs)) - {*CHANNELS, *PARTS, LOGGED_COMMAND, *forces}
    ):
        columns.append(of_run_or_sample(name, "", _at_nodes(course, [run.extras[name] for run in runs], runs)))
    masked = [replace(c, values=np.where(observed, c.values, np.nan)) for c in columns if not c.of_the_run]
    return [column for column in masked if np.nanmax(column.values) > np.nanmin(column.values)]


def _stretches(course: Course, observed: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """The run of each stretch, (S,), and which of its nodes are in it, (S, K)."""
    number = np.where(observed, np.floor(course.time / STRETCH), -1.0)
    stretches = [(r, number[r] == n) for r in range(len(observed)) for n in np.unique(number[r, observed[r]])]
    return np.array([r for r, _ in stretches]), np.array([nodes for _, nodes in stretches])


def _at_nodes(course: Course, columns: list[Floats], runs: tuple[Run, ...]) -> Floats:
    """What is held at the filter's nodes, (R, K)."""
    out = np.zeros(course.time.shape)
    for row, column, run, time in zip(out, columns, runs, course.time):
        at = np.searchsorted(run.time - run.time[0], time + 1e-9, side="right") - 1
        row[:] = column[np.clip(at, 0, len(column) - 1)]
    return out
