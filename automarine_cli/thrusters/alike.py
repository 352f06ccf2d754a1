"""Which of several thrusters are alike: each one's square law against that of all others, direction by direction."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import special

from automarine_cli.results.estimate import Estimate
from automarine_cli.thrusters.analysis import Analysis
from automarine_cli.thrusters.forms import SIDES

MEDIAN = np.sqrt(np.pi / 2)  # standard error of a median over that of a mean
CHANCE = 0.05  # that any of the thrusters of one make is told to differ


@dataclass(frozen=True)
class Compared:
    """One thruster beside the others: its square law by direction, by how much its thrust differs from their median
    [percent], the chance of a difference as large, and whether that is beyond chance; or `why` it has no map.
    """

    name: str
    points: int
    law: Mapping[str, Estimate]
    percent: Mapping[str, float]
    p_value: Mapping[str, float]
    differs: bool
    form: str = ""
    rmse_percent: float = 0.0
    why: str = ""

    def to_json(self) -> dict[str, object]:
        """One entry under `by` of thrusters.json."""
        if self.why:
            return {"thruster": self.name, "why": self.why}
        sides = {
            side: {"a": law.to_json(), "differs_percent": self.percent.get(side), "p_value": self.p_value.get(side)}
            for side, law in self.law.items()
        }
        return {
            "thruster": self.name, "points": self.points, "form": self.form,
            "rmse_percent_of_full_scale": self.rmse_percent, "differs": self.differs, **sides,
        }  # fmt: skip


def compared(parts: Mapping[str, Analysis | str]) -> tuple[Compared, ...]:
    """Each thruster, or why it has no map, against the median of the others, which one that differs does not move;
    beyond chance over all thrusters and directions together (Bonferroni)."""
    laws = {name: one.square for name, one in parts.items() if not isinstance(one, str)}
    tests = sum(len(law) for law in laws.values())
    found = []
    for name, one in parts.items():
        if isinstance(one, str):
            found.append(Compared(name, 0, {}, {}, {}, False, why=one))
            continue
        percent, chance = {}, {}
        for side, _ in SIDES:
            others = [law[side] for other, law in laws.items() if other != name and side in law]
            if side in laws[name] and others:
                percent[side], chance[side] = _against(laws[name][side], others)
        differs = any(p < CHANCE / tests for p in chance.values())
        chosen = one.chosen
        error = one.percent(chosen.rmse) or 0.0
        found.append(
            Compared(name, len(one.points), laws[name], percent, chance, differs, chosen.form.name, float(error))
        )
    return tuple(found)


def _against(own: Estimate, others: list[Estimate]) -> tuple[float, float]:
    """Difference from the others' median [percent], and the chance of one as large."""
    middle = float(np.median([one.value for one in others]))
    spread = MEDIAN * float(np.median([_error(one) for one in others])) / np.sqrt(len(others))
    off = own.value - middle
    return 100.0 * off / middle, float(2.0 * special.ndtr(-abs(off) / max(np.hypot(_error(own), spread), 1e-300)))


def _error(one: Estimate) -> float:
    """Standard error, widened for few levels as the 95 % interval is."""
    return float((one.ci95[1] - one.ci95[0]) / (2.0 * special.ndtri(0.975)))
