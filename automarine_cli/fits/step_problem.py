"""The likelihood of half-turn steps: the closed-form response of models 1 to 3 to them, with what differs from run to
run, and its derivatives."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from automarine_cli.fits.known import NOTHING_KNOWN, Known
from automarine_cli.fits.mixed_problem import SWITCH, Problem
from automarine_cli.fits.nodes import Nodes
from automarine_cli.fits.run_effects import GAIN, START_POSITION, SWITCHES, Block, RunEffects, bias_of
from automarine_cli.fits.step_response import MOST_OFFSET, StepData, density, instant
from automarine_cli.models.closed_form import response, slopes
from automarine_cli.models.yaw_model import base_roles, main_drag
from automarine_cli.quantities import Floats
from automarine_cli.simulation.batch import Channel

LEAST_SHARE = 0.01
"""Of the drag that is left one way, however much it differs: none would drive the vehicle."""

AT_ONCE = 100_000
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
        runs, at_once = len(self.data.moment), max(1, AT_ONCE // self._time(0, slice(None)).shape[1])
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
