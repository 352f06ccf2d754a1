"""Thrust that does not grow as the map says: another power of the command."""

import numpy as np

from automarine_cli.effects.base import Commands, Effect, Floats, Parameter, Place, reference


class ThrustExponent(Effect):
    name = "thrust-exponent"
    place = Place.ACTUATOR
    parameters = (
        Parameter("p", "exponent of the {force} delivered against the one commanded", "1", 0.3, 3.0, 0.9, off=1.0),
        reference("tau_ref", "{force} that both agree on"),
    )
    equation = "{f}_delivered = sgn({f}) tau_ref (|{f}|/tau_ref)^p"
    says = "Thrust grows with another power of the command than the map says."
    reveals = "a bollard test over the whole range of commands"
    mistaken_for = ("dead-band", "linear-drag", "battery-sag")
    separated_by = "a bollard test, or {forces} over a range of ten and a coast-down"
    source = "Blue Robotics T200 performance data (2019): thrust as command to the power 1.64 to 1.69"

    def deliver(self, commands: Commands, values: tuple[Floats, ...]) -> Floats:
        p, agreed = values
        return np.sign(commands.force) * agreed * (np.abs(commands.force) / agreed) ** p
