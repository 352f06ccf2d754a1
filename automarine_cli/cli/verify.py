"""`automarine verify`: folders of results in, one workflow call, what changed out."""

from pathlib import Path

import click

from automarine_cli.cli import options
from automarine_cli.commands.terminal import echo_result


@click.command("verify", short_help="Check that results are unchanged.")
@click.argument(
    "folders", nargs=-1, required=True, metavar="DIR...",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
)  # fmt: skip
@click.option(
    "--inputs", multiple=True, type=click.Path(exists=True, path_type=Path), metavar="FOLDER",
    help="Look for the recorded inputs in this folder and below; may be repeated.",
)  # fmt: skip
@options.json_option
@options.verbosity
@click.pass_context
def verify(ctx: click.Context, folders: tuple[Path, ...], inputs: tuple[Path, ...], as_json: bool) -> object:
    """Recompute the hashes that each manifest.json in DIR recorded, and say what changed.

    It names results that changed, are missing or were added, and inputs that changed since they were read.
    Inputs are looked for by name in the folders given with --inputs, where all of them must be; without --inputs
    here and beside DIR, and those not found are only counted. Exit status 0 if nothing changed, else 1.

    \b
    Example:
      automarine verify out/fit-yaw
    """
    from automarine_cli.workflows import verify as workflow

    result = workflow.verify(folders, inputs=inputs)
    sentences = [folder.sentence() for folder in result.folders]
    echo_result(result, as_json=as_json, tables=sentences, keep_hint=None)
    for folder in result.folders:
        for line in folder.changes():
            click.echo(line, err=True)
    if not result.whole:
        ctx.exit(1)
    return result
