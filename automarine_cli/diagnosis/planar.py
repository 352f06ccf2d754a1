"""What a planar model lacks: couplings, a current, or what stands between command and moment, named by evidence.

Each candidate is added to the model and everything is fitted again by innovations. It counts where its deviance gains
more than a penalty and a head start, run by run beyond chance, and where runs held out are more likely with it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from automarine_cli import effects
from automarine_cli.diagnosis.diagnose import (
    NAMED,
    NOTHING,
    SUSPECTED,
    UNEXPLAINED,
    ForecastGain,
    Gap,
    NamedEffect,
    diagnosis_json,
    listed_rivals,
    outlook_of,
    stretch,
)
from automarine_cli.diagnosis.residual_regions import (
    Column,
    ResidualGrid,
    ResidualRegions,
    find_regions,
    last_side,
    of_run_or_sample,
    since_change,
)
from automarine_cli.diagnosis.scores import penalty
from automarine_cli.diagnosis.search import clear
from automarine_cli.diagnosis.study import HORIZON
from automarine_cli.dofs import SWAY, YAW
from automarine_cli.dofs.motion import PLANAR
from automarine_cli.errors import TooFewRunsError
from automarine_cli.filters.course import Course
from automarine_cli.filters.kalman import Predicted, predict
from automarine_cli.fits.planar_fit import CHANNELS, Candidate, Estimated, Observed, PlanarLikelihood, candidates
from automarine_cli.fits.stepwise import Judge, NamedRival, stepwise_search
from automarine_cli.models.model import Model, Term
from automarine_cli.models.store import StoredModels
from automarine_cli.pipeline.records import Document, Shown, json_document
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import ExcludedRun, Run, runs_json

NOWHERE = ResidualRegions()
SMALL = 0.02  # share of its usual size at which an actuator effect is as good as none
OF_YAW = ("input-delay", "thruster-lag", "dead-band")
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
    fixed, tied = model.fixed, [name for name, *_ in ties]
    if not fixed:
        fixed = tuple(name for name, value in zip(names, model.theta) if not value)
    return replace(model, fixed=tuple(name for name in fixed if name not in tied), ties=tuple(ties))


def suspects(model: Model, observed: Observed, largest: float) -> Iterator[Candidate]:
    """What a model may lack: what logs tell of a hull, and what stands between command and moment; `largest` is the
    largest moment [N m]."""
    yield from candidates(model, observed)
    mass = SWAY.parameter("inertia")
    if mass in [tied for tied, *_ in model.ties]:
        ties = tuple(tie for tie in model.ties if tie[0] != mass)
        yield Candidate("munk-moment", (mass,), replace(model, ties=ties))
    yaw = PLANAR.index(YAW)
    for name in OF_YAW:
        if (yaw, name) not in [(term.dof, term.name) for term in model.terms]:
            parameters = effects.get(name).parameters
            values = tuple(p.off + (not p.held) * SMALL * p.scaled(p.start, largest) for p in parameters)
            yield Candidate.of_term(model, Term(name, values, dof=yaw))


def says_of(candidate: Candidate) -> str:
    description = SAYS.get(candidate.name) or effects.get(candidate.name).card(YAW).says.rstrip(".")
    return f"{description} ({', '.join(candidate.added)})."


def run_to_split(candidate: Candidate) -> str:
    """Say which runs tell a candidate from others."""
    return SPLIT_BY.get(candidate.added[0].rpartition(".")[2]) or effects.get(candidate.name).card(YAW).separated_by


MIN_RUNS = 4  # runs of which one is held out: those of motion in the plane are few and long
HEAD_START = 10.0  # deviance beyond the penalty that an effect has to gain
ERRORS = 2.0  # standard errors by which the mean gain of a run has to exceed zero
FULLY, LOOK = 4, 6  # candidates of a round that are fitted at most, those that promise most; iterations of each
MOST = 3  # effects that are named at most


@dataclass(frozen=True)
class FittedCandidate:
    """A candidate that was fitted: deviance gained by all runs beyond its penalty, whether run by run beyond chance,
    and log likelihood gained by held-out runs."""

    candidate: Candidate
    estimate: Estimated
    surplus: float
    steady: bool
    held_out: float

    @property
    def evident(self) -> bool:
        return self.surplus > HEAD_START and self.steady

    def rivals(self, best: "FittedCandidate") -> bool:
        """Whether the best one does not lead by more than the head start, and run by run beyond chance."""
        behind = best.estimate.fit.density - self.estimate.fit.density
        return best.surplus - self.surplus < HEAD_START or not clear(behind, ERRORS)


@dataclass(frozen=True)
class PlanarStep:
    """One look for an effect: the model that was looked at, the surplus that each candidate's score promised, those
    that were fitted, the `best` if one was taken, and its rivals."""

    before: Estimated
    promised: tuple[tuple[Candidate, float], ...]
    tried: tuple[FittedCandidate, ...]
    best: FittedCandidate | None
    rivals: tuple[FittedCandidate, ...]


@dataclass(frozen=True, repr=False)
class PlanarDiagnosis(Shown):
    """The model as it was given, refitted (`before`), and the rounds of the search.

    `every` has all runs, those fitted before those held out, `fitted` says how many were fitted. By the first and the
    last model there are predictions of the heading over each horizon (`forecasts`) and the runs' log densities
    (`density`, (R,) each). `where` has the gap of the first one, once somebody looked; `parent_sha256` is the hash of
    the model's file."""

    before: Estimated
    rounds: tuple[PlanarStep, ...]
    every: PlanarLikelihood
    fitted: int
    forecasts: tuple[Sequence[Predicted], Sequence[Predicted]]
    density: tuple[Floats, Floats]
    where: ResidualRegions = NOWHERE
    set_aside: tuple[ExcludedRun, ...] = ()
    parent_sha256: str = ""

    @property
    def named(self) -> tuple[FittedCandidate, ...]:
        return tuple(step.best for step in self.rounds if step.best is not None)

    @property
    def suspected(self) -> tuple[FittedCandidate, ...]:
        """What the fitted runs ask for but others do not bear out."""
        return tuple(trial for trial in self.rounds[-1].tried if trial.evident and self.rounds[-1].best is None)

    @property
    def after(self) -> Estimated:
        return self.named[-1].estimate if self.named else self.before

    @property
    def verdict(self) -> str:
        if self.named or self.suspected:
            return NAMED if self.named else SUSPECTED
        return UNEXPLAINED if self.where.regions else NOTHING

    @property
    def why(self) -> str:
        """Why effects are suspected only, or where the gap stands out that no effect explains; else empty."""
        if self.suspected:
            names = " or ".join(contender.candidate.label for contender in self.suspected)
            return f"The fitted runs ask for {names}, but the likelihood of held-out runs does not improve with it."
        if self.verdict != UNEXPLAINED:
            return ""
        passed = "No candidate gains more than chance."
        gaining = [trial for trial in self.rounds[-1].tried if trial.surplus > HEAD_START]
        if gaining:
            most = max(gaining, key=lambda trial: trial.surplus)
            passed = (
                f"The best candidate, {most.candidate.label}, gains {most.surplus:.0f} in deviance, but not in the "
                f"mean of runs by {ERRORS:g} standard errors."
            )
        return f"The error is beyond chance {stretch(self.where.regions[0])}. {passed}"

    @property
    def effects(self) -> tuple[NamedEffect, ...]:
        """What is named or suspected, with its rivals."""
        entries = []
        steps = [(step.best, step.rivals) for step in self.rounds if step.best is not None]
        for trial, others in steps or [(suspect, ()) for suspect in self.suspected]:
            odds = [(rival.candidate, float(np.exp(0.5 * (rival.surplus - trial.surplus)))) for rival in others]
            weight, rivals = listed_rivals([NamedRival(c.name, odd, run_to_split(c), c.label) for c, odd in odds])
            candidate, estimates = trial.candidate, trial.estimate.estimates
            values = {name: estimates[name] for name in candidate.added}
            law, label = "surge, sway and yaw", candidate.label
            entries.append(
                NamedEffect(candidate.name, law, says_of(candidate), values, weight, None, rivals, label=label)
            )
        return tuple(entries)

    def outlook(self, held_out: bool) -> ForecastGain | None:
        """What both models predict of the heading of the runs that were fitted, or of those held out; None where these
        are too short."""

        def part(predicted: Predicted) -> Predicted:
            rows = (predicted.run >= self.fitted) == held_out
            return Predicted(
                **{name: x[rows] if isinstance(x, np.ndarray) else x for name, x in vars(predicted).items()}
            )

        before, after = (list(map(part, predictions)) for predictions in self.forecasts)
        runs = slice(self.fitted, None) if held_out else slice(self.fitted)
        gained = float((self.density[1] - self.density[0])[runs].sum())
        return outlook_of(before, after, gained)

    def document(self, option: str) -> Document:
        if option == "diagnosis":
            return json_document("diagnosis.json", self.to_json())
        return json_document("extended_model.json", self.extended_model())

    def extended_model(self) -> dict[str, object]:
        after = self.after
        return {
            **after.to_json(),
            "effects": [contender.candidate.name for contender in self.named],
            "random": after.fit.of_chance,
            "covariance": after.covariance_json(),
            "parent": self.parent_sha256,
        }

    def to_json(self) -> dict[str, object]:
        before, after = (model.estimates for model in (self.before, self.after))
        first, runs = self.rounds[0], self.every.runs
        fitted = {contender.candidate.added: contender.surplus for contender in first.tried}
        gains = [(candidate, fitted.get(candidate.added, promise)) for candidate, promise in first.promised]
        outlooks = {"fitted_runs": self.outlook(False), "held_out_runs": self.outlook(True)}
        floor = self.after.fit.noise_of[YAW.position]
        gaps: dict[str, Gap | None] = {}
        for name, outlook in outlooks.items():
            old, new = outlook.longest if outlook else (None, None)
            gaps[name] = Gap(old.error, new.error, floor, horizon=old.horizon) if old and new else None
        of, units = {"motion": "planar", "verdict": self.verdict}, (YAW.units.shown, YAW.shown)
        return {
            **diagnosis_json(of, self.why, self.effects, self.where, gaps, *units),
            "prediction": {name: outlook and outlook.to_json(YAW) for name, outlook in outlooks.items()},
            "candidates": [
                {
                    "name": candidate.name, "parameters": list(candidate.added), "gain": gain,
                    "fitted": candidate.added in fitted,
                }
                for candidate, gain in sorted(gains, key=lambda pair: -pair[1])
            ],
            "threshold": HEAD_START,
            "base": {
                name: {"before": estimate.to_json(), "after": after[name].to_json()}
                for name, estimate in before.items() if name in after
            },
            "held_out": [run.name for run in runs[self.fitted :]],
            "runs": runs_json(self.fitted, self.set_aside, runs),
        }  # fmt: skip


