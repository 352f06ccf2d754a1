"""Propellers that lose thrust when the vehicle's turn feeds them (advance speed, momentum drag)."""

import numpy as np

from automarine_cli.effects.base import Effect, Floats, Parameter, Place, State


class ThrustLoss(Effect):
    """-b n r with n = sqrt|tau|, the second term of the bilinear thruster model."""

    name = "thrust-loss"
    place = Place.MOMENT
    parameters = (
        Parameter(
            "b",
            "loss of {force} by {speed} and root of {force}",
            "({force})^1/2 s{/x}",
            0.0,
            float("inf"),
            0.05,
        ),
    )
    equation = "-b sqrt|{f}| {v}"
    says = "Thrust falls as the {move} feeds the propellers with moving water."
    reveals = (
        "reversals at speed and coast-downs; nothing at all in steps from rest, where it hides in drag and "
        "{inertia}"
    )
    mistaken_for = ("quadratic-drag", "linear-drag")
    separated_by = "coast-downs (no propeller turns) beside steps"
    source = "Fossen (1994), bilinear thruster model: equation 1 of Stipanov et al. (2007)"

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats:
        (b,) = values
        return -b * np.sqrt(np.abs(state.delivered)) * state.velocity
