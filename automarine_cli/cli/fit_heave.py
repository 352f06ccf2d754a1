"""`automarine fit-heave`: options in, one workflow call, tables out."""

from pathlib import Path

import click

from automarine_cli.cli import options
from automarine_cli.cli.fit_yaw import told


@click.command("fit-heave", short_help="Step runs to drag, mass and a heave model.")
@click.option(
    "--depths", nargs=2, type=float, metavar="FROM TO",
    help="Follow each step while the depth is between so many metres, clear of surface and bottom.",
)  # fmt: skip
@options.fit_options
def fit_heave(
    logs: tuple[str, ...], columns: Path | None, thrusters: Path | None, depths: tuple[float, float] | None,
    fit_to: str, tail: float | None, channels: str, with_effects: str, out: Path | None, overwrite: bool, strict: bool,
    jobs: int, as_json: bool,
) -> object:  # fmt: skip
    """Identify the heave model from step runs: depth against force, drag, mass, and the vehicle's buoyancy.

    Logs hold depth_m and force_Z_N (or Z, normalised; or n_vert with --thrusters), all positive down. Each step
    is fitted twice, as by fit-yaw; a constant force is fitted with it, and where drag down and up differ, each has
    its own. Logs without steps are fitted as whole runs.

    \b
    Example:
      automarine fit-heave sample_runs/heave --depths 0.2 3 -o out/heave
      automarine fit-heave sample_runs/heave --depths 0.2 3 --tail 1.2
    """
    from automarine_cli.workflows import fit_yaw as workflow

    result = workflow.FITS["heave"](
        logs, columns=columns, thrusters=thrusters, depths=depths, fit_to=fit_to, tail=tail, channels=channels,
        with_effects=options.names_in(with_effects), out=out, overwrite=overwrite, strict=strict, jobs=jobs,
        progress=options.terminal_progress(),
    )  # fmt: skip
    return told(result, out, as_json)
