"""Steps: where a run holds one constant moment or force, from when, and whether the vehicle stood still before."""

from dataclasses import dataclass

import numpy as np

from automarine_cli.quantities import Floats
from automarine_cli.runs.noise import slope
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


def find_steps(run: Run) -> tuple[Step, ...]:
    """Stretches of one constant, non-zero moment of at least five samples, in the order of time.

    Raises RunError where the run has no moment.
    """
    return tuple(
        _step(run, first, stop)
        for first, stop, moment in segments(run.command)
        if moment != 0 and stop - first >= FEWEST_SAMPLES
    )


def segments(moment: Floats) -> list[tuple[int, int, float]]:
    """(first, stop, moment) of every stretch of one constant moment, in order; moments of a hair around 0 are
    0.
    """
    if not len(moment):
        return []
    least = SAME_MOMENT * float(np.abs(moment).max())
    edges = [0, *(np.flatnonzero(np.abs(np.diff(moment)) > least) + 1).tolist(), len(moment)]
    values = [float(moment[first]) for first in edges[:-1]]
    return [(a, b, v if abs(v) > least else 0.0) for a, b, v in zip(edges, edges[1:], values)]


def _step(run: Run, first: int, stop: int) -> Step:
    begins, ends = first == 0, stop == len(run)
    before = run.time[0] - run.sample_period if begins else run.time[first - 1]
    sigma = run.noise
    pace = _mean_rate(run, first, stop)
    rest = None if begins else _rest_before(run, first, sigma, pace)
    rate, doubt = start_motion(run.time[first:stop], run.position[first:stop], sigma, run.dof.limits.start)
    slow = abs(rate) <= SLOW * abs(pace) + SURE * doubt
    only = begins or first < SHORT_REST  # too little before the step to tell: its own start decides
    force = run.dof.words.force
    note = f"the log begins with the {force} already on: its switch is taken within the sample period before"
    return Step(
        run=run,
        first=first,
        stop=stop,
        moment=float(run.command[first]),
        switch_from=float(before),
        switch_to=float(run.time[first]),
        start_position=None if rest is None else float(run.position[rest].mean()),
        rest=rest,
        from_rest=rest is not None or (only and slow),
        start_rate=0.0 if rest is not None else rate,
        begins_log=begins,
        ends_log=ends,
        notes=(note,) if begins else (),
    )


def _mean_rate(run: Run, first: int, stop: int) -> float:
    """Mean rate of the step [rad/s or m/s], as far as it is followed at most."""
    turned = run.position[first:stop] - run.position[first]
    last = int(np.argmax(np.abs(turned) > run.dof.limits.trim)) or stop - first - 1
    return float(turned[last] / (run.time[first + last] - run.time[first])) if last else 0.0


def _rest_before(run: Run, first: int, sigma: float, pace: float) -> slice | None:
    """The longest stretch of zero moment right before the step over which the position shows no slope.

    Where a constant force acts, of any one command: that may be the one that balances it.
    """
    least = SAME_MOMENT * float(np.abs(run.command).max())
    idle = run.command[first - 1] if run.dof.has_constant else 0.0
    acting = np.flatnonzero(np.abs(run.command[:first] - idle) > least)
    start = int(acting[-1]) + 1 if acting.size else 0
    length = first - start
    while length >= FEWEST_AT_REST:
        stretch = slice(first - length, first)
        rate, error = slope(run.time[stretch], run.position[stretch])
        doubt = SURE * error * sigma
        whole = length == first and start == 0  # the log begins here: nothing moved the vehicle before
        if abs(rate) <= doubt + 0.2 * SLOW * abs(pace) and (whole or doubt <= SLOW * abs(pace)):
            return stretch
        length = int(0.7 * length)
    return None


def released(run: Run) -> int:
    """The first sample of a new command where the vehicle stands still from the start of the run until then, else 0."""
    changes = segments(run.command)[1:2]
    if not changes:
        return 0
    first, stop, _ = changes[0]
    rest = _rest_before(run, first, run.noise, _mean_rate(run, first, stop)) if first else None
    return first if rest is not None and rest.start <= 2 else 0


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
