"""`automarine simulate`: options in, one workflow call, where the logs are."""

from pathlib import Path

import click

from automarine_cli.cli import options


@click.command("simulate", short_help="Make a pool campaign with known truth.")
@click.argument("specification", type=click.Path(exists=True, dir_okay=False, path_type=Path), metavar="SPEC.toml")
@click.option(
    "-o", "--out", type=click.Path(path_type=Path), required=True, metavar="DIR",
    help="Write the logs and the truth into this folder.",
)  # fmt: skip
@options.overwrite_option
@click.option(
    "--seed", type=click.IntRange(min=0), default=None, metavar="N", help="Instead of the specification's seed."
)
@options.jobs_option
@options.json_option
@options.verbosity
def simulate(**given: object) -> object:
    """A pool campaign with known truth, made from a specification.

    The specification says what vehicle is tested, what acts on it that a model may not know of, what the logger
    loses, and which runs are made: steps, coast-downs, reversals, sequences, ramps, rests, bollard tests. The
    same specification and seed give identical files. truth.json, beside the logs, holds the true values.

    \b
    Example:
      automarine simulate sample_runs/campaign.toml -o out/campaign
    """
    from automarine_cli.workflows.simulate import simulate as command

    return options.perform(command, given)
