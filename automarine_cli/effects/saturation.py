"""Thrusters that give no more than a largest moment: current limit or end of the map."""

import numpy as np

from automarine_cli.effects.base import Commands, Effect, Floats, Parameter, Place


class Saturation(Effect):
    """min(|tau|, tau_max) with the sign of tau."""

    name = "saturation"
    place = Place.ACTUATOR
    parameters = (
        Parameter(
            "tau_max",
            "largest {force}",
            "{force}",
            0.0,
            float("inf"),
            1.0,
            off=float("inf"),
            scan=(0.6, 0.75, 0.9),
        ),
    )
    equation = "{f}_delivered = sgn({f}) min(|{f}|, tau_max)"
    says = "The thrusters give no more than a largest {force}, whatever is commanded."
    reveals = "the highest {forces}: the steady {speed} stops rising"
    mistaken_for = ("cubic-drag", "battery-sag", "thrust-exponent")
    separated_by = "more levels above and below the suspected limit"
    source = "Blanke, Lindegaard and Fossen (2000), Dynamic model for thrust generation of marine propellers"

    def deliver(self, commands: Commands, values: tuple[Floats, ...]) -> Floats:
        (tau_max,) = values
        return np.sign(commands.force) * np.minimum(np.abs(commands.force), tau_max)
