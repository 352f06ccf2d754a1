"""Water that begins to turn with the vehicle: the whirlpool for which the paper trims to half a turn."""

import numpy as np

from automarine_cli.effects.base import Effect, Floats, Parameter, Place, State


class WaterSwirl(Effect):
    """Drag acts on the slip s = r - w; the water is stirred in proportion to s, or to |s| s as turbulence would.

    At a slip of 1 rad/s both laws stir alike, so that their parameters have the same size and meaning.
    """

    name = "water-swirl"
    place = Place.WATER
    parameters = (
        Parameter("chi", "share of the {rate} that the water reaches", "1", 0.0, 0.9, 0.15),
        Parameter(
            "T_w", "time constant of the water", "s", 0.5, 200.0, 10.0, scan=(2.5, 10.0, 40.0), log=True
        ),
        Parameter("law", "how the slip stirs the water", "1", 0.0, 1.0, 0.0, choices=("linear", "turbulent")),
    )
    equation = "drag on s = {v} - {water}, T_w {water}' = chi s - (1 - chi) {water}, or with |s| s for s"
    says = "The water begins to {move} with the vehicle and carries it along."
    reveals = "{moves} of {whole_way}, a reversal after a long {move}, coast-downs that do not end at zero"
    mistaken_for = ("tether-spring", "battery-sag")
    separated_by = "a reversal after a long {move}: its first seconds are slower than from rest"
    source = (
        "Stipanov et al. (2007), section 3.2 (whirlpool); Thomasson and Woolsey (2013), IEEE J. Oceanic "
        "Engineering"
    )

    states = ("water",)

    def water_rate(self, states: tuple[Floats, ...], values: tuple[Floats, ...]) -> Floats:
        return states[0]

    def derivatives(
        self, state: State, states: tuple[Floats, ...], values: tuple[Floats, ...]
    ) -> tuple[Floats, ...]:
        chi, lag, law = values
        slip = state.relative
        if law.any():
            slip = slip * (1.0 + law * (np.abs(slip) - 1.0))
        return ((chi * slip - (1.0 - chi) * states[0]) / lag,)
