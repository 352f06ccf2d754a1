"""`automarine fit-sway`: options in, one workflow call, tables out."""

from pathlib import Path

import click

from automarine_cli.cli import options
from automarine_cli.cli.fit_yaw import told


@click.command("fit-sway", short_help="Step runs to drag, mass and a sway model.")
@click.option(
    "--within", type=click.FloatRange(min=0, min_open=True), metavar="METRES",
    help="Follow each step for so many metres, before the wall is felt; without it to its end.",
)  # fmt: skip
@options.fit_options
def fit_sway(
    logs: tuple[str, ...], columns: Path | None, thrusters: Path | None, within: float | None, fit_to: str,
    tail: float | None, channels: str, with_effects: str, out: Path | None, overwrite: bool, strict: bool, jobs: int,
    as_json: bool,
) -> object:  # fmt: skip
    """Identify the sway model from step runs: distance against force, drag (Table 1) and mass (Table 2).

    Logs hold distance_m and force_Y_N (or Y, normalised), positive to starboard. Each step is fitted twice, as by
    fit-yaw; a hull drags alike to both sides. Logs without steps are fitted as whole runs.

    \b
    Example:
      automarine fit-sway sample_runs/sway --within 3 -o out/sway
      automarine fit-sway sample_runs/sway --within 3 --tail 1.5
    """
    from automarine_cli.workflows import fit_yaw as workflow

    result = workflow.FITS["sway"](
        logs, columns=columns, thrusters=thrusters, within=within, fit_to=fit_to, tail=tail, channels=channels,
        with_effects=options.names_in(with_effects), out=out, overwrite=overwrite, strict=strict, jobs=jobs,
        progress=options.terminal_progress(),
    )  # fmt: skip
    return told(result, out, as_json)
