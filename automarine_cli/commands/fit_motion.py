"""`fit-yaw`, `fit-surge`, `fit-sway`, `fit-heave`: step runs -> drag (Table 1), inertia (Table 2), model, figures;
whole runs where there are no steps. `fit-roll`, `fit-pitch`: free decays -> period, damping, restoring moment.
`fit-planar`: logs of motion in the plane -> surge, sway and yaw together, with what couples them."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import click

from automarine_cli.commands import options
from automarine_cli.commands.command import INPUT, Command, Function, command, option
from automarine_cli.dofs import DOFS, HEAVE, PITCH, PLANAR, ROLL, SURGE, SWAY, YAW, Dof
from automarine_cli.errors import SettingError

if TYPE_CHECKING:
    from automarine_cli.fits.identify import YawFit
    from automarine_cli.fits.planar_fit import PlanarFit
    from automarine_cli.pipeline.parallel import Each, Progress
    from automarine_cli.runs.half_turn import Trim

WHOLE_RUNS = "whole-runs"
HELP = """Identify the yaw model from step runs: drag (Table 1) and inertia (Table 2).

    Logs need heading_deg and tau (or n_port and n_stbd with --thrusters and --arm). Each run is trimmed to its
    first half-turn and fitted twice: by the paper's method, and by maximum likelihood. Logs without steps are
    fitted as whole runs.

    \b
    Example:
      automarine fit-yaw sample_runs/steps -o out/yaw
      automarine fit-yaw sample_runs/steps --tail 90
    """
HELP_OF_TRANSLATION = """Identify the {motion} model from step runs: {results}.

    Logs need {columns}. Each step is fitted twice, as by fit-yaw{more} Logs without steps are fitted as whole runs.

    \b
    Example:
      automarine fit-{motion} sample_runs/{motion} {part} -o out/{motion}
      automarine fit-{motion} sample_runs/{motion} {part} --tail {tail}
    """
HELP_OF_SWING = """Identify the {motion} model from free decays: natural period, damping, restoring moment.

    Logs need {motion}_deg, and {moment}_Nm (or {moment}, normalised) if a moment was commanded. Heel the vehicle, let
    go, and log until it is still. Decays alone give ratios to the inertia; with --known or --mass they give more.

    \b
    Example:
      automarine fit-{motion} sample_runs/roll -o out/{motion}
      automarine fit-{motion} DECAYS --known I_{rate}=1.9 --mass 38
    """
DRAG_AND_MASS = "distance against force, drag (Table 1) and mass (Table 2)"
HELPS = {
    "yaw": HELP,
    "surge": HELP_OF_TRANSLATION.format(
        motion="surge", results=DRAG_AND_MASS, part="--within 3", tail="1.5",
        columns="distance_m and force_X_N (or X, normalised; or n_port and n_stbd with --thrusters)",
        more=". If drag ahead and astern differ, both are given.",
    ),
    "sway": HELP_OF_TRANSLATION.format(
        motion="sway", results=DRAG_AND_MASS, part="--within 3", tail="1.5",
        columns="distance_m and force_Y_N (or Y, normalised), positive to starboard",
        more=". Drag is the same to both sides.",
    ),
    "heave": HELP_OF_TRANSLATION.format(
        motion="heave", results="depth against force, drag, mass, and the vehicle's buoyancy", part="--depths 0.2 3",
        columns="depth_m and force_Z_N (or Z, normalised; or n_vert with --thrusters), all positive down", tail="1.2",
        more=", together with a constant force. If drag down and up differ, both are given.",
    ),
    "roll": HELP_OF_SWING.format(motion="roll", moment="K", rate="p"),
    "pitch": HELP_OF_SWING.format(motion="pitch", moment="M", rate="q").replace("sample_runs/roll", "DECAYS"),
}  # fmt: skip
length = option(
    "--length", type=options.POSITIVE, metavar="METRES", seldom=True,
    help="Vehicle's length, for K and T of a rudder in the prime system.",
)  # fmt: skip
within = option(
    "--within", type=options.POSITIVE, metavar="METRES",
    help="Use this many metres of each step, to end before the wall is felt.  [default: to its end]",
)  # fmt: skip
depths = option(
    "--depths", nargs=2, type=float, metavar="FROM TO",
    help="Use each step between these depths in metres, clear of surface and bottom.",
)  # fmt: skip
mass = option(
    "--mass", type=options.POSITIVE, metavar="KG",
    help="Flooded mass, for the metacentric height in metres.",
)  # fmt: skip


def _fit(
    dof: Dof, *, logs: Sequence[Any], columns: Any, channels: str, with_effects: tuple[str, ...], known: Any,
    strict: bool, jobs: int, map_fn: "Each", progress: "Progress", fit_to: str = "auto", tail: float | None = None,
    mass: float | None = None, length: float | None = None, thrusters: Any = None, arm: float | None = None,
    within: float | None = None, depths: tuple[float, float] | None = None,
) -> "YawFit":  # fmt: skip
    from automarine_cli import effects
    from automarine_cli.fits.driven import parse_effects
    from automarine_cli.fits.identify import identify_turns
    from automarine_cli.fits.known import names_in, parse_known, qualified
    from automarine_cli.fits.paper import parse_tail
    from automarine_cli.models.model import COMMAND_DELAY
    from automarine_cli.report.fit_report import warnings_of
    from automarine_cli.runs.frames import frame_warnings
    from automarine_cli.runs.half_turn import half_turns
    from automarine_cli.runs.load import append_exclusions, load_runs, require_usable
    from automarine_cli.runs.run import command_warnings
    from automarine_cli.thrusters.map import moment_maker

    if tail is not None and fit_to == WHOLE_RUNS:
        raise SettingError("tail is given, but whole runs have no tails; leave it out, or fit to steps")
    tail_start, trim = parse_tail(tail, dof), _trim(within, depths)
    names = parse_effects(with_effects, dof)
    if names and fit_to not in ("auto", WHOLE_RUNS):
        raise SettingError(f"--with fits whole runs; leave out --fit-to {fit_to}")
    parameters = [f"{name}.{parameter}" for name in names for parameter in effects.get(name).names_in(dof)]
    signed = (dof.parameter("constant"), COMMAND_DELAY, *parameters)
    priors = qualified(parse_known(known), names_in(dof, parameters), signed)
    drive = moment_maker(thrusters, arm, columns, dof)
    campaign = load_runs(logs, columns, dof=dof, strict=strict, progress=progress, jobs=jobs)
    runs = [run if drive is None else drive(run) for run in campaign.runs]
    turns, not_turned = ((), ()) if dof.restoring else half_turns(runs, trim)
    with append_exclusions(campaign.set_aside):
        fit = identify_turns(
            dof, turns, not_turned, [trim.of_whole(run) for run in runs],
            fit_to="half-turns" if fit_to == "steps" else fit_to, priors=priors, map_jobs=map_fn, channels=channels,
            tail=tail_start, with_effects=names, mass=mass, length=length,
        )  # fmt: skip
    limits = [limit.warning for limit in campaign.limits if limit.dof is dof]
    warnings = [*command_warnings(runs), *frame_warnings(runs), *limits, *warnings_of(fit)]
    fit = replace(fit, set_aside=(*campaign.set_aside, *fit.set_aside), warnings=tuple(warnings))
    require_usable(runs, fit.set_aside, len(campaign.inputs), strict)
    return fit


def _trim(within: float | None, depths: tuple[float, float] | None) -> "Trim":
    from automarine_cli.runs.half_turn import UNTRIMMED, Trim

    if depths is not None:
        if not depths[0] < depths[1]:
            raise SettingError(f"depths are {depths[0]:g} and {depths[1]:g}; expected the smaller one first")
        return Trim(None, *depths)
    return UNTRIMMED if within is None else Trim(within)


def _command(dof: Dof, *particular: Callable[[Function], Function]) -> Command:
    steps, unit, limits = ("half-turns", "DEGREES", "15 to 165") if dof is YAW else ("steps", "METRES", "above 0")
    fit_to = option(
        "--fit-to", type=click.Choice(("auto", steps, WHOLE_RUNS)), default="auto", show_default=True,
        help=f"Part of the runs to fit. auto takes {steps} if enough runs have them.",
    )  # fmt: skip

    tail = option(
        "--tail", type=options.Checked("fits.paper:parse_tail", dof, type=options.Finite()), metavar=unit,
        help=f"Where the steady part of a step begins, {limits}, for the paper's method.  [default: where the expected "
        f"error of drag and {dof.words.inertia} is smallest]",
    )  # fmt: skip

    channels = option(
        "--channels", type=options.Checked("runs.channels:parse_channels", dof), default="auto", show_default=True,
        metavar="WHICH", seldom=True, group=INPUT, help=options.CHANNELS_HELP,
    )  # fmt: skip

    effect_names = options.Checked("fits.driven:parse_effects", dof, type=options.Names())
    with_effects = option(
        "--with", "with_effects", default="", type=effect_names, metavar="EFFECTS", seldom=True,
        help="Effects to fit with the drag, each in its likeliest law, such as dead-band,input-delay; fits whole runs.",
    )  # fmt: skip

    fit: Function = partial(_fit, dof)
    fit.__doc__ = HELPS[dof.name]
    of_steps = () if dof.restoring else (fit_to, tail)
    declared = options.together(
        *particular[1:], options.logs, options.columns, *particular[:1], *of_steps, channels,
        with_effects, options.known_parameters, options.ending(options.strict, options.jobs),
    )  # fmt: skip
    then = f"automarine validate OTHER_LOGS --model {{out}}/{dof.name}_model.json"
    return command(f"fit-{dof.name}", report="fit_report", then=then)(declared(fit))


FITS = {
    YAW.name: _command(YAW, options.together(options.thrusters, options.arm), length),
    SURGE.name: _command(SURGE, options.thrusters, within),
    SWAY.name: _command(SWAY, options.together(), within),
    HEAVE.name: _command(HEAVE, options.thrusters, depths),
    ROLL.name: _command(ROLL, mass),
    PITCH.name: _command(PITCH, mass),
}
"""What fits each motion, by its name."""
fit_yaw, fit_surge, fit_sway, fit_heave, fit_roll, fit_pitch = FITS.values()
assert FITS.keys() == DOFS.keys()


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
    from automarine_cli.fits.planar_fit import PlanarFit, PlanarLikelihood, search
    from automarine_cli.fits.planar_structure import OWN, observed, with_rudder
    from automarine_cli.runs.frames import frame_warnings
    from automarine_cli.runs.run import command_warnings
    from automarine_cli.thrusters.map import load_planar

    beforehand = parse_known(known)
    campaign = load_planar(logs, columns, thrusters, arm, strict=strict, jobs=jobs, progress=progress)
    channels = observed(campaign.runs)
    warnings = [*command_warnings(campaign.runs), *frame_warnings(campaign.runs)]
    warnings += [limit.warning for limit in campaign.limits]
    names = channels.names()
    priors = qualified(beforehand, names, signed=sorted({*names.values()} - {*OWN}))
    names_with_rudder = with_rudder(parse_effects(with_effects, *PLANAR.dofs), campaign.runs, channels)
    fit = PlanarLikelihood(campaign.runs, channels, priors, names_with_rudder)
    tried = search(fit)
    return PlanarFit(tried, *fit.choose(tried), campaign.runs, channels, campaign.set_aside, tuple(warnings), priors)
