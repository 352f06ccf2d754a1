"""From a learned curve to a formula: the plainest of a small grammar that runs within the curve's band.

What the data say of the curve is quadratic about the fit, u'y - y'H y/2 (see `smooth`), so each form is fitted to the
data themselves, at next to no cost: coefficients by least squares, shapes from a grid on. The length of its description
is half its deviance, half of log R for each number in it, and what its form takes to write (Rissanen 1978, Automatica
14:465).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy import optimize

from automarine_cli.diagnosis.learned_curve import LearnedCurve
from automarine_cli.effects.learned import GAIN, basis
from automarine_cli.quantities import Floats
from automarine_cli.results.estimate import Estimate

LEAST_SLACK = 0.02
"""Share of the curve's range by which a formula may leave the band: none is drawn finer."""
INSIDE = 0.9
"""Share of the points at which it has to be inside: the band holds the truth at each of them in 95 of 100 cases."""


@dataclass(frozen=True)
class Form:
    """One form: `shapes` (n, m) of its m coefficients at x (n,) for the values of its shape parameters, each with its
    unit in powers of x and a grid in shares of the variable's range, and how it is written, for people and in Python;
    `length` of it [nats]. Some need x `above_zero`; shapes that are places count `from_low`, the first knot."""

    name: str
    text: str
    code: str
    coefficients: tuple[str, ...]
    shape: Mapping[str, tuple[float, ...]]
    shapes: Callable[..., Floats]
    length: float
    above_zero: bool = False
    from_low: tuple[str, ...] = ()


def _stacked(*columns: Floats) -> Floats:
    return np.stack(np.broadcast_arrays(*columns), axis=-1)


FORMS = (
    Form("line", "a x", "a * x", ("a",), {}, lambda x: _stacked(x), 1.0),
    Form("square", "a x|x|", "a * x * abs(x)", ("a",), {}, lambda x: _stacked(x * np.abs(x)), 2.0),
    Form(
        "power", "a x^p", "a * x**p", ("a",), {"p": (0.25, 0.5, 1.5, 2.5, 3.0, 4.0)},
        lambda x, p: _stacked(np.maximum(x, 0.0) ** np.clip(p, 0.1, 6.0)), 2.0, above_zero=True,
    ),
    Form(
        "exponential", "a exp(x/L)", "a * np.exp(x / L)", ("a",), {"L": (-1.0, -0.4, -0.15, 0.15, 0.4, 1.0)},
        lambda x, L: _stacked(np.exp(np.clip(x / L, -50.0, 50.0))), 2.0,
    ),
    Form(
        "tanh", "a tanh((x - x_0)/w)", "a * np.tanh((x - x_0) / w)", ("a",),
        {"x_0": (0.1, 0.3, 0.5, 0.7, 0.9), "w": (0.1, 0.2, 0.5)},
        lambda x, x_0, w: _stacked(np.tanh((x - x_0) / w)), 3.0, from_low=("x_0",),
    ),
    Form(
        "ramp", "a max(x - x_0, 0)", "a * np.maximum(x - x_0, 0.0)", ("a",), {"x_0": (0.2, 0.4, 0.6, 0.8)},
        lambda x, x_0: _stacked(np.maximum(x - x_0, 0.0)), 3.0, from_low=("x_0",),
    ),
    Form(
        "sine", "a sin(2 pi x/T) + b cos(2 pi x/T)", "a * np.sin(2 * np.pi * x / T) + b * np.cos(2 * np.pi * x / T)",
        ("a", "b"), {"T": (0.4, 0.6, 0.8, 1.0, 1.3, 1.8)},
        lambda x, T: _stacked(np.sin(2.0 * np.pi * x / T), np.cos(2.0 * np.pi * x / T)), 3.0,
    ),
)  # fmt: skip
"""The grammar. Products of two variables are curves of a gain and of drag: thrust or speed times what stands here."""


@dataclass(frozen=True)
class Formula:
    """A form with its parameters; `constant` where a level of its own is added, `nats` the length of its description,
    `y` (POINTS,) its values in the gauge of the curve."""

    form: Form
    constant: bool
    parameters: Mapping[str, Estimate]
    nats: float
    y: Floats

    @property
    def text(self) -> str:
        """The formula as people write it."""
        return f"{self.form.text} + c" if self.constant else self.form.text

    def to_json(self) -> dict[str, object]:
        """What the result file has of it."""
        return {
            "form": self.form.name,
            "text": self.text,
            "parameters": {name: estimate.to_json() for name, estimate in self.parameters.items()},
            "description_nats": self.nats,
        }


