"""All runs under all models of a file: free and restarted runs, scores, which model does best, what filters predict.

Predictions are from filtered states on driven and disturbed runs, beside somebody who expects no change. The models'
own parameters are held; the sizes of what is random (disturbance, unsteady thrust, scatter of the gain, noise) are
fitted on these very runs, for no file knows the weather of their day.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from automarine_cli import effects
from automarine_cli.comparison.rollouts import needed_signals
from automarine_cli.comparison.scores import (
    SCORES,
    Overall,
    RunScore,
    lead,
    noise_floor,
    overall,
    pooled_floor,
    rate_source,
    resamples,
    score,
    score_key,
)
from automarine_cli.comparison.simulated_runs import FreeRun, Restarts, find_restarts, free_runs, restarted_errors
from automarine_cli.dofs import Dof
from automarine_cli.effects.thruster_imbalance import lacking_signal
from automarine_cli.errors import AutomarineError, FitError, ModelError, RunError
from automarine_cli.filters.course import make_course
from automarine_cli.filters.kalman import Predicted, predict
from automarine_cli.fits.driven import STEPS, ForecastScore, base_starts, disturbed, driven_problem, judged_of, worth_of
from automarine_cli.fits.identify import starts_at_rest
from automarine_cli.fits.innovations import channels_json, fit_innovations, measured_noises
from automarine_cli.fits.whole_runs import rough_model
from automarine_cli.models.store import StoredModels
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.pipeline.progress import Progress, counted, silent
from automarine_cli.pipeline.records import Shown
from automarine_cli.pipeline.result_files import VALIDATION
from automarine_cli.runs.channels import NOTHING_TO_CHOOSE, ChannelChoice
from automarine_cli.runs.checks import without_undriven
from automarine_cli.runs.run import Run, SetAside, runs_json
from automarine_cli.simulation.batch import make_batch

MEANING = {
    "rmse": "free run: measured less simulated {position} from the start of each run to its end",
    "max_abs": "free run: the largest {position} error",
    "fit_percent": "free run: 100 (1 - |error| / |measured - its mean|)",
    "restarted_rmse": "{position} error with the state set anew from the smoothed measured {position} at each restart",
    "rate_rmse": "free run: measured less simulated {rate}",
}


@dataclass(frozen=True)
class Scored:
    """One model: its free runs and scores in the order of the runs, and its scores over all of them."""

    free: tuple[FreeRun, ...]
    scores: tuple[RunScore, ...]
    overall: Mapping[str, Overall]

    @property
    def diverged(self) -> tuple[str, ...]:
        return tuple(one.run.name for one in self.free if one.diverged)


@dataclass(frozen=True)
class Comparison:
    """What was measured against what each model says, R runs; `floors` are their noise, `floor` that of all, in the
    unit that people see.

    `best` is the number of the model with the smallest free-run error of position over all runs, None where every
    model diverged; `because` is the sentence that says so. `carried` are the effects with a state of their own,
    which a restart takes from the free run.
    """

    runs: tuple[Run, ...]
    restarts: tuple[Restarts, ...]
    models: Mapping[str, Scored]
    floors: tuple[float, ...]
    floor: float
    best: str | None
    because: str
    carried: tuple[str, ...]


def compare(stored: StoredModels, runs: Sequence[Run], seed: int = 0, progress: Progress = silent) -> Comparison:
    """Simulate and score `runs` under every model. Raises RunError as `make_batch`."""
    restarts = [find_restarts(run) for run in runs]
    drawn = resamples(len(runs), seed)
    models: dict[str, Scored] = {}
    for number, model in stored.models.items():
        stage = f"simulating model {number}"
        found = free_runs(model, runs, stored.switch_offset)
        free = list(counted(progress, stage, found, len(runs)))
        again = restarted_errors(model, free, restarts, stored.switch_offset)
        scores = tuple(score(one, errors) for one, errors in zip(free, again))
        models[number] = Scored(tuple(free), scores, overall(scores, drawn))
    sizes = {number: len(model.theta) for number, model in stored.models.items()}
    values = {number: one.overall["rmse"].value for number, one in models.items()}
    ranked = sorted((value, sizes[number], number) for number, value in values.items() if value is not None)
    best = ranked[0][2] if ranked else None
    leads = {
        number: lead(models[best].scores, models[number].scores, drawn)
        for _, _, number in ranked[1:]
        if best is not None
    }
    floors = tuple(noise_floor(run) for run in runs)
    because = _because(best, leads, models, runs[0].dof)
    carried = tuple(name for name in stored.effects if effects.get(name).states)
    return Comparison(tuple(runs), tuple(restarts), models, floors, pooled_floor(runs), best, because, carried)


def _because(best: str | None, leads: Mapping[str, Overall], models: Mapping[str, Scored], dof: Dof) -> str:
    """One sentence: which model follows the runs best, and whether its lead could be chance."""
    if best is None:
        return "No model follows these runs: every simulation diverges."
    parts = []
    for number, gap in leads.items():
        part = f"{_digits(gap.value)} {dof.units.shown} below model {number}"
        if gap.ci95 is not None:
            sure = "" if gap.ci95[0] > 0 else ", which may be chance"
            part += f" (95 % interval {_digits(gap.ci95[0])} to {_digits(gap.ci95[1])} over runs{sure})"
        parts.append(part)
    told = ["; ".join(parts)] if parts else []
    told += [
        f"model {number} diverges in {len(m.diverged)} of {len(m.free)} runs"
        for number, m in models.items()
        if m.diverged
    ]
    tail = f": {'; '.join(told)}" if told else ""
    if len(models) == 1:
        return f"Model {best} is the only one{tail}."
    return f"Model {best} has the smallest free-run {dof.position} error over all runs{tail}."


def _digits(gap: float | None) -> str:
    """A number in a sentence: two digits, all before the point where there are more."""
    value = 0.0 if gap is None else gap
    return f"{value:.0f}" if abs(value) >= 10 else f"{value:.2g}"


@dataclass(frozen=True)
class Ahead:
    """What each model, by its number, is worth by horizon; `preferred` is the number of the one that the fit preferred:
    who has no more logs than these cannot know which does best on them. `by_run` are the errors of each model by
    horizon and run."""

    worth: Mapping[str, tuple[ForecastScore, ...]]
    preferred: str
    dof: Dof
    by_run: Mapping[str, Mapping[float, Mapping[str, float]]]

    @property
    def of_use(self) -> bool:
        """Whether the preferred model predicts better than constants do; what cannot be judged counts as of use."""
        one = judged_of(self.worth.get(self.preferred, ()))
        return one is None or one.of_use

    @property
    def sentence(self) -> str:
        judged = {number: one for number, worth in self.worth.items() if (one := judged_of(worth)) is not None}
        if self.preferred not in judged:
            return "These runs are driven and disturbed, and too short to judge predictions."
        one = judged[self.preferred]
        which = f"odel {self.preferred}" + ", which the fit preferred," * (len(self.worth) > 1)
        if one.of_use:
            return f"M{which} predicts {one.beside(self.dof)}."
        none = "The model is of no use" if len(judged) == 1 else "No model is of use"
        if any(other.of_use for other in judged.values()):
            none = f"M{which} is of no use"
            which = "it"
        else:
            which = f"m{which}"
        return (
            f"{none} on these runs: {which} predicts {one.beside(self.dof)}. Do not simulate or "
            "control with it; `automarine diagnose` looks for what it lacks."
        )

    def to_json(self) -> dict[str, list[dict[str, object]]]:
        """By model and horizon, in the unit in which people see positions."""
        dof = self.dof
        return {
            number: [
                one.to_json(dof)
                | {"runs": {run: float(dof.shown(error)) for run, error in self.by_run[number][one.horizon].items()}}
                for one in worth
            ]
            for number, worth in self.worth.items()
        }


def ahead_of(stored: StoredModels, runs: Sequence[Run], channels: tuple[str, ...] | None) -> Ahead | None:
    """Predictions of every model of a file from the filtered states of `runs`; None where the runs are not driven, or
    no filter follows them. `channels` names the quantities that count, None for positions."""
    at_rest = np.array([starts_at_rest(run) for run in runs])
    worth, by_run = {}, {}
    try:
        rough = rough_model("2", make_batch(runs, STEPS[0]))  # what runs are does not hang on the model to be judged
    except FitError:
        rough = stored.models[stored.preferred]
    try:
        if not disturbed(runs, rough, at_rest, channels):
            return None
        for number, model in stored.models.items():
            ahead = _predicted(model, runs, at_rest, channels)
            worth[number] = worth_of(ahead)
            by_run[number] = {one.horizon: _by_run(one, runs) for one in ahead}
    except FitError:  # what the free runs say has to do
        return None
    return Ahead(worth, stored.preferred, stored.dof, by_run)


def _by_run(ahead: Predicted, runs: Sequence[Run]) -> dict[str, float]:
    sizes = np.sqrt(ahead.by_run(ahead.error, len(runs)))
    return {run.name: float(size) for run, size in zip(runs, sizes) if np.isfinite(size)}


def _predicted(
    model: YawModel, runs: Sequence[Run], at_rest: NDArray[np.bool_], channels: tuple[str, ...] | None
) -> tuple[Predicted, ...]:
    """Of one model, by the sizes that the runs themselves give to what is random."""
    course = make_course(runs, at_rest, needed_signals(model), channels=channels)
    problem, own = driven_problem(model, course), len(model.theta)
    held = np.concatenate([np.tile(model.theta[:, None], 2), problem.bounds[own:]])
    problem = replace(problem, bounds=held)
    found = fit_innovations(problem, np.unique(base_starts(problem), axis=0), brief=True)
    return predict(model, course, model.theta, problem.noises(found.theta[None]))


@dataclass(frozen=True, repr=False)
class Validation(Shown):
    """The models of a file, how they compare on runs, the runs left out, the sensors that count; predictions `ahead`
    from filtered states where the runs are driven."""

    stored: StoredModels
    comparison: Comparison
    set_aside: tuple[SetAside, ...]
    channels: ChannelChoice = NOTHING_TO_CHOOSE
    ahead: Ahead | None = None

    def to_json(self) -> dict[str, object]:
        compared, dof, ahead = self.comparison, self.stored.dof, self.ahead
        use = {} if ahead is None else {"of_use": ahead.of_use, "says": ahead.sentence}
        return {
            "schema": VALIDATION.schema,
            **({} if dof.wraps else {"motion": dof.name}),
            "models": {number: self._model_json(scored) for number, scored in compared.models.items()},
            f"noise_floor_{dof.units.key}": compared.floor,
            "best": compared.best,
            "best_because": compared.because,
            "preferred_by_fit": self.stored.preferred,
            "effects": list(self.stored.effects),
            f"{dof.words.force}_unit": self.stored.moment_unit,
            "switch_offset": self.stored.switch_offset,
            **channels_json(self.channels, measured_noises(compared.runs, dof)),
            **({} if ahead is None else {"prediction": ahead.to_json(), "use": use}),
            "scores": {score_key(name, dof): dof.fill(meaning) for name, meaning in MEANING.items()},
            "logs": {
                run.name: {
                    "file": run.source,
                    "samples": len(run),
                    "duration_s": float(run.time[-1] - run.time[0]),
                    f"noise_floor_{dof.units.key}": floor,
                    "restarts": len(restarts.states),
                    "restarted_at": restarts.rule,
                    "restarted_horizon_s": restarts.horizon,
                    "rate_from": rate_source(run),
                }
                for run, floor, restarts in zip(compared.runs, compared.floors, compared.restarts)
            },
            "runs": runs_json(len(compared.runs), self.set_aside, compared.runs),
        }

    def _model_json(self, scored: Scored) -> dict[str, object]:
        dof, data = self.stored.dof, dict[str, object]()
        for name in SCORES:
            key, over_all = score_key(name, dof), scored.overall[name]
            data[key] = over_all.value
            if over_all.ci95 is not None:
                data[f"{key}_ci95"] = list(over_all.ci95)
        data["diverged"] = list(scored.diverged)
        names = (run.name for run in self.comparison.runs)
        data["runs"] = {name: _score_json(score, dof) for name, score in zip(names, scored.scores)}
        return data


def _score_json(score: RunScore, dof: Dof) -> dict[str, object]:
    words, units = dof.words, dof.units
    start = {
        f"{words.position}_{units.key}": float(dof.shown(score.start.position)),
        f"{words.speed}_{units.rate_key}": float(dof.shown(score.start.rate)),
        "how": score.start.how,
    }
    return {**{score_key(name, dof): score.value(name) for name in SCORES}, "diverged": score.diverged, "start": start}


def usable_runs(
    runs: Sequence[Run], stored: StoredModels, drive: Callable[[Run], Run] | None
) -> tuple[list[Run], list[SetAside]]:
    """Select the runs that every model can be driven by and that their commands may have moved, commanded by `drive`;
    return the others with their reasons. Raises ModelError for commands in another unit than the models'."""
    signals = dict.fromkeys(name for model in stored.models.values() for name in needed_signals(model))
    commanded: list[Run] = []
    aside: list[SetAside] = []
    for run in runs:
        try:
            driven = run if drive is None else drive(run)
            _ = driven.command  # refused where there is none
            _refuse_incomplete(driven, tuple(signals))
            commanded.append(driven)
        except AutomarineError as error:
            why = str(error).removeprefix(f"{run.source}, run {run.name!r}: ")
            aside.append(SetAside(run.source, run.name, why))
    usable, undriven = without_undriven(commanded)
    for run in usable:
        if run.moment_unit != stored.moment_unit:
            raise ModelError(
                f"{stored.source} was fitted to {stored.dof.words.force}s in {stored.moment_unit}, {run.source} "
                f"gives them in {run.moment_unit}; there is no factor between the two. Validate with logs in "
                f"{stored.moment_unit}, or fit a model to logs in {run.moment_unit}"
            )
    return usable, [*aside, *undriven]


def _refuse_incomplete(run: Run, signals: Sequence[str]) -> None:
    for name in signals:
        signal = run.signal(name)
        if signal is None:
            raise RunError(f"an effect of the model needs the {lacking_signal(name, '; map it with --columns')}")
        missing = int(np.count_nonzero(~np.isfinite(signal)))
        if missing:
            raise RunError(
                f"an effect of the model needs {name!r} in every row; {missing} rows lack it. Complete the column, or "
                "validate a model without that effect"
            )
