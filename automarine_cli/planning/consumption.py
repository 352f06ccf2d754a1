"""What a thruster draws, from tests that logged a current or a power beside the thrust."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from automarine_cli.errors import RunError
from automarine_cli.planning.budget import POWER_LAW
from automarine_cli.thrusters.records import Series

Floats = NDArray[np.float64]

COLUMNS = ("power_W", "current_A")
FEWEST = 6


@dataclass(frozen=True)
class Consumption:
    """Electrical power of one thruster: `idle` + c |F|^1.5 [W], c `ahead` and `astern` [W/N^1.5]."""

    idle: float
    ahead: float
    astern: float

    def power(self, force: float) -> float:
        """Power [W] that the thrust `force` [N] takes, without the idle share."""
        return (self.ahead if force > 0 else self.astern) * abs(force) ** POWER_LAW


def consumption(records: Sequence[Series], per_test: int, volts: float) -> Consumption:
    """Least squares over all rows with a power or a current, none of the three below zero; `per_test` equal thrusters
    pulled together, `volts` of the supply where a current was logged without a voltage.

    Raises RunError where no test has such a column, or too few rows.
    """
    force, power = [], []
    for one in records:
        drawn = _power(one, volts)
        if drawn is not None:
            good = np.isfinite(drawn)
            force.append(one.force[good] / per_test)
            power.append(drawn[good] / per_test)
    count = sum(map(len, force))
    if count < FEWEST:
        raise RunError(
            f"{count} rows of the thruster tests hold a power or a current, and {FEWEST} are needed; name the column "
            "power_W or current_A, or state the current at full moment with battery.full_A in the limits"
        )
    f, p = np.concatenate(force), np.concatenate(power)
    size = np.abs(f) ** POWER_LAW
    design = np.stack([np.ones_like(f), np.where(f > 0, size, 0.0), np.where(f < 0, size, 0.0)], axis=1)
    idle, ahead, astern = optimize.nnls(design, p)[0]
    return Consumption(float(idle), float(ahead or astern), float(astern or ahead))


def _power(one: Series, volts: float) -> Floats | None:
    """Power [W] of all pulling thrusters, (N,), or None."""
    if "power_W" in one.extras:
        return one.extras["power_W"]
    if "current_A" not in one.extras:
        return None
    return one.extras["current_A"] * (volts if one.voltage is None else one.voltage)