@dataclass(frozen=True)
class _Planar(Judge[Estimated, PlanarStep]):
    """Candidates judged by innovations of the fitted runs, and by the density of the `other` runs."""

    likelihood: PlanarLikelihood
    other: PlanarLikelihood
    most = MOST

    def look(self, model: Estimated, number: int) -> PlanarStep:
        likelihood, other, runs = self.likelihood, self.other, len(self.likelihood.runs)
        largest = float(np.abs(likelihood.course.commanded[-1]).max()) or 1.0
        promised = likelihood.promised(model, partial(suspects, observed=likelihood.observed, largest=largest))
        tried = [
            _fitted(c, likelihood.tried(c, promise, model, LOOK), model, other)
            for c, promise in sorted(promised, key=lambda pair: -pair[1].gain)[:FULLY]
            if 2.0 * promise.gain > HEAD_START
        ]
        model, tried = _on_the_best_summit(likelihood, model, tried, other)
        good = sorted((t for t in tried if t.evident and t.held_out > 0), key=lambda trial: -trial.surplus)
        surplus = tuple((c, 2.0 * promise.gain - penalty(len(c.added), runs)) for c, promise in promised)
        if not good:
            return PlanarStep(model, surplus, tuple(tried), None, ())
        best, *runners_up = good
        estimate = likelihood.estimate(best.candidate.model, best.estimate.fit.of_chance)
        rivals = tuple(trial for trial in runners_up if trial.rivals(best))
        return PlanarStep(model, surplus, tuple(tried), replace(best, estimate=estimate), rivals)

    def admissible(self, look: PlanarStep, first: PlanarStep) -> list[Estimated]:
        return [] if look.best is None else [look.best.estimate]


