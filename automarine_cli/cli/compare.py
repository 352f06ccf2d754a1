"""`automarine compare`: folders of results in, one workflow call, tables out."""

from pathlib import Path

import click

from automarine_cli.cli import options


@click.command("compare", short_help="Compare results and test their differences.")
@click.argument(
    "results", nargs=-1, required=True, metavar="DIR DIR...",
    type=click.Path(exists=True, path_type=Path),
)  # fmt: skip
@options.ending()
def compare(**given: object) -> object:
    """Put results of fit-thrusters, fit-yaw, validate or diagnose side by side, each against the first: another
    vehicle, another day, another battery, another model of the same runs. Each difference has a confidence interval,
    and a word on its significance.

    \b
    Example:
      automarine compare out/fit-yaw out/hidden
    """
    from automarine_cli.workflows.compare import compare as command

    return options.perform(command, given)
