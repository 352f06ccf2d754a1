"""Water that begins to turn with the vehicle: the whirlpool for which the paper trims to half a turn."""

import numpy as np

from automarine_cli.effects.base import Effect, Law, Parameter, Place, State, choice, choose, multiple, reference
from automarine_cli.quantities import Floats


class WaterSwirl(Effect):
    """Drag acts on the slip s = r - w. The water is stirred in proportion to s, to |s| s as turbulence would, to |r| s
    as what passes a hull that moves, or to the thrusters' jets; it calms in proportion to w, to |w| w, or in a time
    of its own.

    At a slip and speed of 1 per s, and under the largest moment, all laws stir alike, so that their parameters have the
    same size and meaning.
    """

    name = "water-swirl"
    place = Place.WATER
    parameters = (
        Parameter("chi", "share of the {rate} that the water reaches", "1", 0.0, 0.9, 0.15),
        Parameter("T_w", "time constant of the water", "s", 0.5, 200.0, 10.0, scan=(2.5, 10.0, 40.0), log=True),
        choice(
            "law",
            "what stirs the water, and how it calms",
            "linear; turbulent; by slip and speed; by the jets; turbulent, calms as its square; own time to calm; "
            "by the jets, calms as its square",
        ),
        reference("tau_ref", "{force} whose jets stir as a slip of one", laws=(3, 6)),
        multiple("calm", "time to calm, as a multiple of T_w", laws=(5,)),
    )
    equation = "drag on s = {v} - {water}, T_w {water}' = chi s - (1 - chi) {water}"
    says = "The water begins to {move} with the vehicle and carries it along."
    reveals = "{moves} of {whole_way}, a reversal after a long {move}, coast-downs that do not end at zero"
    mistaken_for = ("tether-spring", "battery-sag")
    separated_by = "a reversal after a long {move}: its first seconds are slower than from rest"
    source = (
        "Stipanov et al. (2007), section 3.2 (whirlpool); Thomasson and Woolsey (2013), IEEE J. Oceanic "
        "Engineering 38:226"
    )
    laws = (
        Law(
            "T_w {water}' = chi |s| s - (1 - chi) {water}",
            "Pope (2000), Turbulent Flows (stress as the square of the slip)",
        ),
        Law(
            "T_w {water}' = chi |{v}| s - (1 - chi) {water}",
            "Batchelor (1967), An Introduction to Fluid Dynamics (exchange with what passes a body)",
            ("tether-spring", "battery-sag", "linear-drag"),
        ),
        Law(
            "T_w {water}' = chi {f}/tau_ref - (1 - chi) {water}",
            "Faltinsen (1990), Sea Loads on Ships and Offshore Structures (jets of thrusters)",
            ("tether-spring", "battery-sag", "thrust-loss"),
        ),
        Law(
            "T_w {water}' = chi |s| s - (1 - chi) |{water}| {water}",
            "Pope (2000), Turbulent Flows (decay as the square)",
        ),
        Law(
            "T_w {water}' = chi s - (1 - chi) {water}, or calm T_w for T_w as |{water}| falls",
            "Greenspan (1968), The Theory of Rotating Fluids (spin-up and spin-down)",
        ),
        Law(
            "T_w {water}' = chi {f}/tau_ref - (1 - chi) |{water}| {water}",
            "Faltinsen (1990), Sea Loads on Ships and Offshore Structures (jets); Pope (2000) (decay as the square)",
            ("tether-spring", "battery-sag", "thrust-loss"),
        ),
    )

    states = ("water",)

    def water_rate(self, states: tuple[Floats, ...], values: tuple[Floats, ...]) -> Floats:
        return states[0]

    def derivatives(self, state: State, states: tuple[Floats, ...], values: tuple[Floats, ...]) -> tuple[Floats, ...]:
        chi, lag, law, largest, calm = values
        slip, (water,) = state.relative, states
        decay = (1.0 - chi) * water
        if not law.any():
            return ((chi * slip - decay) / lag,)

        def own_time() -> Floats:
            pulled = chi * slip - decay
            return pulled / np.where(pulled * water < 0, calm, 1.0)

        rate = choose(
            law, lambda: chi * slip - decay, lambda: chi * np.abs(slip) * slip - decay,
            lambda: chi * np.abs(state.velocity) * slip - decay, lambda: chi * state.delivered / largest - decay,
            lambda: chi * np.abs(slip) * slip - np.abs(water) * decay, own_time,
            lambda: chi * state.delivered / largest - np.abs(water) * decay,
        )  # fmt: skip
        return (rate / lag,)
