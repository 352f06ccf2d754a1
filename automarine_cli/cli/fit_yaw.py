"""`automarine fit-yaw`: options in, one workflow call, tables out."""

from pathlib import Path
from typing import Any

import click

from automarine_cli.cli import options
from automarine_cli.cli.echo import Printable

FIGURES = ("half_turns.png", "drag.png", "inertia.png", "collapse.png")


def files_of(half_turns: bool, motion: str = "yaw") -> tuple[str, ...]:
    """What a fit to half-turns (steps), or to whole runs, leaves in its folder."""
    steps = FIGURES if motion == "yaw" else ("steps.png", *FIGURES[1:])
    figures = steps if half_turns else ("whole_runs.png",)
    return (f"{motion}_model.json", "table1 and table2 (.csv, .md, .tex)", "runs.parquet", *figures)


@click.command("fit-yaw", short_help="Step runs to drag, inertia and a yaw model.")
@options.logs_argument
@options.columns_option
@options.thrusters_option
@options.arm_option
@options.fit_to_option
@options.tail_option("DEGREES")
@options.channels_option
@options.with_option
@options.out_option
@options.overwrite_option
@options.strict_option
@options.jobs_option
@options.json_option
@options.verbosity
def fit_yaw(
    logs: tuple[str, ...], columns: Path | None, thrusters: Path | None, arm: float | None, fit_to: str,
    tail: float | None, channels: str, with_effects: str, out: Path | None, overwrite: bool, strict: bool, jobs: int,
    as_json: bool,
) -> object:  # fmt: skip
    """Identify the yaw model from step runs: drag (Table 1) and inertia (Table 2).

    Each run is trimmed to its first half-turn and fitted twice: by the paper's steady rates and velocity
    errors, and by maximum likelihood on the headings. Logs without steps are fitted as whole runs.

    \b
    Example:
      automarine fit-yaw sample_runs/steps -o out/fit-yaw
      automarine fit-yaw sample_runs/steps --tail 90
    """
    from automarine_cli.workflows import fit_yaw as workflow

    result = workflow.fit_yaw(
        logs, columns=columns, thrusters=thrusters, arm=arm, fit_to=fit_to, tail=tail, channels=channels,
        with_effects=options.names_in(with_effects), out=out, overwrite=overwrite, strict=strict, jobs=jobs,
        progress=options.terminal_progress(),
    )  # fmt: skip
    return told(result, out, as_json)


def told(result: Any, out: Path | None, as_json: bool) -> object:
    """Print the fit of any motion; hand it back."""
    from automarine_cli.report import yaw_report

    tables: list[Printable | str] = [*yaw_report.tables(result, short=True), *yaw_report.sentences(result)]
    files = files_of(bool(result.turns), result.dof.name)
    options.echo_result(result, as_json=as_json, out=out, tables=tables, files=files)
    return result
