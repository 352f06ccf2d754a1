"""`PlanarModel`: surge, sway and yaw together, as one inertia matrix, terms of drag and a current.

    M nu' + C(nu_r) nu_r = tau - drag(nu_r),    nu = (u, v, r),    nu_r = nu - R(psi)' (current north, east, 0)

M holds the rigid body and the added mass, both symmetric; C follows from M. In a constant current without rotation the
equations hold for velocities through the water as they do for those over ground in still water, so that M serves both.
Sources: SNAME (1950), Technical and Research Bulletin 1-5 (names of forces and derivatives); Fossen (2021), Handbook of
Marine Craft Hydrodynamics and Motion Control, second edition, chapters 3 (rigid body), 6 (manoeuvring models) and
10 (current). Signs are those of this tool: every drag counts as positive where it resists, every added mass where it
adds, so that m_v = m - Y_v', m_vr = m x_g - Y_r' and Y_r stands for what Fossen writes -Y_r.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass, fields, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from automarine_cli import effects
from automarine_cli.dofs import Dof
from automarine_cli.dofs.motion import PLANAR, Motion
from automarine_cli.effects import Effect, Place, State
from automarine_cli.errors import ModelError
from automarine_cli.models.allocation import Bound
from automarine_cli.models.yaw_model import Term, delayed_terms, values_for, with_values
from automarine_cli.quantities import Floats

PLACES = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
"""Where the entries of `Inertia`, in its order, stand in the matrix."""

FORCES, VELOCITIES = "XYN", "uvr"
OF_ROLE = {
    "linear": "linear-drag", "quadratic": "quadratic-drag", "cubic": "cubic-drag", "constant": "bias-moment",
    "difference": "drag-asymmetry",
}  # fmt: skip
"""The effect whose one parameter has a letter of its own in a motion, by what it is there (see `Dof.parameters`)."""
_DERIVATIVE = re.compile(rf"([{FORCES}])_([{VELOCITIES}]{{1,2}})")


@dataclass(frozen=True)
class Inertia:
    """Inertia of surge, sway and yaw, of the rigid body, of the water, or of both: a symmetric matrix about the origin
    of the vehicle's axes.

    `m_u`, `m_v` [kg], `I_r` [kg m²]; `m_vr` and `m_ur` [kg m] couple sway and surge with yaw, `m_uv` [kg] surge with
    sway. A vehicle alike on both sides has no `m_ur` and no `m_uv`, one alike fore and aft no `m_vr`.
    """

    m_u: float
    m_v: float
    I_r: float
    m_vr: float = 0.0
    m_ur: float = 0.0
    m_uv: float = 0.0

    @property
    def matrix(self) -> Floats:
        return _matrices(np.array([astuple(self)]))[0]

    def refuse_unless_positive(self, where: str) -> None:
        """Raise ModelError where kinetic energy is not above zero in every motion; `where` begins the sentence."""
        matrix = self.matrix
        if not np.isfinite(matrix).all() or np.linalg.eigvalsh(matrix)[0] <= 0:
            entries = ", ".join(f"{name} = {value:g}" for name, value in zip(inertia_names(), astuple(self)))
            raise ModelError(
                f"{where}: found an inertia of {entries}; expected a matrix that is positive definite (m_u, m_v and "
                "I_r above zero, and couplings that are small beside them); check the signs of the added masses, which "
                "count as positive where they add"
            )


@dataclass(frozen=True)
class CrossDrag(Effect):
    """Resistance to one degree of freedom by the flow along others: -c b or -c |a| b, such as Y_r r or N_vr |v| r.

    `along` is the place of b in the motion, `size` that of a. No effect of the library: one motion alone knows no
    other's flow.
    """

    along: int
    size: int | None = None

    name = "cross-drag"
    place = Place.MOMENT
    states: ClassVar[tuple[str, ...]] = ()
    source = "Fossen (2021), Handbook of Marine Craft Hydrodynamics and Motion Control, chapter 6"

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats:
        (size,) = values
        if self.size is not None:
            size = size * np.abs(state.flow[self.size])
        return -size * state.flow[self.along]


@dataclass(frozen=True)
class PlanarModel:
    """The planar motion of one vehicle, in newtons and newton metres.

    `surge`, `sway` and `yaw` are effects of the library that act on one degree of freedom. `cross` are derivatives by
    the velocities of others, as `Term("Y_r", (2.0,))`: linear ones (Y_r, N_v) and quadratic ones, of which the first
    letter stands for a size (N_vr |v| r, Y_rr |r| r). `water` is the water's velocity north and east [m/s], None where
    it is still. The parameter vector theta holds the six of the inertia, then the values of `surge`, `sway`, `yaw` and
    `cross`, then the current. Raises ModelError for a derivative that is none.
    """

    inertia: Inertia
    surge: tuple[Term, ...] = ()
    sway: tuple[Term, ...] = ()
    yaw: tuple[Term, ...] = ()
    cross: tuple[Term, ...] = ()
    water: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        for term in self.cross:
            derivative(term.name)

    @property
    def motion(self) -> Motion:
        return PLANAR

    def delayed(self, seconds: float) -> "PlanarModel":
        """The same model whose commands act later by `seconds`, by an input delay in each motion."""
        surge, sway, yaw = (delayed_terms(terms, seconds) for _, terms in self._alone())
        return replace(self, surge=surge, sway=sway, yaw=yaw)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Qualified names of the entries of theta: "surge.m_u", "planar.m_vr", "yaw.k_rr", "sway.Y_r",
        "yaw.input-delay.T", "current.north"."""
        names = [dof.parameter("inertia") for dof in PLANAR.dofs]
        names += [f"{PLANAR.name}.{name}" for name in inertia_names()[len(names) :]]
        names += [name for dof, terms in self._alone() for term in terms for name in parameters_of(dof, term)]
        names += [f"{PLANAR.dofs[derivative(term.name)[0]].name}.{term.name}" for term in self.cross]
        return (*names, *(("current.north", "current.east") if self.water is not None else ()))

    @property
    def theta(self) -> Floats:
        values = (value for _, _, term in self._effects() for value in term.values)
        return np.array([*astuple(self.inertia), *values, *(self.water or ())])

    def with_theta(self, theta: ArrayLike) -> "PlanarModel":
        """The same terms with other values. Raises ModelError unless there is one for each parameter."""
        values = values_for(self.parameter_names, theta)
        inertia = Inertia(*(next(values) for _ in PLACES))
        surge, sway, yaw, cross = (with_values(x, values) for x in (self.surge, self.sway, self.yaw, self.cross))
        water = None if self.water is None else (next(values), next(values))
        return PlanarModel(inertia, surge, sway, yaw, cross, water)

    def inertia_matrix(self, theta: Floats) -> Floats:
        return _matrices(theta)

    def forces(self, theta: Floats) -> list[Bound]:
        column, bound = len(PLACES), []
        for place, effect, term in self._effects():
            count = len(term.values)
            bound.append(Bound(place, effect, tuple(theta[:, column + i, None] for i in range(count))))
            column += count
        return bound

    def current(self, theta: Floats) -> Floats | None:
        return None if self.water is None else theta[:, -2:].T[..., None]

    def _alone(self) -> Iterator[tuple[Dof, tuple[Term, ...]]]:
        yield from zip(PLANAR.dofs, (self.surge, self.sway, self.yaw))

    def _effects(self) -> Iterator[tuple[int, Effect, Term]]:
        """Every term with its effect and the place of what it acts on, in the order of theta."""
        for place, (_, terms) in enumerate(self._alone()):
            yield from ((place, effects.get(term.name), term) for term in terms)
        for term in self.cross:
            place, drag = derivative(term.name)
            yield place, drag, term


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

    def expanded(self, theta: ArrayLike) -> Floats:
        """All parameters of the model for free ones theta (..., f): (..., p)."""
        fixed = np.where(self.spread.any(axis=1), 0.0, self.model.theta)
        return np.asarray(theta, dtype=float) @ self.spread.T + fixed

    def with_theta(self, theta: Sequence[float] | Floats) -> "Tied":
        return Tied(self.model.with_theta(self.expanded(theta)), self.free, self.ties)

    def inertia_matrix(self, theta: Floats) -> Floats:
        return self.model.inertia_matrix(self.expanded(theta))

    def forces(self, theta: Floats) -> list[Bound]:
        return self.model.forces(self.expanded(theta))

    def current(self, theta: Floats) -> Floats | None:
        return self.model.current(self.expanded(theta))

    @cached_property
    def _places(self) -> dict[str, int]:
        return {name: i for i, name in enumerate(self.model.parameter_names)}


