"""`tune`: a model or a diagnosis -> gains of a controller with their margins, or why none can be promised."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from automarine_cli.control.authority import authority
from automarine_cli.control.design import Designed, Outcome, design
from automarine_cli.control.knowledge import EXTENDED, SUPPLY, Knowledge, is_diagnosis, read_knowledge
from automarine_cli.control.param_file import present_gains
from automarine_cli.control.search import Task
from automarine_cli.control.targets import get
from automarine_cli.control.targets.base import Design
from automarine_cli.errors import ModelError, SettingError
from automarine_cli.logs import given_columns
from automarine_cli.pipeline.outputs import ResultFolder
from automarine_cli.pipeline.plain_data import Source
from automarine_cli.pipeline.shown import Shown
from automarine_cli.report import outcomes, tuning_tables
from automarine_cli.report.figures.files import write_figures
from automarine_cli.report.figures.tuning import tuning_figure
from automarine_cli.report.tables import Table
from automarine_cli.results.estimate import Estimate
from automarine_cli.results.kinds import TUNING
from automarine_cli.thrusters.map import ThrusterMap
from automarine_cli.workflows.command import Command, ReadBack, Runner, reads
from automarine_cli.workflows.moments import map_and_arm
from automarine_cli.workflows.shared import Columns, Drawn, aligned
from automarine_cli.workflows.view import Row, View

SCHEMA = "automarine/tuning/1"
BAND_DEG, BAND_M = 2.0, 0.05
"""Within what a step counts as settled: the field's two degrees of heading, and 5 cm."""
STEP_DEG, STEP_M = 90.0, 1.0


@dataclass(frozen=True, repr=False)
class Tuning(Shown):
    """The verdict, the names of what was read, and the settings that were asked for."""

    made: Designed
    source: str
    asked: "TuneOptions"

    def to_json(self) -> dict[str, Any]:
        """The result: schema automarine/tuning/1."""
        made = self.made
        dof, task, target = made.nominal.dof, made.task, made.target
        unit = dof.units.log
        return {
            "schema": SCHEMA,
            "verdict": made.verdict,
            "why": made.why,
            "target": target.name,
            "firmware": target.firmware or None,
            "motion": dof.name,
            "model": self.source,
            f"{dof.words.force}_unit": made.nominal.force_unit,
            f"full_{dof.words.force}": made.nominal.full,
            "sample_time_s": target.period,
            f"step_{unit}": dof.logged(task.step),
            f"settled_within_{dof.units.key}": dof.shown(task.band),
            "load_percent": 100.0 * task.load,
            "margin_asked": task.margin,
            "flight_s": task.seconds,
            "gains": self._gains(),
            "disk_margin": None if made.new is None else _json(tuning_tables.margins_of(made.new)["disk_margin"]),
            "margins": {name: _all(tuning_tables.margins_of(one)) | {
                "share_with_margin": one.share_with(task.margin), "stable": float(one.margins.stable.mean())}
                for name, one in self._sets()},
            "promised": None if made.new is None else self._promised(made.new),
            "present": None if made.old is None else self._promised(made.old),
            "vehicles": sum(len(one.vehicles) for one in made.crowds),
            "explanations": [one.name for one in made.crowds],
            "settled_by": made.run or None,
            "notes": list(made.notes),
        }  # fmt: skip

    def _sets(self) -> Iterator[tuple[str, Outcome]]:
        for name, one in (("present", self.made.old), ("new", self.made.new)):
            if one is not None:
                yield name, one

    def _gains(self) -> dict[str, Any]:
        new, old = self.made.new, self.made.old
        if new is None:
            return {}
        unit = self.made.nominal.dof.units.base
        return {
            one.name: {
                "value": new.gains[one.name], "before": None if old is None else old.gains.get(one.name),
                "unit": one.unit.replace("{x}", unit),
                "documented": [one.low, one.high] if one.high < float("inf") else None,
            }
            for one in self.made.target.parameters
        }  # fmt: skip

    def _promised(self, one: Outcome) -> dict[str, Any]:
        return _all(tuning_tables.promises(one, self.made)) | {"settles": float(one.scores.settles.mean())}

    def tables(self) -> list[Table | str]:
        """What the terminal shows."""
        return tuning_tables.tables(self.made)

    @property
    def file(self) -> str | None:
        """The target's own file, where gains are given."""
        return None if self.made.new is None else self.made.target.file

    def target_text(self) -> str:
        """Its content."""
        made = self.made
        assert made.new is not None
        held = (
            f"Disk margin {made.task.margin:g} or more for {made.new.share_with(made.task.margin):.0%} of the vehicles"
        )
        notes = (f"From {self.source} by automarine tune.", f"{held} that the model allows.", *self._warnings())
        return made.target.text(Design(made.new.gains, {} if made.old is None else made.old.gains, made.nominal, notes))

    def _warnings(self) -> tuple[str, ...]:
        beyond = self.made.target.beyond and self.made.target.firmware
        return ("Warning: values may lie beyond the documented ranges.",) if beyond else ()


@dataclass(frozen=True, kw_only=True)
class _Asked:
    """The model or diagnosis, the stack, and what the vehicle's whole output gives."""

    model: Source = field(metadata=reads("file"))
    target: str
    step: float | None = None
    load: float = 10.0
    margin: float = 0.75
    full: float | None = None
    thrusters: Source | ThrusterMap | None = field(default=None, metadata=reads("file"))
    arm: float | None = None


