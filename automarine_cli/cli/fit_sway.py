"""`automarine fit-sway`: options in, one workflow call, tables out."""

import click

from automarine_cli.cli import options


@click.command("fit-sway", short_help="Identify drag, mass and a sway model.")
@click.option(
    "--within", type=click.FloatRange(min=0, min_open=True), metavar="METRES",
    help="Follow each step for so many metres, before the wall is felt; without it to its end.",
)  # fmt: skip
@options.fit_options("steps", "METRES")
def fit_sway(**given: object) -> object:
    """Identify the sway model from step runs: distance against force, drag (Table 1) and mass (Table 2).

    Logs hold distance_m and force_Y_N (or Y, normalised), positive to starboard. Each step is fitted twice, as by
    fit-yaw; a hull drags alike to both sides. Logs without steps are fitted as whole runs.

    \b
    Example:
      automarine fit-sway sample_runs/sway --within 3 -o out/sway
      automarine fit-sway sample_runs/sway --within 3 --tail 1.5
    """
    from automarine_cli.workflows.fit_yaw import FITS

    return options.perform(FITS["sway"], given)
