"""Thrusters that take time to do what is commanded."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from automarine_cli.effects.base import (
    SLOWLY,
    Commands,
    Effect,
    Law,
    Parameter,
    Place,
    choice,
    deliver_by_law,
    lagged,
    multiple,
    reference,
)
from automarine_cli.effects.thruster_imbalance import PARTS, each
from automarine_cli.quantities import Floats

MIN_LAG_S = 1e-6  # s
FASTER, OWN_TIME, OF_EACH = 2, 4, 5
"""The laws that are faster at speed, with a time constant of their own as the speed falls, and of each thruster."""
Advance = Callable[[Floats, Floats, Floats, tuple[Floats, ...]], tuple[Floats, Floats]]


class ThrusterLag(Effect):
    """First order in the propeller's speed n, with the {force} as n |n|, or in the thrust itself; or n' limited.

    Every law is solved exactly under a command that is held, a change of sign included.
    """

    name = "thruster-lag"
    place = Place.ACTUATOR
    stage = SLOWLY
    parameters = (
        Parameter("T", "time constant; of a slew limit the time to the speed at tau_ref", "s", 0.0, 3.0, 0.15),
        choice(
            "law",
            "what is slow",
            "propeller speed; thrust; propeller, faster at speed; slew limit; own time as it falls; "
            "speed of each propeller",
        ),
        reference("tau_ref", "{force} at whose speed T is meant", laws=(2, 3)),
        multiple("fall", "time constant as the speed falls, as a multiple of T", laws=(4,)),
    )
    equation = "T n' = n_c - n, {f} = n |n|"
    says = "The thrusters reach what is commanded only after a lag."
    reveals = "starts of steps, reversals and square waves; nothing in the steady {move}"
    mistaken_for = ("input-delay", "sensor-lag")
    separated_by = "a fast square wave, or a log of the propeller's speed"
    source = "Yoerger, Cooke and Slotine (1990), IEEE J. Oceanic Engineering 15:167"
    laws = (
        Law(
            "T {f}' = {f}_c - {f}",
            "Healey et al. (1995), IEEE J. Oceanic Engineering 20:354",
            ("input-delay", "sensor-lag", "periodic-disturbance"),
        ),
        Law(
            "2 T n_ref n' = {f}_c - n |n|, {f} = n |n|, n_ref = sqrt(tau_ref)",
            mistaken_for=("input-delay", "dead-band"),
        ),
        Law(
            "|n'| <= n_ref/T, {f} = n |n|, n_ref = sqrt(tau_ref)",
            "Van Amerongen (1982), Adaptive steering of ships, Delft (limited rate of an actuator)",
            ("input-delay", "saturation"),
        ),
        Law(
            "T n' = n_c - n, or fall T n' = n_c - n as |n| falls, {f} = n |n|",
            "Bachmayer, Whitcomb and Grosenbaugh (2000), IEEE J. Oceanic Engineering 25:146",
            ("input-delay", "thrust-loss"),
        ),
        Law("T n_i' = n_c,i - n_i, {f} = sum over thrusters of n_i |n_i|"),
    )

    def late(self, values: Sequence[float]) -> float:
        """Give what holds at a quarter of tau_ref: there what is faster at speed takes twice T."""
        return float(values[0] * (max(values[3], 1.0) if values[1] == OWN_TIME else 1.0 + (values[1] == FASTER)))

    def needs_at(self, values: tuple[float, ...]) -> tuple[str, ...]:
        return PARTS if self.law(values) == OF_EACH else ()

    def deliver(self, commands: Commands, values: tuple[Floats, ...]) -> Floats:
        """Mean {force} over each step."""
        others = [partial(_step_by_step, advance) for advance in ADVANCES[FASTER:OF_EACH]]
        return deliver_by_law([_of_speed, _of_thrust, *others, _of_each], commands, values, values[1])


def speed_of(force: Floats) -> Floats:
    """The n whose n |n| is this force."""
    return np.sign(force) * np.sqrt(np.abs(force))


def _of_speed(commands: Commands, values: tuple[Floats, ...]) -> Floats:
    """Mean of n |n| over each step, T n' = n_c - n."""
    target, length, lag = speed_of(commands.force), commands.length, np.maximum(values[0], MIN_LAG_S)
    begun, _ = lagged(target, speed_of(commands.before), length, lag)
    return _relaxed(target, begun, length, lag, lag)[0] / np.maximum(length, 1e-12)


def _of_thrust(commands: Commands, values: tuple[Floats, ...]) -> Floats:
    """Mean force over each step, T f' = f_c - f."""
    return lagged(commands.force, commands.before, commands.length, np.maximum(values[0], MIN_LAG_S))[1]


def _step_by_step(advance: Advance, commands: Commands, values: tuple[Floats, ...]) -> Floats:
    """Mean of n |n| over each step, n advanced from step to step by one law."""
    lag, _, largest, fall = values
    target = speed_of(commands.force)
    shape = np.broadcast_shapes(target.shape, commands.length.shape, lag.shape)
    target, length = np.broadcast_to(target, shape), np.broadcast_to(commands.length, shape)
    sizes = (np.maximum(lag, MIN_LAG_S)[..., 0], np.sqrt(np.maximum(largest, 1e-12))[..., 0], fall[..., 0])
    delivered = np.empty(shape)
    speed = np.broadcast_to(speed_of(commands.before)[..., 0], shape[:2])
    for m in range(shape[2]):
        impulse, speed = advance(target[..., m], speed, length[..., m], sizes)
        delivered[..., m] = impulse / np.maximum(length[..., m], 1e-12)
    return delivered


