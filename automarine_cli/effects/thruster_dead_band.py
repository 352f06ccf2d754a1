"""Single thrusters that do nothing below a smallest thrust: seen also where both together are asked for much."""

import numpy as np

from automarine_cli.effects.base import Commands, Floats, Parameter, inf
from automarine_cli.effects.thruster_imbalance import SingleThrusterEffect, each


class ThrusterDeadBand(SingleThrusterEffect):
    name = "thruster-dead-band"
    parameters = (Parameter("width", "half width of the dead-band of one thruster", "{force}", 0.0, inf, 0.03),)
    equation = "{f}_delivered = sum over thrusters of sgn({f}_i) max(|{f}_i| - width, 0)"
    says = "Each thruster gives nothing below a smallest share of the {force}."
    reveals = "small commands of one thruster with large ones of the other"
    mistaken_for = ("dead-band", "coulomb-drag", "thrust-exponent")
    separated_by = "a run with each thruster alone, forward and backward"
    source = "Blue Robotics T200 performance data (2019): no thrust within 7 to 10 % of the command range"

    def deliver(self, commands: Commands, values: tuple[Floats, ...]) -> Floats:
        return commands.force - sum(np.clip(thrust, -values[0], values[0]) for thrust in each(commands))
