"""Extended Kalman filter of all runs under all parameter sets together, blind to the effects.

State of a run: positions and velocities, states of the water and of slow sensors, an acceleration for each degree of
freedom that is an Ornstein-Uhlenbeck process (wind, waves, tether, current: whatever pushes and is not logged), the log
gain of the run's thrust, what effects let vary from run to run, and the bias of each velocity sensor. The thrust is
noisy in proportion to its size as well. Actuators act on the logged commands before the filter and know no noise.

Derivatives are central differences over one standard deviation of the state: of a smooth law they are its slope, of a
kinked one (Coulomb drag) about what statistical linearisation gives; a push is moved little, to one side. Sources:
Särkkä (2013), Bayesian Filtering and Smoothing, chapter 5; Nørgaard, Poulsen and Ravn (2000), Automatica 36:1627
(divided differences); Huber (1964), Annals of Mathematical Statistics 35:73 (readings far off count linearly).
"""

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, fields, replace
from functools import cached_property, reduce

import numpy as np
from numpy.typing import NDArray

from automarine_cli.effects import Place
from automarine_cli.filters.course import Course
from automarine_cli.logs.columns import SIGNALS
from automarine_cli.models.model import Bound, Model, Term, actuators, turned
from automarine_cli.quantities import Floats
from automarine_cli.simulation.batch import Channel
from automarine_cli.simulation.rollout import foreknown, in_body_axes, right_hand_side, rk4

MIN_STATE_SD = 1e-3  # least difference [rad, m, per s] by which a state is moved to see what depends on it
LITTLE = 0.01  # standard deviations by which a push and the gain are moved: over a step they act on the velocity alone


@dataclass(frozen=True)
class States:
    """Places of the n states of a run. The first `dynamic` of them are advanced by the equation of motion: positions,
    velocities, states of the water, and what slow sensors show (`memory`, each with the position `remembered`). Then
    come the disturbing accelerations `pushed`, the log `gain`, what effects let vary (`per_run`), and each velocity
    channel's `bias`, with its degree of freedom, where its position is read too."""

    position: tuple[int, ...]
    velocity: tuple[int, ...]
    water: tuple[int, ...]
    memory: tuple[int, ...]
    remembered: Mapping[int, int]
    dynamic: int
    pushed: tuple[int, ...]
    gain: int
    per_run: Mapping[str, tuple[int, ...]]
    bias: Mapping[str, tuple[int, int]]
    count: int


def _places(dofs: int, terms: list[Bound], course: Course) -> States:
    movers = [term for term in terms if term.effect.place in (Place.MOMENT, Place.WATER)]
    slow = [term for term in terms if term.effect.place is Place.SENSOR and term.effect.remembers]
    water = sum(len(term.effect.states) for term in movers)
    first = 2 * dofs
    memory = tuple(range(first + water, first + water + len(slow)))
    dynamic = first + water + len(slow)
    gain = dynamic + dofs
    per_run, at = {}, gain + 1
    for term in terms:
        if term.effect.varies(tuple(float(value.flat[0]) for value in term.values)):
            per_run[term.effect.name] = tuple(range(at, at + term.effect.per_run))
            at += term.effect.per_run
    bias, logged = {}, {channel.quantity for channel in course.channels}
    for channel in course.channels:
        if channel.velocity and course.motion.positions[channel.dof] in logged:  # else it is one with the velocity
            bias[channel.quantity] = (at, channel.dof)
            at += 1
    return States(
        position=tuple(range(dofs)), velocity=tuple(range(dofs, first)), water=tuple(range(first, first + water)),
        memory=memory, remembered={place: term.dof for place, term in zip(memory, slow)}, dynamic=dynamic,
        pushed=tuple(range(dynamic, gain)), gain=gain, per_run=per_run, bias=bias, count=at,
    )  # fmt: skip


