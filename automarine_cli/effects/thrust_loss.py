"""Propellers that lose thrust when the vehicle's turn feeds them (advance speed, momentum drag)."""

import numpy as np

from automarine_cli.effects.base import Effect, Floats, Law, Parameter, State, choice, inf


class ThrustLoss(Effect):
    name = "thrust-loss"
    parameters = (
        Parameter("b", "loss of {force} by {speed} and root of {force}", "({force})^1/2 s{/x}", 0.0, inf, 0.05),
        choice("law", "when thrust is lost", "both ways; in advance only"),
    )
    equation = "-b sqrt|{f}| {v}"
    says = "Thrust falls as the {move} feeds the propellers with moving water."
    reveals = (
        "reversals at speed and coast-downs; nothing at all in steps from rest, where it hides in drag and {inertia}"
    )
    mistaken_for = ("quadratic-drag", "linear-drag")
    separated_by = "coast-downs (no propeller turns) beside steps"
    source = "Fossen (1994), bilinear thruster model: equation 1 of Stipanov et al. (2007)"
    laws = (
        Law(
            "-b sqrt|{f}| {v} where {f} {v} > 0, else 0",
            "Carlton (2007), Marine Propellers and Propulsion (the quadrants of a propeller)",
        ),
    )

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats:
        b, law = values
        loss = -b * np.sqrt(np.abs(state.delivered)) * state.velocity
        return np.where((law > 0) & (state.delivered * state.velocity <= 0), 0.0, loss) if law.any() else loss
