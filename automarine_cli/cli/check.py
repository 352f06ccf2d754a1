"""`automarine check`: options in, one workflow call, tables out."""

import click

from automarine_cli.cli import options


@click.command("check", short_help="Inspect logs and list their problems.")
@options.logs_argument
@options.columns_option
@options.ending("strict", "jobs")
def check(**given: object) -> object:
    """Inspect logs and list their problems.

    For each run: sampling, gaps, what cleaning dropped, heading noise, moments, turns, which half-turn a fit
    would keep and what cut it, or why there is none. Yaw logs and thruster tests may be mixed.

    \b
    Example:
      automarine check sample_runs/steps
    """
    from automarine_cli.workflows.check import check as command

    return options.perform(command, given)
