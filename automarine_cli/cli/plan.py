"""`automarine plan`: what is unsure and what is allowed in, one workflow call, the next campaign out."""

from pathlib import Path

import click

from automarine_cli.cli import options

_FILE = click.Path(exists=True, dir_okay=False, path_type=Path)


def _print_example(ctx: click.Context, param: click.Parameter, value: bool) -> None:
    if value and not ctx.resilient_parsing:
        from automarine_cli.workflows.plan import example_limits

        click.echo(example_limits(), nl=False)
        ctx.exit()


@click.command("plan", short_help="The next campaign: the fewest runs that tell the most.")
@click.argument("model", type=_FILE, metavar="MODEL.json")
@click.option(
    "--diagnosis", type=_FILE, metavar="FILE", help="A diagnosis.json whose rivals are to be told apart."
)
@click.option("--limits", type=_FILE, metavar="FILE.toml", help="What the day at the pool allows.")
@click.option(
    "--example-limits", is_flag=True, is_eager=True, expose_value=False, callback=_print_example,
    help="Print a limits file with every setting and its default, and exit.",
)  # fmt: skip
@click.option(
    "--parameter", "parameters", multiple=True, metavar="NAME",
    help="Shrink the interval of this parameter (k_rr, I_r, ...); may be given again.  [default: all]",
)  # fmt: skip
@click.option(
    "--thruster-tests", multiple=True, type=click.Path(readable=False), metavar="LOG",
    help="Bollard tests with a current or power column, for the battery; may be given again.",
)  # fmt: skip
@options.thrusters_option
@options.arm_option
@options.columns_option
@options.out_option
@options.overwrite_option
@options.seed_option
@options.jobs_option
@options.json_option
@options.verbosity
def plan(
    model: Path,
    diagnosis: Path | None,
    limits: Path | None,
    parameters: tuple[str, ...],
    thruster_tests: tuple[str, ...],
    thrusters: Path | None,
    arm: float | None,
    columns: Path | None,
    out: Path | None,
    overwrite: bool,
    seed: int,
    jobs: int,
    as_json: bool,
) -> object:
    """The next pool campaign for a yaw model: which runs, in which order, and what intervals to expect of them.

    Runs are chosen for what they will tell (Fisher information, with all that differs from run to run), within the
    time, the battery and the moments that the limits allow. With a diagnosis, runs that tell its rivals apart come
    first.

    \b
    Example:
      automarine plan out/yaw/yaw_model.json -o out/plan
    """
    from automarine_cli.workflows import plan as workflow

    result = workflow.plan(
        model,
        diagnosis=diagnosis,
        limits=limits,
        parameters=parameters,
        thrusters=thrusters,
        arm=arm,
        thruster_tests=thruster_tests,
        columns=columns,
        out=out,
        overwrite=overwrite,
        seed=seed,
        jobs=jobs,
        progress=options.terminal_progress(),
    )
    options.echo_result(result, as_json=as_json, out=out, tables=result.tables(), files=workflow.FILES)
    return result
