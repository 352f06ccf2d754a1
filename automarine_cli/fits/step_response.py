"""Half-turn steps as arrays; step_problem.py holds their likelihood."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import special

from automarine_cli.dofs import Dof
from automarine_cli.fits.mixed_problem import Slot, slots_of
from automarine_cli.fits.nodes import Nodes, nodes_of
from automarine_cli.quantities import Floats
from automarine_cli.runs.half_turn import MOST_REST, HalfTurn
from automarine_cli.simulation.batch import Channel

MOST_OFFSET = 2.5
"""Bound of the common z of the switch instants: `instant` then lies within 0.6 % of the end of the interval."""


@dataclass(frozen=True)
class StepData:
    """R half-turns padded to N samples, rest before the step included.

    `time` (R, N) [s] since the middle of the interval in which the command switched, `heading` (R, N) [rad]
    less the start heading's first guess, `seen` (R, N), `moment` (R,), `interval` (R,) [s] width of the
    interval of the switch. `velocity` (R, N) is what a velocity sensor read where `velocity_seen`, None where it is
    not used; of the runs whose position does not count (`position_counts` (R,), None: of none) it stands in for a
    sensor that their logs lack.
    """

    names: tuple[str, ...]
    time: Floats
    heading: Floats
    seen: NDArray[np.bool_]
    moment: Floats
    interval: Floats
    dof: Dof
    velocity: Floats | None = None
    velocity_seen: NDArray[np.bool_] | None = None
    position_counts: NDArray[np.bool_] | None = None
    _nodes: dict[int, tuple[Nodes, ...] | None] = field(default_factory=dict, repr=False, compare=False)

    @property
    def channels(self) -> tuple[Channel, ...]:
        """What was measured: the position, and the velocity where it is used."""
        counts, seen = self.position_counts is None or bool(self.position_counts.any()), self.seen
        if self.position_counts is not None and counts:
            seen = seen & self.position_counts[:, None]
        found = [Channel(self.dof.position, 0, False, self.heading, seen, counts)]
        if self.velocity is not None and self.velocity_seen is not None:
            found.append(Channel(self.dof.velocity, 0, True, self.velocity, self.velocity_seen))
        return tuple(found)

    @cached_property
    def slots(self) -> tuple[Slot, ...]:
        """The places of the channels among the readings."""
        return slots_of(self.channels)

    def nodes(self, count: int) -> tuple[Nodes, ...] | None:
        """The half-turns at `count` nodes each (see nodes.py), channel by channel, made once for all models."""
        if count not in self._nodes:
            made = [nodes_of(self.time, c.values, c.seen, self.interval, count) for c in self.channels]
            whole = [one for one in made if one is not None]
            self._nodes[count] = tuple(whole) if len(whole) == len(made) else None
        return self._nodes[count]

    def rated(self, velocities: Sequence[Floats], position_counts: NDArray[np.bool_] | None = None) -> "StepData":
        """The same with what a velocity sensor read in each run, NaN where it did not."""
        read = np.full(self.seen.shape, np.nan)
        read[self.seen] = np.concatenate(velocities)
        return replace(
            self, velocity=np.nan_to_num(read), velocity_seen=np.isfinite(read), position_counts=position_counts,
            _nodes={},
        )  # fmt: skip

    def some(self, count: int) -> "StepData":
        """So many of the half-turns, drawn evenly whatever their order; all if there are no more."""
        if len(self.names) <= count:
            return self
        drawn = np.sort(np.random.default_rng(0).permutation(len(self.names))[:count])
        return replace(
            self,
            names=tuple(self.names[i] for i in drawn),
            time=self.time[drawn],
            heading=self.heading[drawn],
            seen=self.seen[drawn],
            moment=self.moment[drawn],
            interval=self.interval[drawn],
            velocity=None if self.velocity is None else self.velocity[drawn],
            velocity_seen=None if self.velocity_seen is None else self.velocity_seen[drawn],
            position_counts=None if self.position_counts is None else self.position_counts[drawn],
            _nodes={},
        )


def instant(z: Floats) -> Floats:
    """Where in its sample interval a command switched, -1/2 to 1/2, for a standard normal z: uniform in it."""
    return np.asarray(special.ndtr(z) - 0.5)


def density(z: Floats) -> Floats:
    """Its derivative: the standard normal density."""
    return np.asarray(np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi))


def half_turn_data(turns: Sequence[HalfTurn], channels: Sequence[str] | None = None) -> StepData:
    """Half-turns with the rest before them as padded arrays, of the `channels` named (None: the position alone).

    The command of a log that begins with the moment already on is taken to have switched at its first
    sample, any other in the middle of the interval in which it did; both may move by half an interval.
    """
    names, times, headings, velocities, moments, intervals = [], [], [], [], [], []
    dof = turns[0].step.run.dof
    for turn in turns:
        run, rest = turn.step.run, turn.step.rest or slice(turn.kept.start, turn.kept.start)
        instant = turn.switch_to if turn.step.begins_log else turn.step.switch_mid
        kept = slice(max(rest.start, rest.stop - MOST_REST), rest.stop), turn.kept
        velocity = run.channel(dof.velocity)
        velocity = np.full(len(run), np.nan) if velocity is None else velocity
        names.append(turn.name)
        times.append(np.concatenate([run.time[part] for part in kept]) - instant)
        headings.append(np.concatenate([run.position[part] for part in kept]) - turn.start_position)
        velocities.append(np.concatenate([velocity[part] for part in kept]))
        moments.append(turn.moment)
        intervals.append(turn.switch_to - turn.switch_from)
    data = step_data(names, times, headings, moments, intervals, dof)
    if channels is None or dof.velocity not in channels:
        return data
    counts = np.array([dof.position in channels and not turn.step.run.summed_up for turn in turns])
    return data.rated(velocities, None if counts.all() else counts)


def step_data(
    names: Sequence[str],
    times: Sequence[Floats],
    headings: Sequence[Floats],
    moments: Sequence[float],
    intervals: Sequence[float],
    dof: Dof,
) -> StepData:
    """Pad runs, given as time since the middle of the switch interval [s] and heading less start heading
    [rad]."""
    width = max(len(t) for t in times)
    time, heading = np.zeros((2, len(times), width))
    seen = np.zeros((len(times), width), dtype=bool)
    for i, (t, psi) in enumerate(zip(times, headings)):
        time[i, : len(t)], heading[i, : len(t)], seen[i, : len(t)] = t, psi, True
    return StepData(
        tuple(names), time, heading, seen, np.array(moments, dtype=float), np.array(intervals, dtype=float), dof
    )


AT_ONCE = 4000
"""Runs whose readings are worked out together: of more the intermediate results take more memory than the runs."""
