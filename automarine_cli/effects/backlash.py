"""Thrusters that follow a command only once it has moved by a play: gears, linkages, hysteresis."""

import numpy as np

from automarine_cli.effects.base import Commands, Effect, Floats, Parameter, Place, inf


class Backlash(Effect):
    name = "backlash"
    place = Place.ACTUATOR
    returning = True
    parameters = (Parameter("width", "half width of the play", "{force}", 0.0, inf, 0.05),)
    equation = "{f}_delivered stays until |{f} - {f}_delivered| > width, then follows that far behind"
    says = "The thrusters follow a command only once it has moved by a play."
    reveals = "the same {force} reached from above and from below, and {forces} that return to zero"
    mistaken_for = ("dead-band", "coulomb-drag")
    separated_by = "a {force} reached from above as well as from below: a dead-band never leaves anything behind"
    source = "Nordin and Gutman (2002), Controlling mechanical systems with backlash: a survey, Automatica 38:1633"

    def deliver(self, commands: Commands, values: tuple[Floats, ...]) -> Floats:
        (width,) = values
        low, high = np.broadcast_arrays(commands.force - width, commands.force + width)
        delivered = np.empty(low.shape)
        begun = commands.before - np.clip(commands.before, -width, width)  # come to from nothing
        now = np.broadcast_to(begun, (*low.shape[:2], 1))[..., 0]
        for m in range(low.shape[2]):
            delivered[..., m] = now = np.clip(now, low[..., m], high[..., m])
        return delivered
