"""Water that remembers how the vehicle came to its speed: history forces, added inertia that falls with frequency."""

import numpy as np

from automarine_cli.effects.base import Effect, Floats, Law, Parameter, State, choice, choose, inf

MEMORY_TIMES, MEMORY_SHARES = (0.327, 2.62, 39.3), (2.0, 0.752, 0.379)
"""Time constants [s] and sizes of the exponentials whose sum is sqrt(1 s/t) to 4 % from 0.2 to 30 s."""


class HistoryForce(Effect):
    """-h times the sum of all past changes of velocity, each faded since: by exp(-t/T), or as Basset's 1/sqrt(t).

    Slow changes feel it as inertia (h T more), fast ones as drag; a steady velocity does not feel it. Basset's kernel
    is told in units of its value after 1 s. What it has of still shorter times is added inertia.
    """

    name = "history-force"
    parameters = (
        Parameter("h", "{force} by change of {speed}", "{force} s{/x}", 0.0, inf, 0.1),
        Parameter("T", "time in which it fades", "s", 0.1, 30.0, 2.0, off=2.0, scan=(0.7, 3.0, 12.0), log=True),
        choice("law", "how it fades", "exponentially; as 1/sqrt(t)"),
    )
    equation = "-h ({v} - past), T past' = {v} - past"
    says = "A {force} opposes every change of the {speed} and fades only with time: the water remembers."
    reveals = "starts, reversals and coast-downs together with steady runs, and square waves of several periods"
    mistaken_for = ("water-swirl", "linear-drag", "tether-spring")
    separated_by = "square waves of several periods: it resists fast changes, and no steady {move}"
    source = (
        "Cummins (1962), The impulse response function and ship motions, David Taylor Model Basin report 1661; Fossen "
        "(2021), Handbook of Marine Craft Hydrodynamics and Motion Control, chapter 5 (fluid memory)"
    )
    laws = (
        Law(
            "-h int {v}'(t - a) sqrt(1 s/a) da over all ages a",
            "Van Hinsberg, ten Thije Boonkkamp and Clercx (2011), J. Computational Physics 230:1465 (Basset's "
            "force by a sum of exponentials)",
            ("water-swirl", "linear-drag", "dead-band"),
        ),
    )

    states = ("past", "past_medium", "past_long")

    def held(self, values: tuple[float, ...]) -> tuple[bool, ...]:
        return (False, self.law(values) == 1, True)

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats:
        h, _, law = values
        past = state.stored

        def basset() -> Floats:
            return sum((share * (state.relative - p) for share, p in zip(MEMORY_SHARES, past)), np.zeros(()))

        return -h * choose(law, lambda: state.relative - past[0], basset)

    def derivatives(self, state: State, states: tuple[Floats, ...], values: tuple[Floats, ...]) -> tuple[Floats, ...]:
        _, fades, law = values
        behind = [state.relative - past for past in states]
        first = np.where(law > 0, MEMORY_TIMES[0], fades)
        longer = (law * change / time for change, time in zip(behind[1:], MEMORY_TIMES[1:]))
        return (behind[0] / first, *longer)
