"""`automarine tune`: a model and a target in, one workflow call, gains with their margins out."""

import click

from automarine_cli.cli import options


@click.command("tune", short_help="Gains of a controller, with the margin they need.")
@click.argument("model", type=options.FILE, metavar="MODEL.json")
@click.option("--for", "target", default="", metavar="TARGET", help="ardusub, ardurover, pid or python.")
@click.option("--step", type=float, metavar="DEG", help="Step of the heading.  [default: 90; of others 1 m]")
@click.option("--load", type=float, default=10.0, show_default=True, metavar="PERCENT", help="Load to hold against.")
@click.option("--margin", type=float, default=0.75, show_default=True, metavar="M", help="Disk margin to keep.")
@click.option("--full", type=float, metavar="VALUE", help="Moment or force of the whole output, in the model's unit.")
@click.option("--delay", type=float, metavar="SECONDS", help="Longest delay that the logs cannot show.")
@click.option(
    "--supply", type=float, nargs=2, default=(0.88, 1.08), show_default=True, metavar="LOW HIGH",
    help="Lowest and highest supply voltage, in shares of that of the logs.",
)  # fmt: skip
@click.option("--present", type=options.FILE, metavar="FILE", help="The vehicle's .param file.  [default: defaults]")
@click.option("--sample-time", type=float, metavar="SECONDS", help="Time between two loops (pid, python).")
@click.option("--beyond-range", is_flag=True, help="Allow gains beyond the ranges that the firmware documents.")
@click.option(
    "--check", multiple=True, type=click.Path(readable=False), metavar="LOG",
    help="A log flown with the gains: MODEL.json is then the tuning.json. May be repeated.",
)  # fmt: skip
@click.option("--reference", metavar="COLUMN", help="Column of such a log with the heading asked for.")
@options.thrusters_option
@options.arm_option
@options.columns_option
@options.ending("seed")
def tune(**given: object) -> object:
    """Gains of a controller from a model or a diagnosis, as fast as its uncertainty allows.

    What is uncertain is flown: the model's parameters, thrust that differs from run to run, the supply, delays that
    the logs cannot show, and every explanation that a diagnosis left open. MODEL.json is a model of a fit, or a
    diagnosis.json with its extended_model.json beside it. The verdict is new gains, the present ones kept, or that
    none can be promised, with the run that would settle it.

    \b
    Example:
      automarine fit-yaw sample_runs/steps -o out/yaw
      automarine tune out/yaw/yaw_model.json --for ardusub --full 1.2 --delay 0.1 -o out/tuning
    """
    if not given["target"] and not given["check"]:
        raise click.UsageError("give --for TARGET, or --check LOG with a tuning.json")
    from automarine_cli.workflows.tune import tune as command

    return options.perform(command, given)
