"""Quadratic drag: form drag of a bluff body, the usual yaw drag of a small ROV."""

import numpy as np

from automarine_cli.effects.base import Effect, Floats, Parameter, State, inf


class QuadraticDrag(Effect):
    name = "quadratic-drag"
    parameters = (Parameter("{quadratic}", "quadratic {motion} drag", "{force} s²{/x2}", 0.0, inf, 1.0),)
    equation = "-{quadratic} |{v}| {v}"
    says = "Part of the drag grows with the square of the {rate}."
    reveals = "high {forces}, and the first seconds of coast-downs"
    mistaken_for = ("cubic-drag", "linear-drag")
    separated_by = "{forces} over a range of ten or more"
    source = "Fossen (1994), Guidance and Control of Ocean Vehicles"
    role = "quadratic"
    power = 2

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats:
        return -values[0] * np.abs(state.relative) * state.relative
