"""The kinds of runs that a specification may ask for; a new kind is one class here.

A group makes cases: a label, and the commands as (moment or force, seconds) one after the other, in the plane
((X, Y, N), seconds). The rest before and after belongs to the campaign's schedule.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from string import ascii_lowercase
from typing import Any, ClassVar, Literal, TypeAlias

import numpy as np

from automarine_cli.dofs import Dof
from automarine_cli.dofs.motion import PLANAR
from automarine_cli.errors import SettingError
from automarine_cli.models.closed_form import response
from automarine_cli.models.yaw_model import CONSTANT, YawModel
from automarine_cli.pipeline.records import FILLER, Codec, Place, key_of, keyed
from automarine_cli.simulation.checks import at_least_zero, positive, safe_path
from automarine_cli.simulation.streams import uniform

Format: TypeAlias = Literal["csv", "csv.gz", "parquet"]
Fault: TypeAlias = Literal["never-moves", "stuck-compass", "ends-early"]
Commands: TypeAlias = tuple[tuple[float, float], ...]

Run: TypeAlias = tuple[str, str, tuple[tuple[Any, float], ...]]
"""Its name, the key of its random streams, and what is commanded."""
MOST_LEVELS = 100_000
ABOVE_ZERO = ("repeats", "way", "duration_s", "coast_s", "back_s", "steps")
LABELS = {"step": "{f}", "coast-down": "coast"}  # what labels begin with where it is not the kind


@dataclass(frozen=True)
class Range:
    """Values from one to the other in equal steps, both ends included, without zero."""

    from_: float
    to: float
    step: float

    def __post_init__(self) -> None:
        positive(self, "step")
        if self.to < self.from_:
            raise SettingError(f"to is {self.to:g}; expected at least from, {self.from_:g}")
        if (self.to - self.from_) / self.step > MOST_LEVELS:
            raise SettingError(f"step is {self.step:g}; that makes more than {MOST_LEVELS} values; give a larger step")

    @property
    def values(self) -> tuple[float, ...]:
        count = int((self.to - self.from_) / self.step + 1e-9) + 1
        every = (round(self.from_ + i * self.step, 10) for i in range(count))  # three steps of 0.1 are 0.3
        return tuple(value for value in every if value != 0)


Levels: TypeAlias = tuple[float, ...] | Range


def levels_of(levels: Levels) -> tuple[float, ...]:
    """List the values of a list or range. Raises SettingError if there are none."""
    values = levels.values if isinstance(levels, Range) else levels
    if not values:
        raise SettingError("no values are left in the list or range of levels; expected at least one")
    return values


@dataclass(frozen=True, kw_only=True)
class RunGroup:
    """What all kinds share: where the logs go and what is wrong with them on purpose.

    Files are `folder/LABEL.format` with a letter for the repeat (or `suffix`); with `together` all runs of the
    group go into the one file of that name, distinguished by a column `run`. `wait_after_s` takes the place of the
    campaign's wait after each of these runs.
    """

    kind: str
    name: str = ""
    folder: str = "runs"
    format: Format = "csv"
    together: str | None = None
    repeats: int = 1
    suffix: str | None = None
    fault: Fault | None = None
    wait_after_s: float | None = None
    dof: Dof = field(kw_only=True, repr=False, metadata=FILLER)

    def __post_init__(self) -> None:
        positive(self, *(name for name in ABOVE_ZERO if name in self.__dataclass_fields__))
        at_least_zero(self, "wait_after_s")
        safe_path(self, "folder", "together", "suffix")
        if self.name:
            safe_path(self, "name")
        if self.suffix is not None and self.repeats > 1:
            raise SettingError("suffix names a single run; expected repeats = 1 with it")

    def runs(self, model: YawModel, seed: int) -> Iterator[Run]:
        for label, commands in self.cases(model):
            for repeat in range(self.repeats):
                key = f"{self.folder}/{label}#{self.suffix or repeat}"
                yield named(label, repeat, self.repeats, self.suffix), key, commands

    @property
    def base(self) -> str:
        return self.name or self.dof.fill(LABELS.get(self.kind, self.kind))

    def cases(self, model: YawModel) -> Iterator[tuple[str, Commands]]:
        """Yield label and commands of each run of the group, repeats left out."""
        raise NotImplementedError


def named(label: str, repeat: int, repeats: int, suffix: str | None = None) -> str:
    """Return the name of a run: its label, and a letter (or number) where there are several."""
    letter = ascii_lowercase[repeat] if repeats <= len(ascii_lowercase) else str(repeat + 1)
    return f"{label}_{suffix or (letter if repeats > 1 else '')}".rstrip("_")


@dataclass(frozen=True, kw_only=True)
class StepRuns(RunGroup):
    """One constant moment or force, each of `levels`, held until the base vehicle has gone its `way` [unit of logs], or
    for `duration_s`. In a file of yaw they are `moments` and `turn_deg`, of a translation `forces` and `travel_m`.
    """

    kind: Literal["step"] = "step"
    levels: Levels = field(metadata=keyed("{forces}"))
    way: float | None = field(default=None, metadata=keyed("{way_key}_{log_unit}"))
    duration_s: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.way is None) == (self.duration_s is None):
            raise SettingError(f"expected one of {key_of(self, 'way')} and duration_s")
        if 0.0 in levels_of(self.levels):
            name = key_of(self, "levels")
            raise SettingError(f'{name} has a zero; expected other values (a run of kind "rest" has none)')

    def cases(self, model: YawModel) -> Iterator[tuple[str, Commands]]:
        for moment in levels_of(self.levels):
            way = self.dof.inner(self.way or 0.0)
            hold = time_to_turn(way, moment, model) if self.duration_s is None else self.duration_s
            yield f"{self.base}_{moment_text(moment)}", self.commands(moment, hold)

    def commands(self, moment: float, hold: float) -> Commands:
        """Return what is commanded when `moment` is first held for `hold` [s]."""
        return ((moment, hold),)


@dataclass(frozen=True, kw_only=True)
class CoastDownRuns(StepRuns):
    """A step, then no command for `coast_s`."""

    kind: Literal["coast-down"] = "coast-down"  # type: ignore[assignment]
    coast_s: float

    def commands(self, moment: float, hold: float) -> Commands:
        return ((moment, hold), (0.0, self.coast_s))


@dataclass(frozen=True, kw_only=True)
class ReversalRuns(StepRuns):
    """A step, then the opposite command for `back_s`, by default for twice as long as the step."""

    kind: Literal["reversal"] = "reversal"  # type: ignore[assignment]
    back_s: float | None = None

    def commands(self, moment: float, hold: float) -> Commands:
        return ((moment, hold), (-moment, 2.0 * hold if self.back_s is None else self.back_s))


@dataclass(frozen=True, kw_only=True)
class SequenceRuns(RunGroup):
    """Any `commands`, each [moment or force, seconds], like the source paper's figure 10."""

    kind: Literal["sequence"] = "sequence"
    commands: tuple[tuple[float, float], ...]

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.commands or min(seconds for _, seconds in self.commands) <= 0:
            raise SettingError(
                f"commands: expected at least one [{self.dof.words.force}, seconds], each longer than 0 s"
            )

    def cases(self, model: YawModel) -> Iterator[tuple[str, Commands]]:
        joined: list[tuple[float, float]] = []
        for moment, seconds in self.commands:
            if joined and joined[-1][0] == moment:
                joined[-1] = (moment, joined[-1][1] + seconds)
            else:
                joined.append((moment, seconds))
        yield self.base, tuple(joined)