class Step:
    """One model on one course for P parameter sets: commands delivered, steps, readings.

    `delivered` (K, D, P, R) is what the actuators give without the runs' gain, the mean over each step, and `tilt` how
    it rises over the step [per s]; `inverse` (P, D, D) is that of the inertia, `columns` are the states on which the
    dynamic ones depend nonlinearly, or that push them, `slow` the sensors that lag.
    """

    def __init__(
        self, model: Model, course: Course, theta: Floats, late: Floats, thrust: Sequence[Floats] | None = None
    ) -> None:
        self.course, self.sets, self.runs = course, len(theta), len(course.names)
        dofs, terms = len(model.motion.dofs), list(model.forces(theta))
        self.places = _places(dofs, terms, course)
        self.origin = np.zeros((dofs, self.runs))  # the first reading of each position, zero where it is not logged
        for channel in course.channels:
            if not channel.velocity:
                self.origin[channel.dof] = channel.values[np.arange(self.runs), channel.seen.argmax(axis=1)]
        self.sensors = [t for t in terms if t.effect.place is Place.SENSOR and not t.effect.remembers]
        self.clock, self.signals = course.time, course.averaged_signals
        self.inverse = np.linalg.inv(model.inertia_matrix(theta))
        self.delivered, self.tilt, *self._before = thrust or thrust_of(model, course, theta, late)
        acting = {n: column[None] for n, column in course.signals.items() if n in SIGNALS and SIGNALS[n].commanded}
        acting |= turned(terms, course.signals, course.commands[0])
        self._commanded = {n: course.averaged(column, late)[0].swapaxes(1, 2) for n, column in acting.items()}
        self.water_moves = model.current(theta)
        places = self.places
        placed = bool(self.places.memory) or any(t.effect.uses_position for t in terms)
        self._placed = placed or any(not of.velocity and of.dof < dofs - 1 for of in course.channels)
        self._followed = self._placed or self.water_moves is not None
        self._turned = model.motion.turns and not placed  # its heading turns the way of a step, and nothing else
        first = 0 if placed else dofs - self._turned
        self.columns = slice(first, places.count - len(places.bias))
        self._pushed = slice(places.dynamic, places.gain)
        self._model, self._theta = model, theta
        self._moving, self._forced = slice(self._turned, places.dynamic - first), slice(places.dynamic - first, None)
        columns = np.arange(places.count)[self.columns]
        moving, forced = columns[self._moving], columns[self._forced]
        count, last = len(moving), 1 + 2 * len(moving)
        self._ahead, self._behind = (moving, np.arange(1, 1 + count)), (moving, np.arange(1 + count, last))
        self._harder = forced, np.arange(last, last + len(forced))
        self._build(model, theta, last + len(forced), self.origin)

    def _bound(self, term: Bound) -> Bound:
        """A term with the coefficients that each run has of its own; these arrays are filled anew in every step."""
        if term.effect.name not in self._own:
            return replace(term, values=(*term.values, *[np.zeros((1, 1))] * term.effect.per_run))
        return replace(term, values=(*term.values, *self._own[term.effect.name]))

    def of_pieces(self, cut: Course, begin: Floats, run: NDArray[np.int64], at: NDArray[np.int64]) -> "Step":
        """The same for A pieces of the runs as runs of their own: `cut` has their names and lengths, `begin` (A,) [s]
        is when they begin in their `run` (A,), and `at` (A, K) are the steps that they are made of."""
        pieces = copy(self)
        pieces.course, pieces.runs = cut, len(run)
        cuts = (x[at.T, :, :, run].transpose(0, 2, 3, 1) for x in (self.delivered, self.tilt, *self._before))
        pieces.delivered, pieces.tilt, *pieces._before = cuts
        pieces.clock = begin[:, None] + np.concatenate([0.0 * begin[:, None], np.cumsum(cut.length, axis=1)], axis=1)
        pieces.signals = {name: column[run[:, None], at] for name, column in self.signals.items()}
        pieces._commanded = {name: column[:, at.T, run] for name, column in self._commanded.items()}
        pieces._build(self._model, self._theta, 1, self.origin[:, run])
        return pieces

    def _build(self, model: Model, theta: Floats, copies: int, origin: Floats) -> None:
        """The right-hand side for so many copies of every run."""
        wide = np.tile(theta, (copies, 1))
        self._copies = copies
        self._own = {name: np.zeros((len(group), len(wide), self.runs)) for name, group in self.places.per_run.items()}
        terms = model.forces(wide)
        movers = [self._bound(term) for term in terms if term.effect.place in (Place.MOMENT, Place.WATER)]
        self.slow = [t for t in terms if t.effect.place is Place.SENSOR and t.effect.remembers]
        self._curves = foreknown([t for t in model.forces(theta) if t.effect.needs], self.signals)
        inertia, current = model.inertia_matrix(wide), model.current(wide)
        self._slope = right_hand_side(model, movers, inertia, current, origin[:, None], self._placed)

    def moved(self, m: int, mean: Floats, ramp: Floats) -> Floats:
        """The state (n, P, R) at the end of step m, without derivatives, if it was built for one copy."""
        every = mean.copy()
        every[self._pushed] *= ramp
        after = mean.copy()
        after[: self.places.dynamic] = self._moved(m, every[:, None])
        return after

    def advance(self, m: int, mean: Floats, covariance: Floats, ramp: Floats) -> tuple[Floats, Floats]:
        """The state at the end of step m, (n, P, R), and the derivatives (dynamic, columns, P, R) of its dynamic part
        by the states of `columns`; `ramp` (D, P, R) is the mean of a disturbance over the step as a share of what it
        begins with, and those by disturbances are by such a mean."""
        places, count, dofs = self.places, len(self._ahead[0]), len(self.places.position)
        every = np.repeat(mean[:, None], self._copies, axis=1)
        every[self._pushed] *= ramp[:, None]
        deviations = np.sqrt(np.maximum(np.einsum("iipr->ipr", covariance)[self.columns], MIN_STATE_SD**2))
        sizes, little = deviations[self._moving], LITTLE * deviations[self._forced]
        ahead = mean[dofs : 2 * dofs] + self.delivered[m]  # its sign is that of the way, also from rest
        little[:dofs] = np.copysign(little[:dofs], ahead)  # of a mirrored run the derivatives are mirrored
        every[self._ahead] += sizes
        every[self._behind] -= sizes
        every[self._harder] += little
        moved = self._moved(m, every).reshape(places.dynamic, self._copies, self.sets, self.runs)
        after = mean.copy()
        after[: places.dynamic] = moved[:, 0]
        slopes = np.empty((places.dynamic, *deviations.shape))
        slopes[:, self._moving] = (moved[:, 1 : 1 + count] - moved[:, 1 + count : 1 + 2 * count]) / (2.0 * sizes)
        slopes[:, self._forced] = (moved[:, 1 + 2 * count :] - moved[:, :1]) / little
        if self._turned:
            slopes[:, 0] = self._turning(m, mean, after)
        return after, slopes

    def _turning(self, m: int, mean: Floats, after: Floats) -> Floats:
        """What another heading makes of the dynamic states (dynamic, P, R) after step m: the way through the water
        turns with it."""
        north, east, heading = self.places.position
        slopes = np.zeros((self.places.dynamic, *mean.shape[1:]))
        slopes[heading] = 1.0
        if self._placed:
            drifted = 0.0 if self.water_moves is None else self.water_moves * self.course.length[:, m]
            way = after[[north, east]] - mean[[north, east]] - drifted
            slopes[north], slopes[east] = -way[1], way[0]
        return slopes

    def _moved(self, m: int, every: Floats) -> Floats:
        """The dynamic states of all copies after step m, (dynamic, copies P, R), by Runge and Kutta's method."""
        places, dofs = self.places, len(self.places.position)
        flat = every.reshape(len(every), self._copies * self.sets, self.runs)
        for name, group in places.per_run.items():
            np.copyto(self._own[name], flat[list(group)])
        h = self.course.length[:, m]
        begin, end = self.clock[:, m], self.clock[:, m + 1]
        signals = {name: column[:, m] for name, column in self.signals.items()}
        late = self._commanded | self._curves
        signals |= {name: np.tile(column[:, m], (self._copies, 1)) for name, column in late.items()}
        gain = np.exp(every[places.gain])
        levels = self.delivered[m], 0.5 * h * self.tilt[m]
        force, rise = ((level[:, None] * gain).reshape(dofs, *flat.shape[1:]) for level in levels)
        forces = force - rise, force, force + rise
        pushed, x = flat[self._pushed], flat[:dofs]

        def slope(*state):  # type: ignore[no-untyped-def]
            swing, move, stirred = self._slope(*state)
            return swing + pushed, move, stirred

        water = [flat[place] for place in places.water]
        times = begin, 0.5 * (begin + end), end
        way, velocity, water = rk4(slope, x, flat[dofs : 2 * dofs], water, forces, times, h, signals, self._followed)
        out = np.empty((places.dynamic, *flat.shape[1:]))
        out[:dofs], out[dofs : 2 * dofs] = x + way, velocity
        for place, state in zip(places.water, water):
            out[place] = state
        for place, term in zip(places.memory, self.slow):
            of = places.remembered[place]
            out[place] = term.effect.remember(flat[place], x[of], out[of], h, term.values)
        return out

    def _delivered_at(self, dof: int, m: int) -> Floats:
        """What the actuators give as node m is reached, by the commands of rows before it, (P, R, 1)."""
        delivered, tilt = self._before
        step, half = max(m - 1, 0), 0.5 if m else -0.5
        return np.asarray((delivered[step, dof] + half * self.course.length[:, step] * tilt[step, dof])[..., None])

    def reading(
        self, channel: Channel, m: int, mean: Floats, covariance: Floats
    ) -> tuple[Floats, list[tuple[int, Floats | None]]]:
        """What a channel shows at node m, (P, R), and its derivatives by the states that it depends on, if not one."""
        places = self.places
        if channel.velocity:
            at = [places.velocity[channel.dof], *places.bias.get(channel.quantity, ())[:1]]
            reading = sum(mean[place] for place in at)
            if self.water_moves is not None:
                reading = reading + in_body_axes(self.water_moves, mean[places.position[-1]])[channel.dof]
            return reading, [(place, None) for place in at]
        place = next((k for k, of in places.remembered.items() if of == channel.dof), channel.dof)
        sensors = [term for term in self.sensors if term.dof == channel.dof]
        if not sensors:
            return mean[place], [(place, None)]
        size = np.sqrt(np.maximum(covariance[place, place], MIN_STATE_SD**2))
        tried = mean[place] + np.stack([0.0 * size, size, -size])
        time = self.clock[:, m, None]
        for term in sensors:
            values = (*term.wide(), *((self._delivered_at(channel.dof, m),) if term.effect.reads_force else ()))
            tried = np.stack([term.effect.read(x[..., None], time, values)[..., 0] for x in tried])
        return tried[0], [(place, (tried[1] - tried[2]) / (2.0 * size))]


