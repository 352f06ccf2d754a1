"""Single thrusters that give no more than a largest thrust, each for itself."""

import numpy as np

from automarine_cli.effects.base import Commands, Floats, Parameter, inf
from automarine_cli.effects.thruster_imbalance import SingleThrusterEffect, each


class ThrusterLimit(SingleThrusterEffect):
    name = "thruster-limit"
    parameters = (
        Parameter(
            "limit", "largest share of the {force} of one thruster", "{force}", 0.0, inf, 0.5, off=inf,
            scan=(0.25, 0.33, 0.42, 0.55, 0.7, 0.9),
        ),
    )  # fmt: skip
    equation = "{f}_delivered = sum over thrusters of sgn({f}_i) min(|{f}_i|, limit)"
    says = "Each thruster gives no more than a largest share of the {force}, whatever is commanded."
    reveals = "the highest commands of one thruster with small ones of the other"
    mistaken_for = ("saturation", "cubic-drag", "thruster-imbalance")
    separated_by = "a run with each thruster alone, forward and backward"
    source = "Blanke, Lindegaard and Fossen (2000), Dynamic model for thrust generation of marine propellers"

    def deliver(self, commands: Commands, values: tuple[Floats, ...]) -> Floats:
        return commands.force - sum(thrust - np.clip(thrust, -values[0], values[0]) for thrust in each(commands))
