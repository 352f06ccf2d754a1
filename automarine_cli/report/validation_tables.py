"""The tables of `validate`: every model over all runs, and every run under every model."""

from collections.abc import Sequence

from automarine_cli.comparison.scores import SCORES, Overall, score_key
from automarine_cli.comparison.validation import Ahead, Comparison
from automarine_cli.dofs import Dof
from automarine_cli.report.tables import MISSING, Cell, Table, number

HEADINGS = {
    "rmse": "rmse {shown_unit}",
    "max_abs": "max {shown_unit}",
    "fit_percent": "fit %",
    "restarted_rmse": "restarted rmse {shown_unit}",
    "rate_rmse": "{speed} rmse {shown_unit}/s",
}
DIVERGED = "diverged"


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
