"""Thrusters that push the vehicle harder one way round than the other."""

import numpy as np

from automarine_cli.effects.base import ODD, Commands, Effect, Floats, Parameter, Place


class ThrustAsymmetry(Effect):
    """(1 + a sgn tau) tau; the part common to both sides is a gain and cannot be seen."""

    name = "thrust-asymmetry"
    place = Place.ACTUATOR
    parameters = (
        Parameter("a", "half the relative difference of {positive} and {negative} {moves}", "1", -0.9, 0.9, 0.05),
    )
    equation = "{f}_delivered = (1 + a sgn({f})) {f}"
    says = "The same commanded {force} gives more {one_way} than {the_other}."
    reveals = "equal {forces} {both_ways}, and reversals"
    mistaken_for = ("drag-asymmetry", "bias-moment", "gyro-drift")
    separated_by = "a coast-down {each_way}: drag differs in it, thrust does not"
    source = "propellers that push harder one way than the other: equation 2 of Stipanov et al. (2007)"
    parity = ODD

    def deliver(self, commands: Commands, values: tuple[Floats, ...]) -> Floats:
        return (1.0 + values[0] * np.sign(commands.force)) * commands.force
