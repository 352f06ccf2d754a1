"""What was learned, to be shown: the curve with its band, and what the verdict says of it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from automarine_cli import effects
from automarine_cli.diagnosis.smooth import learned_term, places
from automarine_cli.diagnosis.trials import Found, Trial
from automarine_cli.diagnosis.verdict import NamedEffect
from automarine_cli.effects.learned import DRAG, GAIN, MOMENT, PREFIX, Learned, basis, kind_of, scale_of
from automarine_cli.quantities import Floats

POINTS = 61
"""Places at which a curve is told."""


@dataclass(frozen=True)
class LearnedCurve:
    """A curve over `variable` [`unit`]: `y` (POINTS,) at `x` [`y_unit`], with its 95 % band from `low` to `high`.

    It is in the gauge of the fit: of a gain the mean is in inertia and drag, of a moment over the speed what drag of
    the model would do is in that.
    """

    variable: str
    unit: str
    kind: str
    y_unit: str
    x: Floats
    y: Floats
    low: Floats
    high: Floats
    sized: bool
    needs: tuple[str, ...]

    @property
    def range(self) -> float:
        """Largest less smallest value of the curve."""
        return float(np.ptp(self.y))

    def to_json(self) -> dict[str, object]:
        """The contract's form."""
        return {
            "variable": self.variable,
            "unit": self.unit,
            "kind": self.kind,
            "y_unit": self.y_unit,
            "x": self.x.tolist(),
            "y": self.y.tolist(),
            "low": self.low.tolist(),
            "high": self.high.tolist(),
        }


def curve_of(trial: Trial) -> LearnedCurve | None:
    """The learned curve of a trial; None where it has none."""
    inside = learned_term(trial.model)
    if inside is None:
        return None
    model, term = trial.model, trial.model.terms[inside]
    effect = effects.get(term.name)
    assert isinstance(effect, Learned)
    low, high = term.values[:2]
    kind, variable, scale = kind_of(term.values), effect.variable, scale_of(term.values)
    y_unit = {MOMENT: "{force}", GAIN: "1", DRAG: "{force} s{/x}"}[kind]
    at = places(model)
    covariance, values = trial.fit.covariance[np.ix_(at, at)], trial.fit.theta[at]
    x = np.linspace(low, high, POINTS)
    shape = basis(x, low, high, closed=bool(variable.turn))
    y = shape @ values * scale
    half = special.ndtri(0.975) * scale * np.sqrt(np.einsum("nk,kj,nj->n", shape, covariance, shape))
    return LearnedCurve(
        variable=term.name.removeprefix(PREFIX),
        unit=model.dof.unit_in(variable.unit, model.moment_unit),
        kind=kind,
        y_unit=model.dof.unit_in(y_unit, model.moment_unit),
        x=x,
        y=y,
        low=y - half,
        high=y + half,
        sized=variable.sized,
        needs=variable.needs,
    )


def with_curves(found: Found, named: Sequence[NamedEffect]) -> tuple[NamedEffect, ...]:
    """The effects named with what was learned, and a sentence that says whether it is thrust or a moment."""
    curve = curve_of(found.final)
    return tuple(
        replace(one, learned=curve, says=sentence(curve, found))
        if curve is not None and one.name == PREFIX + curve.variable
        else one
        for one in named
    )


def sentence(curve: LearnedCurve, found: Found) -> str:
    """What the verdict says of a curve."""
    words = found.final.model.dof.words
    size = f"{100 * curve.range:.2g} %" if curve.kind == GAIN else f"{curve.range:.2g} {curve.y_unit}"
    what, which = {
        MOMENT: (f"A {words.force}", "it differs"),
        GAIN: ("The thrust", "it differs"),
        DRAG: ("The drag", f"what it has in proportion to the {words.rate} differs"),
    }[curve.kind]
    return f"{what} depends on {curve.variable}: {which} by {size} over its range; no effect of the library does this."
