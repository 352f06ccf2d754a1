"""Linear drag: laminar friction, dominant at low rates."""

from automarine_cli.effects.base import Effect, Floats, Parameter, State, inf


class LinearDrag(Effect):
    name = "linear-drag"
    parameters = (Parameter("{linear}", "linear {motion} drag", "{force} s{/x}", 0.0, inf, 0.05),)
    equation = "-{linear} {v}"
    says = "Part of the drag grows with the {rate} itself, not with its square."
    reveals = "low {forces}, and coast-downs, which end exponentially instead of as 1/t"
    mistaken_for = ("coulomb-drag", "dead-band", "thrust-exponent")
    separated_by = "a coast-down below the {speed} where both drags are equal"
    source = "Fossen (1994), Guidance and Control of Ocean Vehicles"
    role = "linear"
    power = 1

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats:
        return -values[0] * state.relative
