"""A planar model of which only some parameters are free: the others are fixed, or follow a free one."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from automarine_cli.dofs.motion import Motion
from automarine_cli.models.allocation import Bound
from automarine_cli.models.planar import PlanarModel
from automarine_cli.quantities import Floats


@dataclass(frozen=True)
class Tied:
    """`model` with the parameter vector theta of the `free` names alone, (f,); a `Vehicle` like any other.

    `ties` say which parameter is which free one times a factor, such as {"sway.m_v": ("surge.m_u", 1.0)}. All others
    stay as they are in the model. Raises KeyError for a name that the model lacks: that is a slip of the program.
    """

    model: PlanarModel
    free: tuple[str, ...]
    ties: Mapping[str, tuple[str, float]]

    def __post_init__(self) -> None:
        lacking = {*self.free, *self.ties} - set(self.model.parameter_names)
        if lacking:
            raise KeyError(f"the model has no parameter {', '.join(sorted(lacking))}")

    @property
    def motion(self) -> Motion:
        return self.model.motion

    @property
    def parameter_names(self) -> tuple[str, ...]:
        return self.free

    @property
    def theta(self) -> Floats:
        return self.model.theta[[self._places[name] for name in self.free]]

    @cached_property
    def spread(self) -> Floats:
        """What each parameter of the model is made of, (p, f): ones, factors of ties, zero rows for fixed ones."""
        matrix = np.zeros((len(self._places), len(self.free)))
        for j, name in enumerate(self.free):
            matrix[self._places[name], j] = 1.0
        for name, (source, factor) in self.ties.items():
            matrix[self._places[name], self.free.index(source)] = factor
        return matrix

    def whole(self, theta: ArrayLike) -> Floats:
        """All parameters of the model for free ones theta (..., f): (..., p)."""
        fixed = np.where(self.spread.any(axis=1), 0.0, self.model.theta)
        return np.asarray(theta, dtype=float) @ self.spread.T + fixed

    def with_theta(self, theta: Sequence[float] | Floats) -> "Tied":
        return Tied(self.model.with_theta(self.whole(theta)), self.free, self.ties)

    def inertia_matrix(self, theta: Floats) -> Floats:
        return self.model.inertia_matrix(self.whole(theta))

    def forces(self, theta: Floats) -> list[Bound]:
        return self.model.forces(self.whole(theta))

    def current(self, theta: Floats) -> Floats | None:
        return self.model.current(self.whole(theta))

    @cached_property
    def _places(self) -> dict[str, int]:
        return {name: i for i, name in enumerate(self.model.parameter_names)}
