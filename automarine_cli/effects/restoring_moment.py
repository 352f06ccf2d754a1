"""Weight and buoyancy that turn the vehicle back, m g GM sin(phi): a pendulum of roll or pitch."""

import numpy as np

from automarine_cli.dofs import Dof
from automarine_cli.effects.base import Effect, Floats, Parameter, State, inf


class RestoringMoment(Effect):
    name = "restoring-moment"
    parameters = (Parameter("{restoring}", "m g GM, the moment over sin({x})", "{force}", 0.0, inf, 1.0),)
    equation = "-{restoring} sin({x})"
    says = "Weight and buoyancy bring the vehicle upright."
    reveals = "a free decay from several angles, to both sides"
    mistaken_for = ("tether-spring",)
    separated_by = "runs that start at different angles: a tether pulls back to where the run began"
    source = "Fossen (2021), Handbook of Marine Craft Hydrodynamics and Motion Control, chapter 4 (m g GM sin)"
    uses_position = True
    uses_absolute = True
    role = "restoring"

    def acts_in(self, dof: Dof) -> bool:
        return dof.restoring

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats:
        return -values[0] * np.sin(state.position)
