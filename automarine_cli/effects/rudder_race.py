"""A rudder in the race of a propeller whose thrust is logged: it steers with that thrust, also without way on."""

from automarine_cli.dofs import Dof
from automarine_cli.effects.base import Effect, Floats, Parameter, State, inf


class RudderRace(Effect):
    """The race adds c times the thrust to u|u| of `rudder`: this is that part, N_deltaX being N_delta c. Momentum
    theory makes the square of the race's speed grow with the thrust."""

    name = "rudder-race"
    parameters = (Parameter("{letter}_deltaX", "{force} by angle and thrust ahead", "{force}/N", -inf, inf, 0.05),)
    equation = "{letter}_deltaX delta X"
    says = "The propeller's race makes the rudder steer in proportion to the thrust ahead."
    reveals = "the rudder put over at one speed with much and with little thrust"
    mistaken_for = ("rudder", "rudder-inflow")
    separated_by = "the rudder put over while the propeller starts from rest, and while the vehicle coasts"
    source = (
        "Molland and Turnock (2007), Marine Rudders and Control Surfaces, chapter 3 (rudder in the race of a "
        "propeller); Yasukawa and Yoshimura (2015), J. Marine Science and Technology 20:37"
    )
    needs = ("rudder", "force_X")

    def acts_in(self, dof: Dof) -> bool:
        return dof.name != "surge"

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats:
        return values[0] * state.signals["rudder"] * state.signals["force_X"]
