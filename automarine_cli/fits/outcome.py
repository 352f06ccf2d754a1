"""What every maximum-likelihood fit returns, whichever likelihood it rests on, and the coordinates of its search."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from automarine_cli.fits.known import Prior, prior_of
from automarine_cli.quantities import Floats

SMALLEST = 1e-9
"""What a positive parameter may fall to: nothing, for all that a log can show."""


@dataclass(frozen=True)
class Outcome(ABC):
    """Outcome of one fit.

    `theta` (p,) and `phi` (p,), the same in the search's coordinates, in which are `covariance` (p, p) from
    the likelihood and `left_out` (R, p), phi without each run; `positive` (p,) marks what is searched on the logarithm;
    `log_likelihood` (marginal), `predictive` (R,) log density of each run predicted from the others, `at_bound` indices
    of the parameters that a bound stopped, `known` what was known beforehand, by name.
    """

    names: tuple[str, ...]
    theta: Floats
    phi: Floats
    positive: NDArray[np.bool_]
    covariance: Floats
    left_out: Floats
    log_likelihood: float
    predictive: Floats
    at_bound: tuple[int, ...]
    iterations: int
    converged: bool
    known: Mapping[str, Prior] = field(default_factory=dict, kw_only=True)

    def value(self, name: str) -> float:
        """The fitted value of a parameter."""
        return float(self.theta[self.names.index(name)])

    @property
    @abstractmethod
    def of_model(self) -> Floats:
        """The model's own entries of theta."""

    @property
    @abstractmethod
    def information(self) -> Floats:
        """What each run says of phi, (R, p, p)."""

    @property
    @abstractmethod
    def noise_of(self) -> dict[str, float]:
        """Noise of each channel that counts, by its quantity [its unit]."""

    @property
    @abstractmethod
    def read(self) -> dict[str, int]:
        """How many readings each of these channels has."""

    @property
    def noise(self) -> float:
        """Noise of the first of these channels [its unit]."""
        return next(iter(self.noise_of.values()))

    @abstractmethod
    def factor(self, block: str) -> float:
        """Estimated size of one kind of run effect."""

    @abstractmethod
    def factor_interval(self, block: str) -> tuple[float, float]:
        """95 % interval of that size."""

    @abstractmethod
    def own(self, block: str) -> Floats:
        """Each run's own effects (R, k) of one kind."""

    @property
    def jackknife_covariance(self) -> Floats:
        """Covariance of phi from leaving each run out, (p, p); needs no assumption on the noise within a
        run."""
        count = len(self.left_out)
        spread = self.left_out - self.left_out.mean(axis=0)
        return (count - 1) / count * spread.T @ spread

    @property
    def error_of_known(self) -> Floats:
        """Covariance of phi that the errors of what was known make, (p, p): no run that is left out shows it."""
        prior = prior_of(self.known, self.names, self.positive)
        return np.zeros_like(self.covariance) if prior is None else self.covariance @ prior[1] @ self.covariance


def natural_of(phi: Floats, positive: NDArray[np.bool_]) -> Floats:
    """theta (..., p) of the search's coordinates phi."""
    return np.where(positive, np.exp(np.where(positive, phi, 0.0)), phi)


def search_of(theta: Floats, positive: NDArray[np.bool_]) -> Floats:
    """phi (..., p) of theta; a positive parameter at zero counts as `SMALLEST`."""
    return np.where(positive, np.log(np.maximum(np.where(positive, theta, 1.0), SMALLEST)), theta)
