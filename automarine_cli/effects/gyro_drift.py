"""A heading integrated from a gyro with a bias."""

from automarine_cli.effects.base import ODD, Effect, Floats, Parameter, Place


class GyroDrift(Effect):
    name = "gyro-drift"
    place = Place.SENSOR
    parameters = (Parameter("g", "drift of the {position}", "{x}/s", -0.2, 0.2, 0.003),)
    equation = "{x}_m = {x} + g t"
    says = "The {position} drifts with time, as from {drift}."
    reveals = "a rest record: the {position} creeps while the vehicle stands"
    mistaken_for = ("bias-moment", "thrust-asymmetry")
    separated_by = (
        "a rest record beside a {sensor}: a {rate_sensor} creeps at rest at once, a bias {force} {moves} the vehicle"
    )
    source = "Titterton and Weston (2004), Strapdown Inertial Navigation Technology"
    parity = ODD

    def read(self, heading: Floats, time: Floats, values: tuple[Floats, ...]) -> Floats:
        return heading + values[0] * time