def thrust_of(model: Model, course: Course, theta: Floats, late: Floats) -> tuple[Floats, ...]:
    """What the actuators of a model deliver over the steps, means and slopes, then the same as sensors may know it.

    A controller makes the command of a row of that row's reading: were it told beforehand, a sensor that commands
    disturb would explain its own noise (closed loops: Forssell and Ljung 1999, Automatica 35:1215).
    """
    terms = list(model.forces(theta))
    delivered = _delivered(terms, course, late)
    fed = any(term.effect.reads_force for term in terms if term.effect.place is Place.SENSOR)
    return *delivered, *(_delivered(terms, course, np.maximum(late, course.half_width)) if fed else delivered)


def _delivered(terms: list[Bound], course: Course, late: Floats) -> tuple[Floats, Floats]:
    """What the actuators deliver over the filter's steps, `late` (P,) [s] after the log has it: means and
    slopes, (K, D, P, R).

    A dead time is read off the commands as they are held, like `late`: means of late commands over fine steps, averaged
    again over the filter's, would be smeared over two of them."""
    commands, instants = list(course.commands), [late] * len(course.commands)
    for term in actuators(terms):
        commanded, values = commands[term.dof], term.wide()
        if term.effect.delays and term.effect.shifts([value.flat[0] for value in values]):
            instants[term.dof] = instants[term.dof] + values[0][:, 0, 0]
        else:
            commands[term.dof] = replace(commanded, force=term.effect.deliver(commanded, values))
    lines = [course.averaged(command.force, instant) for command, instant in zip(commands, instants)]
    mean, slope = (_by_step(np.stack(part)) for part in zip(*lines))
    return mean, slope


