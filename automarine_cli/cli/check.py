"""`automarine check`: options in, one workflow call, tables out."""

from pathlib import Path

import click

from automarine_cli.cli import options


@click.command("check")
@options.logs_argument
@options.columns_option
@options.strict_option
@options.jobs_option
@options.json_option
@options.verbosity
def check(logs: tuple[str, ...], columns: Path | None, strict: bool, jobs: int, as_json: bool) -> object:
    """What is in the logs, and what is wrong with them.

    For each run: sampling, gaps, what cleaning dropped, heading noise, moments, turns, which half-turn a fit
    would keep and what cut it, or why there is none. Yaw logs and thruster tests may be mixed. Nothing is
    written.

    \b
    Example:
      automarine check sample_runs/steps
    """
    from automarine_cli.workflows import check as workflow

    result = workflow.check(
        logs, columns=columns, strict=strict, jobs=jobs, progress=options.terminal_progress()
    )
    options.echo_result(result, as_json=as_json, tables=result.tables(), keep_hint=None)
    return result
