"""Rudder moment that follows the square of the speed, where the rudder itself is the command."""

import numpy as np

from automarine_cli.effects.base import Commands, Effect, Floats, Parameter, Place, inf


class RudderInflow(Effect):
    """At the speed U the moment is as commanded. Of the pressure there the propeller's race makes the share `race`, and
    keeps it while the vehicle slows down; with all of it in the race the speed does not matter."""

    name = "rudder-inflow"
    place = Place.ACTUATOR
    parameters = (
        Parameter("race", "share of the rudder's pressure that the propeller's race makes", "1", 0.0, 1.0, 0.5, 1.0),
        Parameter("U", "speed at which the {force} is as commanded", "m/s", -inf, inf, 1.0, reference="surge"),
    )
    equation = "{f}_delivered = {f} (race + (1 - race) u |u|/U²)"
    says = "The rudder's {force} follows the square of the speed."
    reveals = "zigzags of the rudder at two or more speeds ahead"
    mistaken_for = ("cross-coupling", "thrust-loss")
    separated_by = "small rudder angles at two speeds: large ones slow the vehicle down as they turn it"
    source = "Yasukawa and Yoshimura (2015), J. Marine Science and Technology 20:37 (inflow behind the propeller)"
    needs = ("surge", "rudder")
    steered = True
    rotational = True

    def deliver(self, commands: Commands, values: tuple[Floats, ...]) -> Floats:
        race, usual = values
        speed = commands.signals["surge"]
        return commands.force * (race + (1.0 - race) * speed * np.abs(speed) / usual**2)