def _by_step(values: Floats) -> Floats:
    """(..., K) as (K, ...), so that what a step needs lies together."""
    return np.ascontiguousarray(np.moveaxis(values, -1, 0))


MAX_Z = 5.0  # beyond which an innovation counts linearly, and its reading as noisier than the others


@dataclass(frozen=True)
class Noises:
    """Sizes of everything random, for P parameter sets, and what the logger adds.

    `size` (D, P) standard deviation of the disturbing accelerations [per s²] and `time` (D, P) their time constants
    [s]; `thrust` (D, P) the noise of thrust as a share of it [s^1/2]; `gain` (P,) standard deviation of the runs' log
    gain; `late` (P,) [s] by how much commands act after the middle of the interval in which they changed; `reading` (C,
    P) noise of each channel [its unit]; `per_run` (P,) by effect the size of what it lets vary.
    """

    size: Floats
    time: Floats
    thrust: Floats
    gain: Floats
    late: Floats
    reading: Floats
    per_run: Mapping[str, Floats]

    @classmethod
    def of_all(cls, several: Sequence["Noises"]) -> "Noises":
        """Of all parameter sets of several models, which let the same vary from run to run."""
        names = [field.name for field in fields(cls) if field.name != "per_run"]
        of_sets = {name: np.concatenate([getattr(noises, name) for noises in several], axis=-1) for name in names}
        per_run = {name: np.concatenate([noises.per_run[name] for noises in several]) for name in several[0].per_run}
        return cls(**of_sets, per_run=per_run)


@dataclass(frozen=True)
class FilterResult:
    """What the filter made of the runs: innovations and their variances, (C, P, R, K + 1), one and zero where nothing
    was read; the log gain of each run's thrust at its end (P, R); the filtered states (n, P, R, K + 1) if they were
    asked for, and their places."""

    innovation: Floats
    variance: Floats
    gain: Floats
    states: Floats | None
    places: States

    def of(self, place: int, run: int) -> "FilterResult":
        """The result of one run under the parameter set in that place."""
        at = slice(place, place + 1), slice(run, run + 1)
        states = None if self.states is None else self.states[:, *at]
        return FilterResult(self.innovation[:, *at], self.variance[:, *at], self.gain[at], states, self.places)

    @cached_property
    @np.errstate(over="ignore", invalid="ignore")  # where a filter runs away
    def log_density(self) -> Floats:
        """Log density of the readings of each run, (P, R)."""
        observed = self.variance > 0
        z = np.abs(self.innovation) / np.sqrt(np.where(observed, self.variance, 1.0))
        square = np.where(z <= MAX_Z, np.minimum(z, MAX_Z) ** 2, MAX_Z * (2.0 * z - MAX_Z))
        return -0.5 * np.where(observed, square + np.log(2 * np.pi * np.where(observed, self.variance, 1.0)), 0.0).sum(
            axis=(0, 3)
        )


