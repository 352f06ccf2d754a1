"""A dependence that no law of the library has: a smooth curve over one variable, learned from the logs.

`learned("water_temp_C")` makes the effect of a variable; its name is "learned:water_temp_C". The curve is a cubic
spline through values at KNOTS places, equally far apart from `low` to `high`, and constant beyond; over an angle
it closes on itself. Which curve is likely is said by its `spread` alone, see `roughness`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import inf

import numpy as np

from automarine_cli.dofs import DOFS, Dof
from automarine_cli.effects.base import MIXED, Effect, Parameter, State, choice, choose, reference
from automarine_cli.errors import ModelError
from automarine_cli.quantities import CLOCK, SINCE, Floats

PREFIX = "learned:"
KNOTS = 10
FIRST_KNOTS = 4
"""Place of the curve's first value among the parameters; what stands before them is not fitted."""
TIME = "time-in-run"
KINDS = MOMENT, GAIN_CURVE, DRAG = ("moment", "gain", "drag")
"""What a curve may be: a moment (or force) of its own, a relative gain on the thrust delivered, or a coefficient of
linear drag. The last two make a product of two variables, thrust or speed times what the curve runs over."""
MIN_SLOPE_SHARE, LEVEL_WEIGHT = 0.1, 0.01
"""How much a slope and a level count beside the curvature in `roughness`."""

Read = Callable[[State], Floats]


@dataclass(frozen=True)
class Variable:
    """What a curve runs over: its unit (a template), how it is read from the state, the kinds that are tried.

    Where `sized` only its size counts, and a moment has its sign; `turn` is where it closes on itself, as a heading
    does; `uses_position`, `uses_absolute` and `needs` as those of an effect, `motions` the names of the degrees of
    freedom that have it; `code` reads it in exported files, where it is neither a column nor a heading.
    """

    name: str
    unit: str
    read: Read
    kinds: tuple[str, ...] = KINDS
    sized: bool = False
    turn: float = 0.0
    uses_position: bool = False
    uses_absolute: bool = False
    needs: tuple[str, ...] = ()
    motions: tuple[str, ...] = tuple(DOFS)
    code: str = ""


def hyphened(words: str) -> str:
    return words.replace(" ", "-")


def variable_of(name: str) -> Variable:
    """The variable of that name: of the motion, of its command, a time, or else a logged column."""
    if name == TIME:
        return Variable(name, "s", lambda state: state.time, code="state.time")
    column = Variable(name, "", lambda state: state.signals[name], needs=(name,))
    if name in (CLOCK, SINCE):
        return replace(column, unit="s", kinds=(GAIN_CURVE,) if name == SINCE else KINDS)

    def motions(word: str) -> tuple[str, ...]:
        return tuple(dof.name for dof in DOFS.values() if hyphened(getattr(dof.words, word)) == name)

    if dofs := motions("rate"):
        return Variable(name, "{x}/s", lambda state: state.relative, (MOMENT, GAIN_CURVE), sized=True, motions=dofs,
                        code="state.relative")  # fmt: skip
    if dofs := motions("force"):
        return Variable(name, "{force}", lambda state: state.delivered, (GAIN_CURVE,), sized=True, motions=dofs,
                        code="state.delivered")  # fmt: skip
    if dofs := motions("travelled"):
        return Variable(name, "{x}", lambda state: state.travelled, uses_position=True, motions=dofs,
                        code="state.travelled")  # fmt: skip
    if dofs := tuple(motion for motion in motions("position") if DOFS[motion].wraps or DOFS[motion].restoring):
        turn, place = DOFS[dofs[0]].turn, Variable(name, "{x}", lambda state: state.position, uses_position=True,
                                                   uses_absolute=True, motions=dofs, code="state.position")  # fmt: skip
        return replace(place, read=lambda state: state.position % turn, turn=turn, code="") if turn < inf else place
    return column


class Learned(Effect):
    """f(x), f(x) times the thrust, or -f(x) times the speed; `learned` makes one for a variable x."""

    mistaken_for = ()
    source = "Wood (2017), Generalized Additive Models, sections 5 and 6 (penalised splines, smoothness by likelihood)"
    parity = MIXED
    variable: Variable

    def acts_in(self, dof: Dof) -> bool:
        return dof.name in self.variable.motions

    def foreknown(self, signals: Mapping[str, Floats], values: tuple[Floats, ...]) -> Floats | None:
        if not self.needs:
            return None
        low, high, _, _, *curve, _ = values  # the ends are the same of all parameter sets: no fit moves them
        x = signals[self.variable.name].T
        shape = basis(x.ravel(), float(low.flat[0]), float(high.flat[0]), closed=bool(self.variable.turn))
        return (np.concatenate(curve, axis=1) @ shape.T).reshape(-1, *x.shape)

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats:
        low, high, size, _, *curve, kind = values
        curve_value = state.signals.get(self.name)
        side: Floats | float = 1.0
        if curve_value is None:
            x = self.variable.read(state)
            if self.variable.sized:
                x, side = np.abs(x), np.sign(x)
            curve_value = spline(x, low, high, curve, closed=bool(self.variable.turn))
        factor = choose(kind, lambda: size * side, lambda: state.delivered, lambda: -size * state.relative)
        return np.asarray(factor * curve_value)


def kind_of(values: Sequence[float]) -> str:
    """Which of KINDS the curve of these parameter values is."""
    return KINDS[round(values[-1])]


