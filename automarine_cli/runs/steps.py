"""Steps: where a run holds one constant moment or force, from when, and whether the vehicle stood still before."""

from dataclasses import dataclass

import numpy as np

from automarine_cli.quantities import Floats
from automarine_cli.runs.flat import Indices, Mask, first_where, spread
from automarine_cli.runs.joined import Joined, slopes
from automarine_cli.runs.run import Run

SAME_MOMENT = 1e-6  # of the run's largest moment: moments closer than this are one
FEWEST_SAMPLES = 5  # a shorter stretch of one moment is part of a changing command
FEWEST_AT_REST = 2
SHORT_REST = 10
SLOW = 0.1  # of the mean rate of the step: a slower start counts as standing still
SURE = 4.0  # standard errors


@dataclass(frozen=True)
class Step:
    """Samples `first` to `stop - 1` of `run` hold the constant `moment` [the run's unit].

    The command switched somewhere in (`switch_from`, `switch_to`] [s, campaign clock]: after the last sample
    that does not show the moment, at the latest with the first that does. If the log begins with the moment
    already on (`begins_log`), `switch_from` is one sample period before. `rest` are the samples before the
    step at zero moment during which the vehicle stood still, `start_position` [rad or m] the mean position over
    them; both None where there are none. `from_rest` says whether the step starts from standstill,
    `start_rate` [rad/s or m/s] what rate it seems to start with. `ends_log`: the log ends with the moment still on.
    """

    run: Run
    first: int
    stop: int
    moment: float
    switch_from: float
    switch_to: float
    start_position: float | None
    rest: slice | None
    from_rest: bool
    start_rate: float
    begins_log: bool
    ends_log: bool
    notes: tuple[str, ...] = ()

    @property
    def segment(self) -> slice:
        """The samples of the step."""
        return slice(self.first, self.stop)

    @property
    def switch_mid(self) -> float:
        """Middle of the interval in which the command switched [s]."""
        return (self.switch_from + self.switch_to) / 2


@dataclass(frozen=True)
class Steps:
    """The steps of several runs, (S,), in their order: the `run` that each is of, its samples `first` to `stop - 1` in
    the flat arrays, the first sample of the `rest` before it (`first` where there is none); others as in `Step`, NaN
    for no `start_position`."""

    joined: Joined
    run: Indices
    first: Indices
    stop: Indices
    moment: Floats
    switch_from: Floats
    rest: Indices
    start_position: Floats
    from_rest: Mask
    start_rate: Floats

    def step(self, i: int, run: Run, begin: int) -> Step:
        """Step i in a version of its run that begins with sample `begin` of the flat arrays."""
        joined, first, stop, rest = self.joined, int(self.first[i]), int(self.stop[i]), int(self.rest[i])
        own, after = joined.edges[self.run[i]], joined.edges[self.run[i] + 1]
        return Step(
            run=run,
            first=first - begin,
            stop=min(stop - begin, len(run)),
            moment=float(self.moment[i]),
            switch_from=float(self.switch_from[i]),
            switch_to=float(joined.time[first]),
            start_position=float(self.start_position[i]) if rest < first else None,
            rest=slice(max(rest - begin, 0), first - begin) if rest < first else None,
            from_rest=bool(self.from_rest[i]),
            start_rate=float(self.start_rate[i]),
            begins_log=bool(first == own),
            ends_log=bool(stop == after),
            notes=(joined.dof.fill(ALREADY_ON),) if first == own else (),
        )


ALREADY_ON = "the log begins with the {force} already on: its switch is taken within the sample period before"


def find_steps(run: Run) -> tuple[Step, ...]:
    """Stretches of one constant, non-zero moment of at least five samples, in the order of time.

    Raises RunError where the run has no moment.
    """
    if not len(run.command):
        return ()
    found = steps_of(Joined.of([run]))
    return tuple(found.step(i, run, 0) for i in range(len(found.first)))


