"""What a simulator needs of a vehicle, and the terms that act on its commands."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from automarine_cli.dofs.motion import Motion
from automarine_cli.effects import Effect, Place
from automarine_cli.quantities import Floats


class Vehicle(Protocol):
    """What the simulator needs of a model: its motion, its parameters, inertia, terms, and the water's own velocity."""

    @property
    def motion(self) -> Motion:
        """The degrees of freedom that move together."""

    @property
    def theta(self) -> Floats:
        """Parameter vector, (p,)."""

    def inertia_matrix(self, theta: Floats) -> Floats:
        """Rigid and added inertia for theta (P, p): (P, D, D)."""

    def forces(self, theta: Floats) -> Sequence["Bound"]:
        """Each effect with the degree of freedom on which it acts."""

    def current(self, theta: Floats) -> Floats | None:
        """Velocity of the water north and east [m/s], (2, P, 1), constant and without swirl; None for still water."""


@dataclass(frozen=True)
class Bound:
    """An effect that acts on the degree of freedom in place `dof`, with its parameters, each (P, 1)."""

    dof: int
    effect: Effect
    values: tuple[Floats, ...]

    def wide(self) -> tuple[Floats, ...]:
        return tuple(value[..., None] for value in self.values)


def actuators(terms: Sequence[Bound]) -> list[Bound]:
    """The terms that act on commands, in the order in which they do."""
    acting = [term for term in terms if term.effect.place is Place.ACTUATOR]
    return sorted(acting, key=lambda term: term.effect.stage)
