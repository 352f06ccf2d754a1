"""What `serve` shows of a campaign that it only looks at, and `collect` of what it fetched."""

from automarine_cli.link.collector import Collected
from automarine_cli.link.document import ID_LETTERS
from automarine_cli.link.vehicles.simulated import Rehearsal
from automarine_cli.report.sections import Sections, sections
from automarine_cli.report.tables import Table
from automarine_cli.text import printable


@sections.register
def _(rehearsal: Rehearsal) -> Sections:
    rows = [
        {"run": run["name"], "begins s": f"{run['begins_s']:.1f}", "driven s": f"{run['driven_s']:.1f}",
         "turns deg": "" if run["turned_deg"] is None else f"{run['turned_deg']:+.0f}",
         "battery left Ah": f"{run['left_Ah']:.3f}"}
        for run in rehearsal.planned
    ]  # fmt: skip
    campaign, battery = rehearsal.campaign, rehearsal.campaign.battery
    minutes = (campaign.begins(len(rows)) - campaign.runs[-1].wait_s) / 60.0
    percent = 100.0 * rehearsal.planned[-1]["left_Ah"] / battery.charge_Ah
    text = f"{len(rows)} runs in {minutes:.1f} min; {percent:.0f} % of the battery is left, "
    return Sections([Table.of("Runs", rows), f"{text}{battery.reserve_percent:g} % must be."])


@sections.register
def _(collected: Collected) -> Sections:
    rows = [
        {"campaign": campaign.id[:ID_LETTERS], "runs": f"{campaign.played} of {campaign.runs}",
         "interrupted": campaign.interrupted,
         "state": printable(campaign.why_stopped or ("over" if campaign.over else "going on")),
         "battery left Ah": f"{campaign.battery_left_Ah:g}"}
        for campaign in collected.state.campaigns
    ]  # fmt: skip
    return Sections([
        *([Table.of("Campaigns", rows)] if rows else []),
        f"{collected.new} logs fetched, {collected.bytes_in} bytes, {collected.cuts} cuts; {len(collected.logs)} are "
        "here.",
        *(f"On the vehicle {printable(trouble)}." for trouble in collected.state.troubles),
        *(() if collected.analysis is None else sections(collected.analysis).every),
        *filter(None, [collected.no_analysis]),
    ], listed=("analysis/",))  # fmt: skip
