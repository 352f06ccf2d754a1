"""Quadratic drag: form drag of a bluff body, the usual yaw drag of a small ROV."""

import numpy as np

from automarine_cli.effects.base import Effect, Floats, Parameter, Place, State


class QuadraticDrag(Effect):
    """-k_rr |r| r; the whole drag of model 3, one of two terms of model 2."""

    name = "quadratic-drag"
    place = Place.MOMENT
    parameters = (Parameter("k_rr", "quadratic yaw drag", "{moment} s²", 0.0, float("inf"), 1.0),)
    equation = "-k_rr |r| r"
    says = "Part of the drag grows with the square of the yaw rate."
    reveals = "high moments, and the first seconds of coast-downs"
    mistaken_for = ("cubic-drag", "linear-drag")
    separated_by = "moments over a range of ten or more"
    source = "Fossen (1994), Guidance and Control of Ocean Vehicles"

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats:
        (k_rr,) = values
        return -k_rr * np.abs(state.relative) * state.relative