def _of_each(commands: Commands, values: tuple[Floats, ...]) -> Floats:
    """The same of both thrusters, each with its own n; what other effects made of their commands follows as they do."""
    port, starboard = each(commands)
    steady = np.isclose(commands.before, (port + starboard)[:, :1])  # else nothing was commanded before
    forces = [port[None], starboard[None], commands.force - port - starboard]
    befores = [*(np.where(steady, force[0, :, :1], 0.0) for force in forces[:2]), 0.0 * commands.before]
    single = [replace(commands, force=force, before=before) for force, before in zip(forces, befores)]
    return sum((_of_speed(of, values) for of in single if of.force.any()), 0.0 * commands.force)


def _in_speed(target: Floats, speed: Floats, step: Floats, sizes: tuple[Floats, ...]) -> tuple[Floats, Floats]:
    """T n' = n_c - n: impulse over a step and the speed at its end."""
    return _relaxed(target, speed, step, sizes[0], sizes[0])


def _own_time_as_it_falls(
    target: Floats, speed: Floats, step: Floats, sizes: tuple[Floats, ...]
) -> tuple[Floats, Floats]:
    """The same with another time constant as |n| falls, also on its way through zero to the other side."""
    lag, _, fall = sizes
    falls = (speed * target < 0) | (np.abs(target) < np.abs(speed))
    return _relaxed(target, speed, step, np.where(falls, fall * lag, lag), lag)


def _relaxed(target: Floats, speed: Floats, step: Floats, lag: Floats, beyond: Floats) -> tuple[Floats, Floats]:
    """First order with the time constant `lag`, and `beyond` after a change of sign."""
    gap, crosses = speed - target, speed * target < 0
    impulse, faded = _squares(target, gap, lag, step)
    impulse, after = np.where(speed != 0, np.sign(speed), np.sign(target)) * impulse, target + gap * (1.0 - faded)
    if crosses.any():  # nowhere in nearly every step, and the logarithm is most of the work
        goal, gap, step, lag, beyond = (of[crosses] for of in np.broadcast_arrays(target, gap, step, lag, beyond))
        zero = np.minimum(-lag * np.log(-goal / gap), step)
        before, faded = _squares(goal, gap, lag, zero)
        behind, risen = _squares(goal, -goal, beyond, step - zero)
        impulse[crosses] = np.sign(goal) * (behind - before)
        after[crosses] = np.where(step > zero, goal * risen, goal + gap * (1.0 - faded))
    return impulse, after


def _squares(target: Floats, gap: Floats, lag: Floats, time: Floats) -> tuple[Floats, Floats]:
    """Integral of n² over `time` for n = target + gap exp(-t/lag), and the share of the gap that has gone then."""
    faded = -np.expm1(-time / lag)
    return target**2 * time + gap * lag * faded * (2.0 * target + gap * (1.0 - 0.5 * faded)), faded


def _in_thrust(target: Floats, speed: Floats, step: Floats, sizes: tuple[Floats, ...]) -> tuple[Floats, Floats]:
    """T f' = f_c - f for f = n |n|."""
    goal, thrust, lag = target * np.abs(target), speed * np.abs(speed), sizes[0]
    gap = thrust - goal
    after = goal + gap * np.exp(-step / lag)
    return goal * step - gap * lag * np.expm1(-step / lag), speed_of(after)


def _faster_at_speed(target: Floats, speed: Floats, step: Floats, sizes: tuple[Floats, ...]) -> tuple[Floats, Floats]:
    """2 T n_ref n' = n_c |n_c| - n |n|: about a speed n the time constant is T n_ref / n; solved by tan and tanh."""
    pace = 1.0 / (2.0 * sizes[0] * sizes[1])
    sign = np.where(target != 0, np.sign(target), np.where(speed < 0, -1.0, 1.0))
    goal, u = np.abs(target), sign * speed
    safe = np.maximum(goal, 1e-9)
    back = np.where(u < 0, np.arctan2(-u, goal) / (safe * pace), 0.0)  # time until it turns the other way
    backward = np.minimum(back, step)
    slowed = np.tan(np.minimum(safe * pace * backward, 1.57)) / safe
    u1 = np.where(u < 0, np.where(back < step, 0.0, (u + goal**2 * slowed) / (1.0 - u * slowed)), u)
    q = np.tanh(safe * pace * (step - backward)) / safe
    u2 = np.where(u1 >= 0, (u1 + goal**2 * q) / (1.0 + np.maximum(u1, 0.0) * q), u1)
    return sign * (goal**2 * step - (u2 - u) / pace), sign * u2


def _slew(target: Floats, speed: Floats, step: Floats, sizes: tuple[Floats, ...]) -> tuple[Floats, Floats]:
    """|n'| at most n_ref / T."""
    pace = sizes[1] / sizes[0]
    moved = np.clip(target - speed, -pace * step, pace * step)
    after = speed + moved
    ramp = np.sign(moved) * (np.abs(after) ** 3 - np.abs(speed) ** 3) / (3.0 * pace)
    return ramp + target * np.abs(target) * np.maximum(step - np.abs(moved) / pace, 0.0), after


ADVANCES: tuple[Advance, ...] = (_in_speed, _in_thrust, _faster_at_speed, _slew, _own_time_as_it_falls, _in_speed)
"""By law; of two thrusters that turn equally fast and opposite ways the last is as the first."""