def follow(
    model: Model, course: Course, theta: Floats, noises: Noises, keep: bool = False,
    trace: list[tuple[Floats, ...]] | None = None, thrust: Sequence[Floats] | None = None,
) -> FilterResult:  # fmt: skip
    """Filter all runs of `course` under all parameter sets `theta` (P, p); with `keep` the states are returned too.

    A `trace` gets mean and covariance of every node, and what the next step made of them with its Jacobian; `thrust` is
    that of the model's own actuators, if it is not given.
    """
    step = Step(model, course, theta, noises.late, thrust)
    places, columns = step.places, step.columns
    sets, runs, nodes = len(theta), len(course.names), course.length.shape[1] + 1
    mean, covariance = _start(step, course, noises, sets)
    innovation, variance = np.zeros((2, nodes, len(course.channels), sets, runs))
    states = np.zeros((nodes, places.count, sets, runs)) if keep else None
    time = noises.time[:, :, None, None]
    decay = np.exp(-course.length / time)
    ramp = _by_step((1.0 - decay) * time / np.maximum(course.length, 1e-12))
    fresh, fade = _by_step((noises.size**2)[:, :, None, None] * (1.0 - decay**2)), _by_step(decay)
    root = np.sqrt(np.maximum(course.length, 1e-12))
    thrusty = noises.thrust[None, :, :, None] * np.abs(step.delivered) / _by_step(root)[:, None, None]
    white, dynamic, moving = noises.reading**2, places.dynamic, places.gain
    pushed = np.arange(dynamic, moving)
    of_push = slice(dynamic - columns.start, moving - columns.start)
    transition = np.tile(np.eye(places.count)[..., None, None], (1, 1, sets, runs))
    jacobian = transition[:moving]  # what is behind `moving` stays as it is
    inverse = step.inverse.transpose(1, 2, 0)[..., None]
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        for m in range(nodes):
            _update(step, course, m, mean, covariance, white, innovation[m], variance[m])
            if states is not None:
                states[m] = mean
            if m == nodes - 1:
                break
            before = (mean, covariance.copy()) if trace is not None else ()
            mean, slopes = step.advance(m, mean, covariance, ramp[m])
            blown = np.einsum("djpr,jkpr->dkpr", slopes[:, of_push], inverse * thrusty[m])  # by constant accelerations
            blown *= np.exp(mean[places.gain])
            slopes[:, of_push] *= ramp[m]
            mean[dynamic:moving] *= fade[m]
            jacobian[:dynamic, columns], jacobian[pushed, pushed] = slopes, fade[m]
            moved = np.einsum("ikpr,kjpr->ijpr", jacobian, covariance)
            covariance[:moving, moving:] = moved[:, moving:]
            covariance[moving:, :moving] = moved[:, moving:].swapaxes(0, 1)
            covariance[:moving, :moving] = np.einsum("ikpr,jkpr->ijpr", moved, jacobian)
            covariance[pushed, pushed] += fresh[m]
            covariance[:dynamic, :dynamic] += np.einsum("ikpr,jkpr->ijpr", blown, blown)
            if trace is not None:
                trace.append((*before, mean.copy(), covariance.copy(), transition.copy()))
    innovation, variance = (np.ascontiguousarray(np.moveaxis(x, 0, -1)) for x in (innovation, variance))
    if states is not None:
        states = np.ascontiguousarray(np.moveaxis(states, 0, -1))
    return FilterResult(innovation, variance, mean[places.gain], states, places)


MAX_SETS_TIMES_RUNS = 1000  # beyond which one pass for several models is no quicker than one for each


def _is_drag(term: Term) -> bool:
    """Whether a filter may follow a term also for models without it, for which it is off."""
    return term.effect.power is not None or term.is_cross


def alike(models: Sequence[Model], sizes: Sequence[int]) -> list[list[int]]:
    """Places of models that one filter may follow, for they differ in their actuators and their drag alone, in groups
    that have at most MAX_SETS_TIMES_RUNS of these `sizes` in all."""
    groups: dict[tuple[object, ...], list[list[int]]] = {}
    for i, (model, size) in enumerate(zip(models, sizes)):
        hull = model.hull
        varying = {t.name for t in model.terms if t.effect.varies(t.values)}
        alone = i if varying - {t.name for t in hull.terms} else None  # what varies from run to run is a state
        acting = tuple((t.name, t.dof, t.effect.varies(t.values)) for t in hull.terms if not _is_drag(t))
        of_key = groups.setdefault((alone, acting, hull.moment_unit, hull.water is None), [[]])
        if of_key[-1] and size + sum(sizes[k] for k in of_key[-1]) > MAX_SETS_TIMES_RUNS:
            of_key.append([])
        of_key[-1].append(i)
    return [group for of_key in groups.values() for group in of_key]


def _together(models: Sequence[Model]) -> Model:
    """What the filter of several models that are alike follows: every term of any of them, with drag that is off."""
    hulls = [model.hull for model in models]
    terms = {(t.name, t.dof, t.base): t for hull in hulls for t in hull.terms}
    return replace(hulls[0], terms=tuple(replace(t, values=t.effect.off) if _is_drag(t) else t for t in terms.values()))


