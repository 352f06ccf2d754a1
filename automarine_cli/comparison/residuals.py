"""Free-run simulation against what was measured: one start state a run, then the commands alone."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from automarine_cli.comparison.rollouts import groups, roll
from automarine_cli.comparison.starts import State, start_states
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.runs.run import Run

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class FreeRun:
    """One run simulated from its start to its end: positions as the sensor shows them [rad or m] and true rates
    [rad/s or m/s] at the samples, (N,); not finite from where the model runs away.
    """

    run: Run
    position: Floats
    rate: Floats
    start: State

    @property
    def error(self) -> Floats:
        """Measured less simulated position [rad or m], (N,)."""
        return self.run.position - self.position

    @property
    def diverged(self) -> bool:
        """Whether the simulated position became infinite or no number."""
        return not bool(np.all(np.isfinite(self.position)))


def free_runs(model: YawModel, runs: Sequence[Run], switch_offset: float = 0.0) -> Iterator[FreeRun]:
    """Simulate all runs under `model`, many at a time, in their order.

    `switch_offset` is the share of a sample interval by which commands act later than mid-interval. Raises
    RunError as `make_batch`.
    """
    for group in groups(runs, [len(run) for run in runs]):
        some = runs[group]
        states = start_states(model, some, switch_offset)
        positions, rates = (np.array([getattr(s, name) for s in states]) for name in ("position", "rate"))
        shown = roll(model, some, positions, rates, switch_offset)
        for i, (run, state) in enumerate(zip(some, states)):
            yield FreeRun(run, shown.position[0, i, : len(run)], shown.velocity[0, i, : len(run)], state)
