"""Quadratic drag: form drag of a bluff body, the usual yaw drag of a small ROV."""

import numpy as np

from automarine_cli.effects.base import Effect, Parameter, Place, State
from automarine_cli.quantities import Floats


class QuadraticDrag(Effect):
    """-k_rr |r| r; the whole drag of model 3, one of two terms of model 2."""

    name = "quadratic-drag"
    place = Place.MOMENT
    parameters = (Parameter("{quadratic}", "quadratic {motion} drag", "{force} s²{/x2}", 0.0, float("inf"), 1.0),)
    equation = "-{quadratic} |{v}| {v}"
    says = "Part of the drag grows with the square of the {rate}."
    reveals = "high {forces}, and the first seconds of coast-downs"
    mistaken_for = ("cubic-drag", "linear-drag")
    separated_by = "{forces} over a range of ten or more"
    source = "Fossen (1994), Guidance and Control of Ocean Vehicles"
    role = "quadratic"
    power = 2

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats:
        (k_rr,) = values
        return -k_rr * np.abs(state.relative) * state.relative
