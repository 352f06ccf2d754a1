"""`validate`: simulate each log with each model, compare, plot (the source paper's section 5 and Fig. 10)."""

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from automarine_cli.commands import options
from automarine_cli.commands.command import command
from automarine_cli.errors import SettingError

if TYPE_CHECKING:
    from automarine_cli.comparison.validation import Validation


@command("validate", report="validation_report", then="automarine diagnose LOGS --model {model}", by_effects=True)
@options.logs
@options.model
@options.columns
@options.thrusters
@options.arm
@options.channels
@options.ending(options.strict, options.seed, options.jobs)
def validate(
    logs: Any, model: Any, columns: Any, thrusters: Any, arm: float | None, channels: str, strict: bool, seed: int,
    jobs: int, progress: Any,
) -> "Validation":  # fmt: skip
    """Simulate each log with each model of a fit, and compare that with what was measured.

    The models get the commands only. Use logs that were not fitted. The scores are: error of the free run, error
    of a run restarted at each change of command, error of the speed, fit percent, and the noise level. With -o
    you get one figure per run.

    \b
    Example:
      automarine fit-yaw sample_runs/steps -o out/yaw
      automarine validate sample_runs/validation \\
        --model out/yaw/yaw_model.json -o out/validation
    """
    from automarine_cli.comparison.validation import compare, load_usable, with_predictions
    from automarine_cli.logs import ColumnMap
    from automarine_cli.models.store import read_model
    from automarine_cli.runs.channels import AUTO, choose_channels, parse_channels
    from automarine_cli.runs.run import command_warnings
    from automarine_cli.thrusters.map import load_planar

    half_a_drive = (thrusters is None) != (arm is None) and (thrusters is None or columns == ColumnMap())
    drive: dict[str, Any] = {"columns": columns, "thrusters": thrusters, "arm": arm}
    execution = {"strict": strict, "jobs": jobs, "progress": progress}
    stored = read_model(model)
    if half_a_drive and (stored.in_plane or arm is not None or stored.dof.levered):
        raise click.UsageError("--thrusters MAP.json and --arm METRES go together.")
    if stored.in_plane:
        if channels != AUTO:
            raise SettingError(
                f"{model.name} is a planar model: every channel of its logs is compared; leave --channels out"
            )
        campaign = load_planar(logs, **drive, **execution)
        command_warnings(campaign.runs)  # refused where they cannot be of this map
        return replace(compare(stored, campaign.runs, seed), set_aside=campaign.set_aside)
    parse_channels(channels, stored.dof)
    campaign = load_usable(logs, stored, **drive, **execution)
    believed = choose_channels(campaign.runs, stored.dof, channels, late_position=True)
    runs = [believed.believed(run) for run in campaign.runs]
    compared = compare(stored, runs, seed, progress)
    return with_predictions(replace(compared, set_aside=campaign.set_aside, channels=believed), believed.names)
