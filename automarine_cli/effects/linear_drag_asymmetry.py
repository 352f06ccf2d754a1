"""A hull that drags more moving one way than the other, in proportion to its speed."""

import numpy as np

from automarine_cli.effects.base import ODD, Effect, Floats, Parameter, Place, State


class LinearDragAsymmetry(Effect):
    """-e |r|: adds to the linear drag of motion one way, takes from it the other way."""

    name = "linear-drag-asymmetry"
    place = Place.MOMENT
    parameters = (
        Parameter(
            "e",
            "half the difference of linear drag to starboard and to port",
            "{moment} s",
            -float("inf"),
            float("inf"),
            0.05,
        ),
    )
    equation = "-e |r|"
    says = "Linear drag is larger when turning one way than the other."
    reveals = "equal moments to both sides, and a coast-down to each side"
    mistaken_for = ("thrust-asymmetry", "bias-moment", "drag-asymmetry")
    separated_by = "coast-downs to each side from a small and a large rate"
    source = "asymmetric appendages; Fossen (2011), Handbook of Marine Craft Hydrodynamics, section 7"
    parity = ODD
    axes = ("surge", "heave")

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats:
        (e,) = values
        return -e * np.abs(state.relative)
