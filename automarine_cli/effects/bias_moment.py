"""A constant moment that is not in the log: tether twist, reaction torque of a vertical thruster, steady
current."""

from automarine_cli.effects.base import ODD, Effect, Floats, Parameter, Place, State


class BiasMoment(Effect):
    """+b, whatever the vehicle does; the only effect whose drift of k is odd in the moment with power -1."""

    name = "bias-moment"
    place = Place.MOMENT
    parameters = (Parameter("b", "constant moment", "{moment}", -float("inf"), float("inf"), 0.02),)
    equation = "+b"
    says = "A constant moment acts on the vehicle in one direction, commanded or not."
    reveals = "a rest record (the vehicle drifts), and equal moments to both sides (one side turns faster)"
    mistaken_for = ("gyro-drift", "thrust-asymmetry", "drag-asymmetry")
    separated_by = (
        "a rest record with a second heading sensor, and pairs of small and large moments to both sides"
    )
    source = "Stipanov, Miskovic, Vukic and Barisic (2007), Table 1 read with a constant"
    parity = ODD

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats:
        (b,) = values
        return b
