"""`automarine validate`: options in, one workflow call, tables out."""

from pathlib import Path

import click

from automarine_cli.cli import options
from automarine_cli.dofs import TRANSLATIONS

FILES = ("validation.json", "validation.csv", "validation.md", "validation.tex")
PICTURES = "validation_RUN.png"


def _of_force(model: Path) -> bool:
    """Whether the model is one of a translation, whose thrusters need no arm; if it can be told at a glance."""
    with model.open("rb") as file:
        start = file.read(2000)
    return any(f"{name}-model/1".encode() in start for name in TRANSLATIONS)


@click.command("validate", short_help="Simulate each log with each model, and compare.")
@options.logs_argument
@options.model_option
@options.columns_option
@options.thrusters_option
@options.arm_option
@options.channels_option
@click.option(
    "--figures/--no-figures", default=True, show_default=True, help="Draw a figure of every run into DIR."
)
@options.out_option
@options.overwrite_option
@options.strict_option
@options.seed_option
@options.jobs_option
@options.json_option
@options.verbosity
def validate(
    logs: tuple[str, ...],
    model: Path,
    columns: Path | None,
    thrusters: Path | None,
    arm: float | None,
    channels: str,
    figures: bool,
    out: Path | None,
    overwrite: bool,
    strict: bool,
    seed: int,
    jobs: int,
    as_json: bool,
) -> object:
    """Simulate each log with each model of a yaw_model.json, and compare the headings.

    The models see the commands only. Scores, for each run and over all: heading error of the free run, of a run
    restarted at each change of moment, yaw-rate error, fit percent, and the noise floor beside them. With -o a
    figure a run: headings, errors, moment.

    \b
    Example:
      automarine fit-yaw sample_runs/steps -o out/yaw
      automarine validate sample_runs/validation --model out/yaw/yaw_model.json -o out/validation
    """
    levered = arm is not None or not _of_force(model)
    if levered and (thrusters is None) != (arm is None) and (thrusters is None or columns is None):
        raise click.UsageError("--thrusters MAP.json and --arm METRES go together.")
    from automarine_cli.workflows import validate_planar as workflow

    result = workflow.validate_any(
        logs,
        model=model,
        columns=columns,
        thrusters=thrusters,
        arm=arm,
        channels=channels,
        out=out,
        figures=figures,
        overwrite=overwrite,
        strict=strict,
        seed=seed,
        jobs=jobs,
        progress=options.terminal_progress(),
    )
    files = (*FILES, PICTURES) if figures else FILES
    options.echo_result(result, as_json=as_json, out=out, tables=result.tables(), files=files)
    return result
