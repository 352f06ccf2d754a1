"""`automarine diagnose`: options in, one workflow call, the verdict out."""

import click

from automarine_cli.cli import options


@click.command("diagnose", short_help="Find and name the effect that a model lacks.")
@options.logs_argument
@options.model_option
@click.option(
    "--hold-out", multiple=True, type=click.Path(readable=False), metavar="LOG",
    help="A log kept out of the fit, to test the model on; may be repeated. By default a quarter of the runs.",
)  # fmt: skip
@options.columns_option
@options.thrusters_option
@options.arm_option
@options.channels_option
@options.ending("strict", "seed", "jobs", "cluster")
def diagnose(**given: object) -> object:
    """Find where simulation and measurement disagree, name the missing effect, add it, show the gap shrink.

    Every effect of the library is tried on whole runs with everything refitted; an effect counts if it gains more
    than chance would on the same runs. The verdict is a name (with the rivals that the runs cannot exclude), a
    suspicion that the held-out runs do not confirm, nothing missing, or unexplained. What no effect explains is
    learned as a curve over one variable or logged column. With a thruster map as the model, bollard tests are
    diagnosed in the same way.

    \b
    Example:
      automarine fit-yaw sample_runs/hidden_one --fit-to whole-runs -o out/hidden
      automarine diagnose sample_runs/hidden_one --model out/hidden/yaw_model.json -o out/diagnosis
    """
    from automarine_cli.workflows.diagnose import diagnose as command

    return options.perform(command, given)
