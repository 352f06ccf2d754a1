"""Cubic drag: drag that grows faster than the square, as quadratic coefficients rise with Reynolds number
or tilt."""

from automarine_cli.effects.base import Effect, Floats, Parameter, Place, State


class CubicDrag(Effect):
    """-k_rrr r³, the second term of Norrbin's steering models."""

    name = "cubic-drag"
    place = Place.MOMENT
    parameters = (Parameter("k_rrr", "cubic yaw drag", "{moment} s³", 0.0, float("inf"), 0.1),)
    equation = "-k_rrr r³"
    says = "Drag at high rates grows faster than the square of the yaw rate."
    reveals = "high moments against middle ones, and the first second of coast-downs from high rates"
    mistaken_for = ("battery-sag", "saturation", "thrust-exponent")
    separated_by = "a coast-down from the highest rate (drag without thrust), or a square wave"
    source = "Norrbin (1971), Theory and observations on the use of a mathematical model for ship manoeuvring"

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats:
        (k_rrr,) = values
        return -k_rrr * state.relative * state.relative * state.relative
