"""A compass in the vehicle's own magnetic field: hard iron (one cycle a turn) and soft iron (two)."""

import numpy as np

from automarine_cli.effects.base import MIXED, Effect, Floats, Law, Parameter, Place, choice


class CompassDeviation(Effect):
    name = "compass-deviation"
    place = Place.SENSOR
    parameters = (
        Parameter("B", "hard iron, sine", "{x}", -0.5, 0.5, 0.05),
        Parameter("C", "hard iron, cosine", "{x}", -0.5, 0.5, 0.0),
        Parameter("D", "soft iron, sine", "{x}", -0.3, 0.3, 0.0),
        Parameter("E", "soft iron, cosine", "{x}", -0.3, 0.3, 0.0),
        choice("law", "what iron", "hard and soft; hard alone; soft alone"),
    )
    equation = "psi_m = psi + B sin psi + C cos psi + D sin 2 psi + E cos 2 psi"
    says = "The compass deviates with the heading, the same in both directions and at all moments."
    reveals = "whole turns, several start headings, a gyro next to the compass"
    mistaken_for = ("heading-moment", "thrust-asymmetry")
    separated_by = "start headings a quarter turn apart, at a small and a large moment"
    source = "National Geospatial-Intelligence Agency (2004), Handbook of Magnetic Compass Adjustment"
    laws = (
        Law("psi_m = psi + B sin psi + C cos psi"),
        Law("psi_m = psi + D sin 2 psi + E cos 2 psi", mistaken_for=("wall", "heading-moment")),
    )
    parity = MIXED
    rotational = True

    def held(self, values: tuple[float, ...]) -> tuple[bool, ...]:
        no_hard, no_soft = self.law(values) == 2, self.law(values) == 1
        return (no_hard, no_hard, no_soft, no_soft, True)

    def read(self, heading: Floats, time: Floats, values: tuple[Floats, ...]) -> Floats:
        b, c, d, e, law = values
        if law.any():
            b, c, d, e = b * (law != 2), c * (law != 2), d * (law != 1), e * (law != 1)
        single = b * np.sin(heading) + c * np.cos(heading)
        return heading + single + d * np.sin(2 * heading) + e * np.cos(2 * heading)
