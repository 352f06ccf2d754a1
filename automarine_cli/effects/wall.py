"""A wall beside the vehicle: drag or thrust that differs with the heading, twice in a turn."""

import numpy as np

from automarine_cli.effects.base import MIXED, Effect, Floats, Law, Parameter, State, choice, choose, inf


class Wall(Effect):
    name = "wall"
    parameters = (
        Parameter("p", "cosine part", "{force} s^2/{x}^2", -inf, inf, 0.1),
        Parameter("q", "sine part", "{force} s^2/{x}^2", -inf, inf, 0.0),
        choice("law", "what differs", "drag; thrust"),
        Parameter("p_f", "share of the thrust lost, cosine part", "1", -0.9, 0.9, 0.05, off=0.0, laws=(1,)),
        Parameter("q_f", "share of the thrust lost, sine part", "1", -0.9, 0.9, 0.0, laws=(1,)),
    )
    equation = "-(p cos 2 psi + q sin 2 psi) |{v}| {v}"
    says = "Drag or thrust differs with the heading, twice in a turn, as near a wall."
    reveals = "whole turns, several start headings, the same run at another place of the pool"
    mistaken_for = ("heading-moment", "compass-deviation")
    separated_by = "the same run in the middle of the pool and at its wall"
    source = "Brennen (1982), NCEL report CR 82.010; Korotkin (2009), Added Masses of Ship Structures"
    laws = (
        Law(
            "-(p_f cos 2 psi + q_f sin 2 psi) {f}",
            "Nienhuis (1992), Analysis of thruster effectivity for dynamic positioning and low speed manoeuvring, "
            "thesis, Delft (thrusters at a plate)",
        ),
    )
    parity = MIXED
    uses_position = True
    uses_absolute = True
    rotational = True

    def held(self, values: tuple[float, ...]) -> tuple[bool, ...]:
        thrust = self.law(values) == 1
        return (thrust, thrust, True, not thrust, not thrust)

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats:
        p, q, law, p_f, q_f = values
        cosine, sine = np.cos(2.0 * state.position), np.sin(2.0 * state.position)
        return choose(
            law,
            lambda: -(p * cosine + q * sine) * np.abs(state.relative) * state.relative,
            lambda: -(p_f * cosine + q_f * sine) * state.delivered,
        )
