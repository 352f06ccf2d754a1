"""A hull that drags more turning one way than the other."""

from automarine_cli.effects.base import ODD, Effect, Floats, Parameter, State, inf


class DragAsymmetry(Effect):
    name = "drag-asymmetry"
    parameters = (
        Parameter(
            "e", "half the difference of quadratic drag {to_positive} and {to_negative}", "{force} s²{/x2}", -inf, inf,
            0.05,
        ),
    )  # fmt: skip
    equation = "-e {v}²"
    says = "Drag is larger when {moving} one way than the other."
    reveals = "equal {forces} {both_ways}, and a coast-down {each_way}"
    mistaken_for = ("thrust-asymmetry", "bias-moment")
    separated_by = "a coast-down {each_way}: drag differs in it, thrust does not"
    source = "asymmetric appendages; Fossen (2011), Handbook of Marine Craft Hydrodynamics, section 7"
    parity = ODD
    role = "difference"
    power = 2

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats:
        return -values[0] * state.relative**2
