"""`YawModel`: inertia and a tuple of effects with values; frozen, `with_...` returns a new one."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from automarine_cli import effects
from automarine_cli.dofs import YAW, Dof
from automarine_cli.dofs.motion import Motion, alone
from automarine_cli.errors import ModelError
from automarine_cli.models.vehicle import Bound

Floats = NDArray[np.float64]

BASE_TERMS = {
    "1": ("linear-drag",),
    "2": ("quadratic-drag", "linear-drag"),
    "3": ("quadratic-drag",),
}
"""The drag terms of the paper's three models: D(r) = k_r; k_rr|r| + k_r; k_rr|r|."""


ASYMMETRY = {"1": "linear-drag-asymmetry", "2": "drag-asymmetry", "3": "drag-asymmetry"}
"""The term by which drag differs between the two ways of a translation."""

BASE_NAMES = {
    "linear-drag": "k_r",
    "quadratic-drag": "k_rr",
    "bias-moment": "b",
    **dict.fromkeys(ASYMMETRY.values(), "e"),
}
"""What the one parameter of each of these terms is called in a fit."""


def base_terms(number: str, dof: Dof = YAW, sided: bool = False) -> tuple[str, ...]:
    """The terms of model `number` of a motion: drag, a constant force where one acts, and the asymmetry if `sided`."""
    constant = ("bias-moment",) if dof.has_constant else ()
    return (*BASE_TERMS[number], *constant, *((ASYMMETRY[number],) if sided else ()))


def base_names(number: str, dof: Dof = YAW, sided: bool = False) -> tuple[str, ...]:
    """The parameters of these terms, the inertia first."""
    return ("I_r", *(BASE_NAMES[term] for term in base_terms(number, dof, sided)))


@dataclass(frozen=True)
class Term:
    """One effect with the values of its parameters, in the effect's order."""

    name: str
    values: tuple[float, ...]


@dataclass(frozen=True)
class YawModel:
    """I_r r' = tau + moments of the terms; actuator, water and sensor effects are terms too. Of any motion (`dof`).

    The parameter vector theta is (I_r, values of the first term, values of the second, ...).
    """

    inertia: float
    terms: tuple[Term, ...]
    moment_unit: str = "nu"
    dof: Dof = YAW

    @classmethod
    def base(
        cls,
        number: str,
        inertia: float,
        values: Sequence[float] | Floats,
        moment_unit: str = "nu",
        dof: Dof = YAW,
    ) -> "YawModel":
        """Model "1", "2" or "3" of the paper; `values` in the order of `base_terms`, sided if there is one more."""
        sided = len(values) > len(base_terms(number, dof))
        names = base_terms(number, dof, sided)
        terms = tuple(Term(name, (float(value),)) for name, value in zip(names, values, strict=True))
        return cls(float(inertia), terms, moment_unit, dof)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the entries of theta."""
        return ("I_r", *(p.name for term in self.terms for p in effects.get(term.name).parameters))

    @property
    def theta(self) -> Floats:
        """Parameter vector, shape (p,)."""
        return np.array([self.inertia, *(value for term in self.terms for value in term.values)])

    def with_theta(self, theta: ArrayLike) -> "YawModel":
        """The same terms with other values."""
        values = [float(v) for v in np.asarray(theta)]
        if len(values) != len(self.theta):
            raise ModelError(
                f"{len(values)} values given for the {len(self.theta)} parameters {self.parameter_names}; "
                "give one for each"
            )
        rest = iter(values[1:])
        terms = tuple(replace(term, values=tuple(next(rest) for _ in term.values)) for term in self.terms)
        return replace(self, inertia=values[0], terms=terms)

    def with_effect(self, name: str, values: Sequence[float] | Floats) -> "YawModel":
        """The same model with one more effect; choices of law at the end may be left out, for the first."""
        own = effects.get(name).parameters
        count, given = len(own), len(values)
        values = [*values, *(p.start for p in own[given:] if p.choices)]
        if len(values) != count:
            raise ModelError(
                f"effect {name!r} has {count} parameters, {given} values were given; give one for each"
            )
        return replace(self, terms=(*self.terms, Term(name, tuple(float(v) for v in values))))

    @property
    def motion(self) -> Motion:
        """The one degree of freedom as a motion."""
        return alone(self.dof)

    def inertia_matrix(self, theta: Floats) -> Floats:
        """Inertia for theta (P, p), (P, 1, 1)."""
        return theta[:, :1, None]

    def forces(self, theta: Floats) -> list[Bound]:
        """Each term's effect with its columns of theta (P, p) as arrays of shape (P, 1)."""
        column, found = 1, []
        for term in self.terms:
            count = len(term.values)
            values = tuple(theta[:, column + i, None] for i in range(count))
            found.append(Bound(0, effects.get(term.name), values))
            column += count
        return found

    def current(self, theta: Floats) -> None:
        """Still water: one degree of freedom alone cannot tell a current from its start velocity."""
        return

    def fastest(self, moment: float) -> float:
        """Shortest time constant [s] on the way to the steady rate under |moment|, of the base drag alone."""
        k_r, k_rr = self.drag()
        rate = steady_rate(abs(moment), k_r, k_rr)
        return float(self.inertia / max(k_r + 2.0 * k_rr * float(rate), 1e-12))

    def acting(self, moment: Floats) -> tuple[Floats, Floats | float, Floats | float]:
        """What the vehicle moves by under each `moment`: that with the constant force, k_r and k_rr on its way."""
        k_r, k_rr = self.drag()
        if self.dof.wraps:
            return moment, k_r, k_rr
        found = {term.name: term.values[0] for term in self.terms}
        moment = moment + found.get("bias-moment", 0.0)
        way = np.sign(moment)
        linear, quadratic = (found.get(name, 0.0) for name in (ASYMMETRY["1"], ASYMMETRY["3"]))
        return moment, k_r + way * linear, k_rr + way * quadratic

    def drag(self) -> tuple[float, float]:
        """(k_r, k_rr), zero where the model has no such term."""
        found = {term.name: term.values[0] for term in self.terms}
        return found.get("linear-drag", 0.0), found.get("quadratic-drag", 0.0)


def steady_rate(moment: ArrayLike, k_r: ArrayLike, k_rr: ArrayLike) -> Floats:
    """Rate at which drag balances the moment [rad/s]: root of k_rr |r| r + k_r r = tau; inputs broadcast.

    Not a number where a negative k_rr leaves no such rate.
    """
    size, linear = np.abs(np.asarray(moment, dtype=float)), np.asarray(k_r, dtype=float)
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(linear**2 + 4.0 * np.asarray(k_rr, dtype=float) * size)
        rate = np.sign(np.asarray(moment, dtype=float)) * 2.0 * size / (linear + root)
    return np.where(size > 0, rate, 0.0)
