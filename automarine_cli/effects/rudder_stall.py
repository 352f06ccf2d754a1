"""A rudder that stalls: beyond an angle the flow leaves it, and it lifts no more."""

import numpy as np

from automarine_cli.effects.base import Commands, Effect, Floats, Parameter, Place, inf


class RudderStall(Effect):
    """Lift grows to the stall angle and falls beyond it, or stays as it is with `fall` zero; never does it change
    sides. The angle is that to the hull: what the hull's turn takes off it delays the stall of a ship."""

    name = "rudder-stall"
    place = Place.ACTUATOR
    parameters = (
        Parameter(
            "stall", "angle at which the rudder stalls", "{force}", 0.0, inf, 1.0, off=inf, scan=(0.5, 0.65, 0.8)
        ),
        Parameter("fall", "lift lost beyond, as a share of what it gained before", "1", 0.0, 5.0, 0.5, scan=(0.2, 1.0)),
    )
    equation = "delta_delivered = sgn(delta) (stall - fall (|delta| - stall)) where |delta| > stall, at least 0"
    says = "Beyond an angle the rudder stalls and loses lift."
    reveals = "the rudder at several angles to both sides, up to hard over"
    mistaken_for = ("saturation", "thrust-exponent")
    separated_by = "the rudder at three or more angles below and beyond the suspected stall"
    source = (
        "Molland and Turnock (2007), Marine Rudders and Control Surfaces, chapter 5 (lift against incidence); Fossen "
        "(2021), Handbook of Marine Craft Hydrodynamics and Motion Control, section 9.5 (rudders)"
    )
    needs = ("rudder",)
    acts_on = "rudder"

    def deliver(self, commands: Commands, values: tuple[Floats, ...]) -> Floats:
        stall, fall = values
        size = np.abs(commands.force)
        lift = np.where(size > stall, np.maximum(stall - fall * (size - np.minimum(stall, size)), 0.0), size)
        return np.sign(commands.force) * lift
