"""What runs cost: minutes in the pool, motion, and charge drawn from the battery."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from automarine_cli.planning.candidates import Candidate
from automarine_cli.planning.limits import Limits

Floats = NDArray[np.float64]

POWER_LAW = 1.5
"""Power against thrust of a propeller at rest in the water: P = F^1.5/sqrt(2 rho A) by momentum theory (Rankine)."""


@dataclass(frozen=True)
class Supply:
    """What is drawn [A]: `idle` always, `full` more at the `largest` moment."""

    idle: float
    full: float
    largest: float

    def current(self, moment: float) -> float:
        """Current [A] while `moment` acts."""
        return self.idle + self.full * (abs(moment) / self.largest) ** POWER_LAW

    def drawn(self, candidate: Candidate, still: float) -> float:
        """Charge [Ah] of a run and of `still` seconds without any moment."""
        driven = sum(self.current(moment) * seconds for moment, seconds in candidate.commands)
        return float((driven + self.idle * still) / 3600.0)


def wait_after(candidate: Candidate, limits: Limits) -> float:
    """How long the water needs after a run [s]."""
    return limits.pool.wait_after_long_turn_s if candidate.turns else limits.pool.wait_s


def costs(candidates: Sequence[Candidate], limits: Limits, supply: Supply) -> Floats:
    """Minutes (wait included), runs, motion [s] and charge [Ah] of each candidate, (K, 4)."""
    rows = []
    for one in candidates:
        still = limits.runs.rest_before_s + wait_after(one, limits)
        rows.append(((one.driven + still) / 60.0, 1.0, one.motion, supply.drawn(one, still)))
    return np.array(rows)


def allowance(limits: Limits) -> Floats:
    """What all runs together may cost, (4,), in the units of `costs`; the last run needs no wait."""
    charge = limits.battery.charge_Ah * (1.0 - limits.battery.reserve_percent / 100.0)
    motion = np.inf if limits.pool.motion_s is None else limits.pool.motion_s
    return np.array(
        [limits.pool.minutes + limits.pool.wait_s / 60.0, float(limits.pool.runs), motion, charge]
    )
