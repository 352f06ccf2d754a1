"""`make real`: every real and foreign data set at hand, halves exchanged. Prints Markdown; writes real.md, real.json.

A model is fitted to one half of the runs and predicts the other: from a state every second on, as the second before
shows it, the position 2, 5 and 15 s ahead, and each run freely from its start. Beside it stand what least squares of
the same structure, fitted to each of these horizons (real_baseline.py), a constant rate and a constant position miss
by. Sets that were measured are diagnosed too: what is named. forecasts.json holds the errors of the preferred models:
`make pictures` draws its copy in tests/benchmarks. --only takes what has this text in SET/MOTION, as lake/yaw or
enterprise/planar.

Usage: python tests/benchmarks/real.py [--out DIR] [--only TEXT] [--jobs N]
"""

import math
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import arguments
import numpy as np
import real_baseline as plain
import real_library as library
import real_planar
from real_sets import RealSet, present

from automarine_cli.errors import AutomarineError
from automarine_cli.report.tables import Table
from automarine_cli.runs.run import Run

ALLOWED = 1.05
"""Of what least squares of the same structure misses by, at most."""
AT = plain.HORIZONS.index(5.0)
Row = dict[str, Any]


def judged(item: tuple[RealSet, str, str]) -> Row:
    """The row of one half that is fitted: of a set, a motion, which half."""
    real_set, motion, half = item
    with tempfile.TemporaryDirectory() as scratch, np.errstate(over="ignore", invalid="ignore"):
        runs, aside = real_set.load(motion, Path(scratch))
        fitted, held_out = real_set.halved(runs)[:: 1 if half == "A" else -1]
        begun = time.perf_counter()
        row: Row = {
            "set": real_set.name, "motion": motion, "measured": real_set.measured, "fitted": half,
            "unit": runs[0].dof.units.shown,
            "runs": [run.name for run in fitted], "left_out": [run.name for run in held_out],
            "set_aside": [f"{each.run}: {each.why}" for each in aside],
            "models": {}, "preferred": None, "scatter": None, "refused": None, "named": None,
            **references(real_set, fitted, held_out),
        }  # fmt: skip
        try:
            models, preferred = library.tool_fits(fitted)
            row["models"] = {
                number: scored(models[number], held_out) for number in real_set.numbers if number in models
            }
            row["preferred"] = preferred
            row["scatter"] = scatter_of_ratio(models[preferred], preferred, fitted, held_out)
            if real_set.measured:  # of who simulated a vehicle nobody here knows what is missing
                row["named"] = library.tool_diagnosis(models[preferred], fitted, held_out)
        except AutomarineError as refusal:
            row["refused"] = str(refusal)
        row["seconds"] = round(time.perf_counter() - begun, 1)
        print(f"{real_set.name}, {motion}, half {half}: {row['seconds']} s", file=sys.stderr, flush=True)
        return row


def references(real_set: RealSet, fitted: Sequence[Run], held_out: Sequence[Run]) -> Row:
    """What the plain predictions miss by on the half held out, at each horizon [shown unit]."""
    dof = held_out[0].dof
    learned, tried = plain.anchors_of(fitted), plain.anchors_of(held_out)

    def rmse(predicted: plain.Floats) -> list[float]:
        return plain.by_horizon(predicted - tried.reached)

    squares = {}
    for number in real_set.numbers:
        fits = [plain.fit_plain(learned, number, h, dof.has_constant) for h in plain.HORIZONS]
        errors = [rmse(fit.ahead(tried))[i] for i, fit in enumerate(fits)]
        parameters = [(fit.inertia, fit.linear, fit.quadratic, fit.constant) for fit in fits]
        squares[number] = {"rmse": shown(dof, errors), "parameters": parameters}
    still = np.repeat(tried.position[:, None], len(plain.HORIZONS), axis=1)
    return {
        "least_squares": squares,
        "constant_rate": shown(dof, rmse(still + tried.rate[:, None] * np.array(plain.HORIZONS))),
        "constant_position": shown(dof, rmse(still)),
        "anchors": len(tried.run),
    }


def shown(dof: Any, values: Sequence[float]) -> list[float]:
    """Errors in the unit that people see."""
    return [round(float(dof.shown(value)), 4) for value in values]


def scored(fitted: library.Fitted, held_out: Sequence[Run]) -> Row:
    """What a fitted model misses by on the half held out."""
    dof, anchors = held_out[0].dof, plain.anchors_of(held_out)
    errors = library.tool_predictions(fitted, held_out, anchors) - anchors.reached
    return {
        "parameters": dict(zip(fitted.model.parameter_names, fitted.model.theta.tolist())),
        "rmse": shown(dof, plain.by_horizon(errors)),
        "free_run": shown(dof, [library.tool_free_run(fitted, held_out)])[0],
    }


