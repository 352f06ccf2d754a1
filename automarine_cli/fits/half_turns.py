"""The likelihood of half-turn steps: the closed-form response of models 1 to 3 to them, with what differs from run to
run, and its derivatives.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import special

from automarine_cli.dofs import Dof
from automarine_cli.fits.known import NOTHING_KNOWN, Known
from automarine_cli.fits.linear_mixed import GAIN, START_POSITION, SWITCHES, Block, RunEffects, bias_of
from automarine_cli.fits.mixed_model import SWITCH, Problem, Slot, slots_of
from automarine_cli.models.closed_form import response, slopes
from automarine_cli.models.yaw_model import base_roles, main_drag
from automarine_cli.quantities import Floats
from automarine_cli.runs.half_turn import MOST_REST, HalfTurn
from automarine_cli.simulation.batch import Channel

COUNTS = (16, 24, 36, 54)
"""Numbers of nodes that are tried in turn."""

PAYS = 2
"""Samples a node from which on nodes pay; shorter runs keep their samples."""

CLOSE_ENOUGH = 1e-5
"""Largest share [rad], rms over a run, of the two highest polynomials in headings: a thousandth of a degree's noise.
What no polynomial reaches is smaller still."""

AT_ONCE = 500
"""Runs whose polynomials are worked out together: of more they do not fit into the processor's caches."""


@dataclass(frozen=True)
class Nodes:
    """R runs at W instants: `time` (R, W) [s since the middle of the switch interval], `root` (R, W) the roots of the
    weights, `heading` (R, W) Q'y [rad], `seen` (R, W) what is no padding, `left` (R,) [rad²] the last term of the sum
    of squares, `highest` (R, 2, W) what makes the shares of the two highest polynomials of sqrt(w) f.
    """

    time: Floats
    root: Floats
    heading: Floats
    seen: NDArray[np.bool_]
    left: Floats
    highest: Floats

    def show(self, fitted: Floats, samples: NDArray[np.int64]) -> bool:
        """Whether headings sqrt(w) f (R, W) of a fit to runs of so many `samples` (R,) are between nodes what they are
        at them."""
        shares = np.abs(np.einsum("rkw,rw->rk", self.highest, fitted))
        return bool(np.all(shares.max(axis=1) <= CLOSE_ENOUGH * np.sqrt(samples)))


def nodes_of(time: Floats, heading: Floats, seen: NDArray[np.bool_], interval: Floats, count: int) -> Nodes | None:
    """Reduce runs (R, N) to `count` nodes each after the switch; times are since the middle of its `interval` (R,).

    None where that spares little.
    """
    edge = (0.5 - 1e-9) * interval[:, None]  # samples at the ends of the interval are outside: it is open
    rest, after = seen & (time <= -edge), seen & (time >= edge)
    long = after.sum(axis=1) >= PAYS * count
    alone = seen & ~rest & ~(after & long[:, None])  # samples that stand for themselves
    samples = int(alone.sum(axis=1).max(initial=0))
    own = alone.sum(axis=1) + rest.any(axis=1) + np.where(long, count, 0)
    if 2 * own.max() > time.shape[1]:
        return None
    shape = (len(time), samples + 1 + (count if long.any() else 0))
    (at, root, reduced), highest = np.zeros((3, *shape)), np.zeros((len(time), 2, shape[1]))
    kept, (own_time, own_heading) = _gathered(alone, time, heading)
    at[:, :samples], root[:, :samples], reduced[:, :samples] = own_time, kept, own_heading
    resting = rest.sum(axis=1)
    mean = np.where(rest, heading, 0.0).sum(axis=1) / np.maximum(resting, 1)
    at[:, samples], root[:, samples] = -interval, np.sqrt(resting)
    reduced[:, samples] = root[:, samples] * mean
    left = np.where(rest, (heading - mean[:, None]) ** 2, 0.0).sum(axis=1)
    every = np.flatnonzero(long)
    for runs in (every[i : i + AT_ONCE] for i in range(0, len(every), AT_ONCE)):
        part = (runs, slice(samples + 1, None))
        inside, (t, y) = _gathered(after[runs], time[runs], heading[runs])
        at[part], root[part], reduced[part], off, highest[runs, :, samples + 1 :] = _quadrature(t, y, inside, count)
        left[runs] += off
    seen, (at, root, reduced, *two) = _gathered(root > 0.0, at, root, reduced, highest[:, 0], highest[:, 1])
    return Nodes(at, root, reduced, seen, left, np.stack(two, axis=1))


