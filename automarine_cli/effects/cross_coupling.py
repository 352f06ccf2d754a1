"""Surge that turns the vehicle: unequal added masses ahead and abeam (Munk moment)."""

from automarine_cli.dofs import Dof
from automarine_cli.effects.base import Effect, Parameter, Place, State
from automarine_cli.quantities import Floats


class CrossCoupling(Effect):
    """c u r with the logged surge speed u; the sway that a turn makes is in proportion to r."""

    name = "cross-coupling"
    place = Place.MOMENT
    parameters = (Parameter("c", "coupling of surge and yaw rate", "{force} s²/m", -float("inf"), float("inf"), 0.05),)
    equation = "c u r"
    says = "Surge speed couples into yaw."
    reveals = "runs with and without way on, and a track of the position"
    mistaken_for = ("linear-drag", "thrust-loss")
    separated_by = "balanced thrust (no way on) beside equal thruster speeds"
    source = "Fossen (2011), Handbook of Marine Craft Hydrodynamics, section 6 (added mass, Coriolis)"
    needs = ("surge",)

    def acts_in(self, dof: Dof) -> bool:
        return dof.wraps

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats:
        (c,) = values
        return c * state.signals["surge"] * state.velocity