@dataclass(frozen=True, kw_only=True)
class RampRuns(RunGroup):
    """The command goes from `from_` to `to` in `steps` equal stairs over `duration_s`."""

    kind: Literal["ramp"] = "ramp"
    to: float
    duration_s: float
    from_: float = 0.0
    steps: int = 20

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.to == self.from_:
            raise SettingError(f"to is {self.to:g}, the same as from; expected another {self.dof.words.force}")

    def cases(self, model: YawModel) -> Iterator[tuple[str, Commands]]:
        stairs = [self.from_ + (self.to - self.from_) * (i + 1) / self.steps for i in range(self.steps)]
        commands = tuple((round(moment, 6), self.duration_s / self.steps) for moment in stairs)
        if any(before == after for (before, _), (after, _) in pairwise(commands)):
            raise SettingError(f"steps is {self.steps}; expected fewer, the stairs are below 1e-6")
        yield f"{self.base}_{moment_text(self.to)}", commands


@dataclass(frozen=True, kw_only=True)
class RestRuns(RunGroup):
    kind: Literal["rest"] = "rest"
    duration_s: float

    def cases(self, model: YawModel) -> Iterator[tuple[str, Commands]]:
        yield self.base, ((0.0, self.duration_s),)


@dataclass(frozen=True, kw_only=True)
class PlanarRuns:
    """Runs of one kind in the plane: `commands` one after the other as [X N, Y N, N N m, seconds]; or drawn anew for
    each of the `repeats`, between minus and plus the `largest` of each, held for `hold_s` [least, most], over
    `duration_s`."""

    name: str
    folder: str = "runs"
    format: Format = "csv"
    repeats: int = 1
    commands: tuple[tuple[float, float, float, float], ...] = ()
    largest: tuple[float, float, float] | None = None
    hold_s: tuple[float, float] = (2.0, 5.0)
    duration_s: float = 40.0
    kind: ClassVar[str] = PLANAR.name
    together: ClassVar[None] = None
    fault: ClassVar[None] = None
    wait_after_s: ClassVar[None] = None

    def __post_init__(self) -> None:
        safe_path(self, "name", "folder")
        positive(self, "repeats", "duration_s")
        if bool(self.commands) == (self.largest is not None):
            raise SettingError("expected one of commands = [[X, Y, N, seconds], ...] and largest = [X, Y, N]")
        if any(seconds <= 0 for *_, seconds in self.commands):
            raise SettingError("commands: expected each longer than 0 s")
        if not 0 < self.hold_s[0] <= self.hold_s[1]:
            raise SettingError("hold_s: expected [least, most], both above 0")

    @property
    def length(self) -> float:
        """Time [s] for which anything is commanded."""
        return sum(seconds for *_, seconds in self.commands) if self.commands else self.duration_s

    @property
    def shortest(self) -> float:
        return min((seconds for *_, seconds in self.commands), default=min(self.hold_s[0], self.duration_s))

    def runs(self, model: object, seed: int) -> Iterator[Run]:
        for repeat in range(self.repeats):
            name = named(self.name, repeat, self.repeats)
            key = f"{self.folder}/{name}"
            drawn = self._drawn(seed, key) if self.largest else [(row[:3], row[3]) for row in self.commands]
            yield name, key, tuple(drawn)

    def _drawn(self, seed: int, key: str) -> list[tuple[tuple[float, ...], float]]:
        least, most = self.hold_s
        holds: list[float] = []
        for share in uniform(int(self.duration_s / least) + 1, seed, key, "hold"):
            left = self.duration_s - sum(holds)
            if left < least:
                break
            hold = least + (most - least) * float(share)
            holds.append(left if left - hold < least else hold)
        draw = np.stack([uniform(len(holds), seed, key, "command", dof.name) for dof in PLANAR.dofs], axis=1)
        commands = np.round((2.0 * draw - 1.0) * np.array(self.largest), 3) + 0.0
        return [(tuple(row), hold) for row, hold in zip(commands.tolist(), holds)]


