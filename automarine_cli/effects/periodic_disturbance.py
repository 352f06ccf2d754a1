"""A moment that comes and goes with a period: waves, sloshing of the pool."""

import numpy as np

from automarine_cli.effects.base import MIXED, Effect, Floats, Motion, Parameter, Place


class PeriodicDisturbance(Effect):
    """A sin(2 pi t / T) + B cos(2 pi t / T), t in the run."""

    name = "periodic-disturbance"
    place = Place.MOMENT
    parameters = (
        Parameter("A", "amplitude of the sine", "{moment}", -float("inf"), float("inf"), 0.03),
        Parameter("B", "amplitude of the cosine", "{moment}", -float("inf"), float("inf"), 0.0),
        Parameter("T", "period", "s", 0.3, 20.0, 3.0, scan=tuple(1.0 * 1.06**i for i in range(48)), log=True),
    )
    equation = "A sin(2 pi t/T) + B cos(2 pi t/T)"
    says = "A moment comes and goes with a fixed period, as waves or a sloshing pool would make it."
    reveals = "the spectrum of a rest record"
    mistaken_for = ("heading-moment", "dead-band")
    separated_by = "a rest record of a minute"
    source = "Faltinsen and Timokha (2009), Sloshing; pool modes of 1 to 5 s"
    parity = MIXED

    def moment(self, motion: Motion, values: tuple[Floats, ...]) -> Floats:
        sine, cosine, period = values
        phase = 2.0 * np.pi * motion.time / period
        return sine * np.sin(phase) + cosine * np.cos(phase)
