"""`fit-thrusters`: bollard tests -> thruster map (the source paper's section 3.1, equations 2 and 3)."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import click

from automarine_cli.commands import options
from automarine_cli.commands.command import command, option
from automarine_cli.pipeline.parallel import Progress

if TYPE_CHECKING:
    from automarine_cli.thrusters.result import ThrusterFit

AUTO_FORM = "auto"


def _forms() -> tuple[str, ...]:
    from automarine_cli.thrusters.curves import FORMS

    return (AUTO_FORM, *FORMS)


class _Form(options.OneOf):
    """A thrust curve; None for auto."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        return None if value == AUTO_FORM else super().convert(value, param, ctx)


@command(
    "fit-thrusters", report="thruster_tables",
    then="automarine fit-yaw LOGS --thrusters {out}/thrusters.json --arm METRES",
)  # fmt: skip
@options.logs
@options.columns
@option(
    "--thrusters-per-test", type=click.IntRange(min=1), metavar="N",
    help="Number of equal thrusters that pulled together.  [default: the --columns file's, else 1]",
)  # fmt: skip
@option(
    "--form", type=_Form(_forms), default=AUTO_FORM, show_default=True, metavar="FORM",
    help="Thrust curve of the map, such as square, dead-band-power or spline. auto chooses by cross-validation.",
)  # fmt: skip
@options.ending(options.strict, options.jobs)
def fit_thrusters(
    logs: Sequence[Any], columns: Any, thrusters_per_test: int | None, form: str | None, strict: bool, jobs: int,
    progress: Progress,
) -> "ThrusterFit":  # fmt: skip
    """Make the map of one thruster, forward and backward, from bollard tests (columns n and force_N).

    The square law F = a |n| n, seven other equations and a monotone spline are fitted, and cross-validation chooses
    one. Raw load-cell series are reduced to plateaus. A voltage column gives one map per voltage.

    \b
    Example:
      automarine fit-thrusters sample_runs/thrusters --thrusters-per-test 2
    """
    from dataclasses import replace

    from automarine_cli.runs.load import append_exclusions
    from automarine_cli.thrusters.bollard_data import load_thruster_logs, thrusters_pulling
    from automarine_cli.thrusters.result import ONE_PULLED, fit_records

    loaded = load_thruster_logs(logs, columns, strict=strict, progress=progress)
    together = thrusters_pulling(thrusters_per_test, columns)
    with append_exclusions(loaded.set_aside):
        fit = fit_records(loaded, together, loaded.n_unit, form, jobs, progress)
    assumed = thrusters_per_test is None and "thrusters_per_test" not in columns.defaults
    return replace(fit, notes=(ONE_PULLED, *fit.notes)) if assumed else fit
