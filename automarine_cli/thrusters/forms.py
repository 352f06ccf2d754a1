"""The family of thrust curves, and the fit of one direction by least squares.

Every form is a special case of `f(u) = a max(min(u, n_sat) - n_0, 0)^p` with `u = |n|`: the square law (the source
paper's equation 2) has p = 2, no dead band (n_0 = 0) and no saturation; the others free one, two or three of them.

Many sets of weights are fitted at once: the left-out levels of a cross-validation are weights of zero. A grid over dead
band, exponent and saturation with the amplitude solved for (variable projection), then bounded Levenberg-Marquardt
steps from the best grid points. Deterministic: no random starts.
"""

from dataclasses import dataclass

import numpy as np

from automarine_cli.quantities import Floats

SIDES = (("forward", 1.0), ("backward", -1.0))
SQUARE = 2.0
SUFFIX = "-saturation"


@dataclass(frozen=True)
class Form:
    """One form of the family: which of dead band, exponent and saturation are free beside the amplitude."""

    name: str
    dead_band: bool
    exponent: bool
    saturation: bool

    @property
    def mask(self) -> np.ndarray:
        """Which of amplitude, dead band, exponent and saturation are free, (4,)."""
        return np.array([True, self.dead_band, self.exponent, self.saturation])

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the free parameters in each direction, amplitude first."""
        return tuple(name for name, on in zip(("a", "n_0", "p", "n_sat"), self.mask) if on)

    @property
    def parameters(self) -> int:
        return len(self.free)

    @property
    def equation(self) -> str:
        level = "min(|n|, n_sat)" if self.saturation else "|n|"
        inner = f"max({level} - n_0, 0)" if self.dead_band else level
        return f"|F| = a {inner}^{'p' if self.exponent else '2'}"


_BASE = (("square", False, False), ("dead-band", True, False), ("power", False, True), ("dead-band-power", True, True))
FORMS: dict[str, Form] = {
    name + (SUFFIX if saturation else ""): Form(name + (SUFFIX if saturation else ""), dead_band, exponent, saturation)
    for saturation in (False, True)
    for name, dead_band, exponent in _BASE
}


@dataclass(frozen=True)
class Curve:
    """Thrust in one direction: amplitude a [N/n^p], exponent p [1], dead band n_0 and saturation n_sat [unit of n],
    None where thrust never saturates."""

    a: float
    p: float = SQUARE
    n_0: float = 0.0
    n_sat: float | None = None

    def thrust(self, magnitude: Floats) -> Floats:
        """Size of the thrust [N] for |n| of any shape."""
        level = magnitude if self.n_sat is None else np.minimum(magnitude, self.n_sat)
        return np.asarray(self.a * np.maximum(level - self.n_0, 0.0) ** self.p)


def thrust_both_ways(forward: Curve | None, backward: Curve | None, n: Floats, unmeasured: float = np.nan) -> Floats:
    """Thrust [N] at control signals n of any shape, `unmeasured` in a direction without a curve."""
    total = np.zeros_like(n)
    for (_, sign), curve in zip(SIDES, (forward, backward)):
        here = n * sign > 0
        total[here] = unmeasured if curve is None else sign * curve.thrust(np.abs(n[here]))
    return np.asarray(total + 0.0)  # no negative zero


# Bounds of (amplitude, dead band, exponent, saturation), the second and fourth as shares of the largest command.
LOW = np.array([0.0, 0.0, 0.3, 0.3])
HIGH = np.array([np.inf, 0.8, 4.0, 1.0])
AS_GOOD = 1e-6  # relative difference of sums of squares that counts as none
STARTS = 5
STEPS = 60
SMALL = 1e-9


@dataclass(frozen=True)
class Fits:
    """Parameters of B weighted fits, shape (B, 4): amplitude [N] at full command, dead band, exponent, saturation;
    dead band and saturation are shares of the largest command `scale` [unit of n]."""

    values: Floats
    scale: float

    def thrust(self, magnitude: Floats) -> Floats:
        """Size of the thrust [N], shape (B, N), at |n| of shape (N,)."""
        return _curve(magnitude[None, :] / self.scale, self.values)


def fit_direction(magnitude: Floats, thrust: Floats, weights: Floats, form: Form) -> Fits:
    """Least squares of `thrust` [N] on |n|, both of shape (N,), for each row of `weights`, shape (B, N)."""
    scale = float(np.max(magnitude))
    x = magnitude / scale
    starts = _starts(x, thrust, weights, form)  # (B, S, 4)
    flat, repeated = starts.reshape(-1, 4), np.repeat(weights, starts.shape[1], axis=0)
    if form.parameters > 1:
        flat = _refine(x, thrust, repeated, flat, form.mask)
    values, sse = flat.reshape(starts.shape), _sse(x, thrust, repeated, flat).reshape(starts.shape[:2])
    # of those as good as the best the one with least dead band and saturation: levels left out may not show either
    as_good = sse <= sse.min(axis=1, keepdims=True) * (1.0 + AS_GOOD)
    best = np.argmax(np.where(as_good, values[:, :, 3] - values[:, :, 1], -np.inf), axis=1)
    return Fits(values[np.arange(len(weights)), best], scale)


def _level(x: Floats, values: Floats) -> Floats:
    """Command above the dead band and below saturation, 1 at full command, shape (B, N)."""
    dead, top = values[:, 1:2], values[:, 3:4]
    return np.asarray(np.maximum(np.minimum(x, top) - dead, 0.0) / (1.0 - dead))


def _curve(x: Floats, values: Floats) -> Floats:
    return np.asarray(values[:, :1] * _level(x, values) ** values[:, 2:3])


def _sse(x: Floats, y: Floats, weights: Floats, values: Floats) -> Floats:
    return np.asarray(np.sum(weights * (y - _curve(x[None, :], values)) ** 2, axis=1))


def _grid(x: Floats, form: Form) -> Floats:
    """Grid of (1, dead band, exponent, saturation), shape (G, 4), for the parameters that are free."""
    dead = np.linspace(0.0, min(0.6, 0.95 * float(np.sort(x)[-2])), 16) if form.dead_band else np.array([0.0])
    power = np.array([0.4, 0.6, 0.8, 1.0, 1.3, 1.6, 1.8, 2.0, 2.2, 2.6, 3.2]) if form.exponent else np.array([SQUARE])
    top = np.linspace(0.35, 1.0, 14) if form.saturation else np.array([1.0])
    mesh = np.stack(np.meshgrid([1.0], dead, power, top, indexing="ij"), axis=-1).reshape(-1, 4)
    return mesh[mesh[:, 3] > mesh[:, 1] + 0.1]


def _starts(x: Floats, y: Floats, weights: Floats, form: Form) -> Floats:
    """Best grid points with their amplitudes, shape (B, S, 4), no two of them neighbours in everything."""
    grid = _grid(x, form)
    shape = _curve(x[None, :], grid)  # (G, N)
    cross, square = (weights * y) @ shape.T, weights @ (shape**2).T  # (B, G)
    amplitude = np.maximum(cross / np.maximum(square, 1e-300), SMALL)
    sse = (weights @ y**2)[:, None] - 2.0 * amplitude * cross + amplitude**2 * square
    order = np.argsort(sse, axis=1, kind="stable")[:, : min(STARTS, len(grid))]
    starts = grid[order]
    starts[:, :, 0] = np.take_along_axis(amplitude, order, axis=1)
    return np.asarray(starts)


def jacobian(x: Floats, values: Floats) -> Floats:
    """Derivative of the thrust by the four parameters, shape (B, N, 4); x is |n| / scale, shape (N,)."""
    amplitude, dead, power, top = (values[:, i : i + 1] for i in range(4))
    level = _level(x[None, :], values)
    on = level > 0.0
    safe = np.where(on, level, 1.0)
    unit = np.where(on, safe**power, 0.0)
    slope = np.where(on, amplitude * power * np.maximum(safe, 1e-6) ** (power - 1.0), 0.0)
    by_dead = slope * (np.minimum(x[None, :], top) - 1.0) / (1.0 - dead) ** 2
    by_power = np.where(on, amplitude * unit * np.log(safe), 0.0)
    by_top = np.where(x[None, :] >= top, slope / (1.0 - dead), 0.0)
    return np.stack([unit, by_dead, by_power, by_top], axis=-1)


def _refine(x: Floats, y: Floats, weights: Floats, values: Floats, free: np.ndarray) -> Floats:
    """Bounded Levenberg-Marquardt on all rows of `values`, (B, 4), at once; no step makes a fit worse."""
    values = np.clip(values, LOW, HIGH)
    sse = _sse(x, y, weights, values)
    damping = np.full(len(values), 1e-3)
    width = int(free.sum())
    for _ in range(STEPS):
        residual = y - _curve(x[None, :], values)
        matrix = jacobian(x, values)[:, :, free]
        weighted = weights[:, :, None] * matrix
        gradient = np.einsum("bnk,bn->bk", weighted, residual)
        at = values[:, free]
        # A parameter that stands at its bound and is pushed outwards stays there.
        held = ((at <= LOW[free]) & (gradient < 0)) | ((at >= HIGH[free]) & (gradient > 0))
        gradient = np.where(held, 0.0, gradient)
        normal = np.einsum("bnk,bnl->bkl", weighted, matrix)
        normal = np.where(held[:, :, None] | held[:, None, :], 0.0, normal)
        diagonal = np.einsum("bkk->bk", normal)
        damped = damping[:, None] * diagonal + SMALL * diagonal.max(axis=1, keepdims=True) + 1e-300
        normal = normal + np.eye(width) * damped[:, :, None]
        step = np.linalg.solve(normal, gradient[:, :, None])[:, :, 0]
        trial = values.copy()
        trial[:, free] = np.clip(at + step, LOW[free], HIGH[free])
        trial_sse = _sse(x, y, weights, trial)
        better = trial_sse < sse
        gain = np.where(better, sse - trial_sse, 0.0)
        values = np.where(better[:, None], trial, values)
        settled = np.all((gain <= 1e-12 * sse) & (better | (damping > 1e8)))
        sse = np.where(better, trial_sse, sse)
        damping = np.clip(np.where(better, damping / 5.0, damping * 4.0), 1e-12, 1e12)
        if settled:
            break
    return values
