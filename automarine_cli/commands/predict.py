"""`predict`: where commands take the vehicle, with a 95 % band."""

from typing import TYPE_CHECKING, Any

import click

from automarine_cli.commands import options
from automarine_cli.commands.command import INPUT, argument, command, option

if TYPE_CHECKING:
    from automarine_cli.comparison.prediction import Prediction


@command("predict", report="validation_report", by_effects=True)
@argument("model", type=options.FILE, metavar="MODEL", reads="file", role="model")
@argument(
    "commands", nargs=-1, required=True, type=click.Path(readable=False), metavar="COMMANDS...", reads="logs",
    role="log",
)  # fmt: skip
@options.columns
@options.thrusters
@options.arm
@option(
    "--start", type=options.Finite(), metavar="X", group=INPUT,
    help="Start heading in degrees, or distance or depth in metres.  [default: as logged, else 0]",
)  # fmt: skip
@option(
    "--start-rate", type=options.Finite(), metavar="V", group=INPUT,
    help="Start rate in degrees per second, or speed in metres per second.  [default: as logged, else 0]",
)  # fmt: skip
@option("--parquet", is_flag=True, help="Write prediction.parquet instead of prediction.csv.")
@options.ending(options.strict, options.seed, options.jobs)
def predict(
    model: Any, commands: Any, columns: Any, thrusters: Any, arm: float | None, start: float | None,
    start_rate: float | None, parquet: bool, strict: bool, seed: int, jobs: int, progress: Any,
) -> "Prediction":  # fmt: skip
    """Predict where commands take the vehicle, with a 95 % band.

    MODEL is the model file of a fit or a diagnosis. COMMANDS are logs, or tables with time and command alone. There a
    command acts until the next row, and the last row ends the prediction.

    \b
    Example:
      automarine fit-yaw sample_runs/steps -o out/yaw
      automarine predict out/yaw/yaw_model.json \\
        sample_runs/validation/there_and_back.csv -o out/predicted
    """
    from automarine_cli.comparison.prediction import Prediction, load_commands, predict_runs, read_doubt

    stored, doubt = read_doubt(model)
    runs = load_commands(commands, stored, doubt, columns, thrusters, arm, strict=strict, jobs=jobs, progress=progress)
    position, rate = (None if value is None else stored.dof.inner(value) for value in (start, start_rate))
    predicted = predict_runs(stored, doubt, runs, position=position, rate=rate, seed=seed, progress=progress)
    return Prediction(stored, doubt, predicted, runs.set_aside, seed, parquet)
