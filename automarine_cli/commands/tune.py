"""`tune`: a model or a diagnosis -> gains of a controller with their margins; or a log flown with them."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from automarine_cli.commands import options
from automarine_cli.commands.command import INPUT, argument, command, option
from automarine_cli.pipeline.parallel import Progress

if TYPE_CHECKING:
    from automarine_cli.control.tuning import Tuning, TuningCheck


@command("tune", report="tuning_report")
@argument("model", type=options.FILE, metavar="MODEL.json", reads="file")
@option("--extended", type=options.FILE, hidden=True, reads="file", help="The model of a diagnosis.")
@option("--for", "target", default="", metavar="TARGET", help="ardusub, ardurover or pid.")
@option("--step", type=options.POSITIVE, metavar="SIZE", help="Step to design for.  [default: 90 degrees, or 1 m]")
@option(
    "--load", type=options.Finite(min=0, max=100, min_open=True, max_open=True), default=10.0, show_default=True,
    metavar="PERCENT", help="Load to hold against, in percent of the whole output.",
)  # fmt: skip
@option(
    "--load-recovery", type=options.Finite(min=1, max=600), metavar="SECONDS",
    help="Time in which the load is to be rejected.  [default: four settling times]",
)  # fmt: skip
@option(
    "--margin", type=options.Finite(min=0, max=2, min_open=True, max_open=True), default=0.75, show_default=True,
    metavar="M", help="Disk margin to keep.",
)  # fmt: skip
@option(
    "--full", type=options.POSITIVE, metavar="VALUE",
    help="Moment or force of the whole output, in the model's unit; of a rudder its largest angle in degrees.",
)  # fmt: skip
@option("--delay", type=options.Finite(0, 5), metavar="SECONDS", help="Longest delay that the logs cannot show.")
@option(
    "--supply", type=(options.Finite(min=0, max=1, min_open=True), options.Finite(min=1, max=3, max_open=True)),
    default=(0.88, 1.08), show_default=True, metavar="LOW HIGH",
    help="Lowest and highest supply voltage, as shares of that of the logs. LOW: above 0, to 1. HIGH: 1 to below 3.",
)  # fmt: skip
@option(
    "--present", type=options.FILE, metavar="FILE", reads="file",
    help="The vehicle's .param file.  [default: the firmware's defaults]",
)  # fmt: skip
@option("--sample-time", type=options.Finite(min=0.001, max=1), metavar="SECONDS", help="Time between loops of a pid.")
@option("--beyond-range", is_flag=True, help="Allow gains beyond the firmware's documented ranges, up to ten times.")
@option(
    "--check", multiple=True, type=click.Path(readable=False), metavar="LOG", reads="logs", role="log",
    help="Check a log flown with the gains of MODEL.json, a tuning.json; may be repeated.",
)  # fmt: skip
@option("--reference", metavar="COLUMN", group=INPUT, help="Column of the --check log with the requested heading.")
@options.thrusters
@options.arm
@options.columns
@options.ending(options.seed)
def tune(*, check: Any, reference: str | None, progress: Progress, **settings: Any) -> "Tuning | TuningCheck":
    """Design the gains of a controller from a model or a diagnosis, as fast as its uncertainty allows.

    Gains are tested on simulated vehicles, which differ in all that is uncertain: parameters, thrust, supply, delays,
    and every explanation that a diagnosis left open. MODEL.json is the model of a fit, or a diagnosis.json with its
    extended_model.json in the same folder. The verdict is: new gains, keep the present ones, or no promise, with the
    run that would settle it.

    \b
    Example:
      automarine fit-yaw sample_runs/steps -o out/yaw
      automarine tune out/yaw/yaw_model.json --for ardusub --full 1.2 \\
        --delay 0.1 -o out/tuning
    """
    from automarine_cli.control.tuning import check_tuning, make_tuning

    if check:
        return check_tuning(settings["model"], check, reference, settings["columns"], progress)
    return make_tuning(**settings)


def _completed(settings: dict[str, Any]) -> dict[str, Any]:
    """A diagnosis brings the model beside it. Raises UsageError where there is nothing to do."""
    from automarine_cli.control.knowledge import EXTENDED
    from automarine_cli.models.store import DIAGNOSIS
    from automarine_cli.pipeline.records import schema_in

    if not settings["target"] and not settings["check"]:
        raise click.UsageError("give --for TARGET, or --check LOG with a tuning.json")
    model, extended = settings["model"], settings["extended"]
    sibling = model.with_name(EXTENDED) if isinstance(model, Path) else None
    if extended is None and sibling and sibling.is_file() and schema_in(model) == DIAGNOSIS.schema:
        extended = sibling
    return settings | {"extended": extended}


def _then(result: Any) -> str:
    if not hasattr(result, "gains"):
        return "" if all(step.held for step in result.steps) else "automarine diagnose LOG --model FILE"
    return "fly them, then automarine tune {out}/tuning.json --check LOG" if result.gains() else result.plan_command


tune.complete, tune.then = _completed, _then
