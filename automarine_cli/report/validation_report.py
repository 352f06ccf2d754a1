"""What `validate` shows: every model over all runs, every run under every model, a figure of each run."""

from automarine_cli.comparison.validation import Overall, Validation
from automarine_cli.fits.driven import worth_of
from automarine_cli.fits.innovations import measured_noises, sensors_of
from automarine_cli.report.fit_report import forecast_cells
from automarine_cli.report.log_tables import sensor_sentences
from automarine_cli.report.sections import Content, Drawing, Sections, document, file_stems, forms_of, sections
from automarine_cli.report.tables import MISSING, Table, number, with_band
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
    sensors = sensor_sentences(sensors_of(result.channels, measured_noises(runs, dof)), dof)
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
    ))  # fmt: skip


def overall_table(result: Validation) -> Table:
    """Lay out models down, scores across, each with its 95 % interval over runs."""
    rows = []
    for model, scored in result.models.items():
        cells = {result.dof.fill(result.scores[name].heading): _cell(name, of) for name, of in scored.overall.items()}
        first = next(iter(cells))
        rows.append({"model": model} | cells | ({first: DIVERGED_CELL} if scored.diverged else {}))
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
    return Table.of(
        f"{dof.position.capitalize()} error of each run: rmse in {dof.words.units}, free run and restarted", rows
    )


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
