"""A tether that twists: a torsional spring towards the heading at which the run began."""

import numpy as np

from automarine_cli.effects.base import Effect, Floats, Law, Parameter, State, choice, choose, inf


class TetherSpring(Effect):
    name = "tether-spring"
    parameters = (
        Parameter("kappa", "{stiffness} of the tether", "{force}/{x}", 0.0, inf, 0.01),
        choice("law", "how it pulls", "taut; with slack; hardening"),
        Parameter("slack", "way before it pulls", "{x}", 0.0, 30.0, 1.0, scan=(0.7, 1.5, 3.0), laws=(1,)),
        Parameter("kappa_3", "part that grows with the cube", "{force}/{x}^3", 0.0, inf, 0.001, laws=(2,)),
    )
    equation = "-kappa ({x} - {x}_start)"
    says = "The tether pulls back like a {spring} as the vehicle {moves} away."
    reveals = "{moves} of {whole_way}, and {back_again}"
    mistaken_for = ("water-swirl", "linear-drag")
    separated_by = "a long {move} and back again: a spring helps the way back, swirl resists it"
    source = "stiffness G J / L of a twisted cable; Feldman (1979) on tow cables"
    laws = (
        Law(
            "-kappa sgn(d) max(|d| - slack, 0), d = {x} - {x}_start",
            "Driscoll, Lueck and Nahon (2000), Applied Ocean Research 22:169 (slack tethers)",
            ("water-swirl", "battery-sag"),
        ),
        Law(
            "-kappa d - kappa_3 d^3, d = {x} - {x}_start",
            "Duffing (1918), Erzwungene Schwingungen",
            ("water-swirl", "battery-sag"),
        ),
    )
    uses_position = True

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats:
        kappa, law, slack, cubic = values
        way = state.travelled
        if not law.any():
            return -kappa * way
        return choose(
            law,
            lambda: -kappa * way,
            lambda: -kappa * (way - np.clip(way, -slack, slack)),
            lambda: -(kappa + cubic * way**2) * way,
        )
