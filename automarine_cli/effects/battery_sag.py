"""A supply that falls: with the load of each moment, and as charge is drawn over the campaign."""

import numpy as np

from automarine_cli.effects.base import Commands, Effect, Floats, Parameter, Place


class BatterySag(Effect):
    """tau exp(-discharge t) (1 - load |tau|/tau_ref), t the hours on the campaign's clock since t_ref.

    Thrust falls in proportion to itself: never below nothing, and another t_ref is another gain and no more.
    """

    name = "battery-sag"
    place = Place.ACTUATOR
    parameters = (
        Parameter("discharge", "rate at which thrust is lost over the campaign", "1/h", 0.0, 5.0, 0.08),
        Parameter("load", "share of thrust lost at tau_ref", "1", 0.0, 0.9, 0.05),
        Parameter(
            "tau_ref", "{force} at which load is told", "{force}", 0.0, float("inf"), 1.0, reference="moment"
        ),
        Parameter(
            "t_ref",
            "clock at which nothing was lost yet",
            "s",
            -float("inf"),
            float("inf"),
            0.0,
            reference="clock",
        ),
    )
    equation = "{f}_delivered = {f} exp(-discharge (t - t_ref)) (1 - load |{f}|/tau_ref)"
    says = "The supply sags: thrust falls with load or as the battery empties."
    reveals = "a log of the bus voltage, and the first run repeated last"
    mistaken_for = ("cubic-drag", "thrust-exponent", "saturation")
    separated_by = "the first run repeated last, in random order, with the voltage logged"
    source = "Stipanov et al. (2007), section 2.1: 24 V from lead-acid cells of 2.9 Ah"

    def deliver(self, commands: Commands, values: tuple[Floats, ...]) -> Floats:
        discharge, load, moment, clock = values
        hours = (commands.clock + commands.start - clock) / 3600.0
        fresh = np.exp(-discharge * hours)
        return commands.force * fresh * (1.0 - load * np.abs(commands.force) / moment)
