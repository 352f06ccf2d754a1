"""`Run`: one log of one test, cleaned and frozen; and what becomes of an unusable run."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from automarine_cli.dofs import Dof
from automarine_cli.errors import RunError
from automarine_cli.logs.canonical import names_of
from automarine_cli.logs.find import stem_of
from automarine_cli.pipeline.records import to_mapping
from automarine_cli.pipeline.result_files import SetAside
from automarine_cli.quantities import CLOCK, SINCE, Floats
from automarine_cli.runs.command_range import CommandRange, warnings_of
from automarine_cli.runs.noise import median, position_noise

ASKED = "asked"  # Extra of a run that is driven by its thrusters: the moment or force that was logged beside them

NOISE_FROM = 1000  # Samples, the first of a run, that show its noise to four percent


@dataclass(frozen=True)
class Run:
    """One test of one vehicle, checked once: arrays of shape (N,), SI units.

    `time` [s] rises strictly on the campaign's clock; `position` of the motion `dof` [rad or m] is unwrapped; `moment`
    [`moment_unit`] is the commanded moment or force, held until the next sample, or None where the log has thruster
    commands instead.
    `extras` holds every other numeric column (`yaw_rate` [rad/s], `n_port`, `n_stbd`, `voltage` [V], `surge`,
    `sway` [m/s], ...). `counts` says what cleaning did (name -> number), `notes` what a person should know.
    `reading` are those of the notes that tell how the log was read, such as signs that were turned and how old held
    values are. Where `summed_up` the log has no position: it is that of the velocity, added up to trim runs by and to
    look at, and no evidence. `commanded` is the range of the thruster commands of which a map made the moment.
    """

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

    def command_of(self, dof: Dof) -> Floats:
        """Commanded moment or force of any degree of freedom, (N,). Raises RunError where the log has none."""
        command = self.moment if dof is self.dof else self.extras.get(dof.command)
        if command is None:
            arm = " and --arm METRES" * dof.levered
            thrusters = f"give --thrusters MAP.json{arm} for {' and '.join(dof.thrusters)}, or " * bool(dof.thrusters)
            raise RunError(
                f"{self.source}, run {self.name!r}: no {dof.words.full_force} ({', '.join(names_of(dof.command))}) in "
                f"the log; {thrusters}name the {dof.words.force}'s column with --columns"
            )
        return command

    def channel(self, quantity: str) -> Floats | None:
        """What a sensor logged, (N,) [base units], NaN where it has no reading; None where there is no such sensor."""
        return self.position if quantity == self.dof.position else self.extras.get(quantity)

    def signal(self, name: str) -> Floats | None:
        """What effects may need of a log, (N,): a column, the campaign's clock, or the time since the command last
        changed [s], both by their names; None where there is no such column."""
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
        """Standard deviation [rad or m] of the white noise on the position at the start of the run, see
        `position_noise`."""
        return position_noise(self.time[:NOISE_FROM], self.position[:NOISE_FROM])

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
        """The same run driven by another moment or force (thruster commands through a map), of which `parts` are those
        of single thrusters (`effects.thruster_imbalance.PARTS`); a logged one of that unit stays beside it as ASKED."""
        kept = parts is not None and self.moment is not None and unit == self.moment_unit
        asked = {ASKED: self.command} if kept else {}
        return replace(self, moment=moment, moment_unit=unit, extras={**self.extras, **asked, **(parts or {})},
                       commanded=commanded)  # fmt: skip

    def cut(self, start: int, stop: int) -> "Run":
        """Samples start:stop of this run."""
        return replace(
            self,
            time=self.time[start:stop],
            position=self.position[start:stop],
            moment=None if self.moment is None else self.moment[start:stop],
            extras={name: column[start:stop] for name, column in self.extras.items()},
        )


def command_warnings(runs: Iterable[Run]) -> tuple[str, ...]:
    """How the thruster commands of a campaign do not fit their map. Raises RunError where they cannot be its at all."""
    return warnings_of(run.commanded for run in runs if run.commanded is not None)


def runs_json(used: int, set_aside: Iterable[SetAside], runs: Sequence[Run] = ()) -> dict[str, object]:
    """Return the `runs` of a result file; of `runs` come notes of the reading and of the thrusters' map."""
    by_file = {run.source: list(run.reading) for run in runs if run.reading}
    readings = [{"file": file, "notes": texts} for file, texts in by_file.items()]
    notes = {"readings": readings, "commands": list(command_warnings(runs))}
    notes = {key: texts for key, texts in notes.items() if texts}
    return {"used": used, "set_aside": [to_mapping(run) for run in set_aside], **notes}


def shared_readings(runs: Iterable[Run]) -> tuple[str, ...]:
    """What the reading of the logs tells of more than half of them, once each."""
    told = {run.source: dict.fromkeys(run.reading) for run in runs}
    times = Counter(note for notes in told.values() for note in notes)
    return tuple(note for note, count in times.items() if 2 * count > len(told))


NAMED_APART = "another run of this campaign has the same name; the file's name was put in front"


def own_name(source: str) -> str:
    """The name of a run that is alone in its file."""
    return stem_of(source.rsplit("/", 1)[-1])


def named_apart(runs: Sequence[Run]) -> list[Run]:
    """Runs of one campaign, no two of one name; see `names_apart`."""
    names = names_apart([(run.name, run.source) for run in runs])
    return [
        run if run.name == name else replace(run, name=name, notes=(*run.notes, NAMED_APART))
        for run, name in zip(runs, names)
    ]


def names_apart(runs: Sequence[tuple[str, str]]) -> list[str]:
    """Names for runs, given by name and file: those of one name get their file's name in front (without its ending
    where that is enough).
    """
    named = [name for name, _ in runs]
    for prefix in (stem_of, str):
        times = Counter(named)
        for i, (name, (original, source)) in enumerate(zip(named.copy(), runs)):
            if times[name] > 1:
                front = prefix(source)
                named[i] = front if original == own_name(source) else f"{front}:{original}"
    return named
