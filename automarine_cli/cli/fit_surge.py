"""`automarine fit-surge`: options in, one workflow call, tables out."""

import click

from automarine_cli.cli import options


@click.command("fit-surge", short_help="Identify drag, mass and a surge model.")
@click.option(
    "--within", type=click.FloatRange(min=0, min_open=True), metavar="METRES",
    help="Follow each step for so many metres, before the wall is felt; without it to its end.",
)  # fmt: skip
@options.fit_options("steps", "METRES", options.thrusters_option)
def fit_surge(**given: object) -> object:
    """Identify the surge model from step runs: distance against force, drag (Table 1) and mass (Table 2).

    Logs hold distance_m and force_X_N (or X, normalised; or n_port and n_stbd with --thrusters). Each step is
    fitted twice, as by fit-yaw; where drag ahead and astern differ, each has its own. Logs without steps are
    fitted as whole runs.

    \b
    Example:
      automarine fit-surge sample_runs/surge --within 3 -o out/surge
      automarine fit-surge sample_runs/surge --within 3 --tail 1.5
    """
    from automarine_cli.workflows.fit_yaw import FITS

    return options.perform(FITS["surge"], given)
