"""`plan`: what is still unsure and what a day at the pool allows -> the runs of the next campaign."""

from typing import TYPE_CHECKING, Any

import click

from automarine_cli.commands import options
from automarine_cli.commands.command import argument, command, option
from automarine_cli.pipeline.parallel import Progress

if TYPE_CHECKING:
    from automarine_cli.planning.campaign import Plan


def _print_example(ctx: click.Context, param: click.Parameter, value: bool) -> None:
    if value and not ctx.resilient_parsing:
        from automarine_cli.planning.candidates import example_limits

        click.echo(example_limits(), nl=False)
        ctx.exit()


@command("plan", report="plan_report")
@argument("model", type=options.FILE, metavar="[MODEL.json]", required=False, reads="file")
@option(
    "--diagnosis", type=options.FILE, metavar="FILE", reads="file",
    help="A diagnosis.json whose rivals the runs should separate.",
)  # fmt: skip
@option(
    "--limits", type=options.FILE, metavar="FILE.toml", reads="file",
    help="Limits of time, battery and moments at the pool.",
)  # fmt: skip
@click.option(
    "--example-limits", is_flag=True, is_eager=True, expose_value=False, callback=_print_example,
    help="Print a limits file with every setting and its default, and exit.",
)  # fmt: skip
@option(
    "--parameter", "parameters", multiple=True, metavar="NAME",
    help="Shrink the interval of this parameter (k_rr, I_r, ...); may be repeated.  [default: all]",
)  # fmt: skip
@option(
    "--thruster-tests", multiple=True, type=click.Path(readable=False), metavar="LOG", reads="logs",
    role="thruster_tests", help="Bollard tests with a current or power column, for the battery; may be repeated.",
)  # fmt: skip
@options.thrusters
@options.arm
@options.columns
@options.ending(options.seed, options.jobs)
def plan(progress: Progress, **settings: Any) -> "Plan":
    """Plan the next pool campaign for a yaw model: which runs, in which order, and what intervals to expect.

    Runs are chosen by Fisher information within the limits of time, battery and moments. The choice allows for what
    differs from run to run. With a diagnosis, runs that separate its rivals come first. Without a model the plan is a
    first campaign: the paper's steps, to both sides, as many as the limits allow.

    \b
    Example:
      automarine fit-yaw sample_runs/steps -o out/yaw
      automarine plan out/yaw/yaw_model.json -o out/plan
    """
    from automarine_cli.planning.campaign import make_plan

    return make_plan(**settings, progress=progress)


plan.then = lambda result: f"drive these runs, then {result.fit_command}"