@dataclass(frozen=True, kw_only=True)
class TuneOptions(Drawn, Columns, _Asked):
    """`step` in degrees or metres, `load` [%] of the whole output, disk `margin` to keep; `full` moment or force of the
    whole output; `delay` [s] that the logs cannot show, `supply` voltage in shares of that of the logs; `present`
    gains, `sample_time` [s] of targets that have none of their own; `seed` draws the vehicles."""

    extended: Source | None = field(default=None, metadata=reads("file"))
    delay: float | None = None
    supply: tuple[float, float] = SUPPLY
    present: Source | None = field(default=None, metadata=reads("file"))
    sample_time: float | None = None
    beyond_range: bool = False
    seed: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        beside = self.model.with_name(EXTENDED) if isinstance(self.model, Path) else None
        if self.extended is None and beside is not None and beside.is_file() and is_diagnosis(self.model):
            object.__setattr__(self, "extended", beside)
        low, high = self.supply
        for name, fine, wanted in (
            ("--margin", 0.0 < self.margin < 2.0, "between 0 and 2"),
            ("--load", 0.0 < self.load < 100.0, "between 0 and 100"),
            ("--step", self.step is None or self.step > 0.0, "above 0"),
            ("--full", self.full is None or self.full > 0.0, "above 0"),
            ("--delay", self.delay is None or 0.0 <= self.delay <= 5.0, "between 0 and 5 s"),
            ("--sample-time", self.sample_time is None or 0.001 <= self.sample_time <= 1.0, "between 0.001 and 1 s"),
            ("--supply", 0.0 < low <= 1.0 <= high < 3.0, "shares below and above 1"),
        ):
            if not fine:
                raise SettingError(f"{name}: found a value that makes no sense; expected {wanted}")


def _tune(asked: TuneOptions, runner: Runner) -> Tuning:
    """Design gains of `target` for the model in the file `model`, or for what a diagnosis leaves open.

    Raises ModelError for a model that the target cannot use, SettingError for settings that contradict each other, and
    OutputError.
    """
    known = _known(asked)
    target = get(asked.target, asked.sample_time, asked.beyond_range)
    dof = known.model.dof
    if dof.name not in target.motions:
        raise ModelError(
            f"{known.stored.source} is a model of {dof.name}; {target.name} controls {' or '.join(target.motions)}"
        )
    if asked.thrusters is not None and not dof.levered:
        raise SettingError(f"--thrusters makes turning moments; for {dof.name} give --full with the whole force")
    drive = map_and_arm(asked.thrusters, asked.arm, given_columns(asked.columns), dof)
    full, bend = authority(target, known, asked.full, drive)
    step = asked.step if asked.step is not None else STEP_DEG if dof.wraps else STEP_M
    band = dof.inner(BAND_DEG if dof.wraps else BAND_M)
    task = Task(dof.inner(step), band, asked.load / 100.0, asked.margin, 0.0)
    present = present_gains(target, asked.present)

    def work() -> Tuning:
        made = design(target, known, full, bend, task, present, asked.seed)
        return Tuning(made, known.stored.source, asked)

    return runner.results(asked, work, lambda folder, result: _write(folder, result, asked.figure_formats))


def _known(asked: TuneOptions) -> Knowledge:
    """What the files say."""
    if not is_diagnosis(asked.model):
        return read_knowledge(asked.model, None, asked.delay, asked.supply)
    if asked.extended is None:
        raise ModelError(f"{asked.model.name}: its {EXTENDED} is not beside it; keep both in one folder")
    return read_knowledge(asked.extended, asked.model, asked.delay, asked.supply)


def _write(folder: ResultFolder, result: Tuning, formats: tuple[str, ...]) -> None:
    folder.write_json("tuning.json", result.to_json())
    drawn = result.made.new is not None or result.made.old is not None
    figures = tuple(f"tuning.{kind}" for kind in formats) if drawn else ()
    folder.write("tuning.md", tuning_tables.page(result.made, result.source, figures))
    if drawn:
        folder.write("tuning.csv", tuning_tables.promised_table(result.made).to_csv())
        folder.write("gains.csv", tuning_tables.gains_table(result.made).to_csv())
    if result.file is not None:
        folder.write(result.file, result.target_text())
    if drawn:
        write_figures(folder, {"tuning": lambda: tuning_figure(result.made)}, formats)


def _json(one: Estimate | None) -> dict[str, Any] | None:
    """An estimate; an end that is infinite is null."""
    if one is None:
        return None
    value, low, high = (None if x == float("inf") else x for x in (one.value, *one.ci95))
    return {"value": value, "stderr": one.stderr, "ci95": [low, high], "unit": one.unit}


def _all(found: Mapping[str, Estimate | None]) -> dict[str, Any]:
    return {name: _json(one) for name, one in found.items()}


def _files(result: Tuning) -> tuple[str, ...]:
    own = () if result.file is None else (result.file,)
    return (*own, "tuning.json", "tuning.md", "tuning.csv", "gains.csv", "tuning.png")


def _lines(result: Tuning) -> Iterator[str]:
    yield from tuning_tables.sentences(result.made)
    if result.made.new is not None:
        found = tuning_tables.promises(result.made.new, result.made)
        yield from aligned({name: one for name, one in found.items() if one is not None})


def _rows(result: Tuning) -> Iterator[Row]:
    for name, one in result._gains().items():
        yield {"parameter": name} | one


tune = Command(
    "tune", TuneOptions, _tune,
    {Tuning: View(Tuning.tables, _lines, _rows, lambda result: {"tuning": lambda: tuning_figure(result.made)})},
    files=_files, kept=ReadBack(TUNING, outcomes.of_tuning), section="tuning.md",
)  # fmt: skip
