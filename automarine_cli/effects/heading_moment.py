"""A moment that depends on where the vehicle points: current, a magnetised tether, the pool's shape."""

import numpy as np

from automarine_cli.effects.base import MIXED, Effect, Floats, Parameter, State, inf


class HeadingMoment(Effect):
    name = "heading-moment"
    parameters = (
        Parameter("b", "sine part", "{force}", -inf, inf, 0.03),
        Parameter("c", "cosine part", "{force}", -inf, inf, 0.0),
    )
    equation = "b sin psi + c cos psi"
    says = "A moment turns the vehicle towards one heading, like a weathervane."
    reveals = "several start headings, whole turns at a small moment, rest records at several headings"
    mistaken_for = ("compass-deviation", "bias-moment")
    separated_by = (
        "start headings a quarter turn apart, at a small and a large moment: a moment fades with the "
        "moment's size, a compass does not"
    )
    source = "Fossen (2011), Handbook of Marine Craft Hydrodynamics, section 8 (current and weathervaning)"
    parity = MIXED
    uses_position = True
    uses_absolute = True
    rotational = True

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats:
        b, c = values
        return b * np.sin(state.position) + c * np.cos(state.position)
