"""`automarine fit-planar`: options in, one workflow call, tables out."""

import click

from automarine_cli.cli import options


@click.command("fit-planar", short_help="Identify surge, sway and yaw together.")
@options.logs_argument
@options.columns_option
@options.thrusters_option
@options.arm_option
@options.known_option
@options.ending("strict", "jobs")
def fit_planar(**given: object) -> object:
    """Identify surge, sway and yaw together, and what couples them.

    The logs hold the heading and the speed ahead or the position on the water. Drags, couplings and a current
    are chosen by evidence; what the logs cannot determine is set by stated assumptions.

    \b
    Example:
      automarine fit-planar sample_runs/planar -o out/planar
    """
    from automarine_cli.workflows.fit_planar import fit_planar as command

    return options.perform(command, given)
