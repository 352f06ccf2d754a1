"""`Run`: one log of one test, cleaned and frozen; its noise, and whether its commands fit the map of the thrusters."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from automarine_cli.dofs import Dof
from automarine_cli.errors import ExcludedRun, RunError
from automarine_cli.logs.columns import PULSES, SIGNALS, THRUSTERS, names_of
from automarine_cli.logs.find import stem_of
from automarine_cli.pipeline.records import to_mapping
from automarine_cli.quantities import CLOCK, SINCE, Floats

NORMAL = 1.4826  # median absolute value of a normal variable -> its standard deviation
SAME_POSITION = 1e-9  # rad or m; positions closer than this are one
REPEATS_SHARE = 0.2  # of exact repeats, from which on a sensor is slower than the log: its repeats are no readings
QUANTISED_RATIO = 3.0  # smallest steps of a quantised sensor in its usual steps, from which on repeats are held values


def position_noise(time: Floats, position: Floats) -> float:
    """Estimate the standard deviation [rad or m] of the white noise on a position of shape (N,); 0 if N < 7.

    Each sample is compared with the cubic through two neighbours on either side, which removes smooth motion and clock
    jitter; the median makes glitches harmless. A quantised position has at least its quantum / sqrt(12)."""
    if len(time) < 7:
        return 0.0
    last = len(time) - 2
    off = [time[2 + k : last + k] - time[2:last] for k in (-2, -1, 1, 2)]  # from the sample to its four neighbours
    residual, square = position[2:last].copy(), np.ones(len(time) - 4)
    for k, at in zip((-2, -1, 1, 2), off):  # Lagrange's weights
        weight = np.prod([other / (other - at) for other in off if other is not at], axis=0)
        residual -= weight * position[2 + k : last + k]
        square += weight**2
    sigma = NORMAL * median(np.abs(residual) / np.sqrt(square))
    moved = np.abs(np.diff(position))
    same = moved < SAME_POSITION
    if np.count_nonzero(same) >= len(same) / 3 and not same.all():
        sigma = max(sigma, float(moved[~same].min()) / np.sqrt(12))
    return sigma


def median(values: Floats) -> float:
    """Return the median of numbers (N,), several times as fast as numpy's where there are few."""
    high = len(values) // 2
    low = high - 1 + len(values) % 2
    middle = np.partition(values, (low, high))
    return float(0.5 * (middle[low] + middle[high]))


def slope(time: Floats, position: Floats) -> tuple[float, float]:
    """Fit a slope [rad/s or m/s]; its standard error is for a noise of 1 rad or m. (0, inf) for one sample."""
    centred = time - time.mean()
    square = float(centred @ centred)
    return (float(centred @ (position - position.mean())) / square, square**-0.5) if square else (0.0, math.inf)


def summed(time: Floats, velocity: Floats) -> Floats:
    """Positions (N,) from zero on, by the trapezium over the samples."""
    return np.concatenate([[0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * np.diff(time))])


def filled(time: Floats, readings: Floats) -> Floats:
    """Readings (N,) with straight lines over their gaps; zero where there are none."""
    finite = np.isfinite(readings)
    return np.interp(time, time[finite], readings[finite]) if finite.any() else 0.0 * time


def fresh_readings(read: Floats) -> NDArray[np.bool_]:
    """Tell which samples (N,) are readings, and do not hold the one before of a sensor slower than the log.

    A quantised sensor repeats itself honestly; its steps are then mostly of one quantum."""
    fresh = np.isfinite(read)
    at = np.flatnonzero(fresh)
    moved = np.abs(np.diff(read[at]))
    same = moved < SAME_POSITION
    if len(at) < 3 or same.mean() < REPEATS_SHARE or same.all():
        return fresh
    if median(moved[~same]) >= QUANTISED_RATIO * moved[~same].min():
        fresh[at[1:][same]] = False
    return fresh


def with_later_commands(run: "Run") -> "Run":
    """Return the run with every command a sample later."""

    def later(values: Floats) -> Floats:
        return np.concatenate([values[:1], values[:-1]])

    commanded = {*THRUSTERS, *(name for name, signal in SIGNALS.items() if signal.commanded)}
    extras = {name: later(values) if name in commanded else values for name, values in run.extras.items()}
    return replace(run, moment=None if run.moment is None else later(run.moment), extras=extras)


