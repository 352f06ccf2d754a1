"""A rudder, fin or elevator: a force across the flow that grows with its angle and the square of the speed."""

import numpy as np

from automarine_cli.dofs import Dof
from automarine_cli.effects.base import Effect, Floats, Law, Parameter, State, choice, choose, inf


class Rudder(Effect):
    """N_delta delta u|u| in yaw, Y_delta in sway, Z_delta in heave. The angle is signed as logged: N_delta is positive
    where a positive rudder turns to starboard. Behind a propeller of steady thrust the race adds `c` to u|u|."""

    name = "rudder"
    parameters = (
        Parameter("{letter}_delta", "{force} by angle of the rudder and square of the speed", "{force} s²/m²",
                  -inf, inf, 0.05),
        choice("law", "what flows past the rudder", "the speed through the water; that and the propeller's race; "
               "a constant speed of 1 m/s"),
        Parameter("c", "square of the speed that the propeller's race adds", "m²/s²", 0.0, inf, 0.5, scan=(0.2, 1.0),
                  laws=(1,)),
    )  # fmt: skip
    equation = "{letter}_delta delta u |u|"
    says = "A rudder turns the flow into a {force}."
    reveals = "zigzags of the rudder at two or more speeds ahead"
    mistaken_for = ("bias-moment", "thrust-asymmetry")
    separated_by = "steps of the rudder to both sides under way, beside turns by the thrusters alone"
    source = "Fossen (2021), Handbook of Marine Craft Hydrodynamics and Motion Control, section 9.5 (rudders)"
    laws = (
        Law(
            "{letter}_delta delta (u |u| + c)",
            "Molland and Turnock (2007), Marine Rudders and Control Surfaces, chapter 3; Yasukawa and Yoshimura (2015),"
            " J. Marine Science and Technology 20:37 (inflow behind the propeller)",
        ),
        Law("{letter}_delta delta"),
    )
    needs = ("rudder", "surge")

    def acts_in(self, dof: Dof) -> bool:
        return dof.name != "surge"

    def needs_at(self, values: tuple[float, ...]) -> tuple[str, ...]:
        return self.needs[:1] if self.law(values) == 2 else self.needs

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats:
        size, law, race = values
        angle = state.signals["rudder"]

        def pressure() -> Floats:
            speed = state.signals["surge"]
            return np.asarray(speed * np.abs(speed))

        return size * angle * choose(law, pressure, lambda: pressure() + race, lambda: np.ones_like(angle))
