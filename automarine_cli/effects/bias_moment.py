"""A constant moment that is not in the log: tether twist, reaction torque of a vertical thruster, steady
current."""

from automarine_cli.effects.base import ODD, Effect, Floats, Parameter, State, inf


class BiasMoment(Effect):
    name = "bias-moment"
    parameters = (Parameter("b", "constant {force}", "{force}", -inf, inf, 0.02),)
    equation = "+b"
    says = "A constant {force} acts on the vehicle in one direction, commanded or not."
    reveals = "a rest record (the vehicle drifts), and equal {forces} {both_ways} (one {way} {moves} faster)"
    mistaken_for = ("gyro-drift", "thrust-asymmetry", "drag-asymmetry")
    separated_by = "a rest record with a second {position} sensor, and pairs of small and large {forces} {both_ways}"
    source = "Stipanov, Miskovic, Vukic and Barisic (2007), Table 1 read with a constant"
    parity = ODD
    role = "constant"

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats:
        return values[0]