def _gathered(mask: NDArray[np.bool_], *arrays: Floats) -> tuple[NDArray[np.bool_], tuple[Floats, ...]]:
    """What is marked of arrays (R, N), in front, and zero behind it; and where it stands, (R, most marked)."""
    count = mask.sum(axis=1)
    inside = np.arange(count.max(initial=0)) < count[:, None]
    found = tuple(np.zeros(inside.shape) for _ in arrays)
    for here, array in zip(found, arrays):
        here[inside] = array[mask]
    return inside, found


def _quadrature(
    time: Floats, heading: Floats, inside: NDArray[np.bool_], count: int
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Of runs (R, N): nodes (R, K), roots of their weights, Q'y, what is left of the sums of squares (R,), and what
    makes the shares of the two highest polynomials (R, 2, K)."""
    first, last = time[:, :1], time.max(axis=1, initial=-np.inf, where=inside, keepdims=True)
    x = 2.0 * (time - first) / (last - first) - 1.0
    basis, _ = np.linalg.qr(_chebyshev(x, count) * inside[..., None])  # orthogonal polynomials, lowest first
    points, turn = np.linalg.eigh(np.swapaxes(basis, 1, 2) @ (x[..., None] * basis))
    root = (basis.sum(axis=1)[:, None] @ turn)[:, 0]
    turn, root = turn * np.sign(root)[:, None], np.abs(root)
    image = (heading[:, None] @ basis)[:, 0]
    off = heading - (basis @ image[..., None])[..., 0]
    at = first + 0.5 * (points + 1.0) * (last - first)
    return at, root, (image[:, None] @ turn)[:, 0], (off**2).sum(axis=1), turn[:, -2:]


def _chebyshev(x: Floats, count: int) -> Floats:
    """Chebyshev polynomials of degree 0 to count - 1 at x (...), shape (..., count)."""
    out = np.ones((count, *x.shape))
    out[1] = x
    for k in range(2, count):
        np.multiply(2.0 * x, out[k - 1], out=out[k])
        out[k] -= out[k - 2]
    return np.moveaxis(out, 0, -1)


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


STEP_RESPONSE_AT_ONCE = 4000
"""Runs whose readings are worked out together: of more the intermediate results take more memory than the runs."""


LEAST_SHARE = 0.01
"""Of the drag that is left one way, however much it differs: none would drive the vehicle."""

STEP_PROBLEM_AT_ONCE = 100_000
"""Readings that are worked out together: about what fits into the processor's caches."""

VALUE = "value"
"""Name of what is read, among its derivatives."""


def step_problem(
    data: StepData,
    model: str,
    known: Known = NOTHING_KNOWN,
    nodes: tuple[Nodes, ...] | None = None,
    sided: bool = False,
) -> Problem:
    """Likelihood of the half-turns under model "1", "2" or "3", by their samples or by the `nodes` made of them;
    `sided` with a drag that differs between the ways.

    theta is (the parameters of `base_roles`, SWITCH): z places the instants of the steps in their sample intervals
    (see `instant`), the logger's convention, common to all runs. Run effects are start position, log gain of the
    moment, the run's own part of z, and the bias of a velocity sensor; gain and z scatter by an estimated factor, which
    for instants that are uniform over their intervals is one.
    """
    roles, main = base_roles(model, data.dof, sided), main_drag(model)
    names = (*(data.dof.parameter(role) for role in roles), SWITCH)
    channels = data.channels
    signed = [
        role in ("constant", "difference") or (role == "linear" and main != role) for role in roles[1:]
    ]  # linear drag has either sign beside a quadratic one, as in Table 1
    drags = [(-np.inf if either else 0.0, np.inf) for either in signed]
    most = 0.0 if known.switch_instant else MOST_OFFSET
    bounds = np.array([(0.0, np.inf), *drags, (-most, most)])
    positive = np.array([True, *np.logical_not(signed), False])
    steps = _Steps(data, roles, main, nodes, RunEffects(_blocks(data, known)))
    slots = data.slots
    if nodes is None:
        measured, seen = (np.concatenate(part, axis=1) for part in zip(*((c.values, c.seen) for c in channels)))
        return Problem(
            steps.readings, measured, seen, steps.blocks, bounds, positive, names, slots, slopes=steps.slopes
        ).informed(known.parameters)
    at = np.cumsum([0, *(one.time.shape[1] for one in nodes)]).tolist()
    slots = tuple(replace(slot, part=slice(i, j)) for slot, i, j in zip(slots, at, at[1:]))
    counted = [c for c, channel in enumerate(channels) if channel.counts]
    return Problem(
        steps.readings,
        np.concatenate([one.heading for one in nodes], axis=1),
        np.concatenate([one.seen for one in nodes], axis=1),
        steps.blocks,
        bounds,
        positive,
        names,
        slots,
        np.stack([channels[c].seen.sum(axis=1) for c in counted], axis=1),
        np.stack([nodes[c].left for c in counted], axis=1),
        steps.slopes,
    ).informed(known.parameters)


@dataclass(frozen=True)
class _Steps:
    """The response of half-turns to the parameters in `roles`, of which `main` is the drag that may differ between the
    ways; at `nodes` where there are some."""

    data: StepData
    roles: tuple[str, ...]
    main: str
    nodes: tuple[Nodes, ...] | None
    blocks: RunEffects

    def readings(self, theta: Floats, b: Floats) -> Floats:
        """Readings (P, R, N) for theta (P, p) and run effects (P, R, q)."""
        found = [self._shown(self._driven(theta, b[:, rows], rows), rows) for rows in self._parts()]
        return found[0] if len(found) == 1 else np.concatenate(found, axis=1)

    def slopes(self, theta: Floats, b: Floats) -> tuple[Floats, Floats, Floats]:
        """Readings (R, N) for theta (p,) and run effects (R, q), and their derivatives by these, (R, N, p) and
        (R, N, q)."""
        found = [self._sloped(self._driven(theta[None], b[None, rows], rows), rows) for rows in self._parts()]
        whole = np.swapaxes(found[0] if len(found) == 1 else np.concatenate(found), 1, 2)
        return whole[:, :, 0], whole[:, :, 1 : 1 + len(theta)], whole[:, :, 1 + len(theta) :]

    def _parts(self) -> Iterator[slice]:
        runs, at_once = len(self.data.moment), max(1, STEP_PROBLEM_AT_ONCE // self._time(0, slice(None)).shape[1])
        return (slice(i, i + at_once) for i in range(0, runs, at_once))

    def _driven(self, theta: Floats, b: Floats, rows: slice) -> "_Driven":
        *columns, switch = (theta[:, i, None, None] for i in range(theta.shape[1]))
        own, of_run = dict(zip(self.roles, columns)), {name: self.blocks.of(b, name) for name in self.blocks.names}
        gained = self.data.moment[rows, None] * np.exp(of_run[GAIN])
        force = gained + own["constant"] if "constant" in own else gained
        drags = {role: own.get(role) for role in ("linear", "quadratic")}
        if "difference" in own:
            apart = own[self.main] + np.sign(force) * own["difference"]
            drags[self.main] = np.maximum(apart, LEAST_SHARE * own[self.main])
        return _Driven(own, of_run, switch + of_run[SWITCHES], self.data.interval[rows, None], gained, force, **drags)

    def _time(self, channel: int, rows: slice) -> Floats:
        return self.data.time[rows] if self.nodes is None else self.nodes[channel].time[rows]

    def _shown(self, driven: "_Driven", rows: slice) -> Floats:
        shown = []
        for c, channel in enumerate(self.data.channels):
            if c == 0 or self.nodes is not None:
                states = driven.states(self._time(c, rows))
            found = states[1] + driven.of_run[bias_of(channel.quantity)] if channel.velocity else states[0]
            shown.append(found if self.nodes is None else found * self.nodes[c].root[rows])
        return shown[0] if len(shown) == 1 else np.concatenate(shown, axis=2)

    def _sloped(self, driven: "_Driven", rows: slice) -> Floats:
        """Readings and their derivatives, (R, 1 + p + q, N)."""
        shown = []
        names = (VALUE, *self.roles, SWITCH, *self.blocks.names)
        for c, channel in enumerate(self.data.channels):
            time = self._time(c, rows)
            columns, out = driven.slopes(time, channel, self.main), np.zeros((len(time), len(names), time.shape[1]))
            for i, name in enumerate(names):
                if name in columns:  # the others do not show in this channel
                    out[:, i] = columns[name]
            out *= (channel.seen if self.nodes is None else self.nodes[c].root)[rows, None]
            shown.append(out)
        return shown[0] if len(shown) == 1 else np.concatenate(shown, axis=2)


@dataclass(frozen=True)
class _Driven:
    """What moves R runs under P parameter sets: parameters by role and run effects by name, z of their instants in the
    `interval` (R, 1), the moments with the runs' gains, the same with the constant force, and the drag of each run."""

    own: dict[str, Floats]
    of_run: dict[str, Floats]
    z: Floats
    interval: Floats
    gained: Floats
    force: Floats
    linear: Floats | None
    quadratic: Floats | None

    def states(self, time: Floats) -> tuple[Floats, Floats]:
        """Position and velocity (P, R, N) at `time` (R, N)."""
        linear, quadratic = (0.0 if drag is None else drag for drag in (self.linear, self.quadratic))
        late, begin = self.interval * instant(self.z), self.of_run[START_POSITION]
        return response(time - late, self.force, self.own["inertia"], linear, quadratic, begin)

    def slopes(self, time: Floats, channel: Channel, main: str) -> dict[str, Floats]:
        """What a channel reads under the one parameter set, and its derivatives by role and run effect."""
        late, constant = self.interval * instant(self.z), bias_of(channel.quantity)
        of_rate = channel.velocity
        one = slopes(time - late, self.force, self.own["inertia"], self.linear, self.quadratic, of_rate=of_rate)
        by_switch = one.time * (-self.interval * density(self.z))
        own = constant if of_rate else START_POSITION
        drag = {"linear": one.linear, "quadratic": one.quadratic}
        if "difference" in self.own:
            whole = self.own[main]
            apart = whole + np.sign(self.force) * self.own["difference"] > LEAST_SHARE * whole
            drag["difference"] = drag[main] * np.where(apart, np.sign(self.force), 0.0)
            drag[main] = drag[main] * np.where(apart, 1.0, LEAST_SHARE)
        found = {
            VALUE: one.value + self.of_run[own], "inertia": one.inertia, "constant": one.moment, SWITCH: by_switch,
            own: np.ones((1, 1, 1)), GAIN: one.moment * self.gained, SWITCHES: by_switch, **drag,
        }  # fmt: skip
        return {name: column[0] for name, column in found.items()}


def _blocks(data: StepData, known: Known) -> tuple[Block, ...]:
    """What differs from run to run, before the data; what is known does not."""
    ones, limits = np.ones((len(data.moment), 1)), data.dof.limits
    return (
        Block(START_POSITION, (0.0 if known.start_heading else limits.position_sd) * ones),
        Block(GAIN, (0.0 if known.gain else 1.0) * ones, (1e-4, 1.0)),
        Block(SWITCHES, (0.0 if known.switch_instant else 1.0) * ones, (1e-3, 1.0)),
        *(Block(bias_of(c.quantity), limits.bias_sd * ones) for c in data.channels if c.velocity),
    )