MAX_EXTRAPOLATION, IMPOSSIBLE_EXTRAPOLATION = 1.05, 3.0  # times the range of the map: a guess; of another map
SMALL_COMMANDS, IMPOSSIBLE_COMMANDS, HALF_RANGE = 0.1, 0.02, 0.5
"""The same towards zero, shares of the range; below half of it the largest command must not be exactly 1 or 100."""
FULL_SCALES = {1.0: "normalised (-1 to 1)", 100.0: "like percent"}  # by the largest value that comes near these


@dataclass(frozen=True)
class CommandRange:
    """Thruster commands of one run or several: lowest, highest and usual value, and the range and unit of the map's."""

    low: float
    high: float
    usual: float
    names: tuple[str, ...]
    of_map: tuple[float, float]
    unit: str

    @classmethod
    def of(
        cls, commands: Sequence[Floats], names: Sequence[str], of_map: tuple[float, float], unit: str
    ) -> "CommandRange":
        """The range of commands (N,) of several thrusters."""
        every = np.concatenate(commands)
        return cls(float(every.min()), float(every.max()), median(every), tuple(names), of_map, unit)


@dataclass(frozen=True)
class Misfit:
    """Why commands do not fit a map, and what would mend it; `impossible` where they cannot be of this map at all."""

    sentence: str
    impossible: bool


def misfit_of(ranges: Sequence[CommandRange]) -> Misfit | None:
    """What is wrong with the commands of a campaign, by the ranges of its runs; None where they fit."""
    if not ranges:
        return None
    low, high = min(part.low for part in ranges), max(part.high for part in ranges)
    (least, largest), unit, names = ranges[0].of_map, ranges[0].unit, ranges[0].names
    size, most = max(abs(low), abs(high)), max(abs(least), abs(largest))
    if size == 0 or most == 0:
        return None
    ratio, usual = size / most, median(np.array([part.usual for part in ranges]))
    share = next((word for full, word in FULL_SCALES.items() if 0.2 * full < size <= 1.01 * full), "")
    scale = f"{most if size <= 1.01 else most / 100:.4g}" if size <= 101 else "FACTOR"

    def misfit(why: str, key: str, value: str, impossible: bool) -> Misfit:
        return Misfit(
            f"the thruster commands {' and '.join(names)} go from {low:.4g} to {high:.4g}, those of the thruster map "
            f"from {least:.4g} to {largest:.4g}{f' {unit}' if unit else ''}: {why}; write {names[0]} = {{ from = "
            f'"NAME", {key} = {value} }} under [columns] to mend that, or give the map of this signal',
            impossible,
        )

    if PULSES[0] <= low and high <= PULSES[2] and most < PULSES[0]:
        return misfit("pulses of which the neutral was not subtracted", "subtract", "1500", True)
    if low >= 0 > least and low < usual < high and abs(usual - (low + high) / 2) <= 0.05 * (high - low):
        why = f"they are never negative and mostly {usual:.4g}, half the range, a neutral that was not subtracted"
        return misfit(why, "subtract", f"{usual:.4g}", False)
    looks = f"they look {share or 'like another unit'}"
    if ratio > IMPOSSIBLE_EXTRAPOLATION:
        return misfit(f"{looks}, not the signal of this map", "scale", scale, True)
    if ratio > MAX_EXTRAPOLATION:
        return misfit("beyond its ends the thrust is a guess", "scale", "FACTOR", False)
    full = any(abs(size - share) <= 0.01 * share for share in FULL_SCALES)
    if ratio <= SMALL_COMMANDS or (ratio <= HALF_RANGE and full):
        return misfit(f"{looks}, or the vehicle was hardly driven", "scale", scale, ratio <= IMPOSSIBLE_COMMANDS)
    return None


def usual_neutral(low: float, high: float, idle: float) -> float:
    """The neutral of a signal that goes from `low` to `high` and gives nothing at `idle`: 1500 where it is pulses."""
    pulses = PULSES[0] <= low and high <= PULSES[2] and abs(idle - PULSES[1]) <= 100.0
    return PULSES[1] if pulses else idle


