"""`automarine export`: a model file and a target in, one workflow call, a file for that simulator out."""

from pathlib import Path
from typing import Any

import click

from automarine_cli.cli import options
from automarine_cli.commands.terminal import echo_result, verbosity_level

_ABOVE_ZERO = click.FloatRange(min=0, min_open=True)


@click.command("export", short_help="Write a model for a simulator, a controller or a paper.")
@click.argument("model", metavar="[MODEL.json]", required=False, type=options.FILE)
@click.option("--to", metavar="NAME", help="The target: see --list.")
@click.option("--list", "show_list", is_flag=True, help="List the targets, their forms and frames, and exit.")
@click.option("--form", metavar="NAME", help="Form of the target; by default from FILE's extension.")
@click.option("--number", metavar="N", help="Number of the yaw model in the file.  [default: the preferred one]")
@click.option("--frame", metavar="NAME", help="ENU or NED.  [default: the target's own]")
@click.option(
    "--rigid-inertia", type=_ABOVE_ZERO, metavar="VALUE",
    help="The vehicle's own part of I_r; the rest is written as added inertia.",
)  # fmt: skip
@click.option("--rigid-mass", type=_ABOVE_ZERO, metavar="KG", help="gz-sim, of a planar model: the vehicle's own mass.")
@click.option(
    "--newton-metres-per-nu", type=_ABOVE_ZERO, metavar="VALUE",
    help="The moment in N m that one normalised unit stands for.",
)  # fmt: skip
@click.option(
    "--mesh-torque", type=_ABOVE_ZERO, nargs=2, metavar="QUADRATIC VISCOUS",
    help="stonefish: yaw drag [N m] of your mesh at 1 rad/s with a coefficient of 1.",
)  # fmt: skip
@click.option("--symmetrise", is_flag=True, help="thrusters: one coefficient for both directions, error and all.")
@click.option("--n-max", type=_ABOVE_ZERO, metavar="VALUE", help="thrusters: the largest control signal.")
@click.option("--lag", type=_ABOVE_ZERO, metavar="SECONDS", help="thrusters: time constant of the propeller's speed.")
@click.option("--allow-partial", is_flag=True, help="Leave out what the target cannot represent, and say so.")
@click.option(
    "-o", "--out", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE",
    help="The file to write; without it the text goes to standard output.",
)  # fmt: skip
@options.overwrite_option
@options.json_option
@options.verbosity
def export(show_list: bool, **given: Any) -> object:
    """Write a yaw model or a thruster map for the program that is to use it.

    Signs, units and frame become the target's own and are stated in the file. Effects that the target cannot
    represent are listed, and refused without --allow-partial.

    \b
    Example:
      automarine fit-yaw sample_runs/steps -o out/yaw
      automarine export out/yaw/yaw_model.json --to gz-sim --newton-metres-per-nu 1.5 -o out/vehicle.sdf
    """
    from automarine_cli.workflows.export import export as command
    from automarine_cli.workflows.export import export_targets

    out, as_json = given["out"], given["as_json"]
    if show_list:
        found = export_targets()
        echo_result(found, as_json=as_json, tables=found.tables(), keep_hint=None)
        return found
    if given["model"] is None or given["to"] is None:
        raise click.UsageError("give MODEL.json and --to NAME, or --list for the targets")
    if out is not None or as_json:
        return options.perform_one(command, given, written=f"Written: {out}")
    result = command(**{key: value for key, value in given.items() if key != "as_json"})
    click.echo(result.text, nl=False)
    for note in result.warnings if verbosity_level() >= 0 else ():
        click.echo(note, err=True)
    return result
