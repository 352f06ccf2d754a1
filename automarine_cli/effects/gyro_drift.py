"""A heading integrated from a gyro with a bias."""

from automarine_cli.effects.base import ODD, Effect, Floats, Parameter, Place


class GyroDrift(Effect):
    """psi_m = psi + g t."""

    name = "gyro-drift"
    place = Place.SENSOR
    parameters = (Parameter("g", "drift of the heading", "rad/s", -0.2, 0.2, 0.003),)
    equation = "psi_m = psi + g t"
    says = "The heading drifts with time, as from a gyro with a bias."
    reveals = "a rest record: the heading creeps while the vehicle stands"
    mistaken_for = ("bias-moment", "thrust-asymmetry")
    separated_by = (
        "a rest record beside a compass: a gyro creeps at rest at once, a bias moment turns the vehicle"
    )
    source = "Titterton and Weston (2004), Strapdown Inertial Navigation Technology"
    parity = ODD

    def read(self, heading: Floats, time: Floats, values: tuple[Floats, ...]) -> Floats:
        (drift,) = values
        return heading + drift * time