def undirected(n: Floats, force: Floats) -> str:
    """What is wrong with the control signal of a thruster test, arrays (N,); "" where it can be right."""
    low, high = float(n.min()), float(n.max())
    if PULSES[0] <= low and PULSES[1] <= high <= PULSES[2] and low > 0.4 * high:
        return (
            f"the control signal goes from {low:.4g} to {high:.4g}, as pulses about 1500 do; if it is that, write n = "
            '{ from = "NAME", subtract = 1500 } under [columns]'
        )
    if low >= 0 and force.min() < -0.1 * force.max() < 0:
        return (
            'the control signal is never negative while the force goes both ways; write n = { from = "NAME", sign_from '
            '= "COLUMN" } with a column that says the direction, or subtract its neutral, under [columns]'
        )
    return ""


LOGGED_COMMAND = "asked"  # Extra of a run driven by its thrusters: the moment or force logged beside them

NOISE_SAMPLES = 1000  # Samples, the first of a run, that show its noise to four percent


@dataclass(frozen=True)
class Run:
    """One test of one vehicle, checked once: arrays of shape (N,), SI units.

    `time` [s] rises strictly on the campaign's clock; `position` of the motion `dof` [rad or m] is unwrapped; `moment`
    [`moment_unit`] is the command, held until the next sample (None: the log has thruster commands instead); `extras`
    are all other numeric columns. `counts` say what cleaning did, `notes` what a person should know, of which `reading`
    tell how the log was read. Where `summed_up` the position is the sum of the velocity, and no evidence. `commanded`
    is the range of the thruster commands of which a map made the moment."""

    name: str
    source: str
    time: Floats
    position: Floats
    moment: Floats | None
    moment_unit: str
    extras: Mapping[str, Floats] = field(default_factory=dict)
    counts: Mapping[str, int] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    reading: tuple[str, ...] = ()
    summed_up: bool = False
    commanded: CommandRange | None = None
    dof: Dof = field(kw_only=True)

    def __len__(self) -> int:
        return len(self.time)

    @property
    def command(self) -> Floats:
        """Commanded moment or force [`moment_unit`], shape (N,). Raises RunError where the log has none."""
        return self.command_of(self.dof)

    @property
    def acting(self) -> NDArray[np.bool_]:
        """Where a command drives the run, or a rudder beside it, (N,)."""
        rudder = self.extras.get("rudder") if self.dof.wraps else None
        return (self.command != 0) | (False if rudder is None else np.nan_to_num(rudder) != 0)

    def command_of(self, dof: Dof) -> Floats:
        """Commanded moment or force of any degree of freedom, (N,). Raises RunError where the log has none."""
        command = self.moment if dof is self.dof else self.extras.get(dof.command)
        if command is None:
            remedy = f"name the {dof.words.force}'s column with --columns"
            if dof.thrusters:
                options = "--thrusters MAP.json and --arm METRES" if dof.levered else "--thrusters MAP.json"
                campaign = f'(in a campaign {dof.command} = "thrusters")'
                remedy = f"give {options} {campaign} for {' and '.join(dof.thrusters)}, or {remedy}"
            what = f"no {dof.words.full_force} ({', '.join(names_of(dof.command))}) in the log"
            raise RunError(f"{self.source}, run {self.name!r}: {what}; {remedy}")
        return command

    def channel(self, quantity: str) -> Floats | None:
        """What a sensor logged, (N,) [base units], NaN where it has no reading; None where there is no such sensor."""
        return self.position if quantity == self.dof.position else self.extras.get(quantity)

    def signal(self, name: str) -> Floats | None:
        """Return a column (N,), the campaign's clock, or the time since the command last changed [s]; or None."""
        if name == CLOCK:
            return self.time
        return self.since_change if name == SINCE else self.extras.get(name)

    @cached_property
    def since_change(self) -> Floats:
        """Time since the command last changed, or since the first sample [s], (N,)."""
        changed = np.append(True, np.diff(self.command) != 0)
        return self.time - self.time[np.maximum.accumulate(np.where(changed, np.arange(len(self)), 0))]

    @cached_property
    def sample_period(self) -> float:
        """Median time between samples [s]."""
        return median(np.diff(self.time))

    @cached_property
    def noise(self) -> float:
        """Estimate the white noise on the position [rad or m] at the start of the run, see `position_noise`."""
        return position_noise(self.time[:NOISE_SAMPLES], self.position[:NOISE_SAMPLES])

    def noted(self, *notes: str) -> "Run":
        """The run with notes that tell how its log was read."""
        return replace(self, notes=(*self.notes, *notes), reading=(*self.reading, *notes))

    def as_commanded(self) -> "Run":
        """The run with what is logged of its commands for a moment: thruster commands added up if there is no other."""
        if self.moment is not None:
            return self
        signs = [" - " if side < 0 else " + " for side in self.dof.sides]
        names = "".join(sign + name for sign, name in zip(signs, self.dof.thrusters)).removeprefix(" + ")
        total = sum(side * self.extras[name] for side, name in zip(self.dof.sides, self.dof.thrusters))
        return self.with_moment(np.asarray(total), names)

    def with_moment(
        self, moment: Floats, unit: str, parts: Mapping[str, Floats] | None = None,
        commanded: CommandRange | None = None,
    ) -> "Run":  # fmt: skip
        """Return the run driven by another moment, of which `parts` are those of single thrusters
        (`effects.thruster_imbalance.PARTS`); a logged one of that unit stays as LOGGED_COMMAND."""
        beside = parts is not None and self.moment is not None and unit == self.moment_unit
        logged = {LOGGED_COMMAND: self.command} if beside else {}
        return replace(self, moment=moment, moment_unit=unit, extras={**self.extras, **logged, **(parts or {})},
                       commanded=commanded)  # fmt: skip

    def cut(self, start: int, stop: int) -> "Run":
        """Samples start:stop of this run."""
        part = slice(start, stop)
        moment = None if self.moment is None else self.moment[part]
        extras = {name: column[part] for name, column in self.extras.items()}
        return replace(self, time=self.time[part], position=self.position[part], moment=moment, extras=extras)


