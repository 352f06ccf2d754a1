"""What `validate` shows: every model over all runs, every run under every model, a figure of each run."""

from collections.abc import Mapping, Sequence
from functools import partial

from automarine_cli.comparison.planar import SCORES as PLANAR_SCORES
from automarine_cli.comparison.planar import PlanarValidation
from automarine_cli.comparison.planar import overall as planar_overall
from automarine_cli.comparison.scores import SCORES, Overall, score_key
from automarine_cli.comparison.validation import Ahead, Comparison, Validation
from automarine_cli.dofs import Dof
from automarine_cli.dofs.motion import PLANAR
from automarine_cli.fits.innovations import channel_sentences, measured_noises
from automarine_cli.pipeline.results_folder import file_stems
from automarine_cli.report.figures.planar import planar_figure
from automarine_cli.report.figures.validation import validation_figure
from automarine_cli.report.sections import Sections, sections
from automarine_cli.report.tables import MISSING, Cell, Table, number
from automarine_cli.runs.run import command_warnings

LISTED = ("validation.json", "validation.csv", "validation.md", "validation.tex", "validation_RUN.png")

HEADINGS = {
    "rmse": "rmse {shown_unit}",
    "max_abs": "max {shown_unit}",
    "fit_percent": "fit %",
    "restarted_rmse": "restarted rmse {shown_unit}",
    "rate_rmse": "{speed} rmse {shown_unit}/s",
}
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
    page = [*headline, *[""] * bool(headline), *(table.to_markdown() for table in tables), *sensors]
    free = [{model: scored.free[i] for model, scored in compared.models.items()} for i in range(len(compared.runs))]
    names = (f"validation_{stem}" for stem in file_stems([run.name for run in compared.runs]))
    return Sections(
        [*(f"Warning: {warning}" for warning in command_warnings(compared.runs)), *headline, *tables, *sensors],
        {
            "validation.json": result.to_json(),
            "validation.csv": score_table(compared).to_csv(),
            "validation.md": "\n".join([*page, *[""] * bool(sensors)]),
            "validation.tex": "\n".join(table.to_latex() for table in tables),
        },
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
    table = planar_table(result)
    names = (f"validation_{stem}" for stem in file_stems([free.run.name for free in result.free]))
    return Sections(
        [table],
        {
            "validation.json": result.to_json(),
            "validation.csv": table.to_csv(),
            "validation.md": table.to_markdown(),
            "validation.tex": table.to_latex(),
        },
        {name: partial(planar_figure, free) for name, free in zip(names, result.free)},
        LISTED,
        [{"run": free.run.name, "model": PLANAR.name, **free.scores} for free in result.free],
    )


def planar_table(result: PlanarValidation) -> Table:
    """Lay out one row a run, and one over all."""

    def cells(scores: Mapping[str, float | None]) -> list[str]:
        return [MISSING if (value := scores[name]) is None else number(value, 3) for name in PLANAR_SCORES]

    rows = [
        (
            free.run.name,
            number(float(free.run.time[-1] - free.run.time[0]), 3),
            *((DIVERGED, *[MISSING] * 6) if free.diverged else cells(free.scores)),
        )
        for free in result.free
    ]
    rows.append(("all runs", MISSING, *cells(planar_overall(result.free))))
    count = len(result.free)
    return Table(
        f"Validation over {count} run{'s' * (count != 1)}: surge, sway and yaw together",
        ("run", "s", *(PLANAR_HEADINGS[name] for name in PLANAR_SCORES)),
        tuple(rows),
        notes=(
            "Free run: simulated from the start state of each log to its end by its commands alone; root mean squares "
            "of measured less simulated.",
            "A position adds up every error of speed and heading: judge a long run by its velocities.",
        ),
    )


def overall_table(comparison: Comparison) -> Table:
    """Models down, scores across, each with its 95 % interval over runs."""
    rows = []
    for model, scored in comparison.models.items():
        if scored.diverged:
            rows.append((model, DIVERGED, *(MISSING for _ in SCORES[1:])))
        else:
            rows.append((model, *(_cell(name, scored.overall[name]) for name in SCORES)))
    header = ("model", *(_dof(comparison).fill(HEADINGS[name]) for name in SCORES))
    count = len(comparison.runs)
    title = f"Validation over {count} run{'s' * (count != 1)}"
    notes = (comparison.because, *_notes(comparison))
    return Table(title, header, tuple(rows), notes=notes)


def _dof(comparison: Comparison) -> Dof:
    return comparison.runs[0].dof


def run_table(comparison: Comparison) -> Table:
    """One line for each run: noise level, then free-run and restarted rmse of each model."""
    numbers, dof = tuple(comparison.models), _dof(comparison)
    header = (
        "run",
        "s",
        f"noise {dof.units.shown}",
        *(f"model {n}" for n in numbers),
        *(f"{n} restarted" for n in numbers),
        "horizon s",
        "start",
    )
    rows = []
    for i, run in enumerate(comparison.runs):
        scores = [comparison.models[n].scores[i] for n in numbers]
        free = [DIVERGED if one.diverged else number(one.value("rmse"), 3) for one in scores]
        again = [number(one.value("restarted_rmse"), 3) for one in scores]
        start = scores[0].start.how.split(":")[0]
        length = number(float(run.time[-1] - run.time[0]), 3)
        floor, horizon = number(comparison.floors[i], 2), number(comparison.restarts[i].horizon, 3)
        rows.append((run.name, length, floor, *free, *again, horizon, start))
    title = f"{dof.position.capitalize()} error of each run: rmse in {dof.words.units}, free run and restarted"
    return Table(title, header, tuple(rows))


def ahead_table(ahead: Ahead) -> Table:
    """One line for each model and horizon: its error beside those of somebody who expects no change."""
    dof, unit = ahead.dof, ahead.dof.units.shown
    header = (
        "model",
        "s ahead",
        f"error {unit}",
        f"constant {dof.words.speed} {unit}",
        f"constant {dof.position} {unit}",
        "predictions",
    )
    rows = []
    for model, worth in ahead.worth.items():
        for one in worth:
            sizes = (number(float(dof.shown(x)), 3) for x in (one.error, one.constant_rate, one.constant))
            rows.append((model, f"{one.horizon:g}", *sizes, str(one.count)))
    notes = (
        "Root mean square errors on these driven and disturbed runs. The filter knows the readings until each "
        "prediction begins, and the commands after that; how large disturbances and noise are is fitted on these runs, "
        "the models are left as they are.",
        f"A constant {dof.words.speed} is the slope of the last readings, over the time that predicts best.",
    )
    return Table("Predictions from the filtered state", header, tuple(rows), notes=notes)


def score_table(comparison: Comparison) -> Table:
    """Everything, one line for each run and model and one for each model over all runs: for programs."""
    dof = _dof(comparison)
    keys = [score_key(name, dof) for name in SCORES]
    floor = f"noise_floor_{dof.units.key}"
    header = ("run", "model", *keys, floor, "restarted_horizon_s", "restarted_at", "start")
    rows: list[tuple[Cell, ...]] = []
    for i, run in enumerate(comparison.runs):
        restarts = comparison.restarts[i]
        for model, scored in comparison.models.items():
            one = scored.scores[i]
            cells = (number(one.value(name), 6) for name in SCORES)
            tail = (number(comparison.floors[i], 6), number(restarts.horizon, 6), restarts.rule, one.start.how)
            rows.append((run.name, model, *cells, *tail))
    for model, scored in comparison.models.items():
        cells = (number(scored.overall[name].value, 6) for name in SCORES)
        tail = (number(comparison.floor, 6), MISSING, MISSING, MISSING)
        rows.append(("all runs", model, *cells, *tail))
    return Table("Scores", header, tuple(rows))


def _cell(name: str, score: Overall) -> str:
    """A score and its interval with the decimals that suit its kind."""
    if score.value is None:
        return MISSING
    decimals = 1 if name == "fit_percent" else 2
    text = f"{score.value:.{decimals}f}"
    if score.ci95 is None:
        return text
    return f"{text} [{score.ci95[0]:.{decimals}f}, {score.ci95[1]:.{decimals}f}]"


def _notes(comparison: Comparison) -> list[str]:
    """What each score means: its horizon, its start state, and what no model can undercut."""
    starts = [one.start.how for one in next(iter(comparison.models.values())).free]
    rest, dof = sum(how.startswith("from rest") for how in starts), _dof(comparison)
    rules = dict.fromkeys(restarts.rule for restarts in comparison.restarts)
    logged = sum(dof.velocity in run.extras for run in comparison.runs)
    rate = f"the log in {logged} runs, else " if logged else ""
    notes = [
        "Free run (rmse, max, fit): simulated from start to end of a run by its commands alone. "
        + _starts(rest, len(starts), dof),
        f"Restarted {_listed(list(rules))}; {dof.position} and {dof.words.speed} smoothed there, "
        "whose own error even a perfect model shows.",
        f"Measured {dof.words.rate} from {rate}the smoothed {dof.position}."
        if logged < len(starts)
        else f"Measured {dof.words.rate} from the logs.",
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
    """How the runs were started, in one sentence."""
    still = f"start from rest, at the mean {dof.position} of the rest"
    moving = f"with the {dof.position} and {dof.words.speed} that follow their first second best"
    if rest == runs:
        return f"All {still}."
    return f"All start {moving}." if rest == 0 else f"{rest} of {runs} {still}; the others {moving}."


def _listed(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{'; '.join(words[:-1])}; or {words[-1]}"
