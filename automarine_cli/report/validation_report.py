"""What `validate` shows: every model over all runs, every run under every model, a figure of each run."""

from collections.abc import Mapping
from functools import partial
from itertools import count

from automarine_cli.comparison.scores import PLANAR_SCORES, SCORES, Overall, score_key
from automarine_cli.comparison.validation import Ahead, Comparison, PlanarValidation, Validation
from automarine_cli.dofs import Dof
from automarine_cli.dofs.motion import PLANAR
from automarine_cli.fits.innovations import channel_sentences, measured_noises
from automarine_cli.pipeline.results_folder import file_stems
from automarine_cli.report.figures.runs import planar_figure, validation_figure
from automarine_cli.report.sections import Sections, document, forms_of, sections
from automarine_cli.report.tables import MISSING, Table, number
from automarine_cli.runs.run import command_warnings

LISTED = ("validation.json", "validation.csv", "validation.md", "validation.tex", "validation_RUN.png")
HEADINGS = {
    "rmse": "rmse {shown_unit}", "max_abs": "max {shown_unit}", "fit_percent": "fit %",
    "restarted_rmse": "restarted rmse {shown_unit}", "rate_rmse": "{speed} rmse {shown_unit}/s",
}  # fmt: skip
PLANAR_HEADINGS = {
    "heading_rmse_deg": "heading deg", "heading_max_abs_deg": "max deg", "position_rmse_m": "position m",
    "position_max_abs_m": "max m", "surge_rmse_m_s": "surge m/s", "sway_rmse_m_s": "sway m/s",
    "yaw_rate_rmse_deg_s": "yaw rate deg/s",
}  # fmt: skip
DIVERGED = "diverged"


@sections.register
def _(result: Validation) -> Sections:
    """Of driven runs predictions first, before all how commands do not fit their map."""
    compared, dof, ahead = result.comparison, result.stored.dof, result.ahead
    headline = [] if ahead is None else [ahead.sentence]
    tables = [*([] if ahead is None else [ahead_table(ahead)]), overall_table(compared), run_table(compared)]
    sensors = channel_sentences(result.channels, measured_noises(compared.runs, dof), dof)
    free = [{model: scored.free[i] for model, scored in compared.models.items()} for i in range(len(compared.runs))]
    names = (f"validation_{stem}" for stem in file_stems([run.name for run in compared.runs]))
    files = {"validation.json": result.to_json()} | forms_of("validation", *tables)
    files["validation.csv"] = score_table(compared).to_csv()
    files["validation.md"] = document(*headline, *tables, *sensors)
    return Sections(
        [*(f"Warning: {warning}" for warning in command_warnings(compared.runs)), *headline, *tables, *sensors],
        files,
        {name: partial(validation_figure, *pair) for name, pair in zip(names, zip(free, compared.floors))},
        LISTED,
        [
            {"run": run.name, "model": model, **{score_key(name, dof): score.value(name) for name in SCORES}}
            for model, scored in compared.models.items()
            for run, score in zip(compared.runs, scored.scores)
        ],
    )


@sections.register
def _(result: PlanarValidation) -> Sections:
    table, scored = planar_table(result), result.scored
    names = (f"validation_{stem}" for stem in file_stems([free.run.name for free in scored.free]))
    return Sections(
        [table],
        {"validation.json": result.to_json()} | forms_of("validation", table),
        {name: partial(planar_figure, free) for name, free in zip(names, scored.free)},
        LISTED,
        [{"run": free.run.name, "model": PLANAR.name, **values} for free, values in zip(scored.free, scored.values)],
    )


def planar_table(result: PlanarValidation) -> Table:
    """Lay out each run, and all of them."""

    def row(run: str, length: float | None, scores: Mapping[str, float | None]) -> dict[str, str]:
        values = {PLANAR_HEADINGS[name]: number(scores.get(name), 3) for name in PLANAR_SCORES}
        return {"run": run, "s": number(length, 3)} | values

    rows = []
    for free, values in zip(result.scored.free, result.scored.values):
        rows.append(row(free.run.name, float(free.run.time[-1] - free.run.time[0]), values))
        if free.diverged:
            rows[-1] |= dict.fromkeys(PLANAR_HEADINGS.values(), MISSING) | {"heading deg": DIVERGED}
    rows.append(row("all runs", None, {name: whole.value for name, whole in result.scored.overall.items()}))
    runs = len(result.scored.free)
    title = f"Validation over {runs} run{'s' * (runs != 1)}: surge, sway and yaw together"
    return Table.of(title, rows, (
        "Free run: simulated from the start state of each log to its end by its commands alone; root mean squares "
        "of measured less simulated.",
        "A position adds up every error of speed and heading: judge a long run by its velocities.",
    ))  # fmt: skip


def overall_table(comparison: Comparison) -> Table:
    """Lay out models down, scores across, each with its 95 % interval over runs."""
    rows, dof, runs = list[dict[str, str]](), comparison.runs[0].dof, len(comparison.runs)
    for model, scored in comparison.models.items():
        cells = dict.fromkeys(SCORES, MISSING) | {"rmse": DIVERGED}
        if not scored.diverged:
            cells = {name: _cell(name, scored.overall[name]) for name in SCORES}
        rows.append({"model": model} | {dof.fill(HEADINGS[name]): cell for name, cell in cells.items()})
    notes = (comparison.because, *_notes(comparison))
    return Table.of(f"Validation over {runs} run{'s' * (runs != 1)}", rows, notes)


