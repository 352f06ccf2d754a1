"""`effects`: the library of effects, as a list or as the whole card of one."""

from typing import Any

from automarine_cli.commands import options
from automarine_cli.commands.command import argument, command, option
from automarine_cli.dofs import DOFS, YAW
from automarine_cli.errors import SettingError


@command("effects", report="effect_cards", saves=False)
@argument("name", required=False, metavar="[NAME]")
@option(
    "--motion", metavar="MOTION",
    help="yaw, surge, sway or heave: only what may act there, in its units.  [default: every effect, in those of yaw]",
)  # fmt: skip
@options.together(options.as_json, options.verbosity)
def effects(name: str | None, motion: str | None) -> Any:
    """List the effects that a model may have and that diagnose can name.

    Without NAME: name, place, equation and parameters of each. With NAME the whole card: what the effect and its
    parameters mean, which runs reveal it, its look-alikes, the run that separates them, and the source.

    \b
    Example:
      automarine effects dead-band
    """
    from automarine_cli import effects as library
    from automarine_cli.report.effect_cards import EffectCards
    from automarine_cli.text import listed

    if motion is not None and motion not in DOFS:
        raise SettingError(f"motion {motion!r} is not known; known are {', '.join(DOFS)}")
    dof = YAW if motion is None else DOFS[motion]
    cards = tuple(library.get(effect) for effect in (library.names() if name is None else (name,)))
    acting = tuple(effect for effect in cards if motion is None or effect.acts_in(dof))
    if not acting:
        motions = cards[0].motions
        raise SettingError(f"{name} does not act in {motion}; it acts in {listed(motions)}: give --motion {motions[0]}")
    return EffectCards(acting, name is not None, dof, motion is None)


effects.then = lambda result: f"automarine {'diagnose LOGS --model FILE' if result.in_full else 'effects NAME'}"
