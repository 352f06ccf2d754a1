"""Thrusters that give no more than a largest moment: current limit or end of the map."""

import numpy as np

from automarine_cli.effects.base import Commands, Effect, Floats, Law, Parameter, Place, choice, choose, inf

SOFT = (0.9, 1.4, 2.2)
"""Limits at which a soft one is tried, as shares of the largest moment: it bends moments far below it."""


class Saturation(Effect):
    name = "saturation"
    place = Place.ACTUATOR
    parameters = (
        Parameter("tau_max", "largest {force}", "{force}", 0.0, inf, 1.0, off=inf, scan=(0.6, 0.75, 0.9)),
        choice("law", "how the limit comes on", "hard; soft"),
    )
    equation = "{f}_delivered = sgn({f}) min(|{f}|, tau_max)"
    says = "The thrusters give no more than a largest {force}, whatever is commanded."
    reveals = "the highest {forces}: the steady {speed} stops rising"
    mistaken_for = ("cubic-drag", "battery-sag", "thrust-exponent")
    separated_by = "more levels above and below the suspected limit"
    source = "Blanke, Lindegaard and Fossen (2000), Dynamic model for thrust generation of marine propellers"
    laws = (
        Law(
            "{f}_delivered = tau_max tanh({f}/tau_max)",
            "Khalil (2002), Nonlinear Systems, section 1.2 (saturation and its smooth forms)",
            ("thrust-exponent", "battery-sag", "cubic-drag"),
        ),
    )

    def deliver(self, commands: Commands, values: tuple[Floats, ...]) -> Floats:
        tau_max, law = values
        size = np.abs(commands.force)
        most = np.clip(tau_max, 1e-9 * (1.0 + size), 1e9 * (1.0 + size))  # off it is infinite, at its bound zero
        limited = choose(law, lambda: np.minimum(size, tau_max), lambda: most * np.tanh(size / most))
        return np.sign(commands.force) * limited

    def scan(self, parameter: Parameter, values: tuple[float, ...]) -> tuple[float, ...]:
        return SOFT if parameter.scan and self.law(values) else parameter.scan