def inertia_names() -> tuple[str, ...]:
    return tuple(field.name for field in fields(Inertia))


def _matrices(theta: Floats) -> Floats:
    """Symmetric matrices (P, 3, 3) of the first six columns of theta (P, p)."""
    matrices = np.empty((len(theta), 3, 3))
    for column, (i, j) in enumerate(PLACES):
        matrices[:, i, j] = matrices[:, j, i] = theta[:, column]
    return matrices


def parameters_of(dof: Dof, term: Term) -> Iterator[str]:
    """Qualified names of the parameters of an effect on one degree of freedom; by the letter of their role, if any."""
    effect = effects.get(term.name)
    if OF_ROLE.get(effect.role) == term.name:
        yield dof.parameter(effect.role)
    else:
        yield from (f"{dof.name}.{term.name}.{name}" for name in effect.names_in(dof))


def derivative(name: str) -> tuple[int, CrossDrag]:
    """What a derivative such as N_v or N_vr acts on, and the drag that it is. Raises ModelError."""
    match = _DERIVATIVE.fullmatch(name)
    place = FORCES.index(match[1]) if match else 0
    if match is None or set(match[2]) == {VELOCITIES[place]}:
        raise ModelError(
            f"cross drag {name!r}: expected X, Y or N by the velocities of other degrees of freedom, such as Y_r, N_v, "
            "N_vr or Y_rr; drag by a degree of freedom's own velocity is one of its terms, such as quadratic-drag"
        )
    *size, along = (VELOCITIES.index(letter) for letter in match[2])
    return place, CrossDrag(along, size[0] if size else None)
