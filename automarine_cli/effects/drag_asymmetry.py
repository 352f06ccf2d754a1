"""A hull that drags more turning one way than the other."""

from automarine_cli.effects.base import ODD, Effect, Floats, Parameter, Place, State


class DragAsymmetry(Effect):
    """-e r²: adds to the quadratic drag on turns to starboard, takes from it on turns to port."""

    name = "drag-asymmetry"
    place = Place.MOMENT
    parameters = (
        Parameter(
            "e",
            "half the difference of quadratic drag to starboard and to port",
            "{moment} s²",
            -float("inf"),
            float("inf"),
            0.05,
        ),
    )
    equation = "-e r²"
    says = "Drag is larger when turning one way than the other."
    reveals = "equal moments to both sides, and a coast-down to each side"
    mistaken_for = ("thrust-asymmetry", "bias-moment")
    separated_by = "a coast-down to each side: drag differs in it, thrust does not"
    source = "asymmetric appendages; Fossen (2011), Handbook of Marine Craft Hydrodynamics, section 7"
    parity = ODD

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats:
        (e,) = values
        return -e * state.relative**2
