"""`automarine validate`: options in, one workflow call, tables out."""

import click

from automarine_cli.cli import options


@click.command("validate", short_help="Simulate each log with each model, and compare.")
@options.logs_argument
@options.model_option
@options.columns_option
@options.thrusters_option
@options.arm_option
@options.channels_option
@click.option("--figures/--no-figures", default=True, show_default=True, help="Draw a figure of every run into DIR.")
@options.ending("strict", "seed", "jobs")
def validate(**given: object) -> object:
    """Simulate each log with each model of a yaw_model.json, and compare the headings.

    The models see the commands only. Scores, for each run and over all: heading error of the free run, of a run
    restarted at each change of moment, yaw-rate error, fit percent, and the noise level beside them. With -o a
    figure a run: headings, errors, moment.

    \b
    Example:
      automarine fit-yaw sample_runs/steps -o out/yaw
      automarine validate sample_runs/validation --model out/yaw/yaw_model.json -o out/validation
    """
    options.refuse_half_a_drive(given)
    from automarine_cli.workflows.validate import validate as command

    return options.perform(command, given)
