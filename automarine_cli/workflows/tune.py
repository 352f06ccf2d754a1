"""`tune`: a model or a diagnosis -> gains of a controller with their margins, or why none can be promised."""

import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from automarine_cli import effects
from automarine_cli.control.design import Designed, Outcome, design
from automarine_cli.control.param_file import present_gains
from automarine_cli.control.targets.base import Design
from automarine_cli.errors import ModelError
from automarine_cli.pipeline.records import Document, Source, read_plain, toml_text
from automarine_cli.pipeline.results_folder import ResultFolder
from automarine_cli.planning.limits import Goal, Limits, Moments
from automarine_cli.report import outcomes, tuning_tables
from automarine_cli.report.figures.files import write_figures
from automarine_cli.report.figures.tuning import tuning_figure
from automarine_cli.report.tables import Table
from automarine_cli.results.estimate import Estimate
from automarine_cli.results.kinds import TUNING
from automarine_cli.results.shown import Shown
from automarine_cli.workflows.command import Command, ReadBack, Runner
from automarine_cli.workflows.plan import PlanOptions, planning, write_plan
from automarine_cli.workflows.shared import aligned
from automarine_cli.workflows.tune_check import TuningCheck, tune_check
from automarine_cli.workflows.tune_options import Ready, TuneOptions, ready
from automarine_cli.workflows.view import Row, View

SCHEMA = "automarine/tuning/1"
SETTLES, LIMITS = "settles", "limits.toml"
"""Folder of the runs that settle what is open, within the folder of results, and the file of their limits."""
WIDE, NARROW = 50.0, 10.0
"""Half widths of intervals [%] at which nothing more is planned: where a tie alone is to be settled, and of an effect
whose size is not known."""


@dataclass(frozen=True, repr=False)
class Tuning(Shown):
    """The verdict, the names of what was read, the settings that were asked for, what the runs that settle what is open
    are planned by (None where nothing is, or none can be planned), and the folder of the results."""

    made: Designed
    source: str
    asked: TuneOptions
    settling: PlanOptions | None
    out: Path | None

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
            "plan": None if self.settling is None else self.plan_command(""),
            "notes": list(made.notes),
            "present_gains": None if made.old is None else dict(made.old.gains),
            "made_from": self._made_from(),
        }  # fmt: skip

    def _made_from(self) -> dict[str, Any]:
        """Settings and files, of which `--check` makes the same vehicles again."""
        names = (
            "target",
            "step",
            "load",
            "margin",
            "full",
            "arm",
            "delay",
            "supply",
            "sample_time",
            "beyond_range",
            "seed",
        )
        files = {key: getattr(self.asked, key) for key in ("model", "extended", "thrusters")}
        read = {key: one for key, one in files.items() if isinstance(one, Source)}
        return {
            "settings": {name: getattr(self.asked, name) for name in names},
            "files": {
                key: {"name": one.name, "content": read_plain(one, "JSON", ModelError)} for key, one in read.items()
            },
        }

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
        if self.settling is None:
            return tuning_tables.tables(self.made)
        where = f"are planned in {self.out / SETTLES}" if self.out else f"are planned with -o DIR, into DIR/{SETTLES}"
        own = f"Such runs {where}. To plan them within other limits: {self.plan_command(str(self.out or 'DIR'))}"
        verdict, run, *rest = tuning_tables.tables(self.made)
        return [verdict, run, own, *rest]

    def plan_command(self, out: str) -> str:
        """The line that plans the runs that settle what is open; files by their names alone where `out` is empty."""
        asked = self.settling
        assert asked is not None
        own = PurePosixPath(out, SETTLES)
        options = {"--diagnosis": asked.diagnosis, "--thrusters": asked.thrusters}
        read = {key: one.name if isinstance(one, Document) or not out else str(one) for key, one in
                {"": asked.model, **options}.items() if isinstance(one, Source)}  # fmt: skip
        words = ["automarine", "plan", *(word for pair in read.items() for word in pair if word)]
        words += [word for name in asked.parameters for word in ("--parameter", name)]
        words += ["--arm", f"{asked.arm:g}"] if asked.arm is not None else []
        return shlex.join([*words, "--limits", str(own / LIMITS), "-o", "out/plan"])

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


