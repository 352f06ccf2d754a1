"""A supply that falls: with the load of each moment, and as charge is drawn over the campaign."""

import numpy as np

from automarine_cli.effects.base import Commands, Effect, Floats, Parameter, Place


class BatterySag(Effect):
    """tau (1 - discharge x) (1 - load |tau|/tau_largest), x the share of the campaign that has passed."""

    name = "battery-sag"
    place = Place.ACTUATOR
    parameters = (
        Parameter("discharge", "share of thrust lost over the campaign", "1", 0.0, 0.9, 0.08),
        Parameter("load", "share of thrust lost at the largest moment", "1", 0.0, 0.9, 0.05),
    )
    equation = "tau_delivered = tau (1 - discharge x) (1 - load |tau|/tau_largest)"
    says = "The supply sags: thrust falls with load or as the battery empties."
    reveals = "a log of the bus voltage, and the first run repeated last"
    mistaken_for = ("cubic-drag", "thrust-exponent", "saturation")
    separated_by = "the first run repeated last, in random order, with the voltage logged"
    source = "Stipanov et al. (2007), section 2.1: 24 V from lead-acid cells of 2.9 Ah"

    def deliver(self, commands: Commands, values: tuple[Floats, ...]) -> Floats:
        discharge, load = values
        sagging = 1.0 - load * np.abs(commands.moment) / commands.largest
        return commands.moment * (1.0 - discharge * commands.campaign) * sagging
