"""A steering gear that turns the rudder no faster than it can, where the log holds the angle commanded."""

import numpy as np

from automarine_cli.effects.base import SINGLE, Commands, Effect, Floats, Law, Parameter, Place, choice, inf


class RudderRate(Effect):
    """The rudder goes to the commanded angle at its largest rate, or at last with a lag. Both are solved exactly under
    a command that is held: at the rate until T times the rate is left, then exponentially."""

    name = "rudder-rate"
    place = Place.ACTUATOR
    stage = SINGLE  # the rudder moves before the water feels it
    parameters = (
        Parameter(
            "rate", "largest rate of the rudder", "{force}/s", 0.0, inf, 0.3, off=inf, scan=(0.03, 0.1, 0.3, 1.0)
        ),
        choice("law", "how the gear follows", "at its largest rate; with a lag at the end"),
        Parameter("T", "time constant of the gear", "s", 0.0, 10.0, 1.0, scan=(0.3, 2.0), laws=(1,)),
    )
    equation = "|delta_delivered'| <= rate, towards delta"
    says = "The steering gear follows the commanded rudder only at its largest rate."
    reveals = "zigzags from hard over to hard over, where only the command is logged"
    mistaken_for = ("input-delay", "thruster-lag")
    separated_by = "small and large changes of the rudder at one speed, or a log of its angle"
    source = "Van Amerongen (1982), Adaptive steering of ships, Delft (steering machine with a limited rate)"
    laws = (
        Law(
            "delta_delivered' = (delta - delta_delivered)/T, at most rate",
            "Fossen (2021), Handbook of Marine Craft Hydrodynamics and Motion Control, section 9.5 (steering machine)",
        ),
    )
    needs = ("rudder",)
    acts_on = "rudder"

    def deliver(self, commands: Commands, values: tuple[Floats, ...]) -> Floats:
        """Mean angle over each step."""
        rate, law, lag = values
        shape = np.broadcast_shapes(commands.force.shape, commands.length.shape, rate.shape)
        target, length = (np.broadcast_to(x, shape) for x in (commands.force, commands.length))
        pace = np.clip(rate[..., 0], 1e-9, 1e15)
        late = np.maximum(np.where(law > 0, lag, 0.0)[..., 0], 1e-12)
        angle, delivered = np.broadcast_to(commands.before[..., 0], shape[:2]), np.empty(shape)
        for m in range(shape[2]):
            step, gap = length[..., m], target[..., m] - angle
            ramp = np.clip(np.abs(gap) / pace - late, 0.0, step)
            left = gap - np.sign(gap) * pace * ramp
            decay = np.exp(-(step - ramp) / late)
            missed = 0.5 * (gap + left) * ramp + left * late * (1.0 - decay)
            delivered[..., m] = target[..., m] - missed / np.maximum(step, 1e-12)
            angle = target[..., m] - left * decay
        return delivered
