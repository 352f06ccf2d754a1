"""`automarine diagnose`: options in, one workflow call, the verdict out."""

from pathlib import Path

import click

from automarine_cli.cli import options


@click.command("diagnose", short_help="Find and name the effect that a model lacks.")
@options.logs_argument
@options.model_option
@click.option(
    "--hold-out", multiple=True, type=click.Path(readable=False), metavar="LOG",
    help="A log that is never fitted, to show the gap on; may be given again. Else a quarter of the runs.",
)  # fmt: skip
@options.columns_option
@options.thrusters_option
@options.arm_option
@options.channels_option
@options.out_option
@options.overwrite_option
@options.strict_option
@options.seed_option
@options.jobs_option
@options.cluster_option
@options.json_option
@options.verbosity
def diagnose(
    logs: tuple[str, ...], model: Path, hold_out: tuple[str, ...], columns: Path | None, thrusters: Path | None,
    arm: float | None, channels: str, out: Path | None, overwrite: bool, strict: bool, seed: int, jobs: int,
    cluster: str | None, as_json: bool,
) -> object:  # fmt: skip
    """Find where simulation and measurement disagree, name the missing effect, add it, show the gap shrink.

    Every effect of the library is tried on whole runs with everything refitted; what chance would reach on the
    same runs is the bar. The verdict is a name (with the rivals that the runs cannot exclude), a suspicion that
    the left-out runs do not bear out, nothing missing, or unexplained. What no effect of the library explains is
    learned as a curve over one variable or logged column. With a thruster map as the model, bollard tests are
    diagnosed in the same way.

    \b
    Example:
      automarine fit-yaw sample_runs/hidden_one -o out/hidden
      automarine diagnose sample_runs/hidden_one --model out/hidden/yaw_model.json -o out/diagnosis
    """
    from automarine_cli.workflows.diagnose import diagnose_any, files_of, terminal

    result = diagnose_any(
        logs, model=model, hold_out=hold_out, columns=columns, thrusters=thrusters, arm=arm, channels=channels, out=out,
        overwrite=overwrite, strict=strict, seed=seed, jobs=jobs, cluster=cluster,
        progress=options.terminal_progress(),
    )  # fmt: skip
    options.echo_result(result, as_json=as_json, out=out, tables=terminal(result), files=files_of(result))
    return result
