"""A rudder whose neutral is off: it stands at an angle where the log says zero."""

from automarine_cli.effects.base import ODD, SINGLE, Commands, Effect, Floats, Parameter, Place, inf


class RudderOffset(Effect):
    """Where the angle itself is the command, `bias-moment` is the same."""

    name = "rudder-offset"
    place = Place.ACTUATOR
    stage = SINGLE  # a gear and its offset change places; a stall comes after both
    parameters = (Parameter("offset", "angle of the rudder where the log says zero", "{force}", -inf, inf, 0.1),)
    equation = "delta_delivered = delta + offset"
    says = "The rudder stands at an angle where the log says zero."
    reveals = "the rudder at zero under way, at two speeds"
    mistaken_for = ("bias-moment", "thrust-asymmetry")
    separated_by = "the rudder at zero under way at two speeds, and at rest: an offset steers with the speed's square"
    source = "Molland and Turnock (2007), Marine Rudders and Control Surfaces, chapter 5 (lift against incidence)"
    needs = ("rudder",)
    acts_on = "rudder"
    steered = False
    parity = ODD

    def deliver(self, commands: Commands, values: tuple[Floats, ...]) -> Floats:
        return commands.force + values[0]