def find_missing(
    stored: StoredModels, runs: Sequence[Run], unseen: Sequence[Run], observed: Observed
) -> PlanarDiagnosis:
    """Diagnose a model on `runs`, with `unseen` ones that are never fitted. Raises RunError for too few of either."""
    if len(runs) < 2 or not unseen:
        raise TooFewRunsError(f"{len(runs) + len(unseen)} runs are too few for a diagnosis; give three or more")
    likelihood, other = PlanarLikelihood(tuple(runs), observed), PlanarLikelihood(tuple(unseen), observed)
    base = base_of(stored, observed)  # one start is enough for what somebody took for the vehicle
    outcome = stepwise_search(_Planar(likelihood, other), likelihood.estimate(base, stored.random))
    rounds, before, final = outcome.looks, outcome.looks[0].before, outcome.final
    if rounds[-1].best is not None and final is rounds[-1].before:
        # nothing can be looked for beside the last one: it is not taken
        rounds = (*rounds[:-1], replace(rounds[-1], best=None, rivals=()))
    every = PlanarLikelihood((*runs, *unseen), observed)
    return PlanarDiagnosis(
        before, rounds, every, len(runs),
        (forecasts(every, before), forecasts(every, final)), (_densities(every, before), _densities(every, final)),
    )  # fmt: skip