def formula_of(curve: LearnedCurve, runs: int) -> Formula | None:
    """The formula of shortest description within the band of a curve learned from so many runs; None if none is."""
    inside = [one for one in formulas(curve, runs) if _within(curve, one)]
    return min(inside, key=lambda one: one.nats, default=None)


def formulas(curve: LearnedCurve, runs: int) -> list[Formula]:
    """Every form of the grammar fitted to what the data say of a curve."""
    found = []
    for form in FORMS:
        if form.above_zero and curve.knots[0] < 0:
            continue
        for constant in (False, True)[: 1 + (curve.kind != GAIN and not curve.sized)]:
            fitted = _fit(curve, form, constant, runs)
            if fitted is not None:
                found.append(fitted)
    return found


def _fit(curve: LearnedCurve, form: Form, constant: bool, runs: int) -> Formula | None:
    """One form at its best."""
    low, width = float(curve.knots[0]), float(curve.x[-1] - curve.x[0])
    free = _without(curve.other)

    def shapes(x: Floats, values: Floats) -> Floats:
        columns = form.shapes(x, *values)
        return np.concatenate([columns, np.ones((len(x), 1))], axis=1) if constant else columns

    def solved(values: Floats) -> tuple[float, Floats]:
        columns = free @ shapes(curve.knots, values)
        stiff, pull = columns.T @ curve.information @ columns, columns.T @ curve.pull
        scale = np.sqrt(np.maximum(np.diagonal(stiff), 1e-300))
        best = np.linalg.pinv(stiff / np.outer(scale, scale), rcond=1e-9, hermitian=True) @ (pull / scale) / scale
        return float(best @ stiff @ best - 2.0 * pull @ best), best

    def from_shares(shares: Floats) -> Floats:
        names = list(form.shape)
        return np.array([
            v if n == "p" else low + v * width if n in form.from_low else v * width for n, v in zip(names, shares)
        ])  # fmt: skip

    starts = [from_shares(np.array(shares)) for shares in product(*form.shape.values())]
    values = min(starts, key=lambda one: solved(one)[0])
    if len(values):
        unit = np.abs(values) + 1e-9

        def cost(z: Floats) -> float:
            deviance = solved(z * unit)[0]
            return deviance if np.isfinite(deviance) else 1e12

        values = optimize.minimize(cost, values / unit, method="Nelder-Mead").x * unit
    deviance, coefficients = solved(values)
    theta = np.append(coefficients, values)
    names = [*form.coefficients, *(["c"] if constant else []), *form.shape]
    if not np.all(np.isfinite(theta)):
        return None

    def at_knots(theta: Floats) -> Floats:
        return free @ shapes(curve.knots, theta[len(coefficients) :]) @ theta[: len(coefficients)]

    step = 1e-5 * np.maximum(np.abs(theta), 1e-6)
    slope = np.stack([(at_knots(theta + h) - at_knots(theta - h)) / (2.0 * h.sum()) for h in np.diag(step)], axis=1)
    scale = np.sqrt(np.maximum(np.diagonal(slope.T @ curve.information @ slope), 1e-300))
    spread = np.linalg.pinv(slope.T @ curve.information @ slope / np.outer(scale, scale), rcond=1e-12, hermitian=True)
    error = np.sqrt(np.maximum(np.diagonal(spread), 0.0)) / scale
    freedom = float(max(runs - len(theta), 1))
    estimates = {n: Estimate.from_stderr(float(v), float(e), freedom, "") for n, v, e in zip(names, theta, error)}
    whole = curve.pull @ np.linalg.pinv(curve.information, rcond=1e-10, hermitian=True) @ curve.pull
    nats = 0.5 * (deviance + float(whole)) + 0.5 * len(theta) * np.log(runs) + form.length + constant
    here = basis(curve.x, low, float(curve.x[-1]), closed=bool(curve.knots[-1] < curve.x[-1]))
    return Formula(form, constant, estimates, float(nats), here @ at_knots(theta))


def _without(other: Floats) -> Floats:
    """What takes out of values at the knots the curves (n, K) that other terms of the model are, (K, K)."""
    return np.eye(other.shape[1]) - np.linalg.pinv(other) @ other


def _within(curve: LearnedCurve, formula: Formula) -> bool:
    """Whether a formula runs within the band, but for what no eye sees."""
    slack = LEAST_SLACK * curve.range
    inside = (formula.y > curve.low - slack) & (formula.y < curve.high + slack)
    return bool(np.mean(inside) >= INSIDE)
