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
    def switch_mid(self) -> float:
        """Middle of the interval in which the command switched [s]."""
        return (self.switch_from + self.switch_to) / 2


ALREADY_ON = "the log begins with the {force} already on: its switch is taken within the sample period before"


def find_steps(run: Run) -> tuple[Step, ...]:
    """Find the stretches of one constant, non-zero moment of at least five samples, in the order of time. Raises
    RunError where the run has no moment."""
    held = ((a, b, moment) for a, b, moment in segments(run.command) if moment != 0 and b - a >= FEWEST_SAMPLES)
    return tuple(_step(run, first, stop, moment, _least_change(run.command)) for first, stop, moment in held)


def segments(moment: Floats) -> list[tuple[int, int, float]]:
    """Return (first, stop, moment) of every stretch of one constant moment, in order; a hair around 0 is 0."""
    if not len(moment):
        return []
    least = _least_change(moment)
    first = np.concatenate([[0], np.flatnonzero(np.abs(np.diff(moment)) > least) + 1])
    value = np.where(np.abs(moment[first]) > least, moment[first], 0.0)
    return list(zip(first.tolist(), [*first[1:].tolist(), len(moment)], value.tolist()))


def _least_change(moment: Floats) -> float:
    return SAME_MOMENT * float(np.abs(moment).max(initial=0.0))


def _step(run: Run, first: int, stop: int, moment: float, least: float) -> Step:
    rest, pace = _rest(run, first, stop, least)
    rate = 0.0
    from_rest = rest < first
    if not from_rest:
        limit = run.dof.limits.start
        rate, doubt = start_motion(run.time[first:stop], run.position[first:stop], run.noise, limit)
        # too little before the step to tell: its own start decides
        from_rest = first < SHORT_REST and abs(rate) <= SLOW * abs(pace) + SURE * doubt
    before = run.time[first - 1] if first else run.time[0] - run.sample_period
    return Step(
        run=run,
        first=first,
        stop=stop,
        moment=moment,
        switch_from=float(before),
        switch_to=float(run.time[first]),
        start_position=float(run.position[rest:first].mean()) if rest < first else None,
        rest=slice(rest, first) if rest < first else None,
        from_rest=from_rest,
        start_rate=rate,
        begins_log=first == 0,
        ends_log=stop == len(run),
        notes=() if first else (run.dof.fill(ALREADY_ON),),
    )


def _rest(run: Run, first: int, stop: int, least: float) -> tuple[int, float]:
    """The first sample of the longest stretch of zero moment right before the samples `first` to `stop` - 1 over which
    the position shows no slope, `first` where there is none; and the mean rate of these samples [rad/s or m/s].

    Where a constant force acts, the stretch is one of any one command: that may be the one that balances it.
    """
    far = np.abs(run.position[first:stop] - run.position[first]) > run.dof.limits.trim
    last = first + int(np.argmax(far)) if far.any() else stop - 1  # as far as a step is followed at most
    pace = 0.0
    if last > first:
        pace = float((run.position[last] - run.position[first]) / (run.time[last] - run.time[first]))
    length, most = first - _idle_since(run, first, least), SLOW * abs(pace)
    while length >= FEWEST_AT_REST:
        start = first - length
        rate, error = slope(run.time[start:first], run.position[start:first])
        doubt = SURE * error * run.noise
        # where the log begins, nothing moved the vehicle before
        if abs(rate) <= doubt + 0.2 * most and (start == 0 or doubt <= most):
            return start, pace
        length = int(0.7 * length)
    return first, pace


def _idle_since(run: Run, first: int, least: float) -> int:
    command = run.command
    idle = command[first - 1] if run.dof.has_constant and first else 0.0
    acting = np.flatnonzero(np.abs(command[:first] - idle) > least)
    return int(acting[-1]) + 1 if acting.size else 0


def released(run: Run) -> int:
    """Find the first sample of a new command before which the vehicle stands still from the start of the run on; else
    return 0."""
    stretches = segments(run.command)
    if len(stretches) < 2:
        return 0
    first, stop, _ = stretches[1]
    rest, _ = _rest(run, first, stop, _least_change(run.command))
    return first if rest < first and rest <= 2 else 0


def start_motion(time: Floats, position: Floats, sigma: float, way: float) -> tuple[float, float]:
    """Rate at the first sample [rad/s or m/s] and its standard error, from a parabola through the start of a step: what
    moved less than `way` [rad or m], at least 6 samples. `sigma` [rad or m] is the noise."""
    count = start_length(position, way)
    since, position = time[:count] - time[0], position[:count]
    coefficients, covariance = np.polyfit(since, position, min(2, count - 1), cov="unscaled")
    if abs(position[-1] - position[0]) > 2 * way:  # a slow logger sees more than a parabola
        residual = position - np.polyval(coefficients, since)
        sigma = max(sigma, float(np.sqrt(residual @ residual / max(count - 3, 1))))
    return float(coefficients[-2]), sigma * float(np.sqrt(covariance[-2, -2]))


def start_length(position: Floats, way: float) -> int:
    """How many samples belong to the start of a step: those before the position has moved by `way` for good."""
    moved = np.abs(position - position[0]) > way
    both = moved[:-1] & moved[1:]  # two in a row: a single sample may be noise
    count = int(np.argmax(both)) if both.any() else len(position)
    return min(max(count, 6), len(position))


def start_position(step: Step) -> float:
    """Position at the step [rad or m]: the mean over the rest before it, else a parabola through the start of the step,
    read at the middle of the switch interval (from a standstill without slope there)."""
    if step.start_position is not None:
        return step.start_position
    position = step.run.position[step.first : step.stop]
    count = start_length(position, step.run.dof.limits.start)
    time = step.run.time[step.first : step.first + count] - step.switch_mid
    if step.from_rest:
        design = np.column_stack([np.ones(count), time**2])
        return float(np.linalg.lstsq(design, position[:count], rcond=None)[0][0])
    return float(np.polyfit(time, position[:count], min(2, count - 1))[-1])
