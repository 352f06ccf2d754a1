"""A moment that comes and goes with a period: waves, sloshing of the pool."""

import numpy as np

from automarine_cli.effects.base import MIXED, Effect, Floats, Law, Parameter, State, choice, inf


class PeriodicDisturbance(Effect):
    """A sin(2 pi t / T) + B cos(2 pi t / T), t in the run; or the same with a phase of its own in every run.

    Waves do not wait for a run to begin. With a phase of its own each run has a sine and a cosine of its own, drawn
    from one distribution: A is then the amplitude of such a wave (root two times their standard deviation), B nothing.
    """

    name = "periodic-disturbance"
    parameters = (
        Parameter("A", "amplitude of the sine", "{force}", -inf, inf, 0.03),
        Parameter("B", "amplitude of the cosine", "{force}", -inf, inf, 0.0),
        Parameter("T", "period", "s", 0.3, 20.0, 3.0, scan=tuple(1.0 * 1.04**i for i in range(70)), log=True),
        choice("phase", "phase at the start of a run", "the same; its own in each"),
    )
    equation = "A sin(2 pi t/T) + B cos(2 pi t/T)"
    says = "A {force} comes and goes with a fixed period, as waves or a sloshing pool would make it."
    reveals = "the spectrum of a rest record"
    mistaken_for = ("heading-moment", "dead-band")
    separated_by = "a rest record of a minute"
    source = "Faltinsen and Timokha (2009), Sloshing; pool modes of 1 to 5 s"
    laws = (
        Law(
            "the same with A and B of its own in every run",
            "Faltinsen and Timokha (2009), Sloshing; waves do not wait for a run to begin",
        ),
    )
    parity = MIXED
    per_run = 2

    def varies(self, values: tuple[float, ...]) -> bool:
        return values[3] > 0

    def held(self, values: tuple[float, ...]) -> tuple[bool, ...]:
        varying = self.varies(values)
        return (varying, varying, False, True)

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats:
        sine, cosine, period, own_phase, own_sine, own_cosine = values
        if own_phase.any():
            sine, cosine = (np.where(own_phase > 0, own_sine, sine), np.where(own_phase > 0, own_cosine, cosine))
        phase = 2.0 * np.pi * state.time / period
        return sine * np.sin(phase) + cosine * np.cos(phase)
