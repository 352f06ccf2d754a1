"""`automarine collect`: an address in, one workflow call, a vehicle's logs out."""

from pathlib import Path
from typing import Any

import click

from automarine_cli.cli import options
from automarine_cli.commands.terminal import end_with


@click.command("collect", short_help="On the surface: send a campaign, fetch logs.")
@click.argument("url", metavar="URL")
@click.option(
    "-o", "--out", type=click.Path(file_okay=False, path_type=Path), metavar="DIR", required=True,
    help="Fetch the logs into this folder.",
)  # fmt: skip
@click.option("--token", default="", metavar="T", help="The token that serve printed.")
@click.option(
    "--campaign", type=click.Path(exists=True, path_type=Path), metavar="FILE",
    help="Hand over the folder of a plan, or its plan.json, and stay until it was played.",
)  # fmt: skip
@click.option("--stop", is_flag=True, help="On contact, first stop what the vehicle plays, for good.")
@click.option(
    "--wait", type=click.FloatRange(min=0), metavar="SECONDS",
    help="Give up after so long without contact.  [default: never]",
)  # fmt: skip
@click.option(
    "--then", type=click.Choice(("run",)),
    help="When the campaigns are over, run the campaign.toml in DIR (made as by init) into DIR/analysis.",
)  # fmt: skip
@click.option("--overwrite", is_flag=True, help="Fetch again what was changed in DIR since it was fetched.")
@options.jobs_option
@options.json_option
@options.verbosity
@click.pass_context
def collect(ctx: click.Context, **given: Any) -> object:
    """Wait for contact with a vehicle that runs `automarine serve` at URL, and fetch its logs into DIR.

    On contact come first the vehicle's state and --stop, then the campaign, then the logs; after a cut it goes on
    where it was. Logs have the same names and the same bytes as on the vehicle; ledger.json holds their SHA-256.
    The exit status is 1 where the campaign ended before its last run.

    \b
    Example:
      automarine collect http://192.168.2.2:8722 --token T --campaign out/plan -o out/pool --then run
    """
    from automarine_cli.workflows.collect import collect as command

    written = f"The logs are in {given['out']}" + (", the analysis is in its folder analysis" if given["then"] else "")
    found = options.perform_one(command, given, f"{written}.")
    if found.analysis is not None:
        end_with(ctx, list(found.analysis.refused))
    if found.ended_early:
        click.echo(f"Error: {found.ended_early}", err=True)
        ctx.exit(1)
    return found
