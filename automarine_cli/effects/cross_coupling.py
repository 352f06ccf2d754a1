"""Surge that turns the vehicle: unequal added masses ahead and abeam (Munk moment)."""

from automarine_cli.effects.base import Effect, Floats, Parameter, State, inf


class CrossCoupling(Effect):
    name = "cross-coupling"
    parameters = (Parameter("c", "coupling of surge and yaw rate", "{force} s²/m", -inf, inf, 0.05),)
    equation = "c u r"
    says = "Surge speed couples into yaw."
    reveals = "runs with and without way on, and a track of the position"
    mistaken_for = ("linear-drag", "thrust-loss")
    separated_by = "balanced thrust (no way on) beside equal thruster speeds"
    source = "Fossen (2011), Handbook of Marine Craft Hydrodynamics, section 6 (added mass, Coriolis)"
    needs = ("surge",)
    rotational = True

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats:
        return values[0] * state.signals["surge"] * state.velocity
