"""A hull that drags more moving one way than the other, in proportion to its speed."""

import numpy as np

from automarine_cli.dofs import Dof
from automarine_cli.effects.base import ODD, Effect, Floats, Parameter, State, inf


class LinearDragAsymmetry(Effect):
    name = "linear-drag-asymmetry"
    parameters = (
        Parameter(
            "e", "half the difference of linear drag {to_positive} and {to_negative}", "{force} s{/x}", -inf, inf, 0.05
        ),
    )
    equation = "-e |{v}|"
    says = "Linear drag is larger when {moving} one way than the other."
    reveals = "equal {forces} {both_ways}, and a coast-down {each_way}"
    mistaken_for = ("thrust-asymmetry", "bias-moment", "drag-asymmetry")
    separated_by = "coast-downs {each_way} from a small and a large {speed}"
    source = "asymmetric appendages; Fossen (2011), Handbook of Marine Craft Hydrodynamics, section 7"
    parity = ODD
    role = "difference"
    power = 1

    def acts_in(self, dof: Dof) -> bool:
        return dof.directional

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats:
        return -values[0] * np.abs(state.relative)
