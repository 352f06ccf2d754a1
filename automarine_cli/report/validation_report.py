"""What `validate` shows: every model over all runs, every run under every model, a figure of each run; and `predict`:
the end of each run, and all of it in files."""

from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np

from automarine_cli.comparison.prediction import Prediction
from automarine_cli.comparison.validation import Overall, Validation
from automarine_cli.estimate import Estimate
from automarine_cli.fits.driven import worth_of
from automarine_cli.fits.innovations import measured_noises, sensors_of
from automarine_cli.report.fit_report import forecast_cells, overshoot_sentence
from automarine_cli.report.log_tables import sensor_sentences
from automarine_cli.report.sections import Content, Drawing, Sections, document, file_stems, forms_of, sections
from automarine_cli.report.tables import MISSING, Table, interval, number, with_band
from automarine_cli.runs.run import command_warnings
from automarine_cli.text import plural

LISTED_FILES = ("validation.json", "validation.csv", "validation.md", "validation.tex", "validation_RUN.png")
DIVERGED_CELL = "diverged"


@sections.register
def _(result: Validation) -> Sections:
    """Of driven runs predictions first, before all how commands do not fit their map."""
    runs, dof, says = result.runs, result.dof, result.says
    free = [{model: scored.free[i] for model, scored in result.models.items()} for i in range(len(runs))]
    names = [f"validation_{stem}" for stem in file_stems([run.name for run in runs])]
    files: dict[str, Content] = {"validation.json": result.to_json()}
    figures: dict[str, Drawing] = {}
    if result.stored.in_plane:
        table = planar_table(result)
        figures = {name: Drawing("runs.planar_figure", *of_run.values()) for name, of_run in zip(names, free)}
        files |= forms_of("validation", table)
        return Sections([table], files, figures, LISTED_FILES, score_rows(result), answer=_answer(result, ""))
    tables = [*([ahead_table(result)] if says else []), overall_table(result), run_table(result)]
    sensors = list(sensor_sentences(sensors_of(result.channels, measured_noises(runs, dof)), dof))
    if result.overshoots:
        sensors.insert(0, overshoot_sentence(result.overshoots))
    of_runs = zip(names, free, result.floors)
    figures = {name: Drawing("runs.validation_figure", of_run, result.stored, floor) for name, of_run, floor in of_runs}
    files |= forms_of("validation", *tables)
    first = [line for line in (result.contradiction, says) if line]
    text = document(*first, *tables, *sensors)
    files |= {"validation.csv": score_table(result).to_csv(), "validation.md": text}
    warnings = (f"Warning: {warning}" for warning in command_warnings(runs))
    printed: list[Table | str] = [*warnings, *tables, *sensors]
    over_all = _answer(result, f"; the {dof.position} noise is {number(result.floor, 3)} {dof.units.shown}")
    answer = " ".join([*([result.contradiction] if result.contradiction else []), says or over_all])
    return Sections(printed, files, figures, LISTED_FILES, score_rows(result), answer=answer)


MAX_BEYOND = 1.02  # times the range of commands of the fit, from which a prediction is told to go beyond it


@sections.register
def _(result: Prediction) -> Sections:
    names, columns = [of_run.run.name for of_run in result.predicted], result.columns()
    alone, table = len(names) == 1, "prediction.parquet" if result.parquet else "prediction.csv"
    stems = ["prediction"] if alone else [f"prediction_{stem}" for stem in file_stems(names)]
    form = partial(_file_of, columns, result.parquet)
    files: dict[str, Content] = {"prediction.json": result.to_json(), table: form}
    figures = {name: Drawing("runs.prediction_figure", run, result.shown) for name, run in zip(stems, result.predicted)}
    rows = list[dict[str, object]]()
    for of_run in result.predicted:
        rows.append({"run": of_run.run.name, "s": number(float(np.ptp(of_run.run.time)), 3)})
        for quantity, (value, low, high) in result.end(of_run).items():
            heading = f"{quantity.replace('_', ' ')} {result.shown[quantity].unit}"
            rows[-1][heading] = _with_ends(value, low, high)
        rows[-1]["start"] = of_run.start.how.split(":")[0] if len(names) > 1 else of_run.start.how
    notes = [_included(result), "It leaves out what the model lacks, and the noise of a sensor."]
    warnings: list[Table | str] = [f"Warning: {warning}" for warning in _prediction_warnings(result)]
    printed = [*warnings, Table.of("At the end of the commands", rows, notes)]
    listed_files = ("prediction.json", table, "prediction.png" if alone else "prediction_RUN.png")
    return Sections(printed, files, figures, listed_files, columns, answer=_predicted_end(result))


