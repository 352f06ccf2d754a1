"""Thrusters that do nothing below a smallest command."""

import numpy as np

from automarine_cli.effects.base import Commands, Effect, Floats, Parameter, Place

EDGE = 0.1
CUTS = tuple(0.02 * 1.3**i for i in range(14))
"""Widths at which a cut is tried, as shares of the largest moment."""


class DeadBand(Effect):
    """Nothing below a width; above it that much less, or, where the controller only cuts small commands, all of it.

    The cut is smoothed over EDGE of the width, within which no test's moments could place it.
    """

    name = "dead-band"
    place = Place.ACTUATOR
    parameters = (
        Parameter("width", "half width of the dead-band", "{force}", 0.0, float("inf"), 0.03),
        Parameter("law", "what is left above the width", "1", 0.0, 1.0, 0.0, choices=("the rest", "all")),
    )
    equation = "{f}_delivered = sgn({f}) max(|{f}| - width, 0), or {f} where |{f}| > width, else 0"
    says = "The thrusters give nothing below a smallest {force}."
    reveals = "slow ramps through zero, and the smallest {forces}"
    mistaken_for = ("coulomb-drag", "linear-drag", "thrust-exponent")
    separated_by = "a coast-down: a dead-band leaves it alone, Coulomb drag stops it in finite time"
    source = "Blue Robotics T200 performance data (2019): no thrust within 7 to 10 % of the command range"

    def deliver(self, commands: Commands, values: tuple[Floats, ...]) -> Floats:
        width, law = values
        size = np.abs(commands.force)
        left = np.maximum(size - width, 0.0)
        if law.any():
            share = (size - width) / np.maximum(2.0 * EDGE * width, 1e-12) + 0.5
            left = np.where(law > 0, size * np.clip(share, 0.0, 1.0), left)
        return np.sign(commands.force) * left

    def scan(self, parameter: Parameter, values: tuple[float, ...]) -> tuple[float, ...]:
        """A cut has no slope to follow where no moment lies near it."""
        return CUTS if values[1] and parameter.name == "width" else ()