def run_table(comparison: Comparison) -> Table:
    """Lay out each run: noise level, then free-run and restarted rmse of each model."""
    rows, dof = list[dict[str, str]](), comparison.runs[0].dof
    for i, run in enumerate(comparison.runs):
        scores = {model: scored.scores[i] for model, scored in comparison.models.items()}
        free = {
            model: DIVERGED if score.diverged else number(score.value("rmse"), 3) for model, score in scores.items()
        }
        rows.append({
            "run": run.name,
            "s": number(float(run.time[-1] - run.time[0]), 3),
            f"noise {dof.units.shown}": number(comparison.floors[i], 2),
            **{f"model {model}": error for model, error in free.items()},
            **{f"{model} restarted": number(score.value("restarted_rmse"), 3) for model, score in scores.items()},
            "horizon s": number(comparison.restarts[i].horizon, 3),
            "start": next(iter(comparison.models.values())).free[i].start.how.split(":")[0],
        })  # fmt: skip
    title = f"{dof.position.capitalize()} error of each run: rmse in {dof.words.units}, free run and restarted"
    return Table.of(title, rows)


def ahead_table(ahead: Ahead) -> Table:
    """Lay out each model and horizon: its error beside those of somebody who expects no change."""
    dof, unit = ahead.dof, ahead.dof.units.shown
    rows = [
        {
            "model": model, "s ahead": f"{worth.horizon:g}", f"error {unit}": number(float(dof.shown(worth.error)), 3),
            f"constant {dof.words.speed} {unit}": number(float(dof.shown(worth.constant_rate)), 3),
            f"constant {dof.position} {unit}": number(float(dof.shown(worth.constant)), 3),
            "predictions": worth.count,
        }
        for model, horizons in ahead.worth.items()
        for worth in horizons
    ]  # fmt: skip
    return Table.of("Predictions from the filtered state", rows, (
        "Root mean square errors on these driven and disturbed runs. The filter knows the readings until each "
        "prediction begins, and the commands after that; how large disturbances and noise are is fitted on these runs, "
        "the models are left as they are.",
        f"A constant {dof.words.speed} is the slope of the last readings, over the time that predicts best.",
    ))  # fmt: skip


def score_table(comparison: Comparison) -> Table:
    """Lay out everything, each run and model and then each model over all runs: for programs."""
    dof = comparison.runs[0].dof

    def row(run: str, model: str, values: Mapping[str, float | None], floor: float, *restart: str) -> dict[str, str]:
        cells = {score_key(name, dof): number(value, 6) for name, value in values.items()}
        tail = zip(("restarted_horizon_s", "restarted_at", "start"), restart or [MISSING] * 3)
        return {"run": run, "model": model, **cells, f"noise_floor_{dof.units.key}": number(floor, 6), **dict(tail)}

    rows = []
    for run, floor, restarts, i in zip(comparison.runs, comparison.floors, comparison.restarts, count()):
        for model, scored in comparison.models.items():
            score, horizon = scored.scores[i], number(restarts.horizon, 6)
            values = {name: score.value(name) for name in SCORES}
            rows.append(row(run.name, model, values, floor, horizon, restarts.rule, scored.free[i].start.how))
    for model, scored in comparison.models.items():
        values = {name: scored.overall[name].value for name in SCORES}
        rows.append(row("all runs", model, values, comparison.floor))
    return Table.of("Scores", rows)


def _cell(name: str, score: Overall) -> str:
    if score.value is None:
        return MISSING
    form = ".1f" if name == "fit_percent" else ".2f"
    between = "" if score.ci95 is None else f" [{score.ci95[0]:{form}}, {score.ci95[1]:{form}}]"
    return f"{score.value:{form}}{between}"


def _notes(comparison: Comparison) -> list[str]:
    """What each score means: its horizon, its start state, and what no model can undercut."""
    starts = [free.start.how for free in next(iter(comparison.models.values())).free]
    rest, dof = sum(how.startswith("from rest") for how in starts), comparison.runs[0].dof
    *rules, last = dict.fromkeys(restarts.rule for restarts in comparison.restarts)
    logged = sum(dof.velocity in run.extras for run in comparison.runs)
    rate = f"the log in {logged} runs, else " if logged else ""
    measured = f"Measured {dof.words.rate} from {rate}the smoothed {dof.position}."
    notes = [
        "Free run (rmse, max, fit): simulated from start to end of a run by its commands alone. "
        + _starts(rest, len(starts), dof),
        f"Restarted {'; '.join([*rules, f'or {last}']) if rules else last}; {dof.position} and {dof.words.speed} "
        "smoothed there, whose own error even a perfect model shows.",
        measured if logged < len(starts) else f"Measured {dof.words.rate} from the logs.",
        f"Noise level of the {dof.position}, estimated without a model: {number(comparison.floor, 3)} "
        f"{dof.units.shown}.",
    ]
    if comparison.carried:
        goes = "go" if len(comparison.carried) > 1 else "goes"
        notes.insert(2, f"At a restart {' and '.join(comparison.carried)} {goes} on as in the free run.")
    if len(comparison.runs) >= 3:
        notes.append("In brackets: 95 % intervals, runs resampled.")
    return notes


def _starts(rest: int, runs: int, dof: Dof) -> str:
    still = f"start from rest, at the mean {dof.position} of the rest"
    moving = f"with the {dof.position} and {dof.words.speed} that follow their first second best"
    if rest == runs:
        return f"All {still}."
    return f"All start {moving}." if rest == 0 else f"{rest} of {runs} {still}; the others {moving}."