def follow_all(
    models: Sequence[Model], course: Course, thetas: Sequence[Floats], noises: Sequence[Noises]
) -> list[FilterResult]:
    """Filter all runs under the parameter sets (P, p) of each of several models, with as few passes as may be."""
    results = dict[int, FilterResult]()
    for group in alike(models, [len(theta) * len(course.names) for theta in thetas]):
        if len(group) == 1:
            results[group[0]] = follow(models[group[0]], course, thetas[group[0]], noises[group[0]])
            continue
        hull, of_hull, thrusts, end = _together([models[i] for i in group]), [], [], 0
        places = {name: place for place, name in enumerate(hull.parameter_names)}
        for i in group:
            theta = np.tile(hull.theta, (len(thetas[i]), 1))
            for name, column in zip(models[i].parameter_names, thetas[i].T):
                if name in places:
                    theta[:, places[name]] = column
            of_hull.append(theta)
            thrusts.append(thrust_of(models[i], course, thetas[i], noises[i].late))
        thrust = [np.concatenate(parts, axis=2) for parts in zip(*thrusts)]
        together = Noises.of_all([noises[i] for i in group])
        followed = follow(hull, course, np.concatenate(of_hull), together, thrust=thrust)
        for i in group:
            part = slice(end, end := end + len(thetas[i]))
            innovation, variance = followed.innovation[:, part], followed.variance[:, part]
            results[i] = FilterResult(innovation, variance, followed.gain[part], None, followed.places)
    return [results[i] for i in range(len(models))]


def smoothed(model: Model, course: Course, theta: Floats, noises: Noises) -> FilterResult:
    """What the filter makes of the runs under one parameter set theta (p,), with states given later readings too.

    Rauch, Tung and Striebel (1965), AIAA Journal 3:1445.
    """
    trace: list[tuple[Floats, ...]] = []
    followed = follow(model, course, theta[None], noises, keep=True, trace=trace)
    assert followed.states is not None
    states = followed.states[:, 0].copy()
    for m in range(len(trace) - 1, -1, -1):
        mean, covariance, ahead, spread, jacobian = (
            part[:, 0] if part.ndim == 3 else part[:, :, 0].transpose(2, 0, 1) for part in trace[m]
        )
        moved = (states[..., m + 1] - ahead).T[..., None]
        back = covariance @ jacobian.swapaxes(1, 2) @ np.linalg.pinv(spread, hermitian=True) @ moved
        states[..., m] = mean + back[..., 0].T
    return replace(followed, states=states[:, None])


def _start(step: Step, course: Course, noises: Noises, sets: int) -> tuple[Floats, Floats]:
    """Mean (n, P, R) and covariance (n, n, P, R) at the first node. The vehicle is ahead of a slow sensor by what the
    unknown velocity makes of its lag: were both even, the first readings would not move, however fast the start."""
    places, dofs = step.places, course.motion.dofs
    mean = np.zeros((places.count, sets, len(course.names)))
    deviation = np.zeros_like(mean)
    first = step.origin
    for d, dof in enumerate(dofs):
        mean[places.position[d]] = first[d]
        deviation[places.position[d]] = min(dof.limits.position_sd, 0.5)
        swift = np.where(course.at_rest, 0.0, min(dof.limits.velocity_sd, max(course.fastest[d], 1e-3)))
        deviation[places.velocity[d]] = swift
        deviation[places.pushed[d]] = noises.size[d][:, None]
    deviation[places.gain] = noises.gain[:, None]
    for name, group in places.per_run.items():
        for place in group:
            deviation[place] = noises.per_run[name][:, None]
    for place, of in places.bias.values():
        deviation[place] = dofs[of].limits.bias_sd
    covariance = np.zeros((places.count, places.count, sets, len(course.names)))
    diagonal = np.arange(places.count)
    covariance[diagonal, diagonal] = deviation**2
    for place, term in zip(places.memory, step.slow):
        of, speed = places.remembered[place], places.velocity[places.remembered[place]]
        mean[place] = mean[of]
        behind = term.values[0][:sets]  # its time constant: what it is behind a vehicle of unit speed
        covariance[place, place] = covariance[place, of] = covariance[of, place] = covariance[of, of]
        covariance[of, speed] = covariance[speed, of] = behind * covariance[speed, speed]
        covariance[of, of] += behind**2 * covariance[speed, speed] + 1e-12
    return mean, covariance


def _update(
    step: Step, course: Course, m: int, mean: Floats, covariance: Floats, white: Floats, innovation: Floats,
    variance: Floats,
) -> None:  # fmt: skip
    """Take in the readings of one node, channel by channel, in place."""
    for c, channel in enumerate(course.channels):
        observed = channel.seen[:, m]
        if not observed.any():
            continue
        predicted, weights = step.reading(channel, m, mean, covariance)
        shares, across = _weighed(covariance, weights), _weighed(covariance.swapaxes(0, 1), weights)
        total = _weighed(shares, weights) + white[c][:, None]
        missed = channel.values[:, m] - predicted
        gain = across / (total * np.maximum(np.abs(missed) / (MAX_Z * np.sqrt(total)), 1.0))
        if not observed.all():
            missed, total, gain = (np.where(observed, of, 0.0) for of in (missed, total, gain))
        innovation[c], variance[c] = missed, total
        mean += gain * missed
        covariance -= gain[:, None] * shares  # column by row: else rounding grows where a craft turns away by itself


