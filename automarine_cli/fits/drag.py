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

from automarine_cli.dofs import YAW, Dof
from automarine_cli.errors import FitError
from automarine_cli.fits.estimate import Estimate

Floats = NDArray[np.float64]

COLUMNS = {"1": ("k_r",), "2": ("k_rr", "k_r"), "3": ("k_rr",), "3+c": ("k_rr", "c")}
"""Parameters of each reading of Table 1, in the order of the regressors."""

FEWEST_A_WAY = 3
"""Runs each way from which on it is asked whether drag differs."""


@dataclass(frozen=True)
class DragFit:
    """Least squares of one drag model: estimates by name, SSE [moment²], AICc, residuals (R,) [moment]."""

    model: str
    estimates: dict[str, Estimate]
    sse: float
    aicc: float
    residuals: Floats

    def acting(self, moment: Floats) -> tuple[Floats, Floats | float, Floats | float]:
        """What each run (R,) moves by: the moment with the constant one, k_r and k_rr on the way that it goes."""
        k_r, k_rr = self.drag
        if "b" in self.estimates:
            moment = moment + self.estimates["b"].value
        if "e" not in self.estimates:
            return moment, k_r, k_rr
        more = np.sign(moment) * self.estimates["e"].value
        return (moment, k_r + more, k_rr) if self.model == "1" else (moment, k_r, k_rr + more)

    @property
    def drag(self) -> tuple[float, float]:
        """(k_r, k_rr), zero where the model has no such term."""
        values = {name: e.value for name, e in self.estimates.items()}
        return values.get("k_r", 0.0), values.get("k_rr", 0.0)


@dataclass(frozen=True)
class NestedTest:
    """F test of model 3 within model 2: statistic, degrees of freedom, p-value."""

    f: float
    dof: tuple[int, int]
    p_value: float


def columns_of(model: str, dof: Dof = YAW, sided: bool = False) -> tuple[str, ...]:
    """Parameters of a drag model of a motion: `b` is the constant force, `e` half the difference between the ways."""
    return (*COLUMNS[model], *(("b",) if dof.has_constant else ()), *(("e",) if sided else ()))


def regressors(rate: Floats, model: str, names: Sequence[str] = ()) -> Floats:
    """Regressor columns (R, p) of a drag model for steady rates (R,) [rad/s]."""
    known = {"k_rr": np.abs(rate) * rate, "k_r": rate, "c": np.ones_like(rate), "b": -np.ones_like(rate)}
    known["e"] = np.abs(rate) if model == "1" else rate**2
    return np.stack([known[name] for name in names or COLUMNS[model]], axis=1)


def fit_drag_by_way(moment: Floats, rate: Floats, model: str, moment_unit: str, dof: Dof) -> DragFit:
    """`fit_drag`; of a motion whose drag may differ between its two ways with that, where the points show it."""
    ways = np.sum(rate > 0), np.sum(rate < 0)
    if not dof.directional or min(ways) < FEWEST_A_WAY or model not in ("1", "2", "3"):
        return fit_drag(moment, rate, model, moment_unit, dof)
    try:
        apart = fit_drag(moment, rate, model, moment_unit, dof, sided=True)
    except FitError:
        return fit_drag(moment, rate, model, moment_unit, dof)
    low, high = apart.estimates["e"].ci95
    return apart if low > 0 or high < 0 else fit_drag(moment, rate, model, moment_unit, dof)


def fit_drag(
    moment: Floats,
    rate: Floats,
    model: str,
    moment_unit: str = "nu",
    dof: Dof = YAW,
    sided: bool = False,
) -> DragFit:
    """Fit one drag model to steady points: moments (R,) and rates (R,) [rad/s].

    Raises FitError for fewer points than the model needs or points that cannot tell its terms apart.
    """
    names = columns_of(model, dof, sided)
    x = regressors(rate, model, names)
    points, count = x.shape
    if points < count + 1 or np.linalg.matrix_rank(x / np.abs(x).max(axis=0)) < count:
        sizes = len(np.unique(np.round(np.abs(moment), 9)))
        raise FitError(
            f"model {model} of Table 1 needs at least {count + 1} runs and as many sizes of moment as it has drag "
            f"terms ({count}); there are {points} at {sizes}: run more moments"
        )
    inverse = np.linalg.inv(x.T @ x)
    values = inverse @ x.T @ moment
    residuals = moment - x @ values
    leverage = np.einsum("rp,pk,rk->r", x, inverse, x)
    score = x * (residuals / np.maximum(1.0 - leverage, 1e-6))[:, None]
    stderr = np.sqrt(np.diagonal(inverse @ score.T @ score @ inverse))
    sse = float(residuals @ residuals)
    estimates = {
        name: Estimate.from_stderr(v, e, points - count, dof.unit_of(_like(name, model), moment_unit))
        for name, v, e in zip(names, values, stderr)
    }
    return DragFit(model, estimates, sse, _aicc(sse, points, count), residuals)


def _like(name: str, model: str) -> str:
    """The parameter that has the same unit: the difference between two ways is one of their drag."""
    if name == "e":
        return "k_r" if model == "1" else "k_rr"
    return "tau" if name in ("b", "c") else name


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
