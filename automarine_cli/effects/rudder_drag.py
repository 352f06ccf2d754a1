"""Drag of a rudder: with the square of its angle and of the speed."""

import numpy as np

from automarine_cli.dofs import Dof
from automarine_cli.effects.base import Effect, Floats, Parameter, State, inf


class RudderDrag(Effect):
    name = "rudder-drag"
    parameters = (
        Parameter("{letter}_deltadelta", "drag by squares of the angle and the speed", "{force} s²/m²", 0.0, inf, 0.1),
    )
    equation = "-{letter}_deltadelta delta² {v} |{v}|"
    says = "The rudder resists the way ahead when it is put over."
    reveals = "zigzags of the rudder next to straight courses under the same thrust"
    mistaken_for = ("quadratic-drag", "thrust-loss")
    separated_by = "large rudder angles to both sides that last too short for the hull to drift"
    source = "Yasukawa and Yoshimura (2015), J. Marine Science and Technology 20:37 (F_N sin delta, small angles)"
    needs = ("rudder",)

    def acts_in(self, dof: Dof) -> bool:
        return dof.name == "surge"

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats:
        return -values[0] * state.signals["rudder"] ** 2 * state.relative * np.abs(state.relative)