def _weighed(of: Floats, weights: Sequence[tuple[int, Floats | None]]) -> Floats:
    """The sum over states of what is `of` each, times its weight, if not one."""
    return reduce(np.add, [of[place] if weight is None else of[place] * weight for place, weight in weights])


HORIZONS = (2.0, 5.0, 15.0)  # seconds ahead
SETTLING_S = 2.0  # time [s] that a filter has before its first prediction counts
LOOKS_BACK_S = (0.5, 1.0, 2.0)
"""Lengths [s] over which a constant rate may be taken; the best of them counts, for it is the rival of the model."""


@dataclass(frozen=True)
class Predicted:
    """Predictions of one channel over one horizon [s]: from node `origin` (A,) of run `run` (A,) to its node `target`
    (A,), with the `error` (A,) measured less predicted, and those of a constant rate and a constant position."""

    horizon: float
    run: NDArray[np.int64]
    origin: NDArray[np.int64]
    target: NDArray[np.int64]
    error: Floats
    constant_rate: Floats
    constant: Floats

    @np.errstate(over="ignore")  # a model that runs away misses by infinity
    def rmse(self, error: Floats | None = None) -> float:
        """Root mean square over all predictions; not a number where there are none."""
        of = self.error if error is None else error
        return float(np.sqrt(np.mean(of**2))) if len(of) else float("nan")

    @np.errstate(over="ignore")
    def by_run(self, runs: int) -> Floats:
        """Mean square error of each run (R,), not a number where a run has none."""
        total, count = np.bincount(self.run, self.error**2, runs), np.bincount(self.run, minlength=runs)
        return np.divide(total, count, out=np.full(runs, np.nan), where=count > 0)


def predict(
    model: Model, course: Course, theta: Floats, noises: Noises, channels: Sequence[int] = (0,),
    followed: FilterResult | None = None, alone: bool = False, horizons: Sequence[float] = HORIZONS,
) -> list[tuple[Predicted, ...]]:  # fmt: skip
    """Predictions of each channel over `horizons` [s] under one parameter set theta (p,), with the sizes of what is
    random, from the states that were `followed`; by the model `alone`, without the disturbance and the gain that the
    filter believes in."""
    followed = followed or follow(model, course.unthinned, theta[None], noises, keep=True)
    assert followed.states is not None
    states = followed.states[:, 0]
    if alone:
        states = states.copy()
        states[[*followed.places.pushed, followed.places.gain]] = 0.0
    time, shown = course.time, [shown_channel(course, channel) for channel in channels]
    run, origin = np.nonzero(np.any([of.seen for of in shown], axis=0) & (time >= SETTLING_S))
    targets = [
        {h: np.where(of.seen[run, origin], targets_of(of.seen, time, run, origin, h), -1) for h in horizons}
        for of in shown
    ]
    last = np.max([np.where(at >= 0, at, 0) for of_channel in targets for at in of_channel.values()], axis=0)
    paths = carried(model, course, theta[None], noises, states, shown, run, origin, last)[:, 0]
    return [_along(*of_channel, time, run, origin) for of_channel in zip(shown, paths, targets)]


def _along(
    of: Channel, path: Floats, targets: Mapping[float, NDArray[np.int64]], time: Floats, run: NDArray[np.int64],
    origin: NDArray[np.int64],
) -> tuple[Predicted, ...]:  # fmt: skip
    """Predictions of one channel along the `path` (A, K) from each origin."""
    rates = _rates(of, time, run, origin, targets)
    start = of.values[run, origin]
    predictions = []
    for h, target in targets.items():
        have = target >= 0
        r, o, t = run[have], origin[have], target[have]
        measured = of.values[r, t]
        predictions.append(
            Predicted(
                h, r, o, t,
                error=measured - path[have, t - o],
                constant_rate=measured - start[have] - rates[have] * (time[r, t] - time[r, o]),
                constant=measured - start[have],
            )
        )  # fmt: skip
    return tuple(predictions)


def shown_channel(course: Course, channel: int = 0) -> Channel:
    """The positions of a channel: its own readings, or the sum of its velocities by the trapezoidal rule; velocities in
    axes that turn have none."""
    of = course.channels[channel]
    if not of.velocity or course.motion.turns:
        return of
    summed = np.zeros_like(of.values)
    for row, values, observed, time in zip(summed, of.values, of.seen, course.time):
        steps = 0.5 * (values[observed][1:] + values[observed][:-1]) * np.diff(time[observed])
        row[observed] = np.concatenate([[0.0], np.cumsum(steps)])
    position = course.motion.positions[of.dof]
    return replace(of, quantity=position, velocity=False, values=summed, counts=False)


