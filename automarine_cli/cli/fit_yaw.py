"""`automarine fit-yaw`: options in, one workflow call, tables out."""

import click

from automarine_cli.cli import options


@click.command("fit-yaw", short_help="Identify drag, inertia and a yaw model.")
@options.fit_options("half-turns", "DEGREES", options.thrusters_option, options.arm_option)
def fit_yaw(**given: object) -> object:
    """Identify the yaw model from step runs: drag (Table 1) and inertia (Table 2).

    Each run is trimmed to its first half-turn and fitted twice: by the paper's steady rates and velocity
    errors, and by maximum likelihood on the headings. Logs without steps are fitted as whole runs.

    \b
    Example:
      automarine fit-yaw sample_runs/steps -o out/fit-yaw
      automarine fit-yaw sample_runs/steps --tail 90
    """
    from automarine_cli.workflows.fit_yaw import fit_yaw as command

    return options.perform(command, given)
