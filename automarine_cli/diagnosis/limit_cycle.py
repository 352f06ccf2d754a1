"""A controller's limit cycle: command and position that swing together, as a loop with a lag or a dead-band does.

A wave would show in the position first, and the command would answer it; in a limit cycle neither comes from outside.
The two cannot be distinguished by their period, so that there a periodic disturbance is the last thing to believe.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from automarine_cli.dofs import Dof
from automarine_cli.runs.run import Run

STEP, SEGMENT = 0.25, 30.0
"""Of the spectra [s]."""
SLOWEST, QUICKEST = 15.0, 1.0
"""Periods [s] at which loops of small vehicles swing."""
MOST = 0.4
"""Share of the command's variance that one period has to hold, and of coherence between command and position."""
NEAR = 0.25
"""Share by which another period may differ from that of a cycle and still be the same."""


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
        """For the result file."""
        return {
            "period_s": self.period,
            "share_of_command": self.share,
            "coherence": self.coherence,
            "phase_behind_command_deg": float(np.degrees(self.phase)),
        }

    def sentence(self, dof: Dof) -> str:
        """What a person should know."""
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

    rate, length = 1.0 / STEP, int(SEGMENT / STEP)
    own, cross, positions, weight = 0.0, 0.0, 0.0, 0.0
    frequency = np.fft.rfftfreq(length, STEP)
    for run in runs:
        time = np.arange(run.time[0], run.time[-1], STEP)
        if len(time) < length:
            continue
        command, position = (np.interp(time, run.time, column) for column in (run.command, run.position))
        settings = {"fs": rate, "nperseg": length, "detrend": "linear"}
        own = own + len(time) * signal.welch(command, **settings)[1]
        positions = positions + len(time) * signal.welch(position, **settings)[1]
        cross = cross + len(time) * signal.csd(command, position, **settings)[1]
        weight += len(time)
    if not weight or not np.any(own):
        return None
    power = np.asarray(own)
    may = (frequency >= 1.0 / SLOWEST) & (frequency <= 1.0 / QUICKEST)
    peak = int(np.argmax(np.where(may, power, -1.0)))
    near = np.abs(frequency / frequency[peak] - 1.0) < NEAR
    share = float(power[near].sum() / power.sum())
    here = np.asarray(cross)[peak]
    coherence = float(np.abs(here) ** 2 / max(power[peak] * np.asarray(positions)[peak], 1e-300))
    inside = 0 < peak < len(power) - 1 and power[peak] > 2.0 * np.median(power[may])
    if not inside or share < MOST or coherence < MOST:
        return None
    return LimitCycle(float(1.0 / frequency[peak]), share, coherence, float(-np.angle(here)) % (2.0 * np.pi))
