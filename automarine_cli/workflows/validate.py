"""`validate`: simulate each log with each model, compare, plot (the source paper's section 5 and Fig. 10)."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from automarine_cli.comparison.rollouts import needed_signals
from automarine_cli.comparison.scores import SCORES, RunScore, rate_source, score_key
from automarine_cli.comparison.validation import Ahead, Comparison, Scored, ahead_of, compare
from automarine_cli.dofs import YAW, Dof
from automarine_cli.effects.thruster_imbalance import lacking_signal
from automarine_cli.errors import AutomarineError, ModelError, RunError
from automarine_cli.fits.channel_noise import channel_sentences, channels_of, measured_noises
from automarine_cli.logs import given_columns
from automarine_cli.models.store import StoredModels, load_yaw_models
from automarine_cli.pipeline.records import schema_in
from automarine_cli.pipeline.results_folder import ResultFolder
from automarine_cli.report.figures.files import Draw
from automarine_cli.report.figures.validation import validation_figure
from automarine_cli.report.tables import Table, number
from automarine_cli.report.validation_tables import ahead_table, overall_table, run_table, score_table
from automarine_cli.results.kinds import PLANAR_MODEL, VALIDATION
from automarine_cli.results.records import runs_json
from automarine_cli.results.shown import Shown
from automarine_cli.runs.channels import AUTO, NOTHING_TO_CHOOSE, ChannelChoice, choose_channels, wanted_channels
from automarine_cli.runs.load import load_runs, none_left, refused_by_strict
from automarine_cli.runs.run import Run, SetAside, command_warnings
from automarine_cli.runs.undriven import without_undriven
from automarine_cli.workflows.command import SELDOM, Command, Runner
from automarine_cli.workflows.moments import moment_maker
from automarine_cli.workflows.shared import Ending, Judged, Lever, OfLogs, counted
from automarine_cli.workflows.validate_planar import (
    Pictures,
    PlanarValidation,
    files,
    validate_planar,
    write_figures_of_runs,
)
from automarine_cli.workflows.view import Figures, Row, View

MEANING = {
    "rmse": "free run: measured less simulated {position} from the start of each run to its end",
    "max_abs": "free run: the largest {position} error",
    "fit_percent": "free run: 100 (1 - |error| / |measured - its mean|)",
    "restarted_rmse": "{position} error with the state set anew from the smoothed measured {position} at each restart",
    "rate_rmse": "free run: measured less simulated {rate}",
}


@dataclass(frozen=True, repr=False)
class Validation(Shown):
    """What `validate` found: the models and their effects, the comparison, the runs left out; predictions from filtered
    states where the runs are driven."""

    stored: StoredModels
    comparison: Comparison
    set_aside: tuple[SetAside, ...]
    channels: ChannelChoice = NOTHING_TO_CHOOSE
    ahead: Ahead | None = None

    def to_json(self) -> dict[str, object]:
        """The result: schema automarine/validation/1."""
        found, dof = self.comparison, self.stored.dof
        return {
            "schema": VALIDATION.schema,
            **({} if dof is YAW else {"motion": dof.name}),
            "models": {number: self._model_json(scored) for number, scored in found.models.items()},
            f"noise_floor_{dof.units.key}": found.floor,
            "best": found.best,
            "best_because": found.because,
            "preferred_by_fit": self.stored.preferred,
            "effects": list(self.stored.effects),
            f"{dof.words.force}_unit": self.stored.moment_unit,
            "switch_offset": self.stored.switch_offset,
            **channels_of(self.channels, measured_noises(found.runs, dof)),
            **({} if self.ahead is None else self._ahead_json(self.ahead)),
            "scores": {score_key(name, dof): dof.fill(meaning) for name, meaning in MEANING.items()},
            "logs": {run.name: self._log_json(i) for i, run in enumerate(found.runs)},
            "runs": runs_json(len(found.runs), self.set_aside, found.runs),
        }

    def tables(self) -> tuple[Table | str, ...]:
        """Models over all runs, then run by run; sensors where there was a choice. Of driven runs predictions first,
        before all how commands do not fit their map."""
        first = () if self.ahead is None else (self.ahead.sentence,)
        warned = (f"Warning: {one}" for one in command_warnings(self.comparison.runs))
        return *warned, *first, *self.score_tables(), *self.sensors()

    def sensors(self) -> list[str]:
        """Which sensors count, and why others do not."""
        dof = self.stored.dof
        return channel_sentences(self.channels, measured_noises(self.comparison.runs, dof), dof)

    def score_tables(self) -> tuple[Table, ...]:
        """The tables alone."""
        first = () if self.ahead is None else (ahead_table(self.ahead),)
        return *first, overall_table(self.comparison), run_table(self.comparison)

    def _ahead_json(self, ahead: Ahead) -> dict[str, object]:
        return {"prediction": ahead.to_json(), "use": {"of_use": ahead.of_use, "says": ahead.sentence}}

    def _model_json(self, scored: Scored) -> dict[str, object]:
        data: dict[str, object] = {}
        for name in SCORES:
            key, one = score_key(name, self.stored.dof), scored.overall[name]
            data[key] = one.value
            if one.ci95 is not None:
                data[f"{key}_ci95"] = list(one.ci95)
        data["diverged"] = list(scored.diverged)
        names = (run.name for run in self.comparison.runs)
        data["runs"] = {name: _run_json(one, self.stored.dof) for name, one in zip(names, scored.scores)}
        return data

    def _log_json(self, i: int) -> dict[str, object]:
        run, restarts = self.comparison.runs[i], self.comparison.restarts[i]
        return {
            "file": run.source,
            "samples": len(run),
            "duration_s": float(run.time[-1] - run.time[0]),
            f"noise_floor_{run.dof.units.key}": self.comparison.floors[i],
            "restarts": len(restarts.states),
            "restarted_at": restarts.rule,
            "restarted_horizon_s": restarts.horizon,
            "rate_from": rate_source(run),
        }


def _run_json(one: RunScore, dof: Dof) -> dict[str, object]:
    words, units = dof.words, dof.units
    start = {
        f"{words.position}_{units.key}": float(dof.shown(one.start.position)),
        f"{words.speed}_{units.rate_key}": float(dof.shown(one.start.rate)),
        "how": one.start.how,
    }
    values = {score_key(name, dof): one.value(name) for name in SCORES}
    return {**values, "diverged": one.diverged, "start": start}


@dataclass(frozen=True, kw_only=True)
class ValidateOptions(Ending, Pictures, Lever, Judged, OfLogs):
    """`channels` says which sensors are believed, `seed` is that of the bootstrap over runs."""

    by_effects = True
    channels: str = field(default=AUTO, metadata=SELDOM)
    seed: int = 0


def _validate(asked: ValidateOptions, runner: Runner) -> Validation:
    """Simulate every run with every model of the file `model` and score what it says against what was measured.

    The `arm` [m] may stand as `arm_m` among the column map's defaults, `channels` are those of
    `runs.channels.choose_channels`. One figure a run is drawn unless `figures` is false. Raises LogError, RunError,
    ModelError, SettingError, OutputError.
    """
    stored = load_yaw_models(asked.model)
    wanted_channels(asked.channels, stored.dof)
    names, jobs, progress = given_columns(asked.columns), runner.jobs, runner.progress
    drive = moment_maker(asked.thrusters, asked.arm, names, stored.dof)
    campaign = load_runs(asked.logs, names, dof=stored.dof, strict=asked.strict, progress=progress, jobs=jobs)
    runs, aside = _usable(campaign.runs, stored, drive)
    if asked.strict and aside:
        raise refused_by_strict(aside[0])
    if not runs:
        raise none_left(len(campaign.inputs), (*campaign.set_aside, *aside))
    command_warnings(runs)  # refused where they cannot be of this map
    _same_unit(runs, stored)
    left_out = (*campaign.set_aside, *aside)
    chosen = choose_channels(runs, stored.dof, asked.channels, late_position=True)
    runs = [chosen.believed(run) for run in runs]

    def work() -> Validation:
        compared = compare(stored, runs, asked.seed, progress)
        return Validation(stored, compared, left_out, chosen, ahead_of(stored, runs, chosen.names))

    def write(folder: ResultFolder, result: Validation) -> None:
        _write(folder, result, asked.figure_formats if asked.figures else (), runner)

    return runner.results(asked, work, write)


def _usable(
    runs: Sequence[Run], stored: StoredModels, drive: Callable[[Run], Run] | None
) -> tuple[list[Run], list[SetAside]]:
    """The runs that every model can be driven by and that their commands may have moved, and the others with their
    reasons."""
    signals = dict.fromkeys(name for model in stored.models.values() for name in needed_signals(model))
    good: list[Run] = []
    aside: list[SetAside] = []
    for run in runs:
        try:
            commanded = run if drive is None else drive(run)
            _ = commanded.command  # refused where there is none
            _complete(commanded, tuple(signals))
        except AutomarineError as error:
            why = str(error).removeprefix(f"{run.source}, run {run.name!r}: ")
            aside.append(SetAside(run.source, run.name, why))
        else:
            good.append(commanded)
    driven, undriven = without_undriven(good)
    return driven, [*aside, *undriven]


def _complete(run: Run, signals: Sequence[str]) -> None:
    """Refuse a run without a value of each signal at each sample."""
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


def _same_unit(runs: Sequence[Run], stored: StoredModels) -> None:
    for run in runs:
        if run.moment_unit != stored.moment_unit:
            raise ModelError(
                f"{stored.source} was fitted to {stored.dof.words.force}s in {stored.moment_unit}, {run.source} "
                f"gives them in {run.moment_unit}; there is no factor between the two. Validate with logs in "
                f"{stored.moment_unit}, or fit a model to logs in {run.moment_unit}"
            )


def _write(folder: ResultFolder, result: Validation, formats: tuple[str, ...], runner: Runner) -> None:
    found = result.comparison
    folder.write_json("validation.json", result.to_json())
    folder.write("validation.csv", score_table(found).to_csv())
    tables, sensors = result.score_tables(), result.sensors()
    first = [] if result.ahead is None else [result.ahead.sentence, ""]
    folder.write(
        "validation.md", "\n".join([*first, *(one.to_markdown() for one in tables), *sensors, *[""] * bool(sensors)])
    )
    folder.write("validation.tex", "\n".join(table.to_latex() for table in tables))
    names, draws = [run.name for run in found.runs], _draws(found)
    write_figures_of_runs(folder, names, draws, formats, runner)


def _draws(found: Comparison) -> list[Draw]:
    """What draws the figure of each run."""
    free = [{number: scored.free[i] for number, scored in found.models.items()} for i in range(len(found.runs))]
    return [partial(validation_figure, *pair) for pair in zip(free, found.floors)]


def _lines(result: Validation) -> Iterator[str]:
    found, dof = result.comparison, result.stored.dof
    runs, aside = counted(len(found.runs), "run"), len(result.set_aside)
    preferred = result.stored.preferred
    best = "best here too" if found.best == preferred else f"model {found.best} is best here"
    yield f"Validation on {runs}: model {preferred} was preferred by the fit, {best}; {aside} set aside"
    if result.ahead is not None:
        yield f"  {result.ahead.sentence}"
    for model, scored in found.models.items():
        score = scored.overall["rmse"]
        ends = "" if score.ci95 is None else f" [{number(score.ci95[0], 3)}, {number(score.ci95[1], 3)}]"
        error = f"{dof.position} rmse {number(score.value, 3)}{ends} {dof.units.shown}"
        said = "diverged" if score.value is None else error
        yield f"  model {model}  {said}"
    yield f"  noise of the {dof.position} {number(found.floor, 3)} {dof.units.shown}"


def _rows(result: Validation) -> Iterator[Row]:
    found = result.comparison
    for model, scored in found.models.items():
        for run, one in zip(found.runs, scored.scores):
            scores: Row = {score_key(name, run.dof): one.value(name) for name in SCORES}
            yield {"run": run.name, "model": model} | scores


def _figures(result: Validation) -> Figures:
    found = result.comparison
    return dict(zip((run.name for run in found.runs), _draws(found)))


validate: Command[ValidateOptions, Validation | PlanarValidation] = Command(
    "validate", ValidateOptions, _validate,
    {Validation: View(Validation.tables, _lines, _rows, _figures), **validate_planar.views}, files,
    validate_planar.kept,
    instead=lambda settings: validate_planar if schema_in(settings.get("model")) == PLANAR_MODEL.schema else None,
)  # fmt: skip
