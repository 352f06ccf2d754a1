"""Parameters: their bounds, the scale on which they are searched, what is known of them, what follows others."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import inf

import numpy as np
from numpy.typing import ArrayLike, NDArray

from automarine_cli.quantities import Floats

NUISANCE = "nuisance"  # the role of what is estimated beside a model: delay of commands, what is random
SMALLEST = 1e-9  # what a parameter on a logarithm may fall to: nothing, for all that a log can show


@dataclass(frozen=True)
class Prior:
    """A value that is expected, with its standard error; None: exactly. In the unit of the fit."""

    value: float
    stderr: float | None = None

    def __str__(self) -> str:
        return f"{self.value:g}" + ("" if self.stderr is None else f" ± {self.stderr:g}")


Priors = Mapping[str, Prior]
"""What a user knows beforehand, by qualified name."""
NOTHING_KNOWN: Priors = {}


@dataclass(frozen=True)
class Parameter:
    """One parameter by its qualified name: `value` is where a fit begins, within `lower` and `upper`.

    It is fixed where its bounds are one value, or where it has a `tie` (another's name, factor). If `log` it is
    searched on its logarithm, on which its interval is formed and its prior is Gaussian. `step` is a small one, in its
    unit or its logarithm. `role` says what it is in an equation of motion (see `Dof.parameters`), empty for none.
    """

    name: str
    value: float
    lower: float = -inf
    upper: float = inf
    log: bool = False
    step: float = 1.0
    role: str = ""
    unit: str = ""
    prior: Prior | None = None
    tie: tuple[str, float] | None = None

    def at(self, value: float) -> "Parameter":
        """Return it fixed at a value."""
        return replace(self, value=value, lower=value, upper=value)


@dataclass(frozen=True, eq=False)
class Parameters(Sequence[Parameter]):
    """The parameters of a likelihood, theta (p,), and phi (p,), the same on the scales of the search.

    `priors` are what a user knows beforehand, by name; `smooth` (p, p) is the precision about zero of parameters
    that are on no logarithm, as of a smooth curve.
    """

    entries: tuple[Parameter, ...]
    priors: Priors = field(default_factory=dict)
    smooth: Floats | None = None

    def __len__(self) -> int:
        return len(self.entries)

    def __getitem__(self, index):  # type: ignore[no-untyped-def]
        return self.entries[index]

    @cached_property
    def names(self) -> tuple[str, ...]:
        return tuple(p.name for p in self.entries)

    @cached_property
    def log(self) -> NDArray[np.bool_]:
        """Which are searched, and told, on the logarithm, (p,)."""
        return np.array([parameter.log for parameter in self.entries], dtype=bool)

    @cached_property
    def bounds(self) -> Floats:
        """Bounds of theta, (p, 2)."""
        return np.array([(parameter.lower, parameter.upper) for parameter in self.entries], dtype=float)

    @cached_property
    def limits(self) -> Floats:
        """Bounds of phi, (p, 2)."""
        return np.stack([self.search(end) for end in self.bounds.T], axis=1)

    @property
    def theta(self) -> Floats:
        """Where a fit begins, (p,)."""
        return np.array([parameter.value for parameter in self.entries])

    @cached_property
    def steps(self) -> Floats:
        """A small step of each in its own unit, (p,)."""
        return np.array([parameter.step for parameter in self.entries])

    @cached_property
    def free(self) -> NDArray[np.int64]:
        """Places of those that a fit may choose."""
        return np.flatnonzero([p.lower < p.upper and p.tie is None for p in self.entries])

    @property
    def of_model(self) -> slice:
        """Places of the model's parameters, which come first."""
        return slice(0, sum(parameter.role != NUISANCE for parameter in self.entries))

    @property
    def nuisance(self) -> tuple[Parameter, ...]:
        return self.entries[self.of_model.stop :]

    @np.errstate(over="ignore")  # where a search runs away
    def natural(self, phi: ArrayLike) -> Floats:
        """Return theta (..., p) of phi, with what is tied as its tie says."""
        phi = np.asarray(phi, dtype=float)
        theta = np.where(self.log, np.exp(np.where(self.log, phi, 0.0)), phi)
        return theta @ self.follows.T if any(parameter.tie for parameter in self.entries) else theta

    def search(self, theta: ArrayLike) -> Floats:
        """Return phi (..., p) of theta; what is on a logarithm counts as SMALLEST where it is zero."""
        theta = np.asarray(theta, dtype=float)
        return np.where(self.log, np.log(np.maximum(np.where(self.log, theta, 1.0), SMALLEST)), theta)

    def within(self, theta: ArrayLike) -> Floats:
        """Return theta (..., p) clipped to its bounds."""
        return np.clip(np.asarray(theta, dtype=float), self.bounds[:, 0], self.bounds[:, 1])

    @cached_property
    def follows(self) -> Floats:
        """Derivatives (p, p) of theta by theta before ties: ones, and the factors of what is tied."""
        matrix = np.eye(len(self.entries))
        for row, parameter in zip(matrix, self.entries):
            if parameter.tie is not None:
                name, factor = parameter.tie
                row[:] = factor * (np.array(self.names) == name)
        return matrix

    @cached_property
    def prior(self) -> tuple[Floats, Floats]:
        """Mean (p,) and precision (p, p) of phi before the data; no precision where nothing is expected."""
        count = len(self.entries)
        mean, precision = np.zeros(count), np.zeros((count, count)) if self.smooth is None else self.smooth.copy()
        for i, parameter in enumerate(self.entries):
            expected = self.priors.get(parameter.name, parameter.prior)
            if expected is not None and expected.stderr is not None:
                mean[i] = np.log(expected.value) if parameter.log else expected.value
                precision[i, i] = ((expected.value if parameter.log else 1.0) / expected.stderr) ** 2
        return mean, precision

    def informed(self, priors: Priors) -> "Parameters":
        """Return the same with what a user knows beforehand; what is known exactly is fixed."""
        exact = {name: prior.value for name, prior in priors.items() if prior.stderr is None}
        entries = tuple(p.at(exact[p.name]) if p.name in exact else p for p in self.entries)
        return replace(self, entries=entries, priors=priors)

    def fixed_at(self, theta: Sequence[float] | Floats) -> "Parameters":
        """Return the same with the first ones fixed at the values given, (f,)."""
        fixed = tuple(parameter.at(float(value)) for parameter, value in zip(self.entries, theta))
        return replace(self, entries=(*fixed, *self.entries[len(fixed) :]))
