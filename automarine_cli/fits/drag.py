"""Table 1: yaw moment on steady yaw rate by least squares, for the paper's three drag models.

One point is one run. Model 1 is tau = k_r r, model 2 tau = k_rr |r| r + k_r r, model 3 tau = k_rr |r| r; beside
them the reading of Table 1 with a constant moment, tau = k_rr |r| r + c, which the printed numbers fit. Standard
errors are
robust against unequal scatter (HC3, MacKinnon and White 1985, J. Econometrics 29:305), intervals from
Student's t.

The moment is commanded, so all noise is in the rates, and least squares on a noisy regressor find too little of it
("dilution"); in model 2 that looks like linear drag. Where the variance of the rates is known its part of every sum
is taken off first (corrected score, Nakamura 1990, Biometrika 77:127): of w = r + noise of variance v the Hermite
polynomials 1, w, w² - v, w³ - 3 v w, w⁴ - 6 v w² + 3 v² have the means 1, r, r², r³, r⁴.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from automarine_cli.dofs import Dof
from automarine_cli.errors import FitError
from automarine_cli.models.yaw_model import base_roles, main_drag
from automarine_cli.quantities import Floats
from automarine_cli.results.estimate import Estimate

WITH_CONSTANT, C = "3+c", "c"
"""The reading of Table 1 with a constant moment, and what it is called there."""

FEWEST_A_WAY = 3
"""Runs each way from which on it is asked whether drag differs."""

MOST_DILUTED = 0.5
"""Share of a sum that is taken off as noise at most: where more is noise, what is left says little."""


@dataclass(frozen=True)
class DragFit:
    """Least squares of one drag model of a motion: estimates by name; SSE [moment²], AICc and residuals (R,) [moment]
    of the plain least squares.

    `variance` (R,) [rad²/s²] is that of the rates whose dilution was taken off, `dilution` by how much that moved each
    estimate from the plain least squares, `explained` [moment²] what of the moments' squares the model explains;
    `influence` (R, p) is how far each run moves the estimates.
    """

    model: str
    dof: Dof
    estimates: dict[str, Estimate]
    sse: float
    aicc: float
    residuals: Floats
    variance: Floats
    dilution: Mapping[str, float]
    explained: float
    influence: Floats

    def acting(self, moment: Floats) -> tuple[Floats, Floats | float, Floats | float]:
        """What each run (R,) moves by: the moment with the constant one, linear and quadratic drag on the way that it
        goes."""
        return self.acting_with(moment, [e.value for e in self.estimates.values()])

    def acting_with(self, moment: Floats, values: Iterable[float]) -> tuple[Floats, Floats | float, Floats | float]:
        """The same with other values, in the order of the estimates."""
        own, symbols = dict(zip(self.estimates, values)), self.dof.symbols
        linear, quadratic = own.get(symbols.linear, 0.0), own.get(symbols.quadratic, 0.0)
        moment = moment + own.get(symbols.constant, 0.0)
        if not self.sided:
            return moment, linear, quadratic
        more = np.sign(moment) * own[symbols.difference]
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

    def moved_by(self, influence: Floats) -> "DragFit":
        """The same with intervals that know of this influence of the runs (R, p) on the estimates beside its own."""
        total = self.influence + influence
        stderr = np.sqrt(np.sum(total**2, axis=0))
        spare = len(total) - len(self.estimates)
        own = {
            name: Estimate.from_stderr(e.value, error, spare, e.unit)
            for (name, e), error in zip(self.estimates.items(), stderr)
        }
        return replace(self, estimates=own, influence=total)


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
    known = {"quadratic": np.abs(rate) * rate, "linear": rate, C: np.ones_like(rate), "constant": -np.ones_like(rate)}
    known["difference"] = np.abs(rate) if model == "1" else rate**2
    return np.stack([known[name] for name in columns], axis=1)


@dataclass(frozen=True)
class Sums:
    """Each run's part of the normal equations of a drag model, noise of the rates taken off: squares (R, p, p), their
    products with the moment (R, p)."""

    squares: Floats
    products: Floats

    def solve(self) -> tuple[Floats, Floats]:
        """Values (p,) and the inverse (p, p) of the sum of squares."""
        inverse = np.linalg.inv(self.squares.sum(axis=0))
        return inverse @ self.products.sum(axis=0), inverse


def sums(moment: Floats, rate: Floats, variance: Floats | float, model: str, columns: Sequence[str]) -> Sums:
    """The normal equations of moments (R,) on the regressors of rates (R,) of that variance [rad²/s²]."""
    power = np.array([_power(role, model) for role in columns])
    hermite = without_noise(rate, variance)
    sign = np.sign(regressors(np.sign(rate), model, columns))
    products = sign * hermite[:, power] * moment[:, None]
    return Sums(sign[:, :, None] * sign[:, None, :] * hermite[:, power[:, None] + power], products)


def _power(role: str, model: str) -> int:
    """Power of the rate with which a parameter of a drag model goes."""
    return {"quadratic": 2, "linear": 1, "difference": 1 if model == "1" else 2}.get(role, 0)


def without_noise(rate: Floats, variance: Floats | float) -> Floats:
    """Powers 0 to 4 of the size of rates (R,) without what noise of this variance adds to their means, (R, 5)."""
    w, v = np.abs(rate), np.broadcast_to(variance, rate.shape)
    powers = [np.ones_like(w), w, w**2 - v, w**3 - 3.0 * v * w, w**4 - 6.0 * v * w**2 + 3.0 * v**2]
    return np.stack(powers, axis=1)


def fit_drag_by_way(
    moment: Floats, rate: Floats, model: str, moment_unit: str, dof: Dof, variance: Floats | float = 0.0
) -> DragFit:
    """`fit_drag`; of a motion whose drag may differ between its two ways with that, where the points show it."""
    ways = np.sum(rate > 0), np.sum(rate < 0)
    if not dof.directional or min(ways) < FEWEST_A_WAY or model not in ("1", "2", "3"):
        return fit_drag(moment, rate, model, moment_unit, dof, variance=variance)
    try:
        apart = fit_drag(moment, rate, model, moment_unit, dof, sided=True, variance=variance)
    except FitError:
        return fit_drag(moment, rate, model, moment_unit, dof, variance=variance)
    low, high = apart.estimates[dof.symbols.difference].ci95
    return apart if low > 0 or high < 0 else fit_drag(moment, rate, model, moment_unit, dof, variance=variance)


def fit_drag(
    moment: Floats,
    rate: Floats,
    model: str,
    moment_unit: str,
    dof: Dof,
    sided: bool = False,
    variance: Floats | float = 0.0,
) -> DragFit:
    """Fit one drag model to steady points: moments (R,) and rates (R,) [rad/s] of known variance [rad²/s²], 0 or (R,).

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
    plain = sums(moment, rate, 0.0, model, columns)
    variance = np.broadcast_to(variance, rate.shape) * _credible(plain, moment, rate, variance, model, columns)
    kept = sums(moment, rate, variance, model, columns)
    values, inverse = kept.solve()
    without = plain.solve()[0]
    residuals = moment - x @ without
    leverage = np.einsum("rp,pk,rk->r", x, inverse, x)
    score = (kept.products - kept.squares @ values) / np.maximum(1.0 - leverage, 1e-6)[:, None]
    influence = score @ inverse
    stderr = np.sqrt(np.sum(influence**2, axis=0))
    sse = float(residuals @ residuals)
    estimates = {
        dof.parameters.get(role, role): Estimate.from_stderr(
            v, e, points - count, dof.unit_of(_like(role, model), moment_unit)
        )
        for role, v, e in zip(columns, values, stderr)
    }
    dilution = dict(zip(estimates, (values - without).tolist()))
    explained = float(kept.products.sum(axis=0) @ values)
    aicc = _aicc(sse, points, count)
    return DragFit(model, dof, estimates, sse, aicc, residuals, variance, dilution, explained, influence)


