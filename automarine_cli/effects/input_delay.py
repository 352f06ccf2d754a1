"""Commands that act late: serial and CAN links, video, software."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from automarine_cli.effects.base import Commands, Effect, Floats, Law, Parameter, Place, choice, deliver_by_law

BEYOND_S = 10.0  # seconds before the log over which its first command is taken to have held, and after it the last


class InputDelay(Effect):
    name = "input-delay"
    place = Place.ACTUATOR
    parameters = (
        Parameter("t_d", "dead time of the command", "s", 0.0, 3.0, 0.2),
        choice("law", "of what", "every change; on and off apart"),
        Parameter("t_off", "dead time of what falls", "s", 0.0, 3.0, 0.1, laws=(1,)),
    )
    equation = "{f}_delivered(t) = {f}(t - t_d)"
    says = "The command acts only after a dead time."
    reveals = "starts of steps: a flat start of the same length at all {forces}; square waves"
    mistaken_for = ("thruster-lag", "sensor-lag")
    separated_by = "a fast square wave, a knock test, or a log of the propeller's speed"
    source = "Franklin, Powell and Emami-Naeini, Feedback Control of Dynamic Systems"
    laws = (
        Law(
            "{f}_delivered(t) = {f}(t - t_d) as |{f}| rises, {f}(t - t_off) as it falls, until {f} changes sign",
            "Wie (2008), Space Vehicle Dynamics and Control (delays of thrusters that open and close)",
        ),
    )
    delays = True

    def shifts(self, values: Sequence[float]) -> bool:
        return values[1] == 0.0

    def late(self, values: Sequence[float]) -> float:
        return float(max(values[0], values[2] if values[1] else 0.0))

    def deliver(self, commands: Commands, values: tuple[Floats, ...]) -> Floats:
        """Mean of the delayed command over each step: the delayed impulse is exact for any delay."""
        return deliver_by_law((_delayed, _on_and_off), commands, values, values[1])


def _delayed(commands: Commands, values: tuple[Floats, ...]) -> Floats:
    return delayed(commands, values[0])


def delayed(commands: Commands, delay: Floats) -> Floats:
    """Return what is delivered over each step (P, R, M) of commands that act later by `delay` (P, 1, 1) [s], before
    their time where it is negative: the mean of the delayed command, so that its impulse is exact for any delay."""
    shape = np.broadcast_shapes(commands.force.shape, commands.length.shape, delay.shape)
    rows = (shape[0] * shape[1], shape[2])
    moment, length = (np.broadcast_to(x, shape).reshape(rows) for x in (commands.force, commands.length))
    begin = np.broadcast_to(commands.start, shape)[..., :1].reshape(-1, 1)
    length = np.maximum(length, 0.0)  # a step that runs backwards
    late = np.broadcast_to(delay, (*shape[:2], 1)).reshape(-1, 1)
    before = np.broadcast_to(commands.before, (*shape[:2], 1)).reshape(-1, 1)
    ends, impulse = np.cumsum(length, axis=1), np.cumsum(moment * length, axis=1)
    last = np.take_along_axis(moment, np.argmax(ends, axis=1)[:, None], axis=1)  # held after the log, too
    nodes = begin + np.concatenate([-BEYOND_S + 0.0 * begin, 0.0 * begin, ends, ends[:, -1:] + BEYOND_S], axis=1)
    gained = np.concatenate([-BEYOND_S * before, 0.0 * begin, impulse, impulse[:, -1:] + BEYOND_S * last], axis=1)
    # One interpolation for all rows: each has a stretch of the axis of its own, with room before and after it.
    offset = np.arange(rows[0])[:, None] * (float(np.ptp(nodes)) + 2.0 * BEYOND_S)
    late_nodes = np.maximum(nodes[:, 1:-1] - late, nodes[:, :1]) + offset
    passed = np.interp(late_nodes.ravel(), (nodes + offset).ravel(), gained.ravel()).reshape(late_nodes.shape)
    out = np.diff(passed, axis=1) / np.maximum(length, 1e-12)
    return np.where(length > 1e-9, out, moment).reshape(shape)


def _on_and_off(commands: Commands, values: tuple[Floats, ...]) -> Floats:
    """What rises late by t_d and what falls by t_off, (P, R, M): a side's thrust is the sum of its rises and falls, and
    ends at once where the other side begins, for a propeller turns one way at a time."""
    on, _, off = values
    before = np.broadcast_to(commands.before, (*commands.force.shape[:2], 1))
    sides, shares = [], []
    for side in (1.0, -1.0):
        is_on = {name: 1.0 * (side * getattr(commands, name) > 0.0) for name in ("force", "before")}
        shares.append(delayed(replace(commands, **is_on), on))  # of each step, in which this side is on
        held = np.maximum(side * before, 0.0)
        change = np.diff(np.maximum(side * commands.force, 0.0), axis=2, prepend=held)
        risen = replace(commands, force=held + np.cumsum(np.maximum(change, 0.0), axis=2), before=held)
        fallen = replace(commands, force=np.cumsum(np.minimum(change, 0.0), axis=2), before=0.0 * held)
        sides.append(np.maximum(delayed(risen, on) + delayed(fallen, off), 0.0))
    (ahead, astern), (on_ahead, on_astern) = sides, shares
    return _until(ahead, on_astern) - _until(astern, on_ahead)


def _until(thrust: Floats, other: Floats) -> Floats:
    """What is left of the mean thrust of a side over each step (P, R, M) where the other side, which ends it, is on in
    a share `other` of the step: as large while it lasts as it is in a step beside it."""
    beside = np.pad(thrust, ((0, 0), (0, 0), (1, 1)))
    return np.minimum(thrust, np.maximum(np.maximum(beside[..., :-2], beside[..., 2:]), thrust) * (1.0 - other))
