"""What `plan` shows and writes: the run sheet, intervals before and after, explanations to separate, and plan.md, the
campaign for the people who will run it."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from automarine_cli.estimate import Estimate
from automarine_cli.planning.campaign import Plan, command_path, specification
from automarine_cli.planning.candidates import PLAN, command_file, in_words
from automarine_cli.report.sections import Content, Drawing, Sections, bullets, document, sections, toml_text
from automarine_cli.report.tables import MISSING, Table, interval, number
from automarine_cli.text import plural

CERTAIN, MAX_PERCENT = 1000.0, 100.0
SHEET = {
    "number": "run", "begins_min": "begin at min", "start_heading_deg": "start heading deg",
    "turn_there_deg": "turn there by deg", "do": "after the rest", "wait_s": "then wait s",
    "battery_left_percent": "battery left %", "why": "what for",
}  # fmt: skip
"""What of plan.csv people have in hand."""
FILES = ("plan.md", "plan.csv", PLAN.file, "plan.toml", "plan.png", "commands/")


@sections.register
def _(plan: Plan) -> Sections:
    unit, rest_s = plan.fitting.model.moment_unit, plan.limits.runs.rest_before_s
    specified, rehearsal = specification(plan)
    if specified:
        rehearsal = f"Rehearse it with `automarine simulate plan.toml -o out/rehearsal`. {rehearsal}".rstrip()
    sheet, intervals = _sheet_table(plan), [_interval_table(plan)] if plan.alone else []
    splits = [_split_table(plan)] if plan.splits else []
    files: dict[str, Content] = {"plan.toml": toml_text(specified)} if specified else {}
    files |= {"plan.md": _page(plan, rehearsal, [sheet, *intervals, *splits]), "plan.csv": _sheet_rows(plan).to_csv()}
    files[PLAN.file] = plan.to_json()
    for slot in plan.slots:
        files[command_path(slot)] = command_file(slot.candidate, rest_s, unit, plan.drive, plan.columns)
    figures = {"plan": Drawing("parameters.plan_figure", plan)} if plan.errors else {}
    return Sections(
        [_totals(plan), *plan.notes, *intervals], files, figures,
        [name for name in FILES if (name != "plan.png" or figures) and (name != "plan.toml" or specified)], plan.runs(),
        details=[sheet, *splits],
    )  # fmt: skip


def _totals(plan: Plan) -> str:
    limits = plan.limits
    kinds = Counter(run.kind for run in plan.candidates)
    counts = ", ".join(plural(count, kind) for kind, count in kinds.items())
    return (
        f"{kinds.total()} runs ({counts}): {plan.minutes[-1]:.1f} of {limits.pool.minutes:g} minutes in the pool. They "
        f"move for {plan.motion:.0f} s and leave {100.0 * plan.slots[-1].left / limits.battery.charge_Ah:.0f} % of the "
        "battery."
    )


def _sheet_rows(plan: Plan) -> Table:
    unit, rest_s = plan.fitting.model.moment_unit, plan.limits.runs.rest_before_s
    full = plan.limits.battery.charge_Ah
    return Table.of("", [
        {
            "number": slot.number, "name": slot.name, "kind": slot.candidate.kind,
            "begins_min": f"{slot.begins / 60.0:.2f}", "start_heading_deg": f"{slot.candidate.start_heading:g}",
            "turn_there_deg": f"{slot.turn_there:.0f}",
            "voltage_V": "" if slot.candidate.voltage is None else f"{slot.candidate.voltage:g}",
            "rest_s": f"{rest_s:g}", "do": in_words(slot.candidate, unit), "drive_s": f"{slot.candidate.driven_s:g}",
            "turns_deg": f"{slot.turns:.0f}", "wait_s": f"{slot.wait:g}", "battery_left_Ah": f"{slot.left:.4f}",
            "battery_left_percent": f"{100.0 * slot.left / full:.1f}", "command_file": command_path(slot),
            "why": slot.why,
        }
        for slot in plan.slots
    ])  # fmt: skip


def _sheet_table(plan: Plan) -> Table:
    rows = _sheet_rows(plan)
    columns = {title: rows.header.index(name) for name, title in SHEET.items()}
    begins = "straight ahead at the run's speed" if plan.fitting.steered else "at rest, thrusters idle"
    note = f"Every log begins with {plan.limits.runs.rest_before_s:g} s {begins}."
    return Table.of("Run sheet", [{title: row[i] for title, i in columns.items()} for row in rows.rows], [note])


def _interval_table(plan: Plan) -> Table:
    columns = {"now": plan.now} | ({"with the earlier runs": plan.together} if plan.together else {})
    columns |= {"new runs alone": plan.alone}
    dof, symbols = plan.fitting.model.dof, plan.fitting.model.dof.symbols
    ratio = {dof.words.inertial_length: f"{symbols.inertia}/{symbols.quadratic}"}
    rows = [
        {"parameter": ratio.get(name, name) + (f" [{alone.unit}]" if alone.unit not in ("", "1") else "")}
        | {column: _precision(estimates.get(name)) for column, estimates in columns.items()}
        for name, alone in plan.alone.items()
    ]
    note = "Value, predicted 95 % interval, and half its width in percent, or that the value may be 0."
    return Table.of("Intervals before and after", rows, [note])


def _precision(estimate: Estimate | None) -> str:
    if estimate is None:
        return MISSING
    low, high = estimate.ci95
    half = 50.0 * (high - low) / (abs(estimate.value) or 1.0)
    words = "may be 0" if low <= 0.0 <= high else f"{number(half, 2)} %" if half <= MAX_PERCENT else "over 100 %"
    return f"{interval(estimate)} ({words})"


def _split_table(plan: Plan) -> Table:
    rows = [
        {"if it is": split.true, "and not": split.other,
         "evidence": f"over {CERTAIN:.0f}" if split.evidence > CERTAIN else f"{split.evidence:.1f}"}
        for split in plan.splits
    ]  # fmt: skip
    return Table.of("Explanations to separate", rows, [
        "Expected difference in evidence (deviance, penalties included) where the first is true; from "
        f"{plan.limits.goal.evidence:g} on the two count as separated, below 10 as tied.",
    ])  # fmt: skip


def _page(plan: Plan, rehearsal: str, tables: Sequence[Table]) -> str:
    pool = plan.limits.pool
    sheet, *further = tables
    expected: list[Table | str] = [
        "The intervals below are those that it should report.", *further,
        "![Precision against minutes in the pool](plan.png)",
    ] if plan.model else []  # fmt: skip
    headings = ", ".join(f"{heading:g}" for heading in pool.start_headings_deg)
    return document(
        f"# The next campaign, planned from {plan.model}" if plan.model else "# The first campaign",
        _totals(plan),
        "## Run sheet",
        f"Before each run bring the vehicle back and let the water settle: {pool.wait_s:g} s, after long turns "
        f"{pool.wait_after_long_turn_s:g} s. Start headings in turn: {headings} degrees; a few degrees do not matter. "
        "Turn there by as much as the sheet says, clockwise where it is positive: so the tether never holds more than "
        "half a turn at the start of a run.",
        replace(sheet, title=""),
        "Play `commands/NAME.csv` for each run, or command it by hand, and log time, heading and command of the whole "
        "run, rest included. Repeat a failed run at once; keep the order, which is random on purpose.",
        "## Expected precision" if plan.model else "## Afterwards",
        f"Fit the runs with\n\n```\n{plan.fit_command}\n```",
        *expected,
        "## Assumptions",
        bullets(_assumptions(plan, rehearsal)),
    )


def _assumptions(plan: Plan, rehearsal: str) -> list[str]:
    fitting = plan.fitting
    effects = ", ".join(term.name for term in fitting.model.terms[len(fitting.base.terms) :])
    gyro = "" if fitting.rate_noise is None else f"and yaw rate noise {np.rad2deg(fitting.rate_noise):.3g} degrees/s "
    if not plan.model:
        return [*plan.notes, plan.source, rehearsal.replace("it", "it on such a vehicle", 1)]
    lines = [
        f"The model{f' with {effects}' if effects else ''} is taken to be right: runs are chosen for what it says, and "
        "a campaign of few kinds shows little of what it lacks. After a surprise, run `automarine diagnose` and plan "
        "again with `--diagnosis`.",
        f"Heading noise {np.rad2deg(fitting.noise):.3g} degrees {gyro}at {fitting.rate:g} Hz, thrust scatter "
        f"{100 * fitting.scatter:.3g} % from run to run; start heading, gain of the run and the instant of every "
        "change are fitted for each run.",
        plan.source,
    ]
    return [*lines, *filter(None, [rehearsal]), *plan.notes]
