"""`check`: what is in the logs, what of it serves, and what is wrong with the rest."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from automarine_cli.commands import options
from automarine_cli.commands.command import command
from automarine_cli.pipeline.parallel import Progress

if TYPE_CHECKING:
    from automarine_cli.report.log_tables import Check


@command("check", report="log_tables")
@options.logs
@options.columns
@options.ending(options.strict, options.jobs)
def check(logs: Sequence[Any], columns: Any, strict: bool, jobs: int, progress: Progress) -> "Check":
    """Inspect logs and list their problems.

    For each run: sampling, gaps, removed samples, heading noise, moments, turns, and the half-turn that a fit would
    use, or why there is none. Yaw logs and bollard tests may be mixed.

    \b
    Example:
      automarine check sample_runs/steps
    """
    from dataclasses import replace
    from functools import partial

    from automarine_cli.pipeline.parallel import ordered_map
    from automarine_cli.report.log_tables import Check
    from automarine_cli.runs.load import require_usable
    from automarine_cli.runs.look import look_at_log, with_limits
    from automarine_cli.runs.run import NAMED_APART, make_unique

    look = partial(look_at_log, columns=columns)
    contents = ordered_map(look, logs, jobs, progress=progress, stage="looking at logs")
    runs = [run for of_log, _, _ in contents for run in of_log]
    tests = tuple(test for _, of_log, _ in contents for test in of_log)
    set_aside = tuple(run for _, _, of_log in contents for run in of_log)
    require_usable([*runs, *tests], set_aside, len(logs), strict)
    names = make_unique([(run.run, run.file) for run in runs])
    distinct = tuple(
        run if run.run == name else replace(run, run=name, notes=[*run.notes, NAMED_APART])
        for run, name in zip(with_limits(runs), names)
    )
    return Check(distinct, tests, set_aside, len(logs))


check.then = lambda result: f"automarine fit-{result.runs[0].dof.name if result.runs else 'thrusters'} LOGS -o DIR"
