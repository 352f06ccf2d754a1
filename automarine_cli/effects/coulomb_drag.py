"""Dry friction: a tether that scuffs the floor, a seal."""

import numpy as np

from automarine_cli.effects.base import Effect, Floats, Parameter, Place, State

CREEP = 0.02  # rad/s within which the sign is smoothed, far below any rate that a step reaches


class CoulombDrag(Effect):
    """-c sgn(r), smoothed within CREEP."""

    name = "coulomb-drag"
    place = Place.MOMENT
    parameters = (Parameter("c", "dry friction {force}", "{force}", 0.0, float("inf"), 0.03),)
    equation = "-c sgn({v})"
    says = "A friction {force} of constant size opposes every motion."
    reveals = (
        "the ends of coast-downs, which stop in finite time, and small {forces}, which do not start the "
        "vehicle"
    )
    mistaken_for = ("dead-band", "linear-drag")
    separated_by = "a coast-down: Coulomb drag stops it in finite time, a dead-band leaves it alone"
    source = "Olsson et al. (1998), Friction models and friction compensation, European J. Control 4:176"
    power = 0

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats:
        (c,) = values
        return -c * np.tanh(state.velocity / CREEP)
