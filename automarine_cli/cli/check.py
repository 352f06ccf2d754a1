"""`automarine check`: options in, one workflow call, tables out."""

from pathlib import Path

import click

from automarine_cli.cli import options


@click.command("check", short_help="What is in the logs, and what is wrong with them.")
@options.logs_argument
@options.columns_option
@options.out_option
@options.overwrite_option
@options.strict_option
@options.jobs_option
@options.json_option
@options.verbosity
def check(
    logs: tuple[str, ...], columns: Path | None, out: Path | None, overwrite: bool, strict: bool, jobs: int,
    as_json: bool,
) -> object:  # fmt: skip
    """What is in the logs, and what is wrong with them.

    For each run: sampling, gaps, what cleaning dropped, heading noise, moments, turns, which half-turn a fit
    would keep and what cut it, or why there is none. Yaw logs and thruster tests may be mixed.

    \b
    Example:
      automarine check sample_runs/steps
    """
    from automarine_cli.workflows import check as workflow

    result = workflow.check(
        logs, columns=columns, out=out, overwrite=overwrite, strict=strict, jobs=jobs,
        progress=options.terminal_progress(),
    )  # fmt: skip
    options.echo_result(
        result, as_json=as_json, out=out, tables=result.tables(), files=workflow.FILES, keep_hint=None
    )
    return result
