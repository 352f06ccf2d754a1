"""`report`: what the steps of a campaign left, as one page and as Markdown."""

from pathlib import Path
from typing import Any

import click

from automarine_cli.commands import options
from automarine_cli.commands.command import argument, command, option
from automarine_cli.errors import OutputError


@command("report", report="campaign", then="open {out}/report.html", saves=False)
@argument("folder", metavar="DIR", type=click.Path(exists=True, file_okay=False, path_type=Path))
@option("--title", help="Heading of the page.  [default: by the models, such as Yaw identification]")
@options.overwrite
@options.as_json
@options.verbosity
def report(folder: Path, title: str | None, overwrite: bool) -> Any:
    """Write report.html and report.md into DIR from the results of a campaign.

    Results are read from the folders check, thrusters, yaw, validation and diagnosis in DIR; a missing one is left
    out. The page is one file that needs no network.

    \b
    Example:
      automarine run sample_runs/pool_day.toml --until fit-yaw -o out/pool_day
      automarine report out/pool_day
    """
    from automarine_cli.pipeline.results_folder import write_whole
    from automarine_cli.report.campaign import REPORT_FILES, RUN_RESULT, make_report

    there = [name for name in REPORT_FILES if (folder / name).exists()]
    if there and not overwrite:
        raise OutputError(f"{folder} already holds {there[0]}; give --overwrite to replace it")
    record = folder / RUN_RESULT.file
    result = make_report(folder, title, RUN_RESULT.read(record, refuse=OutputError) if record.is_file() else None)
    for name, text in result.files.items():
        write_whole(folder / name, text)
    return result
