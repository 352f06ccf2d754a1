"""`make real`: every real and foreign data set at hand, halves exchanged. Prints Markdown; writes real.md, real.json.

A model is fitted to one half of the runs and predicts the other: from a state every second on, told from the second
before, the position 2, 5 and 15 s ahead, and each run freely from its start. Beside it stand what least squares of the
same structure, fitted to each of these horizons (real_baseline.py), a constant rate and a constant position miss by.
Sets that were measured are diagnosed too: what is named.

Usage: python tests/benchmarks/real.py [--out DIR] [--only TEXT] [--quick] [--jobs N] [--before FILE]
"""

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy

import argparse
import json
import math
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import real_baseline as plain
import real_library as library
import real_planar
from click.testing import CliRunner
from real_sets import CONTACTS, Contact, RealSet, present

from automarine_cli.commands import automarine
from automarine_cli.errors import AutomarineError
from automarine_cli.report.tables import MISSING, Table
from automarine_cli.runs.run import Run

SCHEMA = "automarine/real/1"
ALLOWED = 1.05
"""Of what least squares of the same structure misses by, at most."""
AT = plain.HORIZONS.index(5.0)
Row = dict[str, Any]


def judged(item: tuple[RealSet, str, str, bool]) -> Row:
    """The row of one half that is fitted: of a set, a motion, which half, and whether without a diagnosis."""
    one, motion, name, quick = item
    with tempfile.TemporaryDirectory() as scratch, np.errstate(over="ignore", invalid="ignore"):
        runs, aside = one.load(motion, Path(scratch))
        halves = one.halved(runs)
        fitted, kept = halves if name == "A" else halves[::-1]
        begun = time.perf_counter()
        row: Row = {
            "set": one.name, "motion": motion, "measured": one.measured, "fitted": name,
            "unit": runs[0].dof.units.shown,
            "runs": [run.name for run in fitted], "left_out": [run.name for run in kept],
            "set_aside": [f"{each.run}: {each.why}" for each in aside], **references(one, fitted, kept),
        }  # fmt: skip
        try:
            fits = library.tool_fits(fitted)
            models = {number: scored(fits.models[number], kept) for number in one.numbers if number in fits.models}
            row |= {"models": models, "preferred": fits.preferred, "refused": None}
            judge = one.measured and not quick  # of who simulated a vehicle nobody here knows what is missing
            row["named"] = named(fits.models[fits.preferred], fitted, kept) if judge else None
        except AutomarineError as refusal:
            row |= {"models": {}, "preferred": None, "refused": str(refusal), "named": None}
        row["seconds"] = round(time.perf_counter() - begun, 1)
        print(f"{one.name}, {motion}, half {name}: {row['seconds']} s", file=sys.stderr, flush=True)
        return row


def references(one: RealSet, fitted: Sequence[Run], kept: Sequence[Run]) -> Row:
    """What the plain predictions miss by on the half kept, at each horizon [shown unit]."""
    dof = kept[0].dof
    learned, tried = plain.anchors_of(fitted), plain.anchors_of(kept)
    squares = {}
    for number in one.numbers:
        found = [plain.fit_plain(learned, number, h, dof.has_constant) for h in plain.HORIZONS]
        errors = [plain.by_horizon(tried.errors_of(p.ahead(tried)))[i] for i, p in enumerate(found)]
        parameters = [(p.inertia, p.linear, p.quadratic, p.constant) for p in found]
        squares[number] = {"rmse": shown(dof, errors), "parameters": parameters}
    return {
        "least_squares": squares,
        "constant_rate": shown(dof, plain.by_horizon(tried.errors_of(plain.constant_rate(tried)))),
        "constant_position": shown(dof, plain.by_horizon(tried.errors_of(plain.constant_position(tried)))),
        "anchors": len(tried.run),
    }


def shown(dof: Any, values: Sequence[float]) -> list[float]:
    """Errors in the unit that people see."""
    return [round(float(dof.shown(value)), 4) for value in values]


def scored(fitted: library.Fitted, kept: Sequence[Run]) -> Row:
    """What a fitted model misses by on the half kept."""
    dof, anchors = kept[0].dof, plain.anchors_of(kept)
    errors = anchors.errors_of(library.tool_predictions(fitted, kept, anchors))
    return {
        "parameters": dict(zip(fitted.model.parameter_names, fitted.model.theta.tolist())),
        "rmse": shown(dof, plain.by_horizon(errors)),
        "free_run": shown(dof, [library.tool_free_run(fitted, kept)])[0],
        "log_likelihood": library.tool_log_likelihood(fitted, kept),
    }


def named(fitted: library.Fitted, runs: Sequence[Run], kept: Sequence[Run]) -> str:
    """What is named on one half, or the refusal."""
    try:
        return library.tool_diagnosis(fitted, runs, kept)
    except AutomarineError as refusal:
        return f"refused: {refusal}"


def met(contact: Contact) -> Row:
    """What a command says of a log that is looked at only, or to be refused."""
    found = CliRunner().invoke(automarine, [*contact.arguments[:-1], str(contact.log)])
    said = (found.stderr.strip().splitlines() or found.stdout.strip().splitlines() or [""])[-1]
    as_wanted = found.exit_code == contact.status and contact.said in found.stderr + found.stdout
    return {
        "log": contact.name, "command": contact.arguments[0], "status": found.exit_code, "says": said,
        "as_wanted": as_wanted,
    }  # fmt: skip


