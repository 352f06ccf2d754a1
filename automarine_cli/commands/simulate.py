"""`simulate`: a specification -> the logs of a pool campaign, and the truth beside them."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from automarine_cli.commands import options
from automarine_cli.commands.command import GENERAL, OUTPUT, argument, command, option
from automarine_cli.pipeline.parallel import Progress

if TYPE_CHECKING:
    from automarine_cli.report.log_tables import Simulation


@command("simulate", report="log_tables", then="automarine check {out}")
@argument("specification", type=options.FILE, metavar="SPEC.toml", reads="file", recorded=False)
@option(
    "-o", "--out", type=click.Path(path_type=Path), required=True, metavar="DIR", group=OUTPUT,
    help="Write the logs and the truth into this folder.",
)  # fmt: skip
@options.overwrite
@option("--seed", type=click.IntRange(min=0), metavar="N", group=GENERAL, help="Another seed than the specification's.")
@options.together(options.jobs, options.as_json, options.verbosity)
def simulate(specification: Any, seed: int, jobs: int, progress: Progress) -> "Simulation":
    """Make the logs of a pool campaign with known truth from a specification.

    The specification names the vehicle, the effects that a model may not know of, the noise of the logger, and the
    runs. The same specification and seed give identical files. truth.json contains the true values.

    \b
    Example:
      automarine simulate sample_runs/campaign.toml -o out/campaign
    """
    from automarine_cli.report.log_tables import Simulation
    from automarine_cli.simulation.campaign import make_campaign

    spec = _read(specification)
    return Simulation(spec, seed, make_campaign(spec, seed, jobs=jobs, progress=progress))


simulate.complete = lambda settings: (
    settings if settings["seed"] is not None else settings | {"seed": _read(settings["specification"]).seed}
)


def _read(specification: Any) -> Any:
    if not isinstance(specification, Path):
        return specification
    from automarine_cli.pipeline.records import read_mapping
    from automarine_cli.simulation.specification import specification_from
    from automarine_cli.text import printable

    return specification_from(read_mapping(specification), printable(specification.name))
