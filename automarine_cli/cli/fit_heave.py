"""`automarine fit-heave`: options in, one workflow call, tables out."""

import click

from automarine_cli.cli import options


@click.command("fit-heave", short_help="Identify drag, mass and a heave model.")
@click.option(
    "--depths", nargs=2, type=float, metavar="FROM TO",
    help="Follow each step while the depth is between so many metres, clear of surface and bottom.",
)  # fmt: skip
@options.fit_options("steps", "METRES", options.thrusters_option)
def fit_heave(**given: object) -> object:
    """Identify the heave model from step runs: depth against force, drag, mass, and the vehicle's buoyancy.

    Logs hold depth_m and force_Z_N (or Z, normalised; or n_vert with --thrusters), all positive down. Each step
    is fitted twice, as by fit-yaw; a constant force is fitted with it, and where drag down and up differ, each has
    its own. Logs without steps are fitted as whole runs.

    \b
    Example:
      automarine fit-heave sample_runs/heave --depths 0.2 3 -o out/heave
      automarine fit-heave sample_runs/heave --depths 0.2 3 --tail 1.2
    """
    from automarine_cli.workflows.fit_yaw import FITS

    return options.perform(FITS["heave"], given)