def segments(moment: Floats) -> list[tuple[int, int, float]]:
    """(first, stop, moment) of every stretch of one constant moment, in order; moments of a hair around 0 are
    0.
    """
    if not len(moment):
        return []
    _, first, stop, value = _stretches(moment, np.array([0, len(moment)]))[0]
    return list(zip(first.tolist(), stop.tolist(), value.tolist()))


def _stretches(command: Floats, edges: Indices) -> tuple[tuple[Indices, Indices, Indices, Floats], Indices]:
    """Run, first sample, one after the last, and command of every stretch of one constant command, (S,), of runs one
    behind the other; and where any command differs from the one before at all."""
    least = _least_change(command, edges)
    change = command[1:] - command[:-1]
    moved = np.flatnonzero(change != 0)
    large = np.abs(change[moved]) > least[np.searchsorted(edges, moved + 1, side="right") - 1]
    first = np.union1d(edges[:-1], moved[large] + 1)
    run = np.searchsorted(edges, first, side="right") - 1
    value = command[first]
    found = run, first, np.append(first[1:], len(command)), np.where(np.abs(value) > least[run], value, 0.0)
    return found, np.union1d(edges[:-1], moved + 1)


def _least_change(command: Floats, edges: Indices) -> Floats:
    """From what size on a change of the command is one, (R,)."""
    largest = np.maximum(np.maximum.reduceat(command, edges[:-1]), -np.minimum.reduceat(command, edges[:-1]))
    return SAME_MOMENT * largest


def steps_of(joined: Joined) -> Steps:
    """The steps of all runs."""
    stretches, pieces = _stretches(joined.command, joined.edges)
    held = (stretches[3] != 0) & (stretches[2] - stretches[1] >= FEWEST_SAMPLES)
    run, first, stop, _ = (one[held] for one in stretches)
    time, position, sigma, own = joined.time, joined.position, joined.noise[run], joined.edges[run]
    begins = first == own
    before = time[first - 1]
    before[begins] = [time[i] - joined.runs[r].sample_period for i, r in zip(first[begins], run[begins])]
    pace = _mean_rates(joined, first, stop)
    rest = _rests(joined, run, first, pace, pieces)
    rate, slow = np.zeros(len(first)), np.zeros(len(first), dtype=bool)
    for i in np.flatnonzero(rest == first):
        one = slice(first[i], stop[i])
        rate[i], doubt = start_motion(time[one], position[one], float(sigma[i]), joined.dof.limits.start)
        slow[i] = abs(rate[i]) <= SLOW * abs(pace[i]) + SURE * doubt
    only = begins | (first - own < SHORT_REST)  # too little before the step to tell: its own start decides
    lasting = zip(rest.tolist(), first.tolist())
    start = np.array([position[a:b].mean() if a < b else np.nan for a, b in lasting])
    from_rest = (rest < first) | (only & slow)
    return Steps(joined, run, first, stop, joined.command[first], before, rest, start, from_rest, rate)


def _mean_rates(joined: Joined, first: Indices, stop: Indices) -> Floats:
    """Mean rate of each stretch [rad/s or m/s], (S,), as far as a step is followed at most."""
    time, position = joined.time, joined.position
    far = np.abs(position - spread(position[first], first, stop, len(position))) > joined.dof.limits.trim
    last = np.where((last := first_where(far, first, stop)) < stop, last, stop - 1)
    taken = np.where(last > first, time[last] - time[first], np.inf)
    return (position[last] - position[first]) / taken


def _rests(joined: Joined, run: Indices, first: Indices, pace: Floats, pieces: Indices) -> Indices:
    """The first samples, (S,), of the longest stretches of zero moment right before samples `first` of runs over which
    the position shows no slope, `first` where there is none. Where a constant force acts, of any one command: that may
    be the one that balances it. `pieces` as of `_stretches`.
    """
    time, position, sigma, own = joined.time, joined.position, joined.noise[run], joined.edges[run]
    rest = first.copy()
    length = first - _idle_since(joined, run, first, pieces)
    left = np.flatnonzero(length >= FEWEST_AT_REST)
    while left.size:
        start = first[left] - length[left]
        rate, error = slopes(time, position, start, first[left])
        doubt, most = SURE * error * sigma[left], SLOW * np.abs(pace[left])
        whole = start == own[left]  # the log begins here: nothing moved the vehicle before
        still = (np.abs(rate) <= doubt + 0.2 * most) & (whole | (doubt <= most))
        rest[left[still]] = start[still]
        length[left] = (0.7 * length[left]).astype(np.int64)
        left = left[~still & (length[left] >= FEWEST_AT_REST)]
    return rest


