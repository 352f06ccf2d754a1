"""What `init` sees in a folder of logs: columns and what they are taken for, runs and what kind of test they are."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from automarine_cli.dofs import DOFS, SURGE, SWAY, YAW, Dof
from automarine_cli.dofs.motion import PLANAR
from automarine_cli.errors import LogError
from automarine_cli.fits.planar_structure import PLACES
from automarine_cli.logs import ColumnMap, ColumnRule, LogFile, is_thruster_test, read_log
from automarine_cli.logs.canonical import CANONICAL, driven, names_of
from automarine_cli.logs.recognise import Recognised, Span, recognise, spans
from automarine_cli.pipeline.parallel import ordered_map
from automarine_cli.pipeline.progress import Progress, silent
from automarine_cli.report.tables import number
from automarine_cli.runs.kinds import RunKind, kind_of
from automarine_cli.runs.load import read_runs, unreadable
from automarine_cli.runs.run import SetAside
from automarine_cli.workflows.campaign_file import Logs

NEEDED = ("time", YAW.position, YAW.command)
OF_YAW = (*NEEDED, YAW.velocity, "voltage")
BOLLARD = ("n", "force", "time", "voltage")
HELD_BACK = ("valid", "hold", "verif")  # how folders of runs begin that no fit may see
VALIDATION = "_validation"  # and how they may end
TURNED_ROUND = 0.8  # share of the steps that turn against their moment, from which a sign is asked for


@dataclass(frozen=True)
class Layout:
    """Logs with the same columns: whether they are thruster tests, what each column does over all of them, and of which
    motion they are (translations only by columns of those names).
    """

    names: tuple[str, ...]
    bollard: bool
    files: tuple[LogFile, ...]
    seen: Mapping[str, Span]
    dof: Dof


@dataclass(frozen=True)
class Look:
    """Everything that was seen: what the columns are taken for, the runs of each yaw log, what could not be read; and
    the logs of translations, by motion and kind.
    """

    folder: Path
    layouts: tuple[Layout, ...]
    columns: tuple[Recognised, ...]
    lacking: tuple[str, ...]
    runs: Mapping[LogFile, tuple[RunKind, ...]]
    set_aside: tuple[SetAside, ...]
    placed: Mapping[str, tuple[LogFile, ...]] = field(default_factory=dict)
    forces: Mapping[str, Mapping[str, tuple[LogFile, ...]]] = field(default_factory=dict)

    @property
    def thrusters_drive(self) -> bool:
        """Whether the yaw logs hold thruster commands and no moment."""
        keys = {one.key for one in self.columns}
        return driven(YAW, keys) and not keys & set(names_of(YAW.command))

    @property
    def turns(self) -> tuple[int, int]:
        """How many stretches from rest turned with, and against, the sign of their moment."""
        forces = {file for kinds in self.forces.values() for files in kinds.values() for file in files}
        kinds = [kind for file, runs in self.runs.items() if file not in forces for kind in runs]
        return sum(kind.with_moment for kind in kinds), sum(kind.against for kind in kinds)

    @property
    def turned_round(self) -> bool:
        """Whether nearly all turn against their moment: heading or moment counts the other way."""
        good, bad = self.turns
        return bad >= 2 and bad >= TURNED_ROUND * (good + bad)


def look_at(folder: Path, files: Sequence[LogFile], jobs: int = 1, progress: Progress = silent) -> Look:
    """Look at every log: its columns first, then its runs by what the columns are taken for, then its kind."""
    seen = ordered_map(_columns_of, files, jobs, progress=progress, stage="looking at columns")
    aside = [one for one in seen if isinstance(one, SetAside)]
    groups: dict[tuple[tuple[str, ...], bool, str], list[tuple[LogFile, dict[str, Span]]]] = {}
    for file, one in zip(files, seen):
        if not isinstance(one, SetAside):
            groups.setdefault(one[:3], []).append((file, one[3]))
    every = tuple(
        Layout(names, bollard, tuple(file for file, _ in group), _together([spans for _, spans in group]), DOFS[motion])
        for (names, bollard, motion), group in sorted(groups.items(), key=_yaw_first)
    )
    layouts = tuple(layout for layout in every if layout.dof.wraps)
    columns, lacking = _recognised(layouts)
    rules = ColumnMap({one.key: ColumnRule(one.source, one.unit) for one in columns if not one.as_named})
    yaw = [file for layout in layouts if not layout.bollard for file in layout.files]
    found = ordered_map(
        partial(_runs_of, columns=rules, dof=YAW), yaw, jobs, progress=progress, stage="looking at runs"
    )
    aside += [one for _, bad in found for one in bad]
    runs = dict(zip(yaw, (good for good, _ in found)))
    look = Look(folder, every, columns, lacking, runs, tuple(aside))
    return _with_planar(_with_forces(_placed(look, files), files))


def _yaw_first(group: tuple[tuple[tuple[str, ...], bool, str], Sequence[object]]) -> tuple[bool, int]:
    """The order of layouts: those of yaw, and of them those with more logs."""
    (_, _, motion), logs = group
    return motion != YAW.name, -len(logs)


def _columns_of(file: LogFile) -> tuple[tuple[str, ...], bool, str, dict[str, Span]] | SetAside:
    """Names, whether it is a thruster test, the motion, and what the columns of a log do; or why it cannot be read."""
    try:
        table = read_log(file, dof=None)
    except LogError as error:
        return unreadable(file, error)
    return table.names, is_thruster_test(table), table.dof.name, spans(table)


def _together(seen: Sequence[Mapping[str, Span]]) -> dict[str, Span]:
    whole: dict[str, Span] = {}
    for one in seen:
        for name, span in one.items():
            whole[name] = whole[name] + span if name in whole else span
    return whole


def _recognised(layouts: Sequence[Layout]) -> tuple[tuple[Recognised, ...], tuple[str, ...]]:
    """What columns are taken for, each key once (the layout with more logs decides), and what was not found."""
    found: dict[str, Recognised] = {}
    lacking: dict[str, None] = {}
    for layout in layouts:
        # a column of this name does what it does over all logs, also those with other columns beside it
        alike = _together([one.seen for one in layouts if one.bollard == layout.bollard])
        seen = {name: alike[name] for name in layout.names if name in alike}
        for quantity in _wanted(layout):
            one = recognise(quantity, layout.names, seen)
            if one is not None:
                found.setdefault(one.key, one)
            elif quantity in (BOLLARD[:2] if layout.bollard else (*NEEDED, *YAW.thrusters)):
                lacking.setdefault(quantity)
    there = {CANONICAL[key].quantity for key in found}
    return tuple(found.values()), tuple(one for one in lacking if one not in there)


def _wanted(layout: Layout) -> tuple[str, ...]:
    """Quantities of a layout; thruster commands stand in for a moment that is not there."""
    if layout.bollard:
        return BOLLARD
    if recognise(YAW.command, layout.names, layout.seen) is None:
        sides = [recognise(side, layout.names, layout.seen) for side in YAW.thrusters]
        if all(sides):
            return ("time", YAW.position, *YAW.thrusters, YAW.velocity, "voltage")
    return OF_YAW


def _runs_of(file: LogFile, columns: ColumnMap, dof: Dof) -> tuple[tuple[RunKind, ...], list[SetAside]]:
    try:
        runs, aside = read_runs(LogFile(file.path, file.name, False), columns, dof=dof)
    except LogError as error:  # a guess that does not fit this log
        return (), [unreadable(file, error)]
    return tuple(kind_of(run) for run in runs), aside


def _placed(look: Look, files: Sequence[LogFile]) -> Look:
    """Each log under the kind of test that it is; those that could not be read nowhere."""
    bollard = {file for layout in look.layouts if layout.bollard for file in layout.files}
    placed: dict[str, list[LogFile]] = {kind: [] for kind in Logs.__dataclass_fields__}
    for file in files:
        kind = "thrusters" if file in bollard else _kind_of(file, look.runs.get(file, ()))
        if kind:
            placed[kind].append(file)
    return replace(look, placed={kind: tuple(found) for kind, found in placed.items()})


def _kind_of(file: LogFile, runs: Sequence[RunKind]) -> str:
    """The kind of test that a log of runs holds; none where nothing is commanded."""
    kinds = Counter(run.kind for run in runs)
    if not kinds or set(kinds) == {"idle"}:
        return ""
    if any(part.lower().startswith(HELD_BACK) or part.lower().endswith(VALIDATION) for part in file.name.split("/")):
        return "validation"
    return "manoeuvres" if kinds["manoeuvre"] else "steps"


def _with_forces(look: Look, files: Sequence[LogFile]) -> Look:
    """The look with the logs of translations, each under its motion and kind."""
    forces: dict[str, dict[str, list[LogFile]]] = {}
    aside, runs = list(look.set_aside), dict(look.runs)
    for layout in look.layouts:
        for file in layout.files if not layout.dof.wraps else ():
            runs[file], bad = _runs_of(file, ColumnMap(), layout.dof)
            aside += bad
            kind = _kind_of(file, runs[file])
            if kind:
                sections = {name: list[LogFile]() for name in ("steps", "manoeuvres", "validation")}
                forces.setdefault(layout.dof.name, sections)[kind].append(file)
    order = {file: i for i, file in enumerate(files)}
    told = {
        motion: {kind: tuple(sorted(found, key=lambda file: order[file])) for kind, found in kinds.items()}
        for motion, kinds in sorted(forces.items(), key=lambda one: list(DOFS).index(one[0]))
    }
    return replace(look, forces=told, runs=runs, set_aside=tuple(aside))


def _with_planar(look: Look) -> Look:
    """The look with the logs of surge, sway and yaw together taken out of those of yaw."""
    together = {
        file for layout in look.layouts if layout.dof is YAW and _of_three(layout.names) for file in layout.files
    }
    if not together:
        return look
    kinds: dict[str, list[LogFile]] = {"runs": [], "validation": []}
    for kind, files in look.placed.items():
        kinds["validation" if kind == "validation" else "runs"] += [file for file in files if file in together]
    return replace(
        look,
        placed={kind: tuple(f for f in files if f not in together) for kind, files in look.placed.items()},
        forces={**look.forces, PLANAR.name: {kind: tuple(files) for kind, files in kinds.items()}},
    )


def _of_three(names: Sequence[str]) -> bool:
    """Whether logs with these columns hold the heading, what pushes ahead or abeam, and speeds or a place."""
    there = {CANONICAL[name].quantity for name in names if name in CANONICAL}
    pushed = {SURGE.command, SWAY.command} & there
    moved = {SURGE.velocity, SWAY.velocity} & there or set(PLACES) <= there
    return YAW.position in there and bool(pushed) and bool(moved)


def moments_of(look: Look, files: Sequence[LogFile]) -> str:
    """`18 runs, -1.2 to 1.2 nu`, for the comment beside the logs of a kind."""
    runs = [run for file in files for run in look.runs.get(file, ())]
    if not runs:
        return ""
    low, high = min(run.low for run in runs), max(run.high for run in runs)
    return f"{len(runs)} run{'s' * (len(runs) != 1)}, {number(low, 3)} to {number(high, 3)} {runs[0].unit}"