def scatter_of_ratio(fitted: library.Fitted, number: str, runs: Sequence[Run], held_out: Sequence[Run]) -> float:
    """Jackknife standard error over runs held out of the logarithm of the model's error 5 s ahead over that of least
    squares; infinite for one run."""
    anchors = plain.anchors_of(held_out)
    squares = plain.fit_plain(plain.anchors_of(runs), number, 5.0, held_out[0].dof.has_constant)
    both = (library.tool_predictions(fitted, held_out, anchors), squares.ahead(anchors))
    misses = [np.where(np.isfinite(x := (ahead - anchors.reached)[:, AT]), x, 0.0) ** 2 for ahead in both]
    ours, theirs = (np.bincount(anchors.run, x, len(held_out)) for x in misses)
    logs = 0.5 * np.log((ours.sum() - ours) / (theirs.sum() - theirs))
    count = len(logs)
    return float(np.sqrt((count - 1) * np.var(logs))) if count > 1 else math.inf


def main_table(rows: Sequence[Row]) -> Table:
    """One line a half: the preferred model and what it has to beat."""
    lines = []
    for row in rows:
        model = row["models"].get(row["preferred"])
        number = row["preferred"] or "3"
        same = row["least_squares"][number]["rmse"]
        lines.append({
            "data set": row["set"], "motion": row["motion"],
            "fitted half (runs)": f"{row['fitted']} ({len(row['runs'])})",
            "model": number, "unit": row["unit"],
            "now": _three(model["rmse"]) if model else "refused",
            "least squares": _three(same), "constant rate": _three(row["constant_rate"]),
            "constant position": _three(row["constant_position"]),
            "free run": _digits(model["free_run"]) if model else None,
            "5 s: now / least squares": f"{model['rmse'][AT] / same[AT]:.2f}" if model else None,
            "± (its logarithm)": None if row["scatter"] is None else f"{row['scatter']:.2f}",
            "5 s": use_of(model["rmse"][AT], row, same[AT]) if model else "refused",
            "named": row["named"],
        })  # fmt: skip
    note = "Errors 2 / 5 / 15 s ahead, rms over the half that was not fitted."
    return Table.of("Prediction of held-out halves", lines, [note])


def use_of(error: float, row: Row, same: float) -> str:
    """One word on a model at 5 s."""
    if not error < min(row["constant_rate"][AT], row["constant_position"][AT]):
        return "no better than constant"
    return "no worse than least squares" if error <= ALLOWED * same else "better than constant"


def write(out: Path, rows: Sequence[Row], planar: Sequence[Row]) -> str:
    """The tables of what is there so far, after writing real.md and real.json: some sets take minutes."""
    tables = [main_table(rows), real_planar.table(planar)]
    text = "\n".join(table.to_markdown() for table in tables if table.rows)
    content = {"schema": "automarine/real/1", "horizons_s": plain.HORIZONS, "rows": rows}
    arguments.write_json(out / "real.json", content)
    arguments.write_json(out / "forecasts.json", [forecasts(row) for row in rows if row["preferred"]])
    if planar:
        arguments.write_json(out / "real_planar.json", planar)
    (out / "real.md").write_text(text)
    return text


def forecasts(row: Row) -> Row:
    """What the preferred model and the plain predictions miss by at each horizon, to three digits."""
    number = row["preferred"]
    errors = {"tool": row["models"][number]["rmse"], "least_squares": row["least_squares"][number]["rmse"]}
    errors |= {plain: row[plain] for plain in ("constant_rate", "constant_position")}
    rounded = {of: [float(f"{x:.3g}") if math.isfinite(x) else None for x in each] for of, each in errors.items()}
    return {name: row[name] for name in ("set", "motion", "fitted", "unit")} | rounded


def _three(values: Sequence[float]) -> str:
    return " / ".join(_digits(value) for value in values)


def _digits(value: float) -> str:
    return f"{value:.3g}" if math.isfinite(value) and abs(value) < 1e4 else f"{value:.1e}"


def main() -> None:
    """All that is at hand, then the tables."""
    chosen = arguments.options(__doc__, out=Path("out"), only="", jobs=1)
    items = [(each, motion, half) for each, motion in present(chosen.only) for half in "AB"]
    planes = real_planar.planar_items(chosen.only)
    if not (items or planes):
        sys.exit(f"no data set with {chosen.only!r} in its name is at hand; AUTOMARINE_DATA names their folder")
    rows: list[Row] = []
    with ProcessPoolExecutor(chosen.jobs) if chosen.jobs > 1 else nullcontext() as pool:
        every = pool.map if pool else map
        planar = every(real_planar.judged, planes)  # the dearest first: nobody waits
        for row in every(judged, items[::-1]):  # of one motion these stand last
            rows.insert(0, row)
            write(chosen.out, rows, [])
        print(write(chosen.out, rows, list(planar)))


if __name__ == "__main__":
    main()
