"""Cubic drag: drag that grows faster than the square, as quadratic coefficients rise with Reynolds number
or tilt."""

from automarine_cli.effects.base import Effect, Floats, Parameter, State, inf


class CubicDrag(Effect):
    name = "cubic-drag"
    parameters = (Parameter("{cubic}", "cubic {motion} drag", "{force} s³{/x3}", 0.0, inf, 0.1),)
    equation = "-{cubic} {v}³"
    says = "Drag at high {speeds} grows faster than the square of the {rate}."
    reveals = "high {forces} against middle ones, and the first second of coast-downs from high {speeds}"
    mistaken_for = ("battery-sag", "saturation", "thrust-exponent")
    separated_by = "a coast-down from the highest {speed} (drag without thrust), or a square wave"
    source = "Norrbin (1971), Theory and observations on the use of a mathematical model for ship manoeuvring"
    power = 3

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats:
        return -values[0] * state.relative * state.relative * state.relative