def _with_ends(value: float, low: float, high: float) -> str:
    """Write a value with the ends of its band, to digits that tell these apart."""
    return interval(Estimate(value, (high - low) / 4.0, (low, high), ""))


def _included(result: Prediction) -> str:
    doubt = result.doubt
    parts = ["the errors of the parameters"] if np.any(doubt.covariance) else []
    parts += [f"thrust that differs by {100 * doubt.scatter:.1f} % from run to run"] if doubt.scatter else []
    sampled = any(of_run.sampled for of_run in result.predicted)
    parts += ["commands that changed somewhere between two samples"] if sampled else []
    parts += ["the disturbance of the runs that were fitted"] if doubt.disturbed else []
    *others, last = parts or ["no error, as the file has none"]
    return f"The 95 % band includes {', '.join(others)}{' and ' if others else ''}{last}."


def _prediction_warnings(result: Prediction) -> Iterator[str]:
    runs, doubt, force = [of_run.run for of_run in result.predicted], result.doubt, result.dof.words.force
    if doubt.says:
        yield doubt.says
    if doubt.force_range is not None:
        low, high = doubt.force_range
        most, unit = max(float(np.abs(run.command).max()) for run in runs), runs[0].moment_unit
        if most > MAX_BEYOND * max(abs(low), abs(high)):
            yield (
                f"The {force}s reach {number(most, 3)} {unit}, those of the fit went from {number(low, 3)} to "
                f"{number(high, 3)} {unit}; beyond them the prediction is a guess."
            )
    if lost := sum(of_run.lost for of_run in result.predicted):
        yield f"{plural(lost, 'vehicle')} that the errors allow would run away; the band is without them."
    yield from command_warnings(runs)


def _predicted_end(result: Prediction) -> str:
    """Say where the commands end, or how wide the bands of many runs are there."""
    position, ends = result.dof.position, [result.end(of_run)[result.dof.position] for of_run in result.predicted]
    unit = result.shown[position].unit
    if len(ends) == 1:
        (value, low, high), seconds = ends[0], number(float(np.ptp(result.predicted[0].run.time)), 3)
        return f"After {seconds} s of commands the {position} is {_with_ends(value, low, high)} {unit}."
    halves = sorted(0.5 * (high - low) for _, low, high in ends)
    sizes = f"±{number(halves[0], 2)} to ±{number(halves[-1], 2)} {unit}"
    return f"{len(ends)} runs are predicted; at their ends the 95 % band of the {position} is {sizes}."


def _file_of(columns: Mapping[str, Any], parquet: bool) -> str | bytes:
    import pandas as pd  # here, as validations need none of it

    frame = pd.DataFrame(columns)
    return frame.to_parquet(index=False) if parquet else frame.to_csv(index=False, lineterminator="\n")


def _answer(result: Validation, more: str) -> str:
    """Say how far the best model is off over whole runs, with its 95 % interval over runs where there is one."""
    if result.best is None:
        return result.because
    name, of = next(iter(result.models[result.best].overall.items()))  # the positions' root mean square stands first
    unit = result.dof.fill(result.scores[name].heading).rpartition(" ")[2]
    runs, position = plural(len(result.runs), "whole run"), result.dof.position
    model = "the planar model" if result.stored.in_plane else f"model {result.best}"
    return f"Over {runs} the {position} of {model} is off by {with_band(of.value, of.ci95)} {unit}{more}."


def planar_table(result: Validation) -> Table:
    (scored,), headings = result.models.values(), [score.heading for score in result.scores.values()]
    overall = {name: score.value for name, score in scored.overall.items()}
    names = [*(run.name for run in result.runs), "all runs"]
    lengths = [*(float(run.time[-1] - run.time[0]) for run in result.runs), None]
    rows = []
    for name, length, values in zip(names, lengths, [*scored.values, overall]):
        cells = (number(value, 3) for value in values.values())
        rows.append({"run": name, "s": number(length, 3), **dict(zip(headings, cells))})
    for row, free in zip(rows, scored.free):
        if free.diverged:
            row |= {headings[0]: DIVERGED_CELL}
    return Table.of(f"Validation over {plural(len(result.runs), 'run')}: surge, sway and yaw together", rows, (
        "Free run: simulated from the start state of each log to its end by its commands alone; root mean squares "
        "of measured less simulated.",
        "A position adds up every error of speed and heading: judge a long run by its velocities.",
        *([overshoot_sentence(result.overshoots)] if result.overshoots else []),
    ))  # fmt: skip


def overall_table(result: Validation) -> Table:
    """Lay out models down, scores across, each with its 95 % interval over runs."""
    rows = []
    for model, scored in result.models.items():
        cells = {result.dof.fill(result.scores[name].heading): _cell(name, of) for name, of in scored.overall.items()}
        rows.append({"model": model} | cells | ({next(iter(cells)): DIVERGED_CELL} if scored.diverged else {}))
    return Table.of(f"Validation over {plural(len(result.runs), 'run')}", rows, (result.because, *_notes(result)))