def targets_of(
    observed: NDArray[np.bool_], time: Floats, run: NDArray[np.int64], origin: NDArray[np.int64], horizon: float
) -> NDArray[np.int64]:
    """The node with a reading nearest to `horizon` after each origin, (A,); -1 if that is a fifth off or a run ends."""
    out = np.full(len(run), -1)
    for r in np.unique(run):
        of_run, nodes = run == r, np.flatnonzero(observed[r])
        target = time[r, origin[of_run]] + horizon
        after = np.clip(np.searchsorted(time[r, nodes], target), 1, len(nodes) - 1)
        nearer = np.where(
            target - time[r, nodes[after - 1]] < time[r, nodes[after]] - target, nodes[after - 1], nodes[after]
        )
        close = (np.abs(time[r, nearer] - target) < 0.2 * horizon) & (target < time[r, nodes[-1]] + 1e-6)
        out[of_run] = np.where(close & (nearer > origin[of_run]), nearer, -1)
    return out


def carried(
    model: Model, course: Course, theta: Floats, noises: Noises, states: Floats, channels: Sequence[Channel],
    run: NDArray[np.int64], origin: NDArray[np.int64], last: NDArray[np.int64],
) -> Floats:  # fmt: skip
    """What C channels show from each origin on under each theta (P, p), every prediction being a run of its own,
    (C, P, A, longest + 1).

    A channel that does not count is a sum of velocities, to which no filter is tied: how far it goes is told from where
    the sum is at the origin.
    """
    longest = int(np.max(last - origin, initial=0))
    at = np.minimum(origin[:, None] + np.arange(longest), course.length.shape[1] - 1)
    step = Step(model, course, theta, noises.late)
    cut = replace(
        course,
        names=tuple(course.names[r] for r in run),
        length=course.length[run[:, None], at] * (origin[:, None] + np.arange(longest) < last[:, None]),
    )
    pieces = step.of_pieces(cut, course.time[run, origin], run, at)
    mean = np.repeat(states[:, run, origin][:, None], len(theta), axis=1)
    spread = np.zeros((len(mean), len(mean), len(theta), len(run)))
    predicted = np.zeros((len(channels), len(theta), len(run), longest + 1))
    with np.errstate(over="ignore", invalid="ignore"):
        for m in range(longest + 1):
            for c, channel in enumerate(channels):
                predicted[c, ..., m] = pieces.reading(channel, m, mean, spread)[0]
            if m == longest:
                break
            fade = np.exp(-cut.length[:, m] / noises.time[:, :, None])
            ramp = (1.0 - fade) * noises.time[:, :, None] / np.maximum(cut.length[:, m], 1e-12)
            mean = pieces.moved(m, mean, ramp)
            for d, place in enumerate(pieces.places.pushed):
                mean[place] = mean[place] * fade[d]
    for path, channel in zip(predicted, channels):
        if not channel.counts:
            path += (channel.values[run, origin] - path[..., 0])[..., None]
    return predicted


def _rates(
    channel: Channel, time: Floats, run: NDArray[np.int64], origin: NDArray[np.int64],
    targets: Mapping[float, NDArray[np.int64]],
) -> Floats:  # fmt: skip
    """The rate at each origin by a straight line through the readings before it, (A,); of several lengths of that
    line the one that predicts best over the middle horizon."""
    middle = sorted(targets)[(len(targets) - 1) // 2]
    target, best, least = targets[middle], np.zeros(len(run)), np.inf
    have = target >= 0
    for length in LOOKS_BACK_S:
        rates = np.zeros(len(run))
        for r in np.unique(run):
            nodes = np.flatnonzero(channel.seen[r])
            t, x = time[r, nodes], channel.values[r, nodes]
            of_run = np.flatnonzero(run == r)
            end = np.searchsorted(nodes, origin[of_run], side="right")
            begin = np.minimum(np.searchsorted(t, t[end - 1] - length - 1e-9), np.maximum(end - 2, 0))
            rates[of_run] = _lines(t, x, begin, end)
        missed = channel.values[run, target] - channel.values[run, origin]
        missed = missed - rates * (time[run, target] - time[run, origin])
        size = float(np.mean(missed[have] ** 2)) if have.any() else 0.0
        if size < least:
            best, least = rates, size
    return best


def _lines(t: Floats, x: Floats, begin: NDArray[np.int64], end: NDArray[np.int64]) -> Floats:
    """Slopes of least-squares lines through t[begin:end], x[begin:end], all at once."""
    t, x = t - t[0], x - x[0]
    sums = [np.concatenate([[0.0], np.cumsum(v)]) for v in (np.ones_like(t), t, x, t * t, t * x)]
    n, st, sx, stt, stx = (s[end] - s[begin] for s in sums)
    below = n * stt - st**2
    return np.divide(n * stx - st * sx, below, out=np.zeros_like(below), where=below > 1e-12)
