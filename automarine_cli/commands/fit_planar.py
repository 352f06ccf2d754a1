"""`fit-planar`: logs of motion in the plane -> surge, sway and yaw together, with what couples them."""

from typing import TYPE_CHECKING, Any

from automarine_cli.commands import options
from automarine_cli.commands.command import command, option
from automarine_cli.dofs import PLANAR

if TYPE_CHECKING:
    from automarine_cli.fits.planar_fit import PlanarFit


@command("fit-planar", report="fit_report", then="automarine validate OTHER_LOGS --model {out}/planar_model.json")
@options.logs
@options.columns
@options.thrusters
@options.arm
@option(
    "--with", "with_effects", default="", seldom=True, metavar="EFFECTS",
    type=options.Checked("fits.driven:parse_effects", *PLANAR.dofs, type=options.Names()),
    help="Effects to fit as well, such as rudder,rudder-drag.",
)  # fmt: skip
@options.known_parameters
@options.ending(options.strict, options.jobs)
def fit_planar(
    logs: Any, columns: Any, thrusters: Any, arm: float | None, with_effects: Any, known: Any, strict: bool, jobs: int,
    progress: Any,
) -> "PlanarFit":  # fmt: skip
    """Identify surge, sway and yaw together, and what couples them.

    The logs need the heading, and the surge speed, the sway speed or the position on the water. The evidence
    decides which drags, couplings and current the model has. What the logs do not show is assumed, and the
    result says so.

    \b
    Example:
      automarine fit-planar sample_runs/planar -o out/planar
    """
    from automarine_cli.fits.driven import parse_effects
    from automarine_cli.fits.known import parse_known, qualified
    from automarine_cli.fits.planar_fit import OWN, PlanarFit, PlanarLikelihood, observed, search
    from automarine_cli.runs.run import command_warnings
    from automarine_cli.thrusters.map import load_planar

    beforehand = parse_known(known)
    campaign = load_planar(logs, columns, thrusters, arm, strict=strict, jobs=jobs, progress=progress)
    channels, unfit = observed(campaign.runs), command_warnings(campaign.runs)
    names = channels.names()
    priors = qualified(beforehand, names, signed=sorted({*names.values()} - {*OWN}))
    effects = parse_effects(with_effects, *PLANAR.dofs)
    estimator = PlanarLikelihood(campaign.runs, channels, priors, effects)
    tried = search(estimator)
    limits = tuple(limit.warning for limit in campaign.limits)
    return PlanarFit(
        tried, *estimator.choose(tried), campaign.runs, channels, campaign.set_aside, (*unfit, *limits), priors
    )