def run_table(result: Validation) -> Table:
    """Lay out runs down, the best model first across: a narrow terminal leaves out the others."""
    rows, dof = list[dict[str, str]](), result.dof
    starts = next(iter(result.models.values())).free
    order = sorted(result.models, key=lambda model: model != result.best)
    for i, (run, floor, restarts) in enumerate(zip(result.runs, result.floors, result.restarts)):
        rows.append({"run": run.name, f"noise {dof.units.shown}": number(floor, 2)})
        for model in order:
            scores = result.models[model].values[i]
            rows[-1][f"model {model}"] = DIVERGED_CELL if scores["rmse"] is None else number(scores["rmse"], 3)
            rows[-1][f"{model} restarted"] = number(scores["restarted_rmse"], 3)
        rows[-1] |= {
            "horizon s": number(restarts.horizon, 3), "s": number(float(run.time[-1] - run.time[0]), 3),
            "start": starts[i].start.how.split(":")[0],
        }  # fmt: skip
    title = f"{dof.position.capitalize()} error of each run: rmse in {dof.words.units}, free run and restarted"
    return Table.of(title, rows)


def ahead_table(result: Validation) -> Table:
    """Lay out each model and horizon: its error beside those of somebody who expects no change."""
    dof = result.dof
    rows = [
        {"model": model} | forecast_cells(score, dof)
        for model, predicted in result.predictions.items()
        for score in worth_of(predicted)
    ]
    return Table.of(f"Predictions from the filtered state, {dof.position} in {dof.units.shown}", rows, (
        "Root mean square errors on these driven and disturbed runs. The filter knows the readings until each "
        "prediction begins, and the commands after that; how large disturbances and noise are is fitted on these runs, "
        "the models are left as they are.",
        f"A constant {dof.words.speed} is the slope of the last readings, over the time that predicts best.",
    ))  # fmt: skip


def score_rows(result: Validation) -> list[dict[str, object]]:
    """List every run under every model: its scores and, of one motion, its noise and how it was restarted."""
    rows = list[dict[str, object]]()
    for i, run in enumerate(result.runs):
        for model, scored in result.models.items():
            scores = {result.key(name): value for name, value in scored.values[i].items()}
            rows.append({"run": run.name, "model": model, **scores})
            if result.restarts:
                rows[-1] |= {
                    f"noise_floor_{result.dof.units.shown}": result.floors[i],
                    "restarted_horizon_s": result.restarts[i].horizon, "restarted_at": result.restarts[i].rule,
                    "start": scored.free[i].start.how,
                }  # fmt: skip
    return rows


def score_table(result: Validation) -> Table:
    """Lay out everything, each run and model and then each model over all runs: for programs."""
    rows = score_rows(result)
    for model, scored in result.models.items():
        scores = {result.key(name): score.value for name, score in scored.overall.items()}
        noise = {f"noise_floor_{result.dof.units.shown}": result.floor}
        rows.append(dict.fromkeys(rows[0]) | {"run": "all runs", "model": model, **scores, **noise})
    cells = [{key: number(x, 6) if isinstance(x, float) else x for key, x in row.items()} for row in rows]
    return Table.of("Scores", cells)


def _cell(name: str, score: Overall) -> str:
    if score.value is None:
        return MISSING
    form = ".1f" if name == "fit_percent" else ".2f"
    between = "" if score.ci95 is None else f" [{score.ci95[0]:{form}}, {score.ci95[1]:{form}}]"
    return f"{score.value:{form}}{between}"


def _notes(result: Validation) -> list[str]:
    """Say what each score means: its horizon, its start state, and what no model can undercut."""
    position, unit = result.dof.position, result.dof.units.shown
    rules = "; or ".join(dict.fromkeys(restarts.rule for restarts in result.restarts))
    notes = [
        "Free run (rmse, max, fit): simulated from start to end of a run by its commands alone.",
        f"Restarted: simulated anew from the smoothed log {rules}. Even a perfect model shows the smoothing error.",
        f"Noise level of the {position}, estimated without a model: {number(result.floor, 3)} {unit}.",
    ]
    if result.expected is not None:
        error, scatter = number(result.expected, 2), 100 * (result.stored.scatter or 0.0)
        right = f"If the model were right, its restarted error would be about {error} {unit}"
        notes.append(f"{right}: the noise, and thrust that differs by {scatter:.1f} % from run to run.")
    return notes if len(result.runs) < 3 else [*notes, "Brackets: 95 % bootstrap intervals over runs."]
