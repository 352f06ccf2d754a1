"""Table 1: yaw moment on steady yaw rate by least squares, for the paper's three drag models.

One point is one run. Model 1 is tau = k_r r, model 2 tau = k_rr |r| r + k_r r, model 3 tau = k_rr |r| r; beside
them the reading of Table 1 with a constant moment, tau = k_rr |r| r + c, which the printed numbers fit. Standard
errors are
robust against unequal scatter (HC3, MacKinnon and White 1985, J. Econometrics 29:305), intervals from
Student's t.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from automarine_cli.dofs import Dof
from automarine_cli.errors import FitError
from automarine_cli.fits.estimate import Estimate
from automarine_cli.models.yaw_model import base_roles, main_drag

Floats = NDArray[np.float64]

WITH_CONSTANT, C = "3+c", "c"
"""The reading of Table 1 with a constant moment, and what it is called there."""

FEWEST_A_WAY = 3
"""Runs each way from which on it is asked whether drag differs."""


@dataclass(frozen=True)
class DragFit:
    """Least squares of one drag model of a motion: estimates by name, SSE [moment²], AICc, residuals (R,) [moment]."""

    model: str
    dof: Dof
    estimates: dict[str, Estimate]
    sse: float
    aicc: float
    residuals: Floats

    def acting(self, moment: Floats) -> tuple[Floats, Floats | float, Floats | float]:
        """What each run (R,) moves by: the moment with the constant one, linear and quadratic drag on the way that it
        goes."""
        linear, quadratic = self.drag
        moment = moment + self._value("constant")
        if not self.sided:
            return moment, linear, quadratic
        more = np.sign(moment) * self._value("difference")
        return (moment, linear + more, quadratic) if self.model == "1" else (moment, linear, quadratic + more)

    @property
    def drag(self) -> tuple[float, float]:
        """Linear and quadratic drag, zero where the model has no such term."""
        return self._value("linear"), self._value("quadratic")

    @property
    def sided(self) -> bool:
        """Whether drag differs between the two ways."""
        return self.dof.symbols.difference in self.estimates

    def _value(self, role: str) -> float:
        name = self.dof.parameters[role]
        return self.estimates[name].value if name in self.estimates else 0.0


@dataclass(frozen=True)
class NestedTest:
    """F test of model 3 within model 2: statistic, degrees of freedom, p-value."""

    f: float
    dof: tuple[int, int]
    p_value: float


def columns_of(model: str, dof: Dof, sided: bool = False) -> tuple[str, ...]:
    """Parameters of a reading of Table 1 of a motion, by what they are, in the order of the regressors."""
    return ("quadratic", C) if model == WITH_CONSTANT else base_roles(model, dof, sided)[1:]


def regressors(rate: Floats, model: str, columns: Sequence[str]) -> Floats:
    """Regressor columns (R, p) of a drag model for steady rates (R,) [rad/s]."""
    known = {
        "quadratic": np.abs(rate) * rate,
        "linear": rate,
        C: np.ones_like(rate),
        "constant": -np.ones_like(rate),
    }
    known["difference"] = np.abs(rate) if model == "1" else rate**2
    return np.stack([known[name] for name in columns], axis=1)


def fit_drag_by_way(moment: Floats, rate: Floats, model: str, moment_unit: str, dof: Dof) -> DragFit:
    """`fit_drag`; of a motion whose drag may differ between its two ways with that, where the points show it."""
    ways = np.sum(rate > 0), np.sum(rate < 0)
    if not dof.directional or min(ways) < FEWEST_A_WAY or model not in ("1", "2", "3"):
        return fit_drag(moment, rate, model, moment_unit, dof)
    try:
        apart = fit_drag(moment, rate, model, moment_unit, dof, sided=True)
    except FitError:
        return fit_drag(moment, rate, model, moment_unit, dof)
    low, high = apart.estimates[dof.symbols.difference].ci95
    return apart if low > 0 or high < 0 else fit_drag(moment, rate, model, moment_unit, dof)


def fit_drag(
    moment: Floats,
    rate: Floats,
    model: str,
    moment_unit: str,
    dof: Dof,
    sided: bool = False,
) -> DragFit:
    """Fit one drag model to steady points: moments (R,) and rates (R,) [rad/s].

    Raises FitError for fewer points than the model needs or points that cannot tell its terms apart.
    """
    columns = columns_of(model, dof, sided)
    x = regressors(rate, model, columns)
    points, count = x.shape
    if points < count + 1 or np.linalg.matrix_rank(x / np.abs(x).max(axis=0)) < count:
        sizes = len(np.unique(np.round(np.abs(moment), 9)))
        raise FitError(
            f"model {model} of Table 1 needs at least {count + 1} runs and as many sizes of {dof.words.force} as it "
            f"has drag terms ({count}); there are {points} at {sizes}: run more {dof.words.force}s"
        )
    inverse = np.linalg.inv(x.T @ x)
    values = inverse @ x.T @ moment
    residuals = moment - x @ values
    leverage = np.einsum("rp,pk,rk->r", x, inverse, x)
    score = x * (residuals / np.maximum(1.0 - leverage, 1e-6))[:, None]
    stderr = np.sqrt(np.diagonal(inverse @ score.T @ score @ inverse))
    sse = float(residuals @ residuals)
    estimates = {
        dof.parameters.get(role, role): Estimate.from_stderr(
            v, e, points - count, dof.unit_of(_like(role, model), moment_unit)
        )
        for role, v, e in zip(columns, values, stderr)
    }
    return DragFit(model, dof, estimates, sse, _aicc(sse, points, count), residuals)


def _like(role: str, model: str) -> str:
    """What has the same unit: the difference between two ways is one of the drag that the model always has."""
    return main_drag(model) if role == "difference" else "constant" if role == C else role


def _aicc(sse: float, points: int, parameters: int) -> float:
    """Akaike's criterion corrected for few points (Hurvich and Tsai 1989); the noise variance counts as a
    parameter."""
    k = parameters + 1
    correction = 2.0 * k * (k + 1) / (points - k - 1) if points > k + 1 else np.inf
    return float(points * np.log(max(sse, 1e-300) / points) + 2.0 * k + correction)


def nested_test(small: DragFit, large: DragFit) -> NestedTest:
    """Does the larger of two nested models explain more than chance would?"""
    more = len(large.estimates) - len(small.estimates)
    rest = len(large.residuals) - len(large.estimates)
    f = (small.sse - large.sse) / more / max(large.sse / rest, 1e-300)
    return NestedTest(float(f), (more, rest), float(stats.f.sf(f, more, rest)))


def identity_gap(rate: Floats, k3: float, k2: float, k_r: float) -> float:
    """k3 - (k2 + k_r sum|r|³/sum r⁴): zero for any least-squares pair of models 3 and 2, whatever the data.

    The first normal equation of model 2 divided by that of model 3. The paper's printed pair breaks it:
    1.257 - 1.259 = -0.002 with k_r = +0.02753, where at least +0.028 is needed.
    """
    return float(k3 - k2 - k_r * np.sum(np.abs(rate) ** 3) / np.sum(rate**4))
