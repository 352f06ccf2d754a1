"""The tables of `validate`: every model over all runs, and every run under every model."""

from collections.abc import Sequence

from automarine_cli.comparison.scores import SCORES, Overall
from automarine_cli.comparison.validation import Comparison
from automarine_cli.dofs import Dof
from automarine_cli.report.tables import MISSING, Cell, Table, number

HEADINGS = {
    "rmse_deg": "rmse deg",
    "max_abs_deg": "max deg",
    "fit_percent": "fit %",
    "restarted_rmse_deg": "restarted rmse deg",
    "rate_rmse_deg_s": "rate rmse deg/s",
}
DIVERGED = "runs away"


def overall_table(comparison: Comparison) -> Table:
    """Models down, scores across, each with its 95 % interval over runs."""
    rows = []
    for model, scored in comparison.models.items():
        if scored.diverged:
            rows.append((model, DIVERGED, *(MISSING for _ in SCORES[1:])))
        else:
            rows.append((model, *(_cell(name, scored.overall[name]) for name in SCORES)))
    header = ("model", *(HEADINGS[name] for name in SCORES))
    count = len(comparison.runs)
    title = f"Validation over {count} run{'s' * (count != 1)}"
    notes = (comparison.because, *_notes(comparison))
    return Table(title, header, tuple(rows), notes=notes)


def _axis(comparison: Comparison) -> Dof:
    return comparison.runs[0].dof


def run_table(comparison: Comparison) -> Table:
    """One line for each run: noise floor, then free-run and restarted heading rmse of each model."""
    numbers = tuple(comparison.models)
    header = (
        "run",
        "s",
        "noise deg",
        *(f"model {n}" for n in numbers),
        *(f"{n} restarted" for n in numbers),
        "horizon s",
        "start",
    )
    rows = []
    for i, run in enumerate(comparison.runs):
        scores = [comparison.models[n].scores[i] for n in numbers]
        free = [DIVERGED if one.diverged else number(one.value("rmse_deg"), 3) for one in scores]
        again = [number(one.value("restarted_rmse_deg"), 3) for one in scores]
        start = scores[0].start.how.split(":")[0]
        length = number(float(run.time[-1] - run.time[0]), 3)
        floor, horizon = number(comparison.floors[i], 2), number(comparison.restarts[i].horizon, 3)
        rows.append((run.name, length, floor, *free, *again, horizon, start))
    title = "Heading error of each run: rmse in degrees, free run and restarted"
    return Table(title, header, tuple(rows))


def score_table(comparison: Comparison) -> Table:
    """Everything, one line for each run and model and one for each model over all runs: for programs."""
    header = ("run", "model", *SCORES, "noise_floor_deg", "restarted_horizon_s", "restarted_at", "start")
    rows: list[tuple[Cell, ...]] = []
    for i, run in enumerate(comparison.runs):
        restarts = comparison.restarts[i]
        for model, scored in comparison.models.items():
            one = scored.scores[i]
            cells = (number(one.value(name), 6) for name in SCORES)
            tail = (
                number(comparison.floors[i], 6),
                number(restarts.horizon, 6),
                restarts.rule,
                one.start.how,
            )
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
    rest = sum(how.startswith("from rest") for how in starts)
    rules = dict.fromkeys(restarts.rule for restarts in comparison.restarts)
    logged = sum(run.dof.velocity in run.extras for run in comparison.runs)
    rate = f"the log in {logged} runs, else " if logged else ""
    notes = [
        "Free run (rmse, max, fit): simulated from start to end of a run by its commands alone. "
        + _starts(rest, len(starts)),
        f"Restarted {_listed(list(rules))}; heading and rate smoothed there, "
        "whose own error even a perfect model shows.",
        f"Measured yaw rate from {rate}the smoothed heading."
        if logged < len(starts)
        else "Measured yaw rate from the logs.",
        f"Noise floor of the heading, measured apart from any model: {number(comparison.floor, 3)} deg.",
    ]
    if comparison.afresh:
        begins = "begin" if len(comparison.afresh) > 1 else "begins"
        notes.insert(
            2,
            f"At a restart {' and '.join(comparison.afresh)} {begins} anew, which in the water nothing does: "
            "judge by the free run.",
        )
    if len(comparison.runs) >= 3:
        notes.append("In brackets: 95 % intervals, runs resampled.")
    return notes


def _starts(rest: int, runs: int) -> str:
    """How the runs were started, in one sentence."""
    still = "start from rest, at the mean heading of the rest"
    moving = "with the heading and rate that follow their first second best"
    if rest == runs:
        return f"All {still}."
    return f"All start {moving}." if rest == 0 else f"{rest} of {runs} {still}; the others {moving}."


def _listed(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{'; '.join(words[:-1])}; or {words[-1]}"
