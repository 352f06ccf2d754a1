"""`automarine run`: campaigns in, one workflow call, what was done out."""

from pathlib import Path
from typing import Any

import click

from automarine_cli.cli import options
from automarine_cli.cli.echo import CampaignTeller, end_with


def _steps() -> tuple[str, ...]:
    from automarine_cli.workflows.campaign_steps import NAMES

    return NAMES


@click.command("run", short_help="Run every step of a campaign and report.")
@click.argument(
    "campaigns", nargs=-1, required=True, metavar="CAMPAIGN.toml...",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
)  # fmt: skip
@click.option(
    "--until", type=options.OneOf(_steps), metavar="STEP",
    help="Stop after this step, by its name in the table of results, such as fit-yaw.",
)  # fmt: skip
@click.option("--force", is_flag=True, help="Run every step, also where nothing has changed.")
@options.ending("jobs", "cluster")
@click.pass_context
def run(ctx: click.Context, **given: Any) -> object:
    """Run every step of a campaign file: check, fit-thrusters, fit-yaw, validate, diagnose, report; with a section
    [surge], [sway] or [heave] its fit, validation and diagnosis too.

    Each step has a folder of its own in DIR, by default "results" beside the campaign file. A step is kept if its
    result is there and its inputs, settings and versions have not changed; for every other the reason is printed.
    `automarine init` writes a campaign file.

    Several campaigns, a fleet or a season, have a folder each in DIR and an overview of all; --jobs N does so many at
    a time, --cluster ADDRESS sends them to a Dask scheduler whose workers share a disk with this machine. One that
    fails does not stop the others.

    \b
    Example:
      automarine run sample_runs/pool_day.toml --until fit-yaw -o out/pool_day
    """
    campaigns = given["campaigns"]
    if len(campaigns) > 1 or given["cluster"]:
        if given["out"] is None:
            raise click.UsageError("several campaigns need a folder for their results; give one with -o DIR")
        from automarine_cli.workflows.campaigns import run_campaigns

        overview = options.perform(run_campaigns, given, lambda made: made.warnings)
        end_with(ctx, [f"{one.name}: {why}" for one in overview.refused for why in one.refused])
        return overview
    from automarine_cli.workflows.run import RESULTS, run_campaign

    teller = CampaignTeller()
    campaign = given.pop("campaigns")[0]
    given |= {"campaign": campaign, "progress": teller.progress, "tell": teller.tell}
    given["out"] = given["out"] or campaign.parent / RESULTS
    result = options.perform(run_campaign, given, lambda made: made.warnings)
    end_with(ctx, [f"{one.step}: {one.why}" for one in result.refused])
    return result
