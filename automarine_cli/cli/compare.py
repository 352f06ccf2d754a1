"""`automarine compare`: folders of results in, one workflow call, tables out."""

from pathlib import Path

import click

from automarine_cli.cli import options
from automarine_cli.cli.echo import Printable


@click.command("compare", short_help="Results side by side: do they differ?")
@click.argument(
    "results", nargs=-1, required=True, metavar="DIR DIR...",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
)  # fmt: skip
@options.out_option
@options.overwrite_option
@options.json_option
@options.verbosity
def compare(results: tuple[Path, ...], out: Path | None, overwrite: bool, as_json: bool) -> object:
    """Put results of fit-thrusters, fit-yaw or diagnose side by side, each against the first: another vehicle,
    another day, another battery. Differences have intervals, and words that say whether they may be chance.

    \b
    Example:
      automarine compare out/fit-yaw out/hidden
    """
    from automarine_cli.workflows import compare as workflow

    result = workflow.compare(results, out=out, overwrite=overwrite)
    tables: list[Printable | str] = [*result.tables(), *result.sentences()]
    options.echo_result(result, as_json=as_json, out=out, tables=tables, files=workflow.FILES)
    return result