def _fitted(candidate: Candidate, extended: Estimated, current: Estimated, other: PlanarLikelihood) -> FittedCandidate:
    gained = extended.fit.density - current.fit.density
    sums = (float(_densities(other, estimate).sum()) for estimate in (extended, current))
    after, before = (density if np.isfinite(density) else -np.inf for density in sums)
    surplus = 2.0 * float(gained.sum()) - penalty(len(candidate.added), len(gained))
    return FittedCandidate(candidate, extended, surplus, clear(gained, ERRORS), after - before)


def _on_the_best_summit(
    likelihood: PlanarLikelihood, current: Estimated, tried: list[FittedCandidate], other: PlanarLikelihood
) -> tuple[Estimated, list[FittedCandidate]]:
    """The model, refitted from where the best contender ended if that is likelier, and the contenders beside it: what
    lets the search out of a lesser summit of the likelihood is no evidence for an effect."""
    if not any(contender.evident for contender in tried):
        return current, tried
    estimate = max(tried, key=lambda contender: contender.surplus).estimate
    names, free = current.model.parameter_names, current.model.free
    values = zip(names, current.model.theta)
    model = current.model.with_theta([estimate.values[name] if name in free else value for name, value in values])
    again = likelihood.estimate(model, estimate.fit.of_chance, LOOK)
    if again.fit.log_likelihood <= current.fit.log_likelihood:
        return current, tried
    again = likelihood.estimate(again.model, again.fit.of_chance)
    return again, [_fitted(contender.candidate, contender.estimate, again, other) for contender in tried]