def scale_of(values: Sequence[float]) -> float:
    """What the values of a curve are told in: the size, or one where it is a gain."""
    return 1.0 if kind_of(values) == GAIN_CURVE else values[2]


def spline(x: Floats, low: Floats, high: Floats, values: Sequence[Floats], *, closed: bool) -> Floats:
    """The curve through `values`, K arrays (P, 1), at equal steps from `low` to `high`, at `x` (P, R).

    The cubic spline, constant beyond; where `closed` the first value comes again at `high`.
    """
    piece, u = _pieces(x, low, high, closed)
    cubics = _CUBICS[closed]
    powers = np.concatenate(values, axis=1) @ cubics.reshape(-1, KNOTS).T  # of each set, piece by piece
    first = len(cubics) * np.arange(len(powers))[:, None]
    cubic = powers.reshape(-1, cubics.shape[1]).take(piece + first, axis=0)
    return np.asarray(((cubic[..., 3] * u + cubic[..., 2]) * u + cubic[..., 1]) * u + cubic[..., 0])


def _pieces(x: Floats, low: Floats | float, high: Floats | float, closed: bool) -> tuple[np.ndarray, Floats]:
    """In which piece of a curve `x` lies, of runaways the first, and how far into it as a share."""
    pieces = len(_CUBICS[closed])
    at = pieces * (x - low) / (high - low)
    at = at % pieces if closed else np.minimum(np.maximum(at, 0.0), pieces)
    piece = np.fmin(np.fmax(at, 0.0), pieces - 1.0).astype(np.int64)
    return piece, at - piece


def _cubics(closed: bool) -> Floats:
    """From values at knots one apart to coefficients of the powers 0 to 3 of the way into each piece, (pieces, 4, K):
    the first two and the last two pieces are one cubic (de Boor's not-a-knot), so that drag by powers of the speed is
    such a curve; unless closed."""
    before, after = np.roll(np.eye(KNOTS), 1, axis=0), np.roll(np.eye(KNOTS), -1, axis=0)
    second = before - 2.0 * np.eye(KNOTS) + after
    equations, rises = 6.0 * np.eye(KNOTS) + second, 6.0 * second
    if not closed:
        equations[[0, -1]], rises[[0, -1]] = second[[1, -2]], 0.0
    bends = np.linalg.solve(equations, rises)  # second derivatives at the knots
    values, following = np.eye(KNOTS), np.roll(np.eye(KNOTS), -1, axis=0)
    bent = np.roll(bends, -1, axis=0)
    slopes = following - values - (2.0 * bends + bent) / 6.0
    coefficients = np.stack([values, slopes, 0.5 * bends, (bent - bends) / 6.0], axis=1)
    return coefficients if closed else coefficients[:-1]


_CUBICS = {closed: _cubics(closed) for closed in (False, True)}


def basis(x: Floats, low: float, high: float, *, closed: bool) -> Floats:
    """What each of the KNOTS values adds to the curve at `x` (n,): (n, KNOTS)."""
    piece, u = _pieces(x, low, high, closed)
    return np.asarray(np.einsum("nj,njk->nk", np.stack([u**0, u, u**2, u**3], axis=1), _CUBICS[closed][piece]))


def roughness(closed: bool) -> Floats:
    """Prior precision of the values of a curve of spread one, (KNOTS, KNOTS): Gaussian second differences of standard
    deviation one, with slopes and the level all but free."""
    after = np.roll(np.eye(KNOTS), -1, axis=0)
    slope = after - np.eye(KNOTS)
    curve = after - 2.0 * np.eye(KNOTS) + after.T
    if not closed:
        slope, curve = slope[:-1], curve[1:-1]
    return curve.T @ curve + MIN_SLOPE_SHARE * slope.T @ slope + LEVEL_WEIGHT * np.eye(KNOTS)


def learned(name: str) -> Effect:
    """The effect of a variable by its whole name, "learned:VARIABLE". Raises ModelError where that names none."""
    variable_name = name.removeprefix(PREFIX)
    if not variable_name or variable_name == name:
        raise ModelError(f"effect {name!r}: expected learned: and a variable, such as learned:yaw-rate")
    variable = variable_of(variable_name)
    text = variable_name.replace("{", "{{").replace("}", "}}")
    logs = partial(Parameter, reference="logs")
    members = {
        "name": name,
        "variable": variable,
        "parameters": (
            logs("low", f"{text} at the first knot", variable.unit),
            logs("high", f"{text} at the last knot", variable.unit, start=1.0),
            reference("size", "{force} of which a curve of {forces} is told in shares"),
            logs("spread", "how much neighbouring slopes of the curve may differ", "1", 0.0, start=1.0),
            *(Parameter(f"y{k}", f"the curve at knot {k} of {KNOTS}", "1") for k in range(1, KNOTS + 1)),
            choice("kind", "what the curve is", "; ".join(KINDS)),
        ),
        "equation": f"y({text}) times {{f}}_delivered, the size, or -{{v}} times the size",
        "says": f"The {{force}} depends on {text}; no effect of the library does this.",
        "reveals": f"the same {{forces}} over the whole range of {text}",
        "separated_by": f"runs in which {text} changes and all else stays as it is",
        "uses_position": variable.uses_position,
        "uses_absolute": variable.uses_absolute,
        "needs": variable.needs,
    }  # fmt: skip
    effect: Effect = type("Learned", (Learned,), members)()
    return effect
