"""Thrusters that do nothing below a smallest command."""

import numpy as np

from automarine_cli.effects.base import Commands, Effect, Floats, Parameter, Place


class DeadBand(Effect):
    """sgn(tau) max(|tau| - width, 0)."""

    name = "dead-band"
    place = Place.ACTUATOR
    parameters = (Parameter("width", "half width of the dead-band", "{moment}", 0.0, float("inf"), 0.03),)
    equation = "tau_delivered = sgn(tau) max(|tau| - width, 0)"
    says = "The thrusters give nothing below a smallest moment, and that much less above it."
    reveals = "slow ramps through zero, and the smallest moments"
    mistaken_for = ("coulomb-drag", "linear-drag", "thrust-exponent")
    separated_by = "a coast-down: a dead-band leaves it alone, Coulomb drag stops it in finite time"
    source = "Blue Robotics T200 performance data (2019): no thrust within 7 to 10 % of the command range"

    def deliver(self, commands: Commands, values: tuple[Floats, ...]) -> Floats:
        (width,) = values
        return np.sign(commands.moment) * np.maximum(np.abs(commands.moment) - width, 0.0)