def _densities(likelihood: PlanarLikelihood, estimate: Estimated) -> Floats:
    problem = likelihood.problem(estimate.model)
    return problem.follow(problem.parameters.search(estimate.fit.theta)[None]).log_density[0]


def forecasts(likelihood: PlanarLikelihood, estimate: Estimated) -> Sequence[Predicted]:
    """What an estimate, of these runs or of others, predicts of the heading of a likelihood's runs."""
    problem, fit = likelihood.problem(estimate.model), estimate.fit
    channel = [channel.quantity for channel in problem.course.channels].index(YAW.position)
    return predict(estimate.model, problem.course, fit.of_model, problem.noises(fit.theta[None]), channel=channel)


STRETCH = 10.0  # length [s] of a stretch: twice the horizon, and several time constants of usual disturbances


def find_planar_where(search: PlanarDiagnosis, seed: int) -> ResidualRegions:
    """Look at the gap of the model before anything was added against every variable; `seed` draws the signs. There are
    none where all runs are too short for predictions."""
    every, before = search.every, search.before
    course, runs, fit = every.course, every.runs, before.fit
    prediction = judged(search.forecasts[0])
    if not len(prediction.error):
        return NOWHERE
    residual, observed = np.zeros(course.time.shape), np.zeros(course.time.shape, dtype=bool)
    residual[prediction.run, prediction.target], observed[prediction.run, prediction.target] = prediction.error, True
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
    floor, columns = float(before.fit.noise_of[YAW.position]), _columns(runs, course, states, command, observed)
    r, part = _stretches(course, observed)
    off = part * residual[r]
    gap = ResidualGrid(
        names=tuple(course.names[i] for i in r), residual=off, raw=off, sign=np.where(part, sign[r], 0.0),
        observed=part, gain=100.0 * states[places.gain, :, -1][r], floor=floor, convert=YAW.shown,
    )  # fmt: skip
    inside = [replace(column, values=np.where(part, column.values[r], np.nan)) for column in columns]
    return find_regions(inside, {name: (unit, part * x[r]) for name, (unit, x) in kinds.items()}, gap, seed)


def judged(predictions: Sequence[Predicted]) -> Predicted:
    """The predictions over the horizon that shows the gap, or the longest below it that any run is long enough for."""
    some = [prediction for prediction in predictions if len(prediction.error) and prediction.horizon <= HORIZON]
    return max(some or predictions[:1], key=lambda prediction: prediction.horizon)


def _columns(
    runs: tuple[Run, ...], course: Course, states: Floats, command: Floats, observed: NDArray[np.bool_]
) -> list[Column]:
    """Motion as filtered, products of velocities, commands, clocks and what else all runs log, at the nodes (R, K)."""
    heading = np.asarray(YAW.shown(states[2]))
    (u, v), turning = states[3:5], np.asarray(YAW.shown(states[5]))
    number = np.any(np.diff(command, axis=2, prepend=0.0) != 0.0, axis=0).cumsum(axis=1).astype(float)
    columns = [
        Column("surge", "m/s", u),
        Column("sway", "m/s", v),
        Column("yaw-rate", "deg/s", turning),
        Column("surge times yaw-rate", "m/s deg/s", u * turning),
        Column("surge times sway", "m²/s²", u * v),
        Column(YAW.words.position, YAW.units.shown, heading % 360.0),
        *(
            Column(dof.words.full_force.replace(" ", "-"), dof.units.forces[1], force)
            for dof, force in zip(PLANAR.dofs, command)
        ),
        Column("time-in-run", "s", course.time),
        Column("time-since-command-change", "s", since_change(number, course.time)),
    ]
    forces = {dof.command for dof in PLANAR.dofs}
    for name in sorted(set.intersection(*(set(run.extras) for run in runs)) - {*CHANNELS, *forces}):
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
