"""`automarine fit-thrusters`: options in, one workflow call, tables out."""

import click

from automarine_cli.cli import options


def _forms() -> tuple[str, ...]:
    from automarine_cli.thrusters.forms import FORMS

    return ("auto", *FORMS)


@click.command("fit-thrusters", short_help="Fit a thruster map to bollard tests.")
@options.logs_argument
@options.columns_option
@click.option(
    "--thrusters-per-test",
    type=click.IntRange(min=1),
    metavar="N",
    help="Equal thrusters that pulled together.  [default: the --columns file's, else 1]",
)
@click.option(
    "--form",
    type=options.OneOf(_forms),
    default="auto",
    show_default=True,
    callback=lambda ctx, param, value: None if value == "auto" else value,
    metavar="FORM",
    help="Thrust curve of the map, such as square or dead-band-power-saturation; or auto, which chooses by "
    "cross-validation.",
)
@options.ending("strict", "jobs")
def fit_thrusters(**given: object) -> object:
    """Bollard tests (columns n, force_N) into the map of one thruster, forward and backward apart.

    The square law F = a |n| n is fitted always; seven other curves stand beside it, and cross-validation
    chooses. Raw load-cell series are reduced to plateaus, a voltage column gives a map for each voltage.

    \b
    Example:
      automarine fit-thrusters sample_runs/thrusters --thrusters-per-test 2
    """
    from automarine_cli.workflows.fit_thrusters import fit_thrusters as command

    return options.perform(command, given)