_CLASSES = (StepRuns, CoastDownRuns, ReversalRuns, SequenceRuns, RampRuns, RestRuns)
KINDS: Mapping[str, type[RunGroup]] = {str(vars(group)["kind"]): group for group in _CLASSES}


def group_from(table: object, codec: Codec, place: Place) -> RunGroup:
    """Read the group in one [[runs]] table. Raises SettingError with the key's path."""
    kind = table.get("kind") if isinstance(table, Mapping) else None
    if not isinstance(kind, str) or kind not in KINDS:
        raise codec.refusal(place, f"kind is {kind!r}; expected one of {', '.join(KINDS)}")
    return codec.read(KINDS[kind], table, place)


def moment_text(moment: float) -> str:
    """Write a moment or force for a file name: signed, with a decimal point."""
    text = f"{moment:+.10g}"
    return text if set(text) & {".", "e"} else f"{text}.0"


def time_to_turn(angle: float, moment: float, model: YawModel) -> float:
    """Return the time [s] in which the vehicle goes `angle` [rad or m] from rest under a constant moment or force."""
    net = abs(moment + sum(term.values[0] for term in model.terms if term.name == CONSTANT))
    if net == 0:
        force = model.dof.words.force
        raise SettingError(f"{force}s holds {moment:g}, which the constant force balances; expected others")
    drag = model.drag()

    def turned(time: float) -> float:
        return float(response(time, net, model.inertia, *drag)[0])

    high = 1.0
    while turned(high) < angle:
        high *= 2.0
    low = 0.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if turned(middle) < angle else (low, middle)
    return high