def _idle_since(joined: Joined, run: Indices, first: Indices, pieces: Indices) -> Indices:
    """From which sample on the command was idle until samples `first` of runs."""
    command, own = joined.command, joined.edges[run]
    least = _least_change(command, joined.edges)[run]
    idle = np.where(first > own, command[first - 1], 0.0) if joined.dof.has_constant else np.zeros(len(first))
    found = first.copy()
    values = command[pieces]
    place = np.searchsorted(pieces, first) - 1
    for i, k in enumerate(place.tolist()):
        while k >= 0 and pieces[k] >= own[i] and not abs(values[k] - idle[i]) > least[i]:
            found[i] = pieces[k]
            k -= 1
    return found


def released(run: Run) -> int:
    """The first sample of a new command where the vehicle stands still from the start of the run until then, else 0."""
    joined = Joined.of([run])
    stretches, pieces = _stretches(joined.command, joined.edges)
    which, first, stop = (one[1:2] for one in stretches[:3])
    rest = _rests(joined, which, first, _mean_rates(joined, first, stop), pieces)
    return int(first[0]) if first.size and rest[0] < first[0] and rest[0] <= 2 else 0


def start_motion(time: Floats, position: Floats, sigma: float, way: float) -> tuple[float, float]:
    """Rate at the first sample [rad/s or m/s] and its standard error, from a parabola through the start of a
    step.

    The start is what moved less than `way` [rad or m] (at least 6 samples, all if fewer). `sigma` [rad or m] is the
    noise.
    """
    count = start_length(position, way)
    coefficients, root = _parabola(time[:count], position[:count])
    if abs(position[count - 1] - position[0]) > 2 * way:  # a slow logger sees more than a parabola
        powers = np.vander(time[:count] - time[0], len(coefficients), increasing=True)
        left = position[:count] - powers @ coefficients
        sigma = max(sigma, float(np.sqrt(left @ left / max(count - 3, 1))))
    return float(coefficients[1]), sigma * float(np.sqrt((root @ root.T)[1, 1]))


def start_length(position: Floats, way: float) -> int:
    """How many samples belong to the start of a step: those before the position has moved by `way` for good."""
    moved = np.abs(position - position[0]) > way
    both = moved[:-1] & moved[1:]  # two in a row: a single sample may be noise
    count = int(np.argmax(both)) if both.any() else len(position)
    return min(max(count, 6), len(position))


def start_position(step: Step) -> float:
    """Position at the step [rad or m]: the mean over the rest before it, else carried back from the start of the
    motion.

    Without rest a parabola through the start of the step is read at the middle of the switch interval (from a
    standstill without slope there). It depends on the first samples of the step only.
    """
    if step.start_position is not None:
        return step.start_position
    position = step.run.position[step.segment]
    count = start_length(position, step.run.dof.limits.start)
    time = step.run.time[step.first : step.first + count] - step.switch_mid
    if step.from_rest:
        design = np.column_stack([np.ones(count), time**2])
        return float(np.linalg.lstsq(design, position[:count], rcond=None)[0][0])
    return float(_parabola(time, position[:count], at=0.0)[0][0])


def _parabola(time: Floats, position: Floats, at: float | None = None) -> tuple[Floats, Floats]:
    """Coefficients of the parabola about `at` (default: the first time), and the matrix that makes them of
    positions.
    """
    shifted = time - (time[0] if at is None else at)
    powers = np.arange(min(3, len(time)))[:, None]
    unit = float(np.abs(shifted).max()) or 1.0
    design = (shifted / unit) ** powers
    inverse = np.linalg.solve(design @ design.T, design) / unit**powers
    return inverse @ position, inverse
