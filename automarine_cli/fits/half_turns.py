"""The likelihood of half-turn steps: the closed-form response of models 1 to 3 to them, with what differs from run to
run.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import special

from automarine_cli.dofs import Dof
from automarine_cli.fits.known import NOTHING_KNOWN, Known
from automarine_cli.fits.linear_mixed import GAIN, START_POSITION, SWITCHES, Block, RunEffects, bias_of
from automarine_cli.fits.mixed_model import SWITCH, Problem, slots_of
from automarine_cli.models.yaw_model import base_roles, main_drag, response
from automarine_cli.quantities import Floats
from automarine_cli.runs.half_turn import MAX_REST, HalfTurn
from automarine_cli.simulation.batch import Channel

MAX_OFFSET = 2.5  # bound of the common z of the switch instants: within 0.6 % of the end of the interval


@dataclass(frozen=True)
class StepData:
    """R half-turns padded to N samples, rest before the step included.

    `time` (R, N) [s] since the middle of the interval in which the command switched, `heading` (R, N) [rad]
    less the start heading's first guess, `observed` (R, N), `moment` (R,), `interval` (R,) [s] width of the
    interval of the switch. `channels` are the readings that are fitted: at first the position alone.
    """

    names: tuple[str, ...]
    time: Floats
    heading: Floats
    observed: NDArray[np.bool_]
    moment: Floats
    interval: Floats
    dof: Dof
    channels: tuple[Channel, ...]

    def rated(self, velocities: Sequence[Floats], position_counts: NDArray[np.bool_] | None = None) -> "StepData":
        """The same with what a velocity sensor read in each run, NaN where it did not; of the runs whose position does
        not count (`position_counts` (R,), None: of none) it stands in for a sensor that their logs lack."""
        rates = np.full(self.observed.shape, np.nan)
        rates[self.observed] = np.concatenate(velocities)
        (position,) = self.channels
        if position_counts is not None:
            some = bool(position_counts.any())
            seen = position.seen & position_counts[:, None] if some else position.seen
            position = replace(position, seen=seen, counts=some)
        velocity = Channel(self.dof.velocity, 0, True, np.nan_to_num(rates), np.isfinite(rates))
        return replace(self, channels=(position, velocity))


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
        run, before = turn.step.run, turn.step.rest or slice(turn.kept.start, turn.kept.start)
        instant = turn.step.switch_to if turn.step.begins_log else turn.step.switch_mid
        parts = slice(max(before.start, before.stop - MAX_REST), before.stop), turn.kept
        velocity = run.channel(dof.velocity)
        velocity = np.full(len(run), np.nan) if velocity is None else velocity
        names.append(turn.name)
        times.append(np.concatenate([run.time[part] for part in parts]) - instant)
        headings.append(np.concatenate([run.position[part] for part in parts]) - turn.start_position)
        velocities.append(np.concatenate([velocity[part] for part in parts]))
        moments.append(turn.moment)
        intervals.append(turn.step.switch_to - turn.step.switch_from)
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
    """Pad runs, given as time since the middle of the switch interval [s] and heading less start heading [rad]."""
    width = max(len(t) for t in times)
    time, heading = np.zeros((2, len(times), width))
    observed = np.zeros((len(times), width), dtype=bool)
    for i, (t, psi) in enumerate(zip(times, headings)):
        time[i, : len(t)], heading[i, : len(t)], observed[i, : len(t)] = t, psi, True
    moment, interval = np.array(moments, dtype=float), np.array(intervals, dtype=float)
    position = Channel(dof.position, 0, False, heading, observed)
    return StepData(tuple(names), time, heading, observed, moment, interval, dof, (position,))


MIN_SHARE = 0.01  # of the drag that is left one way, however much it differs: none would drive the vehicle
AT_ONCE = 100_000  # readings that are worked out together: about what fits into the processor's caches


def step_problem(data: StepData, model: str, prior: Known = NOTHING_KNOWN, sided: bool = False) -> Problem:
    """Likelihood of the half-turns under model "1", "2" or "3"; `sided` with a drag that differs between the ways.

    theta is (the parameters of `base_roles`, SWITCH): z places the instants of the steps in their sample intervals
    (see `instant`), the logger's convention, common to all runs. Run effects are start position, log gain of the
    moment, the run's own part of z, and the bias of a velocity sensor; gain and z scatter by an estimated factor, which
    for instants that are uniform over their intervals is one.
    """
    roles, main = base_roles(model, data.dof, sided), main_drag(model)
    names = (*(data.dof.parameter(role) for role in roles), SWITCH)
    signed = [
        role in ("constant", "difference") or (role == "linear" and main != role) for role in roles[1:]
    ]  # linear drag has either sign beside a quadratic one, as in Table 1
    drags = [(-np.inf if either else 0.0, np.inf) for either in signed]
    blocks = RunEffects(_blocks(data))

    def readings(theta: Floats, b: Floats) -> Floats:
        runs, samples = data.time.shape
        at_once = max(1, AT_ONCE // samples)
        parts = (slice(i, i + at_once) for i in range(0, runs, at_once))
        return np.concatenate([readings_of(theta, b[:, rows], rows) for rows in parts], axis=1)

    def readings_of(theta: Floats, b: Floats, rows: slice) -> Floats:
        *columns, switch = (theta[:, i, None, None] for i in range(theta.shape[1]))
        values, of_run = dict(zip(roles, columns)), {name: blocks.of(b, name) for name in blocks.names}
        force = data.moment[rows, None] * np.exp(of_run[GAIN]) + values.get("constant", 0.0)
        drag = {role: values.get(role, 0.0) for role in ("linear", "quadratic")}
        if "difference" in values:
            drag[main] = np.maximum(values[main] + np.sign(force) * values["difference"], MIN_SHARE * values[main])
        time = data.time[rows] - data.interval[rows, None] * instant(switch + of_run[SWITCHES])
        begin = of_run[START_POSITION]
        position, rate = response(time, force, values["inertia"], drag["linear"], drag["quadratic"], begin)
        predicted = [rate + of_run[bias_of(c.quantity)] if c.velocity else position for c in data.channels]
        return np.concatenate(predicted, axis=2)

    measured, observed = (np.concatenate(part, axis=1) for part in zip(*((c.values, c.seen) for c in data.channels)))
    bounds = np.array([(0.0, np.inf), *drags, (-MAX_OFFSET, MAX_OFFSET)])
    positive = np.array([True, *np.logical_not(signed), False])
    problem = Problem(readings, measured, observed, blocks, bounds, positive, names, slots_of(data.channels))
    return problem.informed(prior.parameters)


def _blocks(data: StepData) -> tuple[Block, ...]:
    """What differs from run to run, before the data."""
    ones, limits = np.ones((len(data.moment), 1)), data.dof.limits
    return (
        Block(START_POSITION, limits.position_sd * ones),
        Block(GAIN, ones, (1e-4, 1.0)),
        Block(SWITCHES, ones, (1e-3, 1.0)),
        *(Block(bias_of(c.quantity), limits.bias_sd * ones) for c in data.channels if c.velocity),
    )
