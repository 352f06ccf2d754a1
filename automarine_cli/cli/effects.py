"""`automarine effects`: a name or none in, one workflow call, cards out."""

from pathlib import Path

import click

from automarine_cli.cli import options
from automarine_cli.cli.echo import echo_result


@click.command("effects", short_help="List the library of effects, or show one.")
@click.argument("name", required=False, metavar="[NAME]")
@click.option(
    "--motion", metavar="NAME",
    help="Only what may act in this motion (surge, say), in its words, letters and units.  [default: all, of yaw]",
)  # fmt: skip
@click.option(
    "--new",
    type=click.Path(path_type=Path),
    metavar="FILE.py",
    help="Test an effect of your own (this runs the file) and copy it into your effects folder: "
    "AUTOMARINE_EFFECTS, else automarine/effects in your settings. Files in it are run whenever effects are loaded.",
)
@options.overwrite_option
@options.json_option
@options.verbosity
def effects(name: str | None, motion: str | None, new: Path | None, overwrite: bool, as_json: bool) -> object:
    """The effects that a model of a motion may have, and that diagnose can name.

    Without NAME: name, place, equation and parameters of each. With NAME the whole card: what the parameters
    mean, what the verdict says, which run reveals the effect, what it is mistaken for and the run that tells
    the two apart, and the source.

    \b
    Example:
      automarine effects dead-band
    """
    from automarine_cli.workflows.effects import effects as workflow
    from automarine_cli.workflows.effects import keep_own

    if new is not None and name is not None:
        raise click.UsageError("--new names the effect by its file; leave NAME out")
    result = workflow(name, motion) if new is None else keep_own(new, overwrite=overwrite)
    echo_result(result, as_json=as_json, tables=result.tables(), keep_hint=None)
    return result
