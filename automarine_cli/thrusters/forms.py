"""The family of thrust curves: thrust of one thruster in one direction against its control signal.

Every form is a special case of `f(u) = a max(min(u, n_sat) - n_0, 0)^p` with `u = |n|`: the square law (the
source paper's equation 2) has p = 2, no dead band (n_0 = 0) and no saturation; the others free one, two or
three of them.
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
    def parameters(self) -> int:
        """Free parameters in each direction, amplitude included."""
        return 1 + self.dead_band + self.exponent + self.saturation

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the free parameters in each direction, amplitude first."""
        flags = (("n_0", self.dead_band), ("p", self.exponent), ("n_sat", self.saturation))
        return ("a", *(name for name, on in flags if on))

    @property
    def equation(self) -> str:
        """The form in one line, for tables and figures."""
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
    """Thrust in one direction: amplitude a [N/n^p], exponent p [1], dead band n_0 and saturation n_sat [unit
    of n].

    `n_sat` is None where thrust never saturates.
    """

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
