"""`automarine fit-planar`: options in, one workflow call, tables out."""

from pathlib import Path

import click

from automarine_cli.cli import options
from automarine_cli.cli.echo import Printable

FILES = ("planar_model.json", "planar (.csv, .md, .tex)", "planar_runs.png")


@click.command("fit-planar", short_help="Driven runs to surge, sway and yaw together.")
@options.logs_argument
@options.columns_option
@options.thrusters_option
@options.arm_option
@options.out_option
@options.overwrite_option
@options.strict_option
@options.jobs_option
@options.json_option
@options.verbosity
def fit_planar(
    logs: tuple[str, ...], columns: Path | None, thrusters: Path | None, arm: float | None, out: Path | None,
    overwrite: bool, strict: bool, jobs: int, as_json: bool,
) -> object:  # fmt: skip
    """Identify surge, sway and yaw together, and what couples them.

    The logs hold the heading and the speed ahead or the position on the water. Drags, couplings and a current
    are chosen by evidence; what the logs do not tell is tied to assumptions that are named.

    \b
    Example:
      automarine fit-planar sample_runs/planar -o out/planar
    """
    from automarine_cli.report import planar_report
    from automarine_cli.workflows import fit_planar as workflow

    result = workflow.fit_planar(
        logs, columns=columns, thrusters=thrusters, arm=arm, out=out, overwrite=overwrite, strict=strict, jobs=jobs,
        progress=options.terminal_progress(),
    )  # fmt: skip
    first, rest = result.use.sentences if result.use else (), planar_report.sentences(result)
    said: list[Printable | str] = [
        *first,
        *planar_report.tables(result),
        *(one for one in rest if one not in first),
    ]
    options.echo_result(result, as_json=as_json, out=out, tables=said, files=FILES)
    return result
