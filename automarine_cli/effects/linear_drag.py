"""Linear drag: laminar friction, dominant at low rates."""

from automarine_cli.effects.base import Effect, Parameter, Place, State
from automarine_cli.quantities import Floats


class LinearDrag(Effect):
    """-k_r r; the whole drag of model 1, one of two terms of model 2."""

    name = "linear-drag"
    place = Place.MOMENT
    parameters = (Parameter("{linear}", "linear {motion} drag", "{force} s{/x}", 0.0, float("inf"), 0.05),)
    equation = "-{linear} {v}"
    says = "Part of the drag grows with the {rate} itself, not with its square."
    reveals = "low {forces}, and coast-downs, which end exponentially instead of as 1/t"
    mistaken_for = ("coulomb-drag", "dead-band", "thrust-exponent")
    separated_by = "a coast-down below the {speed} where both drags are equal"
    source = "Fossen (1994), Guidance and Control of Ocean Vehicles"
    role = "linear"
    power = 1

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats:
        (k_r,) = values
        return -k_r * state.relative
