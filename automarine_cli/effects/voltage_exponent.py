"""Thrust that follows the logged voltage."""

import numpy as np

from automarine_cli.effects.base import Commands, Effect, Floats, Parameter, Place

DEAD = 1e-9  # share of V_ref below which a supply is dead: a power of nothing has no derivative


class VoltageExponent(Effect):
    name = "voltage-exponent"
    place = Place.ACTUATOR
    parameters = (
        Parameter("p", "exponent of thrust against voltage", "1", 0.0, 4.0, 1.2),
        Parameter("V_ref", "voltage at which the {force} is as commanded", "V", 0.0, 1000.0, 12.0, reference="voltage"),
    )
    equation = "{f}_delivered = {f} (V / V_ref)^p"
    says = "Thrust follows the supply voltage."
    reveals = "the same {forces} at two or more voltages"
    mistaken_for = ("battery-sag",)
    separated_by = "a repeat at another voltage"
    source = "Blue Robotics T200 performance data (2019): exponent 1.0 to 1.5 at fixed command"
    needs = ("voltage",)

    def deliver(self, commands: Commands, values: tuple[Floats, ...]) -> Floats:
        p, reference = values
        ratio = np.maximum(commands.signals["voltage"] / reference, DEAD)
        return commands.force * ratio**p
