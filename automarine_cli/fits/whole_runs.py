"""Whole runs simulated under any model: closed-loop driving, sequences, runs with effects that half-turns
cannot show."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from automarine_cli import effects
from automarine_cli.errors import FitError
from automarine_cli.fits.mixed_problem import SWITCH, Problem, slots_of
from automarine_cli.fits.run_effects import (
    DISTURBANCE,
    GAIN,
    START_POSITION,
    START_VELOCITY,
    SWITCHES,
    Block,
    RunEffects,
    bias_of,
)
from automarine_cli.fits.step_response import MOST_OFFSET, instant
from automarine_cli.models.yaw_model import BASE_TERMS, YawModel
from automarine_cli.quantities import Floats
from automarine_cli.simulation.batch import Batch
from automarine_cli.simulation.rollout import Start, simulate

AGAINST = 0.2
"""Share of the impulses that a balance with everything negative must explain to show that a sign is wrong."""


def whole_run_problem(model: YawModel, batch: Batch, at_rest: NDArray[np.bool_], within: bool = False) -> Problem:
    """Likelihood of whole runs by simulation, of all channels of the batch.

    theta is (the model's parameters, SWITCH): all changes of command act that many sample intervals from the middle
    of theirs, within ±1/2. A run's own delay may leave its interval, for on a lake thrusters lag; with `within` it
    cannot, and the last entry of theta is the z of `instant` as for half-turns. Run effects are start
    position [base unit, relative to the first sample], start velocity (only where `at_rest` (R,) is false), log
    gain of the moment delivered, a delay of each change of command, and a disturbance held over each
    window of the batch: wind, waves, tether and whatever the model lacks. Its size is estimated; it is zero
    in a quiet pool, and without it a minute of free running on a lake would say nothing of the vehicle,
    because positions integrate every disturbance. It is an acceleration, so that a common
    gain scales inertia and drag and nothing else. Then come the biases of velocity sensors, and last the coefficients
    of effects that vary from run to run, in the model's order, each effect's with a factor of its own on the largest
    moment.
    """
    first, late = batch.position[:, :1], batch.interval[None]
    varying = varying_terms(model)
    blocks = RunEffects(_blocks(batch, at_rest, within, varying))

    names = (*model.parameter_names, SWITCH)
    inertia, switch = names.index(model.dof.parameter("inertia")), names.index(SWITCH)

    def readings(theta: Floats, b: Floats) -> Floats:
        own, common = blocks.of(b, SWITCHES), theta[:, switch, None, None]
        delay = late * instant(common + own) if within else common * late + own  # a step may run backwards
        accelerations = blocks.of(b, DISTURBANCE)
        start = Start(
            first[None, :, 0] + blocks.of(b, START_POSITION)[..., 0],
            blocks.of(b, START_VELOCITY)[..., 0],
            blocks.of(b, GAIN)[..., 0],
            delay,
            theta[:, inertia, None, None] * accelerations if accelerations.any() else None,
            {name: blocks.of(b, name) for name in varying},
        )
        found = simulate(model, batch, theta[:, :switch], start)
        if len(batch.channels) == 1:
            return found.position
        shown = [found.reading(channel) for channel in batch.channels]
        for i, channel in enumerate(batch.channels):
            if channel.velocity:
                shown[i] = shown[i] + blocks.of(b, bias_of(channel.quantity))
        return np.concatenate(shown, axis=2)

    most = MOST_OFFSET if within else 0.5
    bounds = np.array([*parameter_bounds(model), (-most, most)])
    return Problem(
        readings,
        np.concatenate([channel.values for channel in batch.channels], axis=1),
        np.concatenate([channel.seen for channel in batch.channels], axis=1),
        blocks,
        bounds,
        bounds[:, 0] >= 0.0,
        names,
        slots_of(batch.channels),
    )


def _blocks(batch: Batch, at_rest: NDArray[np.bool_], within: bool, varying: Sequence[str]) -> tuple[Block, ...]:
    """What differs from run to run, before the data."""
    runs, limits = len(at_rest), batch.dof.limits
    ones = np.ones((runs, 1))
    lasts = batch.window.max(axis=1, initial=0, where=batch.length > 0)
    windows = (np.arange(batch.windows) <= lasts[:, None]).astype(float)
    delays = (batch.interval > 0).astype(float) if within else batch.interval / np.sqrt(12.0)
    largest = float(np.abs(batch.force).max()) or 1.0
    return (
        Block(START_POSITION, limits.position_sd * ones),
        Block(START_VELOCITY, np.where(at_rest[:, None], 0.0, limits.velocity_sd)),
        Block(GAIN, ones, (1e-4, 0.3)),
        Block(SWITCHES, delays, (1e-3, 1.0)),
        Block(DISTURBANCE, windows, (1e-5, 1.0)),
        *(Block(bias_of(c.quantity), limits.bias_sd * ones) for c in batch.channels if c.velocity),
        *(Block(name, largest * np.ones((runs, effects.get(name).per_run)), (1e-4, 1.0)) for name in varying),
    )


def varying_terms(model: YawModel) -> list[str]:
    """Names of the model's effects of which every run has coefficients of its own."""
    return [term.name for term in model.terms if effects.get(term.name).varies(term.values)]


def without_gain(problem: Problem) -> Problem:
    """The same problem for runs whose thrust does not scatter."""
    return replace(problem, effects=problem.effects.with_scale(gain=0.0))


def parameter_bounds(model: YawModel) -> list[tuple[float, float]]:
    """Bounds of the model's parameters; the linear term of model 2 may take either sign, as in Table 1."""
    bounds = [(0.0, np.inf)]
    both = {term.name for term in model.terms} >= set(BASE_TERMS["2"])
    for term in model.terms:
        for parameter in effects.get(term.name).parameters:
            lower = -np.inf if both and term.name == "linear-drag" else parameter.lower
            bounds.append((lower, parameter.upper))
    return bounds


def rough_model(number: str, batch: Batch, sided: bool = False) -> YawModel:
    """Start values for model "1", "2" or "3": least squares of the momentum balance over windows of about a
    second.

    I (r2 - r1) + k_rr ∫|r|r dt + k_r ∫r dt = ∫tau dt (and a constant force times t, if there is one), with
    rates from differences of the heading over the same windows. Raises FitError where inertia and drag come
    out negative and the balance holds well enough to be sure: then a sign is wrong.
    """
    rows, sides = [], []
    for i in range(len(batch.names)):
        seen = batch.seen[i]
        time, position = batch.time[i][seen], batch.position[i][seen]
        clock = np.concatenate([[0.0], np.cumsum(batch.length[i])])
        impulse = np.concatenate([[0.0], np.cumsum(batch.length[i] * batch.force[0, i])])
        window = max(time[-1] / 200.0, min(1.0, time[-1] / 8.0))
        knots = np.arange(time[0], time[-1], window)
        way = np.interp(knots, time, position)
        rate = np.diff(way) / window
        middle = 0.5 * (knots[1:] + knots[:-1])
        swing = np.diff(rate)
        push = np.diff(np.interp(middle, clock, impulse))
        mean = 0.5 * (rate[1:] + rate[:-1])
        time_passed = np.full(len(mean), -window)
        rows.append(np.stack([swing, window * np.abs(mean) * mean, window * mean, time_passed], axis=1))
        sides.append(push)
    x, y = np.concatenate(rows), np.concatenate(sides)
    keep = {"1": [0, 2], "2": [0, 1, 2], "3": [0, 1]}[number] + [3] * batch.dof.has_constant
    values = np.linalg.lstsq(x[:, keep], y, rcond=None)[0] if len(y) >= len(keep) else np.ones(len(keep))
    constant = [float(v) for v in values[len(keep) - batch.dof.has_constant :]]
    values = values[: len(keep) - batch.dof.has_constant]
    left = np.sum((y - x[:, keep] @ [*values, *constant]) ** 2)
    if np.all(values < 0) and left < (1.0 - AGAINST) * np.sum(y**2):
        raise FitError(
            batch.dof.fill(
                "the {positions} {move} against the {force}: {inertia} and drag would be negative. If the {position} "
                "counts {other_way}, or the {force} does, map it with sign = -1 in the --columns file "
                "or the campaign: under [columns] "
            )
            + f'{batch.dof.column(batch.dof.position, batch.dof.units.log)} = {{ from = "NAME", sign = -1 }}'
        )
    scale = float(np.abs(batch.force).max()) or 1.0
    values = np.where(values > 1e-3 * scale, values, 0.3 * scale)
    more = [*constant, *([0.0] if sided else [])]
    return YawModel.base(number, values[0], [*values[1:], *more], batch.moment_unit, batch.dof)
