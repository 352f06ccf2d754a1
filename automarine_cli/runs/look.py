"""What logs hold, without fitting: runs and thruster tests for `check`; columns and kinds of tests for `init`."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from automarine_cli.dofs import DOFS, PLANAR, SURGE, SWAY, YAW, Dof
from automarine_cli.errors import LogError
from automarine_cli.logs import ColumnMap, LogFile, LogTable, is_thruster_test, read_log, require_thruster
from automarine_cli.logs.columns import CANONICAL, driven, names_of, quantities_of
from automarine_cli.logs.recognise import Layout, Maps, Recognised, layouts_of
from automarine_cli.pipeline.parallel import Progress, ordered_map
from automarine_cli.quantities import Floats
from automarine_cli.runs.checks import AllocationLimit, Commanded, commanded, laws_of, limit_of, still
from automarine_cli.runs.half_turn import ALREADY_ON, HalfTurn, all_half_turns, segments, why_none
from automarine_cli.runs.load import LET_GO, rows_of_runs, runs_of_table, unreadable
from automarine_cli.runs.run import CommandRange, ExcludedRun, Run, misfit_of, position_noise, undirected

MAX_LOGGED_LEVELS = 64  # more different values than this are a signal, not levels
MAX_TRACED = 600  # samples of a run that a picture needs


@dataclass(frozen=True)
class Trace:
    """A run to look at, (N,) each: time since its first sample [s], position as people see it, command, and which
    samples a fit of steps uses."""

    time: Floats
    position: Floats
    command: Floats
    used: NDArray[np.bool_]


@dataclass(frozen=True)
class RunSeen:
    """One run of a log: `noise` of its position as people see it, `extent` how far it went in all [turns, or m],
    `levels` its moments or forces (None: they never stay), `why` no step serves."""

    dof: Dof
    file: str
    run: str
    samples: int
    begins_s: float
    duration_s: float
    rate_hz: float
    jitter_ms: float
    longest_step_s: float
    counts: Mapping[str, int]
    noise: float
    extent: float
    moment_unit: str
    levels: list[float] | None
    steps: list[dict[str, Any]]
    half_turn: dict[str, Any] | None
    why: str | None
    columns: list[str]
    notes: list[str]
    trace: Trace = field(repr=False)
    commanded: list[Commanded] = field(default_factory=list, repr=False)
    limits: list[AllocationLimit] = field(default_factory=list)

    @property
    def kind(self) -> Literal["step", "manoeuvre", "idle"]:
        """A step has one constant command, whether or not it serves, an idle run none; decays are manoeuvres."""
        if (self.dof.restoring and self.why is None) or LET_GO in self.notes:
            return "manoeuvre"
        count = 2 if self.levels is None else np.count_nonzero(self.levels)
        return "manoeuvre" if count > 1 else "step" if count else "idle"

    @property
    def ways(self) -> list[bool]:
        """Of each stretch from rest that moved whether it went with the sign of its command."""
        force, gone = self.dof.words.force, f"{self.dof.words.gone_key}_{self.dof.units.shown}"
        least = self.dof.shown(self.dof.limits.unmoved)
        moved = (step for step in self.steps if step["from_rest"] and abs(step[gone]) > least)
        return [step[force] * step[gone] > 0 for step in moved]

    def to_json(self) -> dict[str, object]:
        words, dof = self.dof.words, self.dof
        noise, unit = f"{words.position}_noise_{dof.units.shown}", f"{words.force}_unit"
        keys = {"noise": noise, "extent": words.range_key, "moment_unit": unit, "half_turn": dof.step_key}
        limits = {"allocation_limits": [limit.to_json() for limit in self.limits]} if self.limits else {}
        inner = ("dof", "trace", "commanded", "limits")
        return {keys.get(name, name): value for name, value in vars(self).items() if name not in inner} | limits


@dataclass(frozen=True)
class ThrusterTestSeen:
    file: str
    run: str
    points: int
    missing: int
    levels: int
    lowest_n: float
    highest_n: float
    lowest_force_N: float
    highest_force_N: float
    voltages: list[float]
    columns: list[str]
    notes: list[str]


def look_at_log(file: LogFile, columns: ColumnMap) -> tuple[list[RunSeen], list[ThrusterTestSeen], list[ExcludedRun]]:
    """Describe the runs and thruster tests of a file, and what is set aside; samples are dropped."""
    try:
        table = read_log(file, columns, dof=None)
        if is_thruster_test(table):
            require_thruster(table)
            return [], *look_at_tests(table)
        runs, set_aside = runs_of_table(file, table)
    except LogError as error:
        return [], [], [unreadable(file, error)]
    return [look_at_run(run) for run in runs], [], set_aside


def look_at_run(run: Run) -> RunSeen:
    """Describe a run. Thruster commands without a moment or force are seen as they add up."""
    driven = run.as_commanded()
    turns = [] if run.dof.restoring else all_half_turns(driven)
    spans, extent = np.diff(run.time), float(np.ptp(run.position))
    jitter = float(np.percentile(np.abs(spans - run.sample_period), 95))
    best = next((turn for turn in turns if not turn.why), None)
    why = still(run) if run.dof.restoring else why_none(driven, turns) if best is None else None
    levels = sorted({moment for _, _, moment in segments(driven.command)})
    used, part = np.zeros(len(run), dtype=bool), slice(None, None, max(1, len(run) // MAX_TRACED))
    used[slice(0) if best is None else best.kept] = True
    return RunSeen(
        run.dof, run.source, run.name, samples=len(run), begins_s=float(run.time[0]),
        duration_s=float(run.time[-1] - run.time[0]), rate_hz=1 / run.sample_period,
        jitter_ms=round(1000 * jitter, 6),  # not the clock's rounding
        longest_step_s=float(spans.max()), counts=dict(run.counts),
        noise=float(run.dof.shown(position_noise(run.time, run.position))),
        extent=extent / run.dof.turn if run.dof.wraps else float(run.dof.logged(extent)),
        moment_unit=driven.moment_unit,
        levels=levels if len(levels) <= min(MAX_LOGGED_LEVELS, len(run) // 4) else None,
        steps=[_step_seen(turn) for turn in turns], half_turn=None if best is None else _step_seen(best),
        why=why, columns=sorted(run.extras),
        notes=[*run.notes, *(run.dof.fill(ALREADY_ON) for turn in turns if turn.step.begins_log)],
        trace=Trace(
            (run.time - run.time[0])[part], run.dof.shown(run.position)[part], driven.command[part], used[part]
        ),
        commanded=commanded(run),
    )  # fmt: skip


def with_limits(runs: Sequence[RunSeen]) -> list[RunSeen]:
    """Add to each run what it asks of its thrusters beyond the limits that all runs of its motion show."""
    runs = list(runs)
    for motion in dict.fromkeys(run.dof for run in runs):
        for law, commands in laws_of([run.commanded if run.dof is motion else [] for run in runs]):
            for i, part in commands.items():
                if limit := limit_of(law, [part]):
                    notes = [*runs[i].notes, limit.sentence]
                    runs[i] = replace(runs[i], limits=[*runs[i].limits, limit], notes=notes)
    return runs


def _step_seen(turn: HalfTurn) -> dict[str, Any]:
    """A step as in check.json: its start in the unit of logs, how far it went as people see it."""
    step, dof = turn.step, turn.step.run.dof
    return {
        dof.words.force: step.moment, "switch_from_s": step.switch_from, "switch_to_s": step.switch_to,
        "ends_s": float(step.run.time[step.stop - 1]), "from_rest": step.from_rest,
        f"start_{dof.words.position}_{dof.units.log}": float(dof.logged(turn.start_position)),
        "kept_samples": len(turn.time), "kept_s": float(turn.time[-1] - turn.time[0]),
        f"{dof.words.gone_key}_{dof.units.shown}": float(dof.shown(turn.turned)),
        "cut_by": turn.cut_by, "steady": turn.steady, "why": turn.why or None,
    }  # fmt: skip


def look_at_tests(table: LogTable) -> tuple[list[ThrusterTestSeen], list[ExcludedRun]]:
    """The runs of a thruster test, and those without a single point."""
    good = ~(np.isnan(table.columns["n"]) | np.isnan(table.columns["force"]))
    tests, aside = [], []
    for name, every in rows_of_runs(table):
        rows = every[good[every]]
        if not len(rows):
            aside.append(ExcludedRun(table.source, name, "no row has both a control signal and a force"))
            continue
        n, force, voltage = table.columns["n"][rows], table.columns["force"][rows], table.columns.get("voltage")
        volts = [] if voltage is None else np.unique(voltage[rows][~np.isnan(voltage[rows])]).tolist()
        tests.append(ThrusterTestSeen(
            table.source, name, points=len(n), missing=len(every) - len(n), levels=len(np.unique(n)),
            lowest_n=float(n.min()), highest_n=float(n.max()),
            lowest_force_N=float(force.min()), highest_force_N=float(force.max()),
            voltages=volts if len(volts) <= MAX_LOGGED_LEVELS else [], columns=sorted(table.extras),
            notes=[*table.notes, *filter(None, [undirected(n, force)])],
        ))  # fmt: skip
    return tests, aside


UNITS_LINE = "delete a line of units below the names"
NO_COLUMN = f"no column looks like a heading, a moment or a command; {UNITS_LINE}, or name them with --columns"
HELD_BACK = ("valid", "hold", "verif")  # how folders of runs begin that no fit may see
VALIDATION_SUFFIX = "_validation"  # and how they may end
MIN_TURNED_SHARE = 0.8  # share of the steps that turn against their moment, from which a sign is asked for

Placed = Mapping[str, tuple[LogFile, ...]]  # logs by the kind of test that they are


@dataclass(frozen=True)
class Survey:
    """What a folder of logs holds: kinds of files with their columns, the map of all columns, the runs of each log;
    logs by kind, of yaw and of other motions. `unread` logs wait for an answer, `strangers` are of no vehicle."""

    folder: Path
    layouts: tuple[Layout, ...]
    maps: Maps
    runs: Mapping[LogFile, list[RunSeen]]
    set_aside: tuple[ExcludedRun, ...]
    placed: Placed
    forces: Mapping[str, Placed]
    unread: tuple[LogFile, ...]
    strangers: tuple[LogFile, ...]

    @property
    def count(self) -> int:
        bad = {run.file for run in self.set_aside} - {file.name for file, runs in self.runs.items() if runs}
        return sum(file.name not in bad for layout in self.layouts for file in layout.files)

    @property
    def columns(self) -> tuple[Recognised, ...]:
        every = [column for layout in self.layouts for column in layout.columns]
        unique = {(column.key, column.source, str(column.rule)): column for column in reversed(every)}
        return tuple(unique.values())[::-1]

    @property
    def unused(self) -> tuple[str, ...]:
        """Columns that no fit looks at; all that motion in the plane may log serves it."""
        plane = set(CANONICAL) if PLANAR.name in self.forces else set()
        return tuple(dict.fromkeys(name for layout in self.layouts for name in layout.unused if name not in plane))

    @property
    def not_used(self) -> list[ExcludedRun]:
        """Logs and runs that stand nowhere in a campaign, and why."""
        idle = [file for file, runs in self.runs.items() if runs and all(run.kind == "idle" for run in runs)]
        lines = [ExcludedRun(file.name, "", "nothing is commanded in it") for file in idle]
        return [*lines, *self.set_aside, *(ExcludedRun(file.name, "", NO_COLUMN) for file in self.strangers)]

    @property
    def thrusters_drive(self) -> bool:
        """Whether both thrusters are commanded, and no column looks like a moment."""
        keys = {column.key for column in self.columns}
        return driven(YAW, keys) and keys.isdisjoint(names_of(YAW.command))

    @property
    def misfit(self) -> str:
        """Say how commands of the logs do not fit those of the bollard tests; "" where they do."""
        ends = {column.key: end for layout in self.layouts for column in layout.columns
                if (end := layout.ends(column)) is not None}  # fmt: skip
        if not {"n", *YAW.thrusters} <= ends.keys():
            return ""
        low, high, _ = ends["n"]
        unit = next(column.rule.get("unit", "") for column in self.columns if column.key == "n")
        misfit = misfit_of([CommandRange(*ends[side], YAW.thrusters, (low, high), str(unit)) for side in YAW.thrusters])
        return misfit.sentence if misfit else ""

    @property
    def turns(self) -> tuple[int, int]:
        """How many steps of yaw went with and against their moment."""
        elsewhere = {file for kinds in self.forces.values() for files in kinds.values() for file in files}
        ways = [way for file, runs in self.runs.items() if file not in elsewhere for run in runs for way in run.ways]
        return ways.count(True), ways.count(False)

    @property
    def turned_round(self) -> bool:
        """Whether nearly all turn against their moment: heading or moment counts the other way."""
        good, bad = self.turns
        return bad >= 2 and bad >= MIN_TURNED_SHARE * (good + bad)


TEST_KINDS = ("thrusters", "steps", "manoeuvres", "validation")


def survey(folder: Path, files: Sequence[LogFile], columns: ColumnMap, jobs: int, progress: Progress) -> Survey:
    """Look at every log: its columns (by the user's map where there is one), then its runs, then its kind."""
    logs, layouts, maps, errors = layouts_of(folder, files, columns, jobs, progress)
    layout_of = {file: layout for layout in layouts for file in layout.files}
    readable = [file for file in logs if file in layout_of]
    look = partial(look_at_log, columns=maps.columns())
    looks = ordered_map(look, readable, jobs, progress=progress, stage="looking at runs")
    let_go = {file for file, (runs, *_) in zip(readable, looks) if runs and all(LET_GO in run.notes for run in runs)}

    def answered(those: Sequence[Layout]) -> tuple[Layout, ...]:
        return tuple(replace(each, lacking=()) if let_go.issuperset(each.files) else each for each in those)

    layouts, apart = answered(layouts), tuple((names, answered(those)) for names, those in maps.apart)
    maps = replace(maps, shared=answered(maps.shared), apart=apart)
    layout_of = {file: layout for layout in layouts for file in layout.files}
    headed = any(YAW.position not in layout.lacking for layout in layouts if not layout.bollard)
    aside = [unreadable(file, error) for file, error in errors.items()]
    unread: list[LogFile] = []
    logs_of: dict[str, dict[str, list[LogFile]]] = {"": {kind: [] for kind in TEST_KINDS}}  # by motion; "" is yaw
    for file, (runs, tests, bad) in zip(readable, looks):
        layout = layout_of[file]
        questions = layout.lacking or any(column.open for column in layout.columns)
        unclear = questions and not (runs or layout.bollard) and not (headed and YAW.position in layout.lacking)
        if unclear:  # it shows what it is once a question is answered
            unread.append(file)
        else:
            aside += bad
        kind = _kind_of(file, runs, unclear) if not layout.bollard else "thrusters" if tests else ""
        if not kind:
            continue
        motion, kinds = "", list(TEST_KINDS)
        if not layout.dof.wraps:
            motion, kinds = layout.dof.name, kinds[1:]
        elif layout.dof is YAW and _of_three(layout.names):
            motion, kinds, kind = PLANAR.name, ["runs", "validation"], "validation" if kind == "validation" else "runs"
        logs_of.setdefault(motion, {kind: [] for kind in kinds})[kind].append(file)
    placed = {motion: {kind: tuple(of_kind) for kind, of_kind in kinds.items()} for motion, kinds in logs_of.items()}
    return Survey(
        folder, layouts, maps, {file: runs for file, (runs, _, _) in zip(readable, looks)}, tuple(aside),
        placed[""], {motion: placed[motion] for motion in (*DOFS, PLANAR.name) if motion in placed},
        tuple(unread), tuple(file for file in logs if file not in layout_of and file not in errors),
    )  # fmt: skip


def _kind_of(file: LogFile, runs: Sequence[RunSeen], unread: bool = False) -> str:
    """The kind of test that a log of runs holds, "" where nothing is commanded; steps where only an answer tells."""
    kinds = Counter(run.kind for run in runs)
    if not unread and (not kinds or set(kinds) == {"idle"}):
        return ""
    parts = file.name.lower().split("/")
    if any(part.startswith(HELD_BACK) or part.endswith(VALIDATION_SUFFIX) for part in parts):
        return "validation"
    return "manoeuvres" if kinds["manoeuvre"] else "steps"


def _of_three(names: Sequence[str]) -> bool:
    there = quantities_of(names)
    moved = {SURGE.velocity, SWAY.velocity} & there or {"north", "east"} <= there
    return bool(YAW.position in there and {SURGE.command, SWAY.command} & there and moved)
