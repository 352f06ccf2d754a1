"""`automarine slice`: options in, one workflow call, tables out."""

import click

from automarine_cli.cli import options


@click.command("slice", short_help="Cut one long log into runs.")
@options.logs_argument
@click.option(
    "--by", type=click.Choice(["mode", "arm", "moment"]), required=True,
    help="Cut where a flight mode, an arming state, or a constant command begins and ends.",
)  # fmt: skip
@options.columns_option
@click.option("--keep", multiple=True, metavar="MODE", help="Keep only this flight mode; may be repeated.")
@click.option(
    "--lead", type=click.FloatRange(min=0), default=2.0, show_default=True, metavar="S",
    help="Seconds of rest to keep before a constant command.",
)  # fmt: skip
@click.option(
    "--shortest", type=click.FloatRange(min=0), default=1.0, show_default=True, metavar="S",
    help="Minimum duration of a run in seconds.",
)  # fmt: skip
@click.option(
    "--format", "form", type=click.Choice(["csv", "csv.gz", "parquet"]), default="csv", show_default=True,
    help="File format of the runs.",
)  # fmt: skip
@options.ending("strict", "jobs")
def slice_(**given: object) -> object:
    """Cut one long log into runs: a log of each, which names the file and the interval that it comes from.

    A vehicle logs a whole day in one file. Cut it by the flight mode, by arming, or where a constant command begins
    and ends; then check, fit and validate with DIR/runs. Commands that follow another without a rest between are in
    DIR/moving, for validate, diagnose and fit-yaw --fit-to whole-runs. Mode and arming are known in ArduPilot and
    PX4 logs, else from the columns mode and armed.

    \b
    Example:
      automarine slice sample_runs/validation/there_and_back.csv --by moment -o out/slices
    """
    if given["keep"] and given["by"] != "mode":
        raise click.UsageError("--keep MODE goes with --by mode.")
    from automarine_cli.workflows.slice import slice_log as command

    return options.perform(command, given)
