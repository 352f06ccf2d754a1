"""Dry friction: a tether that scuffs the floor, a seal."""

import numpy as np

from automarine_cli.effects.base import Effect, Floats, Law, Parameter, State, choice, inf

CREEP = 0.02  # rad/s within which the sign is smoothed, far below any rate that a step reaches


class CoulombDrag(Effect):
    name = "coulomb-drag"
    parameters = (
        Parameter("c", "dry friction {force}", "{force}", 0.0, inf, 0.03),
        choice("law", "whether it grows near rest", "the same; Stribeck"),
        Parameter("c_s", "what is more of it at rest", "{force}", 0.0, inf, 0.03, off=0.0, laws=(1,)),
        Parameter(
            "v_s", "{speed} at which that has faded to 1/e", "{x}/s", 0.02, 2.0, 0.15, scan=(0.07, 0.15, 0.3), log=True,
            laws=(1,),
        ),
    )  # fmt: skip
    equation = "-c sgn({v})"
    says = "A friction {force} of constant size opposes every motion."
    reveals = "the ends of coast-downs, which stop in finite time, and small {forces}, which do not start the vehicle"
    mistaken_for = ("dead-band", "linear-drag")
    separated_by = "a coast-down: Coulomb drag stops it in finite time, a dead-band leaves it alone"
    source = "Olsson et al. (1998), Friction models and friction compensation, European J. Control 4:176"
    laws = (
        Law(
            "-(c + c_s exp(-({v}/v_s)^2)) sgn({v})",
            "Armstrong-Helouvry, Dupont and Canudas de Wit (1994), Automatica 30:1083",
        ),
    )
    power = 0

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats:
        c, law, more, fades = values
        if law.any():
            c = c + law * more * np.exp(-((state.velocity / fades) ** 2))
        return -c * np.tanh(state.velocity / CREEP)
