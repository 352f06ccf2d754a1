"""Half-turn steps as arrays, and the closed-form response of models 1 to 3 to them with what differs from
run to run."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy import special

from automarine_cli.dofs import Dof
from automarine_cli.fits.linear_mixed import RunEffects
from automarine_cli.fits.mixed_model import Problem
from automarine_cli.fits.nodes import Nodes, nodes_of
from automarine_cli.models.closed_form import response
from automarine_cli.models.yaw_model import base_roles, main_drag
from automarine_cli.runs.half_turn import MOST_REST, HalfTurn

Floats = NDArray[np.float64]

MOST_OFFSET = 2.5
"""Bound of the common z of the switch instants: `instant` then lies within 0.6 % of the end of the interval."""

LEAST_SHARE = 0.01
"""Of the drag that is left one way, however much it differs: none would drive the vehicle."""

START_HEADING_SD = 10.0
"""Standard deviation [rad] of a start heading before the data: so wide that it says nothing."""


@dataclass(frozen=True)
class StepData:
    """R half-turns padded to N samples, rest before the step included.

    `time` (R, N) [s] since the middle of the interval in which the command switched, `heading` (R, N) [rad]
    less the start heading's first guess, `seen` (R, N), `moment` (R,), `interval` (R,) [s] width of the
    interval of the switch.
    """

    names: tuple[str, ...]
    time: Floats
    heading: Floats
    seen: NDArray[np.bool_]
    moment: Floats
    interval: Floats
    dof: Dof
    _nodes: dict[int, Nodes | None] = field(default_factory=dict, repr=False, compare=False)

    def nodes(self, count: int) -> Nodes | None:
        """The half-turns at `count` nodes each (see nodes.py), made once for all models."""
        if count not in self._nodes:
            self._nodes[count] = nodes_of(self.time, self.heading, self.seen, self.interval, count)
        return self._nodes[count]

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
            _nodes={},
        )


@dataclass(frozen=True)
class Known:
    """What an experimenter may know of the runs: then it is not estimated."""

    start_heading: bool = False
    switch_instant: bool = False
    gain: bool = False


def instant(z: Floats) -> Floats:
    """Where in its sample interval a command switched, -1/2 to 1/2, for a standard normal z: uniform in it."""
    return np.asarray(special.ndtr(z) - 0.5)


def half_turn_data(turns: Sequence[HalfTurn]) -> StepData:
    """Half-turns with the rest before them as padded arrays.

    The command of a log that begins with the moment already on is taken to have switched at its first
    sample, any other in the middle of the interval in which it did; both may move by half an interval.
    """
    names, times, headings, moments, intervals = [], [], [], [], []
    for turn in turns:
        run, rest = turn.step.run, turn.step.rest or slice(turn.kept.start, turn.kept.start)
        instant = turn.switch_to if turn.step.begins_log else turn.step.switch_mid
        kept = slice(max(rest.start, rest.stop - MOST_REST), rest.stop), turn.kept
        names.append(turn.name)
        times.append(np.concatenate([run.time[part] for part in kept]) - instant)
        headings.append(np.concatenate([run.heading[part] for part in kept]) - turn.start_heading)
        moments.append(turn.moment)
        intervals.append(turn.switch_to - turn.switch_from)
    return step_data(names, times, headings, moments, intervals, turns[0].step.run.dof)


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
        tuple(names),
        time,
        heading,
        seen,
        np.array(moments, dtype=float),
        np.array(intervals, dtype=float),
        dof,
    )


def step_problem(
    data: StepData, model: str, known: Known = Known(), nodes: Nodes | None = None, sided: bool = False
) -> Problem:
    """Likelihood of the half-turns under model "1", "2" or "3", by their samples or by the `nodes` made of them;
    `sided` with a drag that differs between the ways.

    theta is (the parameters of `base_roles`, z): z places the instants of the steps in their sample intervals
    (see `instant`), the logger's convention, common to all runs. Run effects are start heading, log gain of the
    moment, and the run's own part of z; the last two scatter by an estimated factor, which for instants that are
    uniform over their intervals is one.
    """
    roles, main = base_roles(model, data.dof, sided), main_drag(model)
    time = (data if nodes is None else nodes).time[None]
    moment, interval = data.moment[None, :, None], data.interval[None, :, None]

    def headings(theta: Floats, b: Floats) -> Floats:
        columns = [theta[:, i, None, None] for i in range(theta.shape[1])]
        late = interval * instant(columns[-1] + b[:, :, 2, None])
        gained = moment * np.exp(b[:, :, 1, None])
        own = dict(zip(roles, columns))
        if data.dof.has_constant:
            gained = gained + own["constant"]
        if sided:
            own[main] = np.maximum(own[main] + np.sign(gained) * own["difference"], LEAST_SHARE * own[main])
        drag = (own.get("linear", 0.0), own.get("quadratic", 0.0))
        found = response(time - late, gained, own["inertia"], *drag, heading0=b[:, :, 0, None])[0]
        return found if nodes is None else (nodes.carry @ found[..., None])[..., 0]

    ones = np.ones(len(data.moment))
    scale = np.stack(
        [
            0.0 * ones if known.start_heading else START_HEADING_SD * ones,
            0.0 * ones if known.gain else ones,
            0.0 * ones if known.switch_instant else ones,
        ],
        axis=1,
    )
    effects = RunEffects(scale, np.array([-1, 0, 1]), ((1e-4, 1.0), (1e-3, 1.0)))
    signed = [
        role in ("constant", "difference") or (role == "linear" and main != role) for role in roles[1:]
    ]  # linear drag has either sign beside a quadratic one, as in Table 1
    drags = [(-np.inf if either else 0.0, np.inf) for either in signed]
    most = 0.0 if known.switch_instant else MOST_OFFSET
    bounds = np.array([(0.0, np.inf), *drags, (-most, most)])
    positive = np.array([True, *np.logical_not(signed), False])
    if nodes is None:
        return Problem(headings, data.heading, data.seen, effects, bounds, positive)
    count = data.seen.sum(axis=1)
    return Problem(headings, nodes.heading, nodes.seen, effects, bounds, positive, count, nodes.left)