def _tune(asked: TuneOptions, runner: Runner) -> Tuning:
    """Design gains of `target` for the model in the file `model`, or for what a diagnosis leaves open.

    With logs to `check` the model is a `tuning.json`, whose promises they are compared with. Raises ModelError for a
    model that the target cannot use, SettingError for settings that contradict each other, and OutputError.
    """
    made = ready(asked)
    present = present_gains(made.target, asked.present)

    def work() -> Tuning:
        found = design(made.target, made.known, made.full, made.bend, made.task, present, asked.seed)
        return Tuning(found, made.known.stored.source, asked, _settling(asked, made, found), runner.out)

    def write(folder: ResultFolder, result: Tuning) -> None:
        if result.settling is not None:
            _write_plan(folder.below(SETTLES), result.settling, runner)
        _write(folder, result, asked.figure_formats)

    return runner.results(asked, work, write)


def _settling(asked: TuneOptions, made: Ready, found: Designed) -> PlanOptions | None:
    """What the runs are planned by that settle what changes the answer: they separate what a diagnosis left tied, or
    narrow the interval of the effect that is not known."""
    dof, left = made.known.model.dof, found.open
    if not left or not dof.wraps:
        return None
    drive = (asked.thrusters, asked.arm) if made.known.stored.moment_unit != "nu" else (None, None)
    largest = None if drive[0] is not None else min(made.full, made.known.largest or made.full)
    tied = left in made.known.splits
    wanted = (dof.symbols.inertia, *(() if tied else (f"{left} {effects.get(left).names_in(dof)[0]}",)))
    return PlanOptions(
        model=asked.extended or asked.model, diagnosis=asked.model if asked.extended else None,
        limits=Limits(moments=Moments(largest=largest), goal=Goal(half_width_percent=WIDE if tied else NARROW)),
        parameters=wanted, thrusters=drive[0], arm=drive[1], columns=asked.columns,
        figure_formats=asked.figure_formats, seed=asked.seed,
    )  # fmt: skip


def _write_plan(folder: ResultFolder, asked: PlanOptions, runner: Runner) -> None:
    """The plan's own files, and the limits that it was made within."""
    found = folder.attempt("The runs that settle it could not be planned", planning(asked, runner.progress))
    if found is None or not isinstance(asked.limits, Limits):
        return
    write_plan(folder, found, asked)
    limits = asked.limits
    moments = {} if limits.moments.largest is None else {"moments": {"largest": limits.moments.largest}}
    goal = {"half_width_percent": limits.goal.half_width_percent}
    folder.write(LIMITS, toml_text({"schema": limits.schema, **moments, "goal": goal}))


def _write(folder: ResultFolder, result: Tuning, formats: tuple[str, ...]) -> None:
    folder.write_json("tuning.json", result.to_json())
    drawn = result.made.new is not None or result.made.old is not None
    figures = tuple(f"tuning.{kind}" for kind in formats) if drawn else ()
    plan = f"{SETTLES}/plan.md" if any(name.startswith(f"{SETTLES}/") for name in folder.hashes) else ""
    folder.write("tuning.md", tuning_tables.page(result.made, result.source, figures, plan))
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


def _files(result: Tuning | TuningCheck) -> Sequence[str]:
    if isinstance(result, TuningCheck):
        return tune_check.files(result)
    own = () if result.file is None else (result.file,)
    own = own if result.settling is None else (*own, f"{SETTLES}/")
    return (*own, "tuning.json", "tuning.md", "tuning.csv", "gains.csv", "tuning.png")


def _lines(result: Tuning) -> Iterator[str]:
    yield from tuning_tables.sentences(result.made)
    if result.made.new is not None:
        found = tuning_tables.promises(result.made.new, result.made)
        yield from aligned({name: one for name, one in found.items() if one is not None})


def _rows(result: Tuning) -> Iterator[Row]:
    for name, one in result._gains().items():
        yield {"parameter": name} | one


tune: Command[TuneOptions, Tuning | TuningCheck] = Command(
    "tune", TuneOptions, _tune,
    {Tuning: View(Tuning.tables, _lines, _rows, lambda result: {"tuning": lambda: tuning_figure(result.made)}),
     **tune_check.views},
    files=_files, kept=ReadBack(TUNING, outcomes.of_tuning), section="tuning.md",
    instead=lambda settings: tune_check if settings.get("check") else None,
)  # fmt: skip
