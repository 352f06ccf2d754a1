"""All runs under all models of a file: free and restarted runs, scores, which model does best, what filters predict.

Predictions are from filtered states on driven and disturbed runs, beside somebody who expects no change. The models'
own parameters are held; the sizes of what is random (disturbance, unsteady thrust, scatter of the gain, noise) are
fitted on these very runs, for no file knows the weather of their day.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from automarine_cli import effects
from automarine_cli.comparison.scores import (
    PLANAR_SCORES,
    SCORES,
    Overall,
    RunScore,
    lead,
    noise_floor,
    overall,
    planar_score,
    pooled_floor,
    rate_source,
    resamples,
    score,
    score_key,
)
from automarine_cli.comparison.simulated_runs import (
    FreeRun,
    Restarts,
    State,
    find_restarts,
    free_runs,
    needed_signals,
    planar_free_runs,
    restarted_errors,
)
from automarine_cli.dofs import Dof
from automarine_cli.dofs.motion import PLANAR
from automarine_cli.effects.thruster_imbalance import lacking_signal
from automarine_cli.errors import AutomarineError, FitError, ModelError, RunError, SettingError
from automarine_cli.filters.course import make_course
from automarine_cli.filters.kalman import Predicted, predict
from automarine_cli.fits.driven import STEPS, ForecastScore, base_starts, disturbed, driven_problem, judged_of, worth_of
from automarine_cli.fits.identify import starts_at_rest
from automarine_cli.fits.innovations import channels_json, fit_innovations, measured_noises
from automarine_cli.fits.whole_runs import rough_model
from automarine_cli.models.planar import PlanarModel
from automarine_cli.models.planar_store import StoredPlanar
from automarine_cli.models.store import StoredModels, Use
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.pipeline.progress import Progress, counted, silent
from automarine_cli.pipeline.records import Shown, keyed, told
from automarine_cli.pipeline.result_files import ResultKind, ResultRecord
from automarine_cli.runs.channels import NOTHING_TO_CHOOSE, ChannelChoice
from automarine_cli.runs.checks import without_undriven
from automarine_cli.runs.run import Run, SetAside, runs_json
from automarine_cli.simulation.batch import make_batch

START = ("north_m", "east_m", "heading_rad", "surge_m_s", "sway_m_s", "yaw_rate_rad_s")


@dataclass(frozen=True)
class Scored:
    """One model: its free runs and scores in the order of the runs, and its scores over all of them."""

    free: tuple[FreeRun, ...]
    scores: tuple[RunScore, ...]
    overall: Mapping[str, Overall]

    @property
    def diverged(self) -> tuple[str, ...]:
        return tuple(one.run.name for one in self.free if one.diverged)

    @property
    def values(self) -> list[dict[str, float | None]]:
        """The scores of each run by name."""
        return [{name: score.value(name) for name in self.overall} for score in self.scores]


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
        simulated = free_runs(model, runs, stored.switch_offset)
        free = list(counted(progress, f"simulating model {number}", simulated, len(runs)))
        again = restarted_errors(model, free, restarts, stored.switch_offset)
        scores = tuple(score(one, errors) for one, errors in zip(free, again))
        models[number] = Scored(tuple(free), scores, overall(scores, drawn))
    ranked = sorted(
        (value, len(stored.models[number].theta), number)
        for number, scored in models.items()
        if (value := scored.overall["rmse"].value) is not None
    )
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
    """What each model, by its number, predicts from the filtered states of the `runs`; `preferred` is the one that the
    fit preferred: who has no more logs than these cannot know which does best on them."""

    predicted: Mapping[str, tuple[Predicted, ...]]
    preferred: str
    runs: tuple[str, ...]
    dof: Dof

    @cached_property
    def worth(self) -> dict[str, tuple[ForecastScore, ...]]:
        """What the models are worth by horizon."""
        return {number: worth_of(predicted) for number, predicted in self.predicted.items()}

    @property
    def of_use(self) -> bool:
        """Whether the preferred model predicts better than constants do; what cannot be judged counts as of use."""
        judged = judged_of(self.worth[self.preferred])
        return judged is None or judged.of_use

    @property
    def sentence(self) -> str:
        if (judged := judged_of(self.worth[self.preferred])) is None:
            return "These runs are driven and disturbed, and too short to judge predictions."
        model = f"Model {self.preferred}" + ", which the fit preferred," * (len(self.worth) > 1)
        if judged.of_use:
            return f"{model} predicts {judged.beside(self.dof)}."
        return (
            f"{model} is not usable on these runs: it predicts {judged.beside(self.dof)}. Do not simulate or control "
            "with it; `automarine diagnose` looks for what it lacks."
        )

    def to_json(self) -> dict[str, list[dict[str, object]]]:
        """By model and horizon, in the unit in which people see positions."""

        def by_run(ahead: Predicted) -> dict[str, float]:
            sizes = self.dof.shown(np.sqrt(ahead.by_run(ahead.error, len(self.runs))))
            return {run: float(size) for run, size in zip(self.runs, sizes) if np.isfinite(size)}

        return {
            number: [
                score.to_json(self.dof) | {"runs": by_run(ahead)}
                for score, ahead in zip(self.worth[number], (ahead for ahead in predicted if len(ahead.error)))
            ]
            for number, predicted in self.predicted.items()
        }


def ahead_of(stored: StoredModels, runs: Sequence[Run], channels: tuple[str, ...] | None) -> Ahead | None:
    """Predictions of every model of a file from the filtered states of `runs`; None where the runs are not driven, or
    no filter follows them. `channels` names the quantities that count, None for positions."""
    at_rest = np.array([starts_at_rest(run) for run in runs])
    try:
        rough = rough_model("2", make_batch(runs, STEPS[0]))  # what runs are does not hang on the model to be judged
    except FitError:
        rough = stored.models[stored.preferred]
    try:
        if not disturbed(runs, rough, at_rest, channels):
            return None
        predicted = {number: _predicted(model, runs, at_rest, channels) for number, model in stored.models.items()}
    except FitError:  # what the free runs say has to do
        return None
    return Ahead(predicted, stored.preferred, tuple(run.name for run in runs), stored.dof)


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


@dataclass(frozen=True, kw_only=True)
class ScoreEntry:
    rmse: float | None = field(default=None, metadata=keyed("rmse_{shown_unit}", "heading_rmse_deg"))
    ci95: tuple[float, float] | None = field(default=None, metadata=keyed("rmse_{shown_unit}_ci95"))
    restarted: float | None = field(default=None, metadata=keyed("restarted_rmse_{shown_unit}"))
    runs: Mapping[str, "ScoreEntry"] = field(default_factory=dict)


@dataclass(frozen=True)
class ForecastEntry:
    horizon_s: float
    runs: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class ValidationFile(ResultRecord):
    """`validation.json`: the models of a file against measured runs; of a planar model there is one, and no fit."""

    models: Mapping[str, ScoreEntry]
    best: str
    preferred_by_fit: str = ""
    noise_floor: float | None = field(default=None, metadata=keyed("noise_floor_{shown_unit}"))
    use: Use = field(default_factory=Use)
    logs: Mapping[str, Mapping[str, object]] = field(default_factory=dict)
    prediction: Mapping[str, tuple[ForecastEntry, ...]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.best not in self.models:
            raise SettingError(f"best: found {told(self.best)}, expected one of {', '.join(self.models)}")


VALIDATION = ResultKind("validation.json", "validation", ValidationFile, "validate")


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

        def start(state: State) -> dict[str, object]:
            position, rate = f"{dof.words.position}_{dof.units.key}", f"{dof.words.speed}_{dof.units.rate_key}"
            return {position: float(dof.shown(state.position)), rate: float(dof.shown(state.rate)), "how": state.how}

        return {
            "schema": VALIDATION.schema,
            **({} if dof.wraps else {"motion": dof.name}),
            "models": {
                number: scored_json(scored, lambda name: score_key(name, dof), start)
                for number, scored in compared.models.items()
            },
            f"noise_floor_{dof.units.key}": compared.floor,
            "best": compared.best,
            "best_because": compared.because,
            "preferred_by_fit": self.stored.preferred,
            "effects": list(self.stored.effects),
            f"{dof.words.force}_unit": self.stored.moment_unit,
            "switch_offset": self.stored.switch_offset,
            **channels_json(self.channels, measured_noises(compared.runs, dof)),
            **({} if ahead is None else {"prediction": ahead.to_json(), "use": use}),
            "scores": {score_key(name, dof): dof.fill(score.meaning) for name, score in SCORES.items()},
            "logs": {
                run.name: {
                    **log_json(run),
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


def scored_json(
    scored: Scored, key: Callable[[str], str], start: Callable[[State], Mapping[str, object]]
) -> dict[str, object]:
    """What a file says of one model, by the keys of the scores."""
    data = dict[str, object]()
    for name, whole in scored.overall.items():
        data[key(name)] = whole.value
        if whole.ci95 is not None:
            data[f"{key(name)}_ci95"] = list(whole.ci95)
    runs = {
        free.run.name: {key(name): value for name, value in values.items()}
        | {"diverged": free.diverged, "start": start(free.start)}
        for free, values in zip(scored.free, scored.values)
    }
    return {**data, "diverged": list(scored.diverged), "runs": runs}


def log_json(run: Run) -> dict[str, object]:
    return {"file": run.source, "samples": len(run), "duration_s": float(run.time[-1] - run.time[0])}


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
                f"gives them in {run.moment_unit}; there is no factor between the two. Give logs in "
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


def planar_scored(model: PlanarModel, runs: Sequence[Run], seed: int = 0) -> Scored:
    free = tuple(planar_free_runs(model, runs))
    scores = tuple(map(planar_score, free))
    return Scored(free, scores, overall(scores, resamples(len(runs), seed), PLANAR_SCORES))


@dataclass(frozen=True, repr=False)
class PlanarValidation(Shown):
    """A planar model, every run simulated by it, and the runs left out."""

    stored: StoredPlanar
    scored: Scored
    set_aside: tuple[SetAside, ...]

    def to_json(self) -> dict[str, object]:
        runs, name = [free.run for free in self.scored.free], PLANAR.name

        def start(state: State) -> dict[str, object]:
            return dict(zip(START, [*state.position.tolist(), *state.rate.tolist()]))

        return {
            "schema": VALIDATION.schema,
            "motion": name,
            "models": {name: scored_json(self.scored, str, start)},
            "best": name,
            "scores": {name: score.meaning for name, score in PLANAR_SCORES.items()},
            "logs": {run.name: log_json(run) for run in runs},
            "runs": runs_json(len(runs), self.set_aside, runs),
        }
