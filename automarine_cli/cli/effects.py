"""`automarine effects`: a name or none in, one workflow call, cards out."""

import click

from automarine_cli.cli import options
from automarine_cli.commands.terminal import echo_result


@click.command("effects", short_help="List the library of effects, or show one.")
@click.argument("name", required=False, metavar="[NAME]")
@click.option(
    "--motion", metavar="NAME",
    help="Only what may act in this motion (surge, say), in its words, letters and units.  [default: all, of yaw]",
)  # fmt: skip
@options.json_option
@options.verbosity
def effects(name: str | None, motion: str | None, as_json: bool) -> object:
    """The effects that a model of a motion may have, and that diagnose can name.

    Without NAME: name, place, equation and parameters of each. With NAME the whole card: what the parameters
    mean, what the verdict says, which run reveals the effect, what it is mistaken for and the run that tells
    the two apart, and the source.

    \b
    Example:
      automarine effects dead-band
    """
    from automarine_cli.workflows.effects import effects as workflow

    result = workflow(name, motion)
    echo_result(result, as_json=as_json, tables=result.tables(), keep_hint=None)
    return result
