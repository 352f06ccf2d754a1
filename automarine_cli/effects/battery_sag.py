"""A supply that falls: with the load of each moment, and as charge is drawn over the campaign."""

import numpy as np

from automarine_cli.effects.base import Commands, Effect, Law, Parameter, Place, choice, choose, inf, lagged, reference
from automarine_cli.quantities import Floats


class BatterySag(Effect):
    """tau exp(-discharge t) (1 - load |tau|/tau_ref), t the hours on the campaign's clock since t_ref.

    A battery that polarises follows the load after a time: l for |tau|/tau_ref, T_V l' = |tau|/tau_ref - l, rested at
    each run's start. Charge drawn within a run counts from its start, as momentum theory has the current: with the
    power 3/2 of the thrust. What other runs drew before is told by the clock: of runs not at hand nobody knows it.

    Thrust falls in proportion to itself: never below nothing, and another t_ref is another gain and no more.
    """

    name = "battery-sag"
    place = Place.ACTUATOR
    parameters = (
        Parameter("discharge", "rate at which thrust is lost over the campaign", "1/h", 0.0, 5.0, 0.08),
        Parameter(
            "load", "share of thrust lost at tau_ref; by the charge drawn, in a minute of it", "1", 0.0, 0.9, 0.05
        ),
        reference("tau_ref", "{force} at which load is told"),
        Parameter("t_ref", "clock at which nothing was lost yet", "s", -inf, inf, 0.0, reference="clock"),
        choice("law", "how the load tells", "at once; after a time; by the charge drawn"),
        Parameter(
            "T_V", "time constant of the sag under load", "s", 0.3, 300.0, 5.0, scan=(2.0, 6.0, 20.0), log=True,
            laws=(1,),
        ),
    )  # fmt: skip
    equation = "{f}_delivered = {f} exp(-discharge (t - t_ref)) (1 - load |{f}|/tau_ref)"
    says = "The supply sags: thrust falls with load or as the battery empties."
    reveals = "a log of the bus voltage, and the first run repeated last"
    mistaken_for = ("cubic-drag", "thrust-exponent", "saturation")
    separated_by = "the first run repeated last, in random order, with the voltage logged"
    source = "Stipanov et al. (2007), section 2.1: 24 V from lead-acid cells of 2.9 Ah"
    laws = (
        Law(
            "{f}_delivered = {f} exp(-discharge (t - t_ref)) (1 - load l), T_V l' = |{f}|/tau_ref - l",
            "Chen and Rincon-Mora (2006), IEEE Trans. Energy Conversion 21:504 (resistor and capacitor in series)",
            ("water-swirl", "tether-spring", "cubic-drag"),
        ),
        Law(
            "{f}_delivered = {f} exp(-discharge (t - t_ref) - load q), q = int (|{f}|/tau_ref)^3/2 dt/60 s",
            "Chen and Rincon-Mora (2006), IEEE Trans. Energy Conversion 21:504 (voltage by the state of charge); "
            "current as the power of a propeller at rest",
            ("tether-spring", "water-swirl"),
        ),
    )

    def deliver(self, commands: Commands, values: tuple[Floats, ...]) -> Floats:
        discharge, load, moment, clock, law, lag = values
        hours = (commands.clock + commands.start - clock) / 3600.0
        fresh, drawn = np.exp(-discharge * hours), np.abs(commands.force) / moment
        share = choose(
            law,
            lambda: 1.0 - load * drawn,
            lambda: 1.0 - load * lagged(drawn, np.zeros(1), commands.length, lag)[1],
            lambda: np.exp(-load * _charge(drawn, commands.length)),
        )
        return commands.force * fresh * share


def _charge(drawn: Floats, length: Floats) -> Floats:
    """Charge drawn since the run's start by the middle of each step, in minutes at a load of one, (P, R, M)."""
    charge = drawn**1.5 * length / 60.0
    return np.cumsum(charge, axis=2) - 0.5 * charge