def _credible(
    plain: Sums, moment: Floats, rate: Floats, variance: Floats | float, model: str, columns: Sequence[str]
) -> float:
    """The share of the variance whose dilution can be taken off: all, but where it would be most of some sum."""
    squares = plain.squares.sum(axis=0)
    noise = squares - sums(moment, rate, variance, model, columns).squares.sum(axis=0)
    worst = float(np.linalg.eigvals(np.linalg.solve(squares, noise)).real.max())
    return min(1.0, MOST_DILUTED / worst) if worst > 0 else 1.0


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
    """Does the larger of two nested models explain more than chance would? Both with the same noise taken off."""
    more = len(large.estimates) - len(small.estimates)
    rest = len(large.residuals) - len(large.estimates)
    f = max(large.explained - small.explained, 0.0) / more / max(large.sse / rest, 1e-300)
    return NestedTest(float(f), (more, rest), float(special.fdtrc(more, rest, f)))


def identity_gap(rate: Floats, k3: float, k2: float, k_r: float, variance: Floats | float = 0.0) -> float:
    """k3 - (k2 + k_r sum|r|³/sum r⁴): zero for any least-squares pair of models 3 and 2, whatever the data; the sums
    are those without noise of the rates.

    The first normal equation of model 2 divided by that of model 3. The paper's printed pair breaks it:
    1.257 - 1.259 = -0.002 with k_r = +0.02753, where at least +0.028 is needed.
    """
    cubes, fourths = without_noise(rate, variance)[:, 3:].sum(axis=0)
    return float(k3 - k2 - k_r * cubes / fourths)
