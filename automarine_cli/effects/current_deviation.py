"""A compass that the thrusters' current pulls."""

import numpy as np

from automarine_cli.dofs import Dof
from automarine_cli.effects.base import MIXED, Effect, Parameter, Place
from automarine_cli.quantities import Floats


class CurrentDeviation(Effect):
    """psi_m = psi + (d tau + e |tau|) / tau_ref: a current that turns round with the thrust, or one that does not."""

    name = "current-deviation"
    place = Place.SENSOR
    parameters = (
        Parameter("d", "deviation at tau_ref that changes its sign with the {force}", "{x}", -0.5, 0.5, 0.05),
        Parameter("e", "deviation at tau_ref that does not", "{x}", -0.5, 0.5, 0.0),
        Parameter("tau_ref", "{force} at which both are told", "{force}", 0.0, float("inf"), 1.0, reference="moment"),
    )
    equation = "psi_m = psi + (d tau + e |tau|)/tau_ref"
    says = "The compass is pulled by the thrusters' current."
    reveals = "a jump of the heading at every change of the moment, before the vehicle can have turned"
    mistaken_for = ("sensor-lag", "input-delay", "compass-deviation")
    separated_by = "thrusters switched on while the vehicle is held still, or a gyro beside the compass"
    source = "Bowditch (2019), The American Practical Navigator, chapter on the compass (electromagnetic deviation)"
    parity = MIXED
    fed = True

    def acts_in(self, dof: Dof) -> bool:
        return dof.wraps

    def read(self, heading: Floats, time: Floats, values: tuple[Floats, ...]) -> Floats:
        odd, even, largest, moment = values
        return heading + (odd * moment + even * np.abs(moment)) / largest
