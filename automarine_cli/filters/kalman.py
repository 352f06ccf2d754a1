"""Extended Kalman filter of all runs under all parameter sets together, blind to the effects.

State of a run: positions and velocities, states of the water and of slow sensors, an acceleration for each degree of
freedom that is an Ornstein-Uhlenbeck process (wind, waves, tether, current: whatever pushes and is not logged), the log
gain of the run's thrust, what effects let vary from run to run, and the bias of each velocity sensor. The thrust is
noisy in proportion to its size as well. Actuators act on the logged commands before the filter and know no noise.

Derivatives are central differences over one standard deviation of the state: of a smooth law they are its slope, of a
kinked one (Coulomb drag) about what statistical linearisation gives. Sources: Särkkä (2013), Bayesian Filtering and
Smoothing, chapter 5; Nørgaard, Poulsen and Ravn (2000), Automatica 36:1627 (divided differences); Huber (1964), Annals
of Mathematical Statistics 35:73 (readings far off count linearly).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from automarine_cli.filters.course import Course
from automarine_cli.filters.states import States, Step
from automarine_cli.models.vehicle import Vehicle
from automarine_cli.quantities import Floats

FAR = 5.0
"""Standard deviations beyond which an innovation counts linearly, and its reading as noisier than the others."""


@dataclass(frozen=True)
class Noises:
    """Sizes of everything random, for P parameter sets, and what the logger adds.

    `size` (D, P) standard deviation of the disturbing accelerations [per s²] and `time` (D, P) their time constants
    [s]; `thrust` (D, P) the noise of thrust as a share of it [s^1/2]; `gain` (P,) standard deviation of the runs' log
    gain; `late` (P,) by how many samples commands act after the middle of the interval in which they changed: the
    logger's convention; `reading` (C, P) noise of each channel [its unit]; `own` (P,) by effect the size of what it
    lets vary.
    """

    size: Floats
    time: Floats
    thrust: Floats
    gain: Floats
    late: Floats
    reading: Floats
    own: Mapping[str, Floats]


@dataclass(frozen=True)
class Followed:
    """What the filter made of the runs: innovations and their variances, (C, P, R, K + 1), one and zero where nothing
    was read; the filtered states (n, P, R, K + 1) if they were asked for, and their places."""

    innovation: Floats
    variance: Floats
    states: Floats | None
    places: States

    @cached_property
    @np.errstate(over="ignore", invalid="ignore")  # where a filter runs away
    def log_density(self) -> Floats:
        """Log density of the readings of each run, (P, R)."""
        read = self.variance > 0
        z = np.abs(self.innovation) / np.sqrt(np.where(read, self.variance, 1.0))
        square = np.where(z <= FAR, np.minimum(z, FAR) ** 2, FAR * (2.0 * z - FAR))
        return -0.5 * np.where(read, square + np.log(2 * np.pi * np.where(read, self.variance, 1.0)), 0.0).sum(
            axis=(0, 3)
        )


def follow(
    model: Vehicle,
    course: Course,
    theta: Floats,
    noises: Noises,
    keep: bool = False,
    trace: list[tuple[Floats, ...]] | None = None,
) -> Followed:
    """Filter all runs of `course` under all parameter sets `theta` (P, p); with `keep` the states are returned too.

    A `trace` gets mean and covariance of every node, and what the next step made of them with its Jacobian.
    """
    step = Step(model, course, theta, noises.late)
    places = step.places
    sets, runs, nodes = len(theta), len(course.names), course.length.shape[1] + 1
    mean, covariance = _start(step, course, noises, sets)
    delivered, thrusty, inverse = step.delivered, noises.thrust[:, :, None], step.inverse
    shape = (len(course.channels), sets, runs, nodes)
    innovation, variance = np.zeros(shape), np.zeros(shape)
    states = np.zeros((places.count, sets, runs, nodes)) if keep else None
    decay = np.exp(-course.length[None, None] / noises.time[:, :, None, None])
    ramp = (1.0 - decay) * noises.time[:, :, None, None] / np.maximum(course.length, 1e-12)
    fresh = ((noises.size**2)[:, :, None, None] * (1.0 - decay**2)).transpose(1, 2, 0, 3)
    fade, root = decay.transpose(1, 2, 0, 3), np.sqrt(np.maximum(course.length, 1e-12))
    white, still, dynamic = noises.reading**2, np.eye(places.count), places.dynamic
    pushed = np.array(places.pushed)
    here = np.searchsorted(step.columns, pushed)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        for m in range(nodes):
            _update(step, course, m, mean, covariance, white, innovation, variance)
            if states is not None:
                states[..., m] = mean
            if m == nodes - 1:
                break
            force = delivered[..., m]
            before = (mean, covariance)
            mean, slopes = step.advance(m, mean, covariance, ramp[..., m])
            bumps = slopes[:, here].transpose(2, 3, 0, 1)  # (P, R, dynamic, D): of constant accelerations
            slopes = slopes.transpose(2, 3, 0, 1).copy()
            slopes[..., here] *= ramp[..., m].transpose(1, 2, 0)[:, :, None]
            jacobian = np.empty_like(covariance)
            jacobian[:] = still
            jacobian[..., :dynamic, step.columns] = slopes
            jacobian[..., pushed, pushed] = fade[..., m]
            mean[pushed] *= decay[..., m]
            covariance = jacobian @ covariance @ jacobian.swapaxes(2, 3)
            covariance[..., pushed, pushed] += fresh[..., m]
            unsteady = thrusty * np.abs(force) * (np.exp(mean[places.gain]) / root[:, m])
            blown = bumps @ (inverse[:, None] * unsteady.transpose(1, 2, 0)[:, :, None])
            covariance[..., :dynamic, :dynamic] += blown @ blown.swapaxes(2, 3)
            if trace is not None:
                trace.append((*before, mean.copy(), covariance.copy(), jacobian))
    return Followed(innovation, variance, states, places)


def smoothed(model: Vehicle, course: Course, theta: Floats, noises: Noises) -> Followed:
    """What the filter makes of the runs under one parameter set theta (p,), with states given later readings too.

    Rauch, Tung and Striebel (1965), AIAA Journal 3:1445.
    """
    trace: list[tuple[Floats, ...]] = []
    followed = follow(model, course, theta[None], noises, keep=True, trace=trace)
    assert followed.states is not None
    states = followed.states[:, 0].copy()
    for m in range(len(trace) - 1, -1, -1):
        mean, covariance, ahead, spread, jacobian = (part[:, 0] if part.ndim == 3 else part[0] for part in trace[m])
        moved = (states[..., m + 1] - ahead).T[..., None]
        back = covariance @ jacobian.swapaxes(1, 2) @ np.linalg.pinv(spread, hermitian=True) @ moved
        states[..., m] = mean + back[..., 0].T
    return replace(followed, states=states[:, None])


def _start(step: Step, course: Course, noises: Noises, sets: int) -> tuple[Floats, Floats]:
    """Mean (n, P, R) and covariance (P, R, n, n) at the first node."""
    places, dofs = step.places, course.motion.dofs
    mean = np.zeros((places.count, sets, len(course.names)))
    deviation = np.zeros_like(mean)
    first = step.origin
    for d, dof in enumerate(dofs):
        mean[places.position[d]] = first[d]
        deviation[places.position[d]] = min(dof.limits.position_sd, 0.5)
        swift = np.where(course.still, 0.0, min(dof.limits.velocity_sd, max(course.fastest[d], 1e-3)))
        deviation[places.velocity[d]] = swift
        deviation[places.pushed[d]] = noises.size[d][:, None]
    for place in places.memory:
        mean[place] = mean[places.remembered[place]]
        deviation[place] = 1e-6
    deviation[places.gain] = noises.gain[:, None]
    for name, own in places.own.items():
        for place in own:
            deviation[place] = noises.own[name][:, None]
    for place, of in places.bias.values():
        deviation[place] = dofs[of].limits.bias_sd
    covariance = np.zeros((sets, len(course.names), places.count, places.count))
    diagonal = np.arange(places.count)
    covariance[..., diagonal, diagonal] = np.moveaxis(deviation**2, 0, 2)
    for place in places.memory:  # a slow sensor starts where the vehicle does
        other = places.remembered[place]
        covariance[..., place, :] = covariance[..., other, :]
        covariance[..., :, place] = covariance[..., :, other]
        covariance[..., place, place] = covariance[..., other, other] + 1e-12
    return mean, covariance


def _update(
    step: Step,
    course: Course,
    m: int,
    mean: Floats,
    covariance: Floats,
    white: Floats,
    innovation: Floats,
    variance: Floats,
) -> None:
    """Take in the readings of one node, channel by channel, in place."""
    for c, channel in enumerate(course.channels):
        seen = channel.seen[:, m]
        if not seen.any():
            continue
        shown, weights = step.reading(channel, m, mean, covariance)
        shares, total = np.zeros(covariance.shape[:3]), np.zeros(shown.shape) + white[c][:, None]
        for place, weight in weights:
            shares = shares + covariance[..., place] * weight[..., None]
        for place, weight in weights:
            total = total + shares[..., place] * weight
        missed = channel.values[:, m] - shown
        innovation[c, :, :, m] = np.where(seen, missed, 0.0)
        variance[c, :, :, m] = np.where(seen, total, 0.0)
        doubt = np.maximum(np.abs(missed) / (FAR * np.sqrt(total)), 1.0)
        gain = np.where(seen[:, None], shares / (total * doubt)[..., None], 0.0)
        mean += gain.transpose(2, 0, 1) * np.where(seen, missed, 0.0)
        covariance -= gain[..., :, None] * shares[..., None, :]
