"""A tether that twists: a torsional spring towards the heading at which the run began."""

from automarine_cli.effects.base import Effect, Floats, Parameter, Place, State


class TetherSpring(Effect):
    """-kappa (psi - psi_start)."""

    name = "tether-spring"
    place = Place.MOMENT
    parameters = (Parameter("kappa", "{stiffness} of the tether", "{force}/{x}", 0.0, float("inf"), 0.01),)
    equation = "-kappa ({x} - {x}_start)"
    says = "The tether pulls back like a {spring}, the more the vehicle has {moved}."
    reveals = "{moves} of {whole_way}, and {back_again}"
    mistaken_for = ("water-swirl", "linear-drag")
    separated_by = "a long {move} and back again: a spring helps the way back, swirl resists it"
    source = "stiffness G J / L of a twisted cable; Feldman (1979) on tow cables"
    steered = True

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats:
        (kappa,) = values
        return -kappa * state.travelled
