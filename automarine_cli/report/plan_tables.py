"""The tables of a plan: the run sheet, intervals before and after, explanations to split, one run more of each kind."""

import csv
import io
from collections.abc import Sequence

from automarine_cli.dofs import Dof
from automarine_cli.planning.campaign import Campaign
from automarine_cli.planning.rivals import Split
from automarine_cli.planning.vehicle import in_words
from automarine_cli.report.tables import MISSING, Table, interval, number
from automarine_cli.results.estimate import Estimate

SHEET = (
    "number", "name", "kind", "begins_min", "start_heading_deg", "turn_there_deg", "voltage_V", "rest_s", "do",
    "drive_s", "turns_deg", "wait_s", "battery_left_Ah", "battery_left_percent", "command_file", "why",
)  # fmt: skip
CERTAIN = 1000.0


def in_print(name: str, dof: Dof) -> str:
    """A parameter as tables have it."""
    own = dof.symbols
    others = {own.quadratic: own.quadratic_print, dof.words.inertial_length: f"{own.inertia}/{own.quadratic_print}"}
    return others.get(name, name)


def command_name(name: str) -> str:
    """Where a run's command file is, from the plan's folder."""
    return f"commands/{name}.csv"


def sheet_csv(campaign: Campaign) -> str:
    """The run sheet for programs and spreadsheets, one row a run."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(SHEET)
    unit, rest = campaign.fitting.model.moment_unit, campaign.limits.runs.rest_before_s
    full = campaign.limits.battery.charge_Ah
    for slot, why, back, turned in zip(campaign.slots, campaign.why, campaign.ways_back, campaign.turns):
        one = slot.candidate
        writer.writerow((
            slot.number, slot.name, one.kind, f"{slot.begins / 60.0:.2f}", f"{one.start_heading:g}", f"{back:.0f}",
            "" if one.voltage is None else f"{one.voltage:g}", f"{rest:g}", in_words(one, unit), f"{one.driven:g}",
            f"{turned:.0f}", f"{slot.wait:g}", f"{slot.left:.4f}", f"{100.0 * slot.left / full:.1f}",
            command_name(slot.name), why,
        ))  # fmt: skip
    return text.getvalue()


def sheet_table(campaign: Campaign) -> Table:
    """The run sheet for people."""
    unit, full = campaign.fitting.model.moment_unit, campaign.limits.battery.charge_Ah
    rows = [
        (
            str(slot.number), _clock(slot.begins), f"{slot.candidate.start_heading:g}", f"{back:+.0f}",
            in_words(slot.candidate, unit), f"{slot.wait:g}", f"{100.0 * slot.left / full:.0f}", why,
        )
        for slot, why, back in zip(campaign.slots, campaign.why, campaign.ways_back)
    ]  # fmt: skip
    header = (
        "run",
        "begin at min:s",
        "start heading deg",
        "turn there by deg",
        "after the rest",
        "then wait s",
        "battery left %",
        "what for",
    )
    rest = f"{campaign.limits.runs.rest_before_s:g} s"
    return Table("Run sheet", header, tuple(rows), notes=(f"Every log begins with {rest} at rest, thrusters idle.",))


def interval_table(campaign: Campaign) -> Table:
    """Parameters down; now, after the new runs alone, and together with the earlier ones across."""
    columns = {"now": campaign.now, "new runs alone": campaign.alone}
    if campaign.together:
        columns["with the earlier runs"] = campaign.together
    rows = [
        (_label(name, one, campaign.fitting.model.dof), *(_precision(found.get(name)) for found in columns.values()))
        for name, one in campaign.alone.items()
    ]
    notes = ("Value, predicted 95 % interval, and half its width in percent.",)
    return Table("Intervals before and after", ("parameter", *columns), tuple(rows), notes=notes)


def split_table(campaign: Campaign) -> Table:
    """Pairs of explanations down; expected evidence of the plan and of the paper's grid across."""
    rows = [
        (one.true, one.other, _evidence(one), _evidence(grid))
        for one, grid in zip(campaign.splits, campaign.grid_splits)
    ]
    enough = campaign.limits.goal.evidence
    note = (
        f"Expected difference in evidence (deviance, penalties included) where the first is true; from {enough:g} "
        "on the two "
        "count as separated, below 10 as tied."
    )
    header = ("if it is", "and not", "this plan", "the paper's grid")
    return Table("Explanations to separate", header, tuple(rows), notes=(note,))


def compared_table(campaign: Campaign) -> Table:
    """The plan, the paper's grid and one run more of each kind: minutes, motion, standard errors in percent."""
    names, dof = list(campaign.plan.percent), campaign.fitting.model.dof
    rows = [
        (
            label, number(curve.minutes[-1], 3), number(curve.motion[-1], 3),
            *(number(curve.percent[name][-1], 2) for name in names),
        )
        for label, curve in (
            ("this plan", campaign.plan), ("the paper's grid", campaign.grid),
            *((f"this plan and one {curve.name}", curve) for curve in campaign.more),
        )
    ]  # fmt: skip
    header = ("campaign", "min in the pool", "s of motion", *(f"{in_print(name, dof)} %" for name in names))
    earlier = " The earlier runs are counted in." if campaign.together else ""
    return Table("Standard errors to expect", header, tuple(rows), (2,), notes=(f"In percent of the value.{earlier}",))


def tables(campaign: Campaign) -> list[Table]:
    """What the terminal shows."""
    split = [split_table(campaign)] if campaign.splits else []
    return [sheet_table(campaign), interval_table(campaign), *split, compared_table(campaign)]


def _evidence(one: Split) -> str:
    return f"over {CERTAIN:.0f}" if one.evidence > CERTAIN else f"{one.evidence:.1f}"


def _label(name: str, one: Estimate, dof: Dof) -> str:
    shown = in_print(name, dof)
    return shown if one.unit in ("", "1") else f"{shown} [{one.unit}]"


def _precision(one: Estimate | None) -> str:
    if one is None:
        return MISSING
    low, high = one.ci95
    half = 50.0 * (high - low) / abs(one.value) if one.value else float("nan")
    return f"{interval(one)} ({number(half, 2)} %)"


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes}:{rest:02d}"


def total_sentences(campaign: Campaign) -> Sequence[str]:
    """How much there is, and what of the limits it takes."""
    slots, limits = campaign.slots, campaign.limits
    rest = limits.runs.rest_before_s
    left = slots[-1].left / limits.battery.charge_Ah
    kinds: dict[str, int] = {}
    for one in campaign.candidates:
        kinds[one.kind] = kinds.get(one.kind, 0) + 1
    told = ", ".join(f"{count} {kind}{'s' * (count > 1)}" for kind, count in kinds.items())
    return (
        f"{len(slots)} runs ({told}): {slots[-1].ends(rest) / 60.0:.1f} of {limits.pool.minutes:g} minutes in the "
        "pool, "
        f"{campaign.motion:.0f} s of motion, {100.0 * left:.0f} % of the battery left.",
    )