def main_table(rows: Sequence[Row], before: Sequence[Row]) -> Table:
    """One line a half: the preferred model and what it has to beat."""
    earlier = {_key(row): row for row in before}
    lines = []
    for row in rows:
        number, unit = row["preferred"], row["unit"]
        own, squares = row["models"].get(number), row["least_squares"]
        number = number or "3"
        same = squares[number]["rmse"]
        old = earlier.get(_key(row), {})
        old_own = old.get("models", {}).get(old.get("preferred"))
        lines.append((
            row["set"], row["motion"], f"{row['fitted']} ({len(row['runs'])})", number, unit,
            _three(old_own["rmse"]) if old_own else MISSING,
            _three(own["rmse"]) if own else "refused",
            _three(same), _three(row["constant_rate"]), _three(row["constant_position"]),
            _digits(own["free_run"]) if own else MISSING,
            f"{own['rmse'][AT] / same[AT]:.2f}" if own else MISSING,
            use_of(own["rmse"][AT], row, same[AT]) if own else "refused",
            row["named"] or MISSING,
        ))  # fmt: skip
    header = (
        "data set", "motion", "fitted half (runs)", "model", "unit", "before", "now", "least squares",
        "constant rate", "constant position", "free run", "5 s: now / least squares", "5 s", "named",
    )  # fmt: skip
    note = "Errors 2 / 5 / 15 s ahead, rms over the half that was not fitted."
    return Table("Prediction of held-out halves", header, tuple(lines), notes=(note,))


def use_of(error: float, row: Row, same: float) -> str:
    """One word on a model at 5 s."""
    if not error < min(row["constant_rate"][AT], row["constant_position"][AT]):
        return "no better than constant"
    return "no worse than least squares" if error <= ALLOWED * same else "better than constant"


def models_table(rows: Sequence[Row]) -> Table:
    """Every model tried, 5 s ahead, with what least squares of its structure misses by."""
    lines = []
    for row in rows:
        for number, squares in row["least_squares"].items():
            own = row["models"].get(number)
            values = own["parameters"].items() if own else ()
            lines.append((
                row["set"], row["motion"], row["fitted"], number,
                _three(own["rmse"]) if own else "refused", _three(squares["rmse"]),
                ", ".join(f"{name.partition('.')[2]} {value:.4g}" for name, value in values) or MISSING,
                ", ".join(f"{value:.4g}" for value in squares["parameters"][AT]),
            ))  # fmt: skip
    header = ("data set", "motion", "half", "model", "library", "least squares", "library's values",
              "least squares, 5 s: inertia, linear, quadratic, constant")  # fmt: skip
    return Table("Models", header, tuple(lines))


def contact_table(found: Sequence[Row]) -> Table:
    """Logs that are looked at only, or refused."""
    rows = tuple(
        (one["log"], one["command"], str(one["status"]), "yes" if one["as_wanted"] else "NO", one["says"])
        for one in found
    )
    return Table("First contact and refusals", ("log", "command", "status", "as wanted", "says"), rows)


def kept(out: Path, rows: Sequence[Row], before: Sequence[Row], contacts: Sequence[Row]) -> str:
    """The tables of what is there so far, after writing real.md and real.json: some sets take minutes."""
    tables = [main_table(rows, before), models_table(rows), contact_table(contacts)]
    text = "\n".join(table.to_markdown() for table in tables if table.rows)
    (out / "real.md").write_text(text)
    content = {"schema": SCHEMA, "horizons_s": plain.HORIZONS, "rows": rows, "contacts": contacts}
    (out / "real.json").write_text(json.dumps(content, indent=1) + "\n")
    return text


def _key(row: Row) -> tuple[str, ...]:
    return row["set"], row["motion"], row["fitted"]


def _three(values: Sequence[float]) -> str:
    return " / ".join(_digits(value) for value in values)


def _digits(value: float) -> str:
    return f"{value:.3g}" if math.isfinite(value) and abs(value) < 1e4 else f"{value:.1e}"


def main() -> None:
    """All that is at hand, then the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("out"), help="folder of real.md and real.json (default: out)")
    parser.add_argument("--only", default="", help="only what has this in SET/MOTION, as lake/yaw")
    parser.add_argument("--quick", action="store_true", help="no diagnoses of measured sets either")
    parser.add_argument("--jobs", type=int, default=1, help="halves at a time (default: 1)")
    parser.add_argument("--before", type=Path, help="a real.json of an earlier version, for its column in the table")
    options = parser.parse_args()
    before = json.loads(options.before.read_text())["rows"] if options.before else []
    contacts = [met(one) for one in CONTACTS if one.log.exists() and options.only in one.name]
    options.out.mkdir(parents=True, exist_ok=True)
    rows: list[Row] = []
    text = kept(options.out, rows, before, contacts) if contacts else ""
    items = [(one, motion, half, options.quick) for one, motion in present(options.only) for half in "AB"]
    with ProcessPoolExecutor(options.jobs) if options.jobs > 1 else nullcontext() as pool:
        every = pool.map if pool else map
        planes = every(real_planar.judged, real_planar.planar_items(options.only))  # the dearest first: nobody waits
        singles = every(judged, items[::-1])  # of one motion these stand last
        for row in singles:
            rows.insert(0, row)
            text = kept(options.out, rows, before, contacts)
        planar = list(planes)
    if planar:
        text += "\n" + real_planar.table(planar).to_markdown()
        (options.out / "real.md").write_text(text)
        (options.out / "real_planar.json").write_text(json.dumps(planar, indent=1) + "\n")
    if not text:
        which = f" with {options.only!r} in its name" if options.only else ""
        raise SystemExit(f"no data set{which} is at hand; AUTOMARINE_DATA names the folder that has them")
    print(text)


if __name__ == "__main__":
    main()
