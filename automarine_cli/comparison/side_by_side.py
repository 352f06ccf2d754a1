"""Two or more results side by side: how far their parameters are apart, with intervals, and whether that is chance."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import special

from automarine_cli.results.estimate import Estimate

DIFFERS, MAY_DIFFER, ALIKE = "differs", "may differ", "no difference shown"
LEVEL = 0.05
Z95 = float(special.ndtri(0.975))


@dataclass(frozen=True)
class Side:
    """One of the results: what it is called, its parameters by name, and what else it says of itself in words."""

    name: str
    parameters: Mapping[str, Estimate]
    facts: Mapping[str, str]
    runs: int


@dataclass(frozen=True)
class OverRuns(Estimate):
    """The mean of a number over runs, with the interval that their scatter gives it, and the number `by_run`."""

    by_run: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, by_run: Mapping[str, float], unit: str) -> "OverRuns":
        """Of two runs or more."""
        values = np.array(list(by_run.values()))
        middle, stderr = float(values.mean()), float(values.std(ddof=1) / np.sqrt(len(values)))
        half = float(special.stdtrit(len(values) - 1, 0.975)) * stderr
        return cls(middle, stderr, (middle - half, middle + half), unit, by_run=by_run)


@dataclass(frozen=True)
class Difference:
    """One parameter of the result `of` less that of the result `base`.

    `p_value` is two-sided, None where neither is uncertain; `verdict` allows for how many were compared.
    """

    parameter: str
    of: str
    base: str
    difference: Estimate
    relative: tuple[float, float, float] | None
    p_value: float | None
    verdict: str

    def to_json(self) -> dict[str, object]:
        """Its form in comparison.json."""
        return {
            "parameter": self.parameter,
            "of": self.of,
            "less": self.base,
            "difference": self.difference.to_json(),
            "relative_percent": None if self.relative is None else list(self.relative),
            "p_value": self.p_value,
            "verdict": self.verdict,
        }


def difference(one: Estimate, other: Estimate) -> Estimate:
    """`one` less `other`, both from data of their own; of means over runs run by run, of two that both have or more.

    The interval takes the distance of each end from its value from the two intervals, so that it is as skew as
    they are (Zou and Donner 2008, Statistics in Medicine 27:1693, equation 9).
    """
    if isinstance(one, OverRuns) and isinstance(other, OverRuns):
        both = {run: value - other.by_run[run] for run, value in one.by_run.items() if run in other.by_run}
        return OverRuns.of(both, one.unit)
    apart = one.value - other.value
    low = apart - math.hypot(one.value - one.ci95[0], other.ci95[1] - other.value)
    high = apart + math.hypot(one.ci95[1] - one.value, other.value - other.ci95[0])
    return Estimate(apart, math.hypot(one.stderr, other.stderr), (low, high), one.unit)


def comparable(one: Estimate, other: Estimate) -> bool:
    """Whether a difference has an interval: means over runs need two in common."""
    if not (isinstance(one, OverRuns) and isinstance(other, OverRuns)):
        return True
    return len(set(one.by_run) & set(other.by_run)) > 1


def p_value(apart: Estimate) -> float | None:
    """Two-sided p of no difference, at 0.05 just where the interval ends at zero."""
    toward = apart.value - apart.ci95[0] if apart.value > 0 else apart.ci95[1] - apart.value
    if toward <= 0:
        return None
    return float(2 * special.ndtr(-Z95 * abs(apart.value) / toward))


def holm(p_values: Sequence[float]) -> list[float]:
    """p-values that allow for their number (Holm 1979, Scandinavian Journal of Statistics 6:65)."""
    order = np.argsort(p_values, kind="stable")
    factor = np.arange(len(order), 0, -1)
    adjusted = np.empty(len(order))
    adjusted[order] = np.maximum.accumulate(factor * np.asarray(p_values)[order])
    return [float(min(1.0, p)) for p in adjusted]


def differences(sides: Sequence[Side]) -> tuple[Difference, ...]:
    """Each result against the first, parameter by parameter, for all parameters that both have in one unit."""
    found = []
    base = sides[0]
    for side in sides[1:]:
        for name, own in side.parameters.items():
            first = base.parameters.get(name)
            if first is None or first.unit != own.unit or not comparable(own, first):
                continue
            apart = difference(own, first)
            p = p_value(apart)
            verdict = ALIKE if apart.value == 0 or (p is not None and p >= LEVEL) else MAY_DIFFER
            found.append(Difference(name, side.name, base.name, apart, _relative(apart, first), p, verdict))
    adjusted = holm([0.0 if one.p_value is None else one.p_value for one in found])
    return tuple(
        replace(one, verdict=DIFFERS) if one.verdict == MAY_DIFFER and p < LEVEL else one
        for one, p in zip(found, adjusted)
    )


def _relative(apart: Estimate, base: Estimate) -> tuple[float, float, float] | None:
    """The difference and its ends in percent of the first's value; None where that is not well away from zero."""
    low, high = base.ci95
    if low <= 0 <= high or base.value == 0:
        return None
    scale = 100.0 / abs(base.value)
    return scale * apart.value, scale * apart.ci95[0], scale * apart.ci95[1]
