"""`automarine plan`: what is unsure and what is allowed in, one workflow call, the next campaign out."""

import click

from automarine_cli.cli import options


def _print_example(ctx: click.Context, param: click.Parameter, value: bool) -> None:
    if value and not ctx.resilient_parsing:
        from automarine_cli.workflows.plan import example_limits

        click.echo(example_limits(), nl=False)
        ctx.exit()


@click.command("plan", short_help="Plan the next campaign.")
@click.argument("model", type=options.FILE, metavar="MODEL.json")
@click.option(
    "--diagnosis", type=options.FILE, metavar="FILE", help="A diagnosis.json whose rivals the runs should separate."
)
@click.option(
    "--limits", type=options.FILE, metavar="FILE.toml", help="Limits of time, battery and moments at the pool."
)
@click.option(
    "--example-limits", is_flag=True, is_eager=True, expose_value=False, callback=_print_example,
    help="Print a limits file with every setting and its default, and exit.",
)  # fmt: skip
@click.option(
    "--parameter", "parameters", multiple=True, metavar="NAME",
    help="Shrink the interval of this parameter (k_rr, I_r, ...); may be repeated.  [default: all]",
)  # fmt: skip
@click.option(
    "--thruster-tests", multiple=True, type=click.Path(readable=False), metavar="LOG",
    help="Bollard tests with a current or power column, for the battery; may be repeated.",
)  # fmt: skip
@options.thrusters_option
@options.arm_option
@options.columns_option
@options.ending("seed", "jobs")
def plan(**given: object) -> object:
    """The next pool campaign for a yaw model: which runs, in which order, and what intervals to expect of them.

    Runs are chosen by Fisher information (with all that differs from run to run), within the
    time, the battery and the moments that the limits allow. With a diagnosis, runs that separate its rivals come
    first.

    \b
    Example:
      automarine plan out/yaw/yaw_model.json -o out/plan
    """
    from automarine_cli.workflows.plan import plan as command

    return options.perform(command, given)