def command_warnings(runs: Iterable[Run]) -> tuple[str, ...]:
    """How the thruster commands of a campaign do not fit their map. Raises RunError where they cannot be its at all."""
    misfit = misfit_of([run.commanded for run in runs if run.commanded is not None])
    if misfit is None:
        return ()
    if misfit.impossible:
        raise RunError(misfit.sentence)
    return (f"{misfit.sentence[0].upper()}{misfit.sentence[1:]}.",)


def runs_json(used: int, set_aside: Iterable[ExcludedRun], runs: Sequence[Run] = ()) -> dict[str, object]:
    """The `runs` of a result file; of `runs` come notes of the reading and of the thrusters' map."""
    by_file = {run.source: list(run.reading) for run in runs if run.reading}
    readings = [{"file": file, "notes": texts} for file, texts in by_file.items()]
    notes = {"readings": readings, "commands": list(command_warnings(runs))}
    aside = [to_mapping(run) for run in set_aside]
    return {"used": used, "set_aside": aside} | {key: texts for key, texts in notes.items() if texts}


def shared_readings(runs: Iterable[Run]) -> tuple[str, ...]:
    """What the reading of the logs tells of more than half of them, once each."""
    by_file = {run.source: dict.fromkeys(run.reading) for run in runs}
    times = Counter(note for notes in by_file.values() for note in notes)
    return tuple(note for note, count in times.items() if 2 * count > len(by_file))


NAMED_APART = "another run of this campaign has the same name; the file's name was put in front"


def own_name(source: str) -> str:
    """The name of a run that is alone in its file."""
    return stem_of(source.rsplit("/", 1)[-1])


def named_apart(runs: Sequence[Run]) -> list[Run]:
    names = make_unique([(run.name, run.source) for run in runs])
    return [
        run if run.name == name else replace(run, name=name, notes=(*run.notes, NAMED_APART))
        for run, name in zip(runs, names)
    ]


def make_unique(runs: Sequence[tuple[str, str]]) -> list[str]:
    """Name runs (name, file): those of one name get their file's name in front."""
    names = [name for name, _ in runs]
    for prefix in (stem_of, str):
        times = Counter(names)
        for i, (name, (original, source)) in enumerate(zip(names.copy(), runs)):
            if times[name] > 1:
                front = prefix(source)
                names[i] = front if original == own_name(source) else f"{front}:{original}"
    return names
