"""A controller's limit cycle: command and position that swing together, as a loop with a lag or a dead-band does.

A wave would show in the position first, and the command would answer it; in a limit cycle neither comes from outside.
The two cannot be distinguished by their period, so that there a periodic disturbance is the last thing to believe.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from automarine_cli.dofs import Dof
from automarine_cli.runs.run import Run

STEP, SEGMENT = 0.25, 30.0  # of the spectra [s]
SLOWEST, QUICKEST = 15.0, 1.0  # periods [s] at which loops of small vehicles swing
MOST = 0.4  # share of the command's variance that one period has to hold, and of coherence between command and position
NEAR = 0.25  # share by which another period may differ from that of a cycle and still be the same


@dataclass(frozen=True)
class LimitCycle:
    """Command and position swing together with a `period` [s]: the `share` of the command's variance there, their
    `coherence`, and the `phase` of the position behind the command [rad]."""

    period: float
    share: float
    coherence: float
    phase: float

    def holds(self, period: float) -> bool:
        """Whether a period [s] is that of the cycle."""
        return abs(period / self.period - 1.0) < NEAR

    def to_json(self) -> dict[str, float]:
        return {
            "period_s": self.period, "share_of_command": self.share, "coherence": self.coherence,
            "phase_behind_command_deg": float(np.degrees(self.phase)),
        }  # fmt: skip

    def sentence(self, dof: Dof) -> str:
        force, position = dof.words.force, dof.words.position
        return (
            f"Command and {position} swing together every {self.period:.2g} s ({self.share:.0%} of the commanded "
            f"{force}), the {position} {np.degrees(self.phase):.0f} degrees of the cycle behind the {force}: a limit "
            "cycle of the controller. A lag, a delay or a dead-band makes one; a periodic disturbance of that period "
            "is not believed."
        )


def limit_cycle(runs: Sequence[Run]) -> LimitCycle | None:
    """The limit cycle that most of the runs show, from spectra averaged over runs (Welch 1967, IEEE Trans. Audio
    Electroacoustics 15:70); None where there is none, or the runs are too short to show one."""
    from scipy import signal  # here, as it loads half of scipy and only driven runs need it

    length = int(SEGMENT / STEP)
    settings: dict[str, Any] = {"fs": 1.0 / STEP, "nperseg": length, "detrend": "linear"}
    frequency = np.fft.rfftfreq(length, STEP)
    spectra = np.zeros((3, len(frequency)), dtype=complex)  # of the command, of the position, across
    for run in runs:
        time = np.arange(run.time[0], run.time[-1], STEP)
        if len(time) >= length:
            command, position = (np.interp(time, run.time, column) for column in (run.command, run.position))
            pairs = ((command, command), (position, position), (command, position))
            spectra += len(time) * np.array([signal.csd(x, y, **settings)[1] for x, y in pairs])
    power, positions, cross = spectra[0].real, spectra[1].real, spectra[2]
    if not np.any(power):
        return None
    may = (frequency >= 1.0 / SLOWEST) & (frequency <= 1.0 / QUICKEST)
    peak = int(np.argmax(np.where(may, power, -1.0)))
    near = np.abs(frequency / frequency[peak] - 1.0) < NEAR
    share = float(power[near].sum() / power.sum())
    coherence = float(np.abs(cross[peak]) ** 2 / max(power[peak] * positions[peak], 1e-300))
    inside = 0 < peak < len(power) - 1 and power[peak] > 2.0 * np.median(power[may])
    if not inside or share < MOST or coherence < MOST:
        return None
    return LimitCycle(float(1.0 / frequency[peak]), share, coherence, float(-np.angle(cross[peak])) % (2.0 * np.pi))
