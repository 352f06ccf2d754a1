"""`compare`: results of two or more campaigns side by side: another vehicle, another day, another battery."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from automarine_cli.commands import options
from automarine_cli.commands.command import argument, command
from automarine_cli.errors import SettingError

if TYPE_CHECKING:
    from automarine_cli.report.compare_report import ResultComparison


@command("compare", report="compare_report", then="automarine diagnose LOGS --model FILE")
@argument(
    "results", nargs=-1, required=True, metavar="DIR DIR...", type=click.Path(exists=True, path_type=Path),
    reads="folders",
)  # fmt: skip
@options.ending()
def compare(results: tuple[Path, ...]) -> "ResultComparison":
    """Compare results of fit-thrusters, fit-yaw, validate or diagnose, each with the first.

    They may be of another vehicle, day or battery, or of another model of the same runs. Each difference has a
    confidence interval, and a word on its significance.

    \b
    Example:
      automarine fit-yaw sample_runs/steps -o out/yaw
      automarine fit-yaw sample_runs/hidden_one -o out/hidden_one
      automarine compare out/yaw out/hidden_one
    """
    from automarine_cli.comparison.side_by_side import differences, read_sides
    from automarine_cli.report.compare_report import ResultComparison
    from automarine_cli.text import listed

    kind, sides, notes = read_sides(results)
    apart = differences(sides)
    if not apart:
        raise SettingError(
            f"{listed(side.name for side in sides)}: the first has no parameter in common with another one; "
            "compare results that have the same model or form, or validations with two runs in common or more"
        )
    return ResultComparison(kind, sides, apart, tuple(notes))


def _inputs(results: tuple[Path, ...]) -> list[object]:
    from automarine_cli.comparison.side_by_side import locate
    from automarine_cli.pipeline.results_folder import Input

    return [Input(f"{name}/{path.name}", path, "result") for name, (path, _) in locate(results).items()]


compare.folder_inputs = _inputs
