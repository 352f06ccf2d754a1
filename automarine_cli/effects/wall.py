"""A wall beside the vehicle: drag that differs with the heading, twice in a turn."""

import numpy as np

from automarine_cli.dofs import Dof
from automarine_cli.effects.base import MIXED, Effect, Floats, Parameter, Place, State


class Wall(Effect):
    """-(p cos 2 psi + q sin 2 psi) |r| r on the true heading: a body lies alongside and across twice a turn."""

    name = "wall"
    place = Place.MOMENT
    parameters = (
        Parameter("p", "cosine part", "{force} s^2/{x}^2", -float("inf"), float("inf"), 0.1),
        Parameter("q", "sine part", "{force} s^2/{x}^2", -float("inf"), float("inf"), 0.0),
    )
    equation = "-(p cos 2 psi + q sin 2 psi) |{v}| {v}"
    says = "Drag differs with the heading, twice in a turn, as beside a wall."
    reveals = "whole turns, several start headings, the same run at another place of the pool"
    mistaken_for = ("heading-moment", "compass-deviation")
    separated_by = "the same run in the middle of the pool and at its wall"
    source = "Brennen (1982), NCEL report CR 82.010; Korotkin (2009), Added Masses of Ship Structures"
    parity = MIXED
    steered = True
    placed = True

    def acts_in(self, dof: Dof) -> bool:
        return dof.wraps

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats:
        p, q = values
        twice = 2.0 * state.position
        return -(p * np.cos(twice) + q * np.sin(twice)) * np.abs(state.relative) * state.relative
