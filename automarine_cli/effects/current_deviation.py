"""A compass that the thrusters' current pulls."""

import numpy as np

from automarine_cli.effects.base import MIXED, Effect, Floats, Parameter, Place, reference


class CurrentDeviation(Effect):
    name = "current-deviation"
    place = Place.SENSOR
    parameters = (
        Parameter("d", "deviation at tau_ref that changes its sign with the {force}", "{x}", -0.5, 0.5, 0.05),
        Parameter("e", "deviation at tau_ref that does not", "{x}", -0.5, 0.5, 0.0),
        reference("tau_ref", "{force} at which both are told"),
    )
    equation = "psi_m = psi + (d tau + e |tau|)/tau_ref"
    says = "The compass is pulled by the thrusters' current."
    reveals = "a jump of the heading at every change of the moment, before the vehicle can have turned"
    mistaken_for = ("sensor-lag", "input-delay", "compass-deviation")
    separated_by = "thrusters switched on while the vehicle is held still, or a gyro beside the compass"
    source = "Bowditch (2019), The American Practical Navigator, chapter on the compass (electromagnetic deviation)"
    parity = MIXED
    reads_force = True
    rotational = True

    def read(self, heading: Floats, time: Floats, values: tuple[Floats, ...]) -> Floats:
        odd, even, largest, moment = values
        return heading + (odd * moment + even * np.abs(moment)) / largest
