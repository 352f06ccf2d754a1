"""`export`: a model file and a target in, a file for that simulator out."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from automarine_cli.commands import options
from automarine_cli.commands.command import OUTPUT, argument, command, option
from automarine_cli.commands.terminal import verbosity_level

if TYPE_CHECKING:
    from automarine_cli.exports.export import Exported, Targets


class ByMotion(click.ParamType):
    """A value, or several by their motions: yaw=1.5,roll=2."""

    def __init__(self, type: click.ParamType = click.STRING) -> None:
        self.type, self.name = type, type.name

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if "=" not in str(value):
            return self.type.convert(value, param, ctx)
        pairs = [part.partition("=") for part in value.split(",")]
        return {name.strip(): self.type.convert(number.strip(), param, ctx) for name, _, number in pairs}


@command("export", report="sections", saves=False)
@argument("model", metavar="[MODEL.json]...", nargs=-1, type=options.FILE, reads="file")
@option("--to", metavar="NAME", help="The target: see --list.")
@option("--list", "show_list", is_flag=True, help="List the targets, their forms and frames, and exit.")
@option("--form", metavar="NAME", help="Form of the target.  [default: by FILE's extension]")
@option(
    "--number", type=ByMotion(), metavar="N",
    help="Number of the model in the file; of several yaw=N,roll=N.  [default: the preferred one]",
)  # fmt: skip
@option("--frame", metavar="NAME", help="ENU or NED.  [default: the target's own]")
@option(
    "--rigid-inertia", type=ByMotion(options.POSITIVE), metavar="VALUE",
    help="The vehicle's own part of I_r, or its mass; the rest becomes added inertia. Of several yaw=VALUE,roll=VALUE.",
)  # fmt: skip
@option("--rigid-mass", type=options.POSITIVE, metavar="KG", help="The vehicle's own mass in air.")
@option(
    "--newton-metres-per-nu", type=ByMotion(options.POSITIVE), metavar="VALUE",
    help="The moment in N m that one normalised unit stands for. Of several yaw=VALUE,surge=VALUE.",
)  # fmt: skip
@option("--symmetrise", is_flag=True, help="thrusters: one coefficient for both directions, with its error.")
@option("--n-max", type=options.POSITIVE, metavar="VALUE", help="thrusters: the largest control signal.")
@option(
    "--arm", type=options.POSITIVE, metavar="METRES",
    help="How far off the centre line the two thrusters of a vehicle push ahead.",
)  # fmt: skip
@option("--lag", type=options.POSITIVE, metavar="SECONDS", help="thrusters: time constant of the propeller's speed.")
@option("--allow-partial", is_flag=True, help="Leave out what the target cannot represent, and say so.")
@option(
    "-o", "--out", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", group=OUTPUT,
    help="The file to write; without it the text goes to standard output.",
)  # fmt: skip
@options.overwrite
@options.as_json
@options.verbosity
def export(*, show_list: bool, out: Path | None, overwrite: bool, **settings: Any) -> "Exported | Targets":
    """Write a model or a thruster map for another program, or several models as one vehicle.

    Signs, units and frame become those of the target and are stated in the file. The command stops if the target
    cannot represent an effect; --allow-partial leaves it out.

    \b
    Example:
      automarine fit-yaw sample_runs/steps -o out/yaw
      automarine export out/yaw/yaw_model.json --to gz-sim \\
        --newton-metres-per-nu 1.5 -o out/vehicle.sdf
    """
    from automarine_cli.exports.export import export_model, export_targets

    return export_targets() if show_list else export_model(**settings, out=out, overwrite=overwrite)


def _refuse_nothing(settings: dict[str, Any]) -> dict[str, Any]:
    if not settings["show_list"] and (not settings["model"] or settings["to"] is None):
        raise click.UsageError("give MODEL.json and --to NAME, or --list for the targets")
    return settings


def _finish(ctx: click.Context, result: Any) -> None:
    if not (ctx.params["as_json"] or ctx.params["show_list"] or result.place):
        click.echo(result.text, nl=False)
        for line in result.warnings if verbosity_level() >= 0 else ():
            click.echo(line, err=True)


export.complete, export.finish = _refuse_nothing, _finish
export.then = lambda result: "" if hasattr(result, "place") else "automarine export MODEL.json --to NAME"
