"""`automarine report`: a folder in, one workflow call, where the page is out."""

from pathlib import Path

import click

from automarine_cli.cli import options
from automarine_cli.commands.terminal import echo_result


@click.command("report", short_help="Write one report of a campaign's results.")
@click.argument("folder", metavar="DIR", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--title", show_default="such as Yaw identification", help="Heading of the page.")
@options.overwrite_option
@options.json_option
@options.verbosity
def report(folder: Path, title: str | None, overwrite: bool, as_json: bool) -> object:
    """Write report.html and report.md into DIR from the results in its folders check, thrusters, yaw, validation
    and diagnosis; what is not there is left out. The page is one file that needs no network.

    \b
    Example:
      automarine report out/pool_day
    """
    from automarine_cli.workflows import report as workflow

    result = workflow.report(folder, title=title, overwrite=overwrite)
    echo_result(result, as_json=as_json, out=folder, files=workflow.FILES)
    return result
