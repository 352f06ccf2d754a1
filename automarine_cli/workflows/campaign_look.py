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
from automarine_cli.logs import ColumnMap, LogFile, read_log, require_thruster, whole_logs
from automarine_cli.logs.canonical import BY, LABELS, RUN, driven, motion_of, names_of
from automarine_cli.logs.reader import whole_log
from automarine_cli.logs.recognise import Recognised, Span, spans
from automarine_cli.logs.table import few_words, means_thruster_test
from automarine_cli.pipeline.parallel import ordered_map
from automarine_cli.pipeline.progress import Progress, silent
from automarine_cli.report.tables import number
from automarine_cli.runs.command_range import CommandRange, misfit_of
from automarine_cli.runs.load import read_runs, unreadable
from automarine_cli.runs.look import RunKind, kind_of
from automarine_cli.runs.run import SetAside
from automarine_cli.workflows.campaign_file import KINDS
from automarine_cli.workflows.campaign_maps import Layout, Maps, joins_of, maps_of, quantities_of, recognised, together

HELD_BACK = ("valid", "hold", "verif")  # how folders of runs begin that no fit may see
VALIDATION = "_validation"  # and how they may end
TURNED_ROUND = 0.8  # share of the steps that turn against their moment, from which a sign is asked for


@dataclass(frozen=True)
class Look:
    """Everything that was seen: kinds of files with what their columns are taken for, the map of all columns, the runs
    of each yaw log, what could not be read; and the logs of translations, by motion and kind. `unread` are logs that
    show what they are only once a question is answered, `strangers` are files of no vehicle.
    """

    folder: Path
    layouts: tuple[Layout, ...]
    maps: Maps
    runs: Mapping[LogFile, tuple[RunKind, ...]]
    set_aside: tuple[SetAside, ...]
    placed: Mapping[str, tuple[LogFile, ...]] = field(default_factory=dict)
    forces: Mapping[str, Mapping[str, tuple[LogFile, ...]]] = field(default_factory=dict)
    unread: tuple[LogFile, ...] = ()
    strangers: tuple[LogFile, ...] = ()

    @property
    def count(self) -> int:
        """How many logs could be read, or will be once the questions are answered."""
        bad = {one.file for one in self.set_aside}
        return sum(file.name not in bad for layout in self.layouts for file in layout.files)

    @property
    def columns(self) -> tuple[Recognised, ...]:
        """What columns are taken for, each meaning once."""
        every = [one for layout in self.layouts for one in layout.columns]
        return tuple({(one.key, one.source, str(one.rule)): one for one in reversed(every)}.values())[::-1]

    @property
    def thrusters_drive(self) -> bool:
        """Whether the yaw logs hold thruster commands and no moment."""
        return self.commands != () and not {one.key for one in self.columns} & set(names_of(YAW.command))

    @property
    def commands(self) -> tuple[str, ...]:
        """The columns of the commands of both thrusters, none where the logs do not hold both."""
        found = {one.key: one.source for one in self.columns if one.key in YAW.thrusters}
        return tuple(found.values()) if driven(YAW, found.keys()) else ()

    @property
    def misfit(self) -> str:
        """How the commands of the logs do not fit those of the bollard tests, which would make their map; "" where
        they do."""
        ends = {one.key: end for layout in self.layouts for one in layout.columns
                if (end := layout.ends(one)) is not None}  # fmt: skip
        if not {"n", *YAW.thrusters} <= ends.keys():
            return ""
        (*tests, _), unit = ends["n"], next(one.rule.get("unit", "") for one in self.columns if one.key == "n")
        seen = [CommandRange(*ends[side], YAW.thrusters, (tests[0], tests[1]), str(unit)) for side in YAW.thrusters]
        found = misfit_of(seen)
        return found.sentence if found else ""

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


def look_at(
    folder: Path, files: Sequence[LogFile], given: ColumnMap, jobs: int = 1, progress: Progress = silent
) -> Look:
    """Look at every log: its columns first (as `given` where the user has a map), then which files are one log, then
    its runs by what the columns are taken for, then its kind."""
    logs = whole_logs(files, given)
    names = partial(_columns_of, columns=given)
    seen = ordered_map(names, logs, jobs, progress=progress, stage="looking at columns")
    beside: list[Layout] = []
    if not given.join:
        apart = [one for one in _recognised(_layouts(logs, seen), given) if one.dof.wraps]
        given = replace(given, join=joins_of(apart, folder))
        clocks = maps_of([one.clock for one in apart], logs, folder, given).columns()
        found = dict(zip(logs, seen))
        logs = whole_logs(logs, given)
        beside = [one.clock for one in apart if not set(one.files) & set(logs)]
        found |= {file: _columns_of(file, clocks) for file in logs if _joined(given, file)}
        seen = [found[file] for file in logs]
    aside = [one for one in seen if isinstance(one, SetAside)]
    every = _recognised(_layouts(logs, seen), given)
    own = {file for one in every if not one.foreign for file in one.files}
    strangers = tuple(file for file in logs if own and file not in own)
    if strangers:  # what their columns do says nothing of columns of that name in the logs
        every = _recognised([one for one in _layouts(logs, seen) if own & set(one.files)], given)
    layouts = tuple(every)
    maps = maps_of([*(one for one in layouts if one.dof.wraps), *beside], files, folder, given)
    columns = maps.columns()
    tests = [file for layout in layouts if layout.bollard for file in layout.files]
    aside += [bad for bad in ordered_map(partial(_test_of, columns=columns), tests, jobs) if bad]
    yaw = [file for layout in layouts if layout.dof.wraps and not layout.bollard for file in layout.files]
    read = partial(_runs_of, columns=columns, dof=YAW)
    runs = ordered_map(read, yaw, jobs, progress=progress, stage="looking at runs")
    headed = any(YAW.position not in layout.lacking for layout in layouts if not layout.bollard)
    unread = {
        file
        for layout in layouts
        if not (headed and YAW.position in layout.lacking)
        and (layout.lacking or any(column.open for column in layout.columns))
        for file in layout.files
    }
    unread -= {file for file, (good, _) in zip(yaw, runs) if good}
    aside += [one for file, (_, bad) in zip(yaw, runs) if file not in unread for one in bad]
    bad_tests = {one.file for one in aside}
    good_runs = dict(zip(yaw, (good for good, _ in runs)))
    ordered = tuple(file for file in yaw if file in unread)
    found_look = Look(folder, layouts, maps, good_runs, tuple(aside), unread=ordered, strangers=strangers)
    kept = [file for file in logs if file not in tests or file.name not in bad_tests]
    return _with_planar(_with_forces(_placed(found_look, kept, set(tests)), logs))


def _joined(columns: ColumnMap, file: LogFile) -> bool:
    """Whether other files are joined to a log, or would be if they were there."""
    try:
        return bool(columns.beside(file.path))
    except LogError:
        return True


Seen = tuple[tuple[str, ...], bool, str, dict[str, Span], dict[str, tuple[str, ...]]]


def _columns_of(file: LogFile, columns: ColumnMap) -> Seen | SetAside:
    """Names, whether it is a thruster test, the motion, and what the columns of a log do; or why it cannot be read."""
    try:
        own = columns.of(file.path)
        raw = whole_log(file, own)
        mapped = {name: rule.source for name, rule in own.columns.items() if rule.source in raw.names}
    except LogError as error:
        return unreadable(file, error)
    dof = motion_of(raw.names, mapped)
    held = quantities_of([*raw.names, *mapped])
    names = tuple(name for name in raw.names if name)
    named = {key: labels.names for key, labels in few_words(raw, {*LABELS, *mapped.values()}).items()}
    words = {} if RUN in raw.names or RUN in own.columns or BY in own.columns else named
    return names, means_thruster_test(held, names, dof), dof.name, spans(raw), words


def _layouts(files: Sequence[LogFile], seen: Sequence[Seen | SetAside]) -> list[Layout]:
    """Files of the same columns together: yaw first, and of yaw those with more logs."""
    groups: dict[
        tuple[tuple[str, ...], bool, str], list[tuple[LogFile, dict[str, Span], dict[str, tuple[str, ...]]]]
    ] = {}
    for file, one in zip(files, seen):
        if not isinstance(one, SetAside):
            groups.setdefault(one[:3], []).append((file, *one[3:]))
    found = [
        Layout(
            names,
            bollard,
            tuple(file for file, *_ in group),
            together([span for _, span, _ in group]),
            DOFS[motion],
            words=group[0][2],
        )
        for (names, bollard, motion), group in groups.items()
    ]
    return sorted(found, key=lambda one: (one.dof is not YAW, one.bollard, -len(one.files)))


def _recognised(layouts: Sequence[Layout], given: ColumnMap) -> list[Layout]:
    """The layouts of yaw and of tests with what their columns are taken for: a column of one name does what it does
    over all logs of the kind."""
    found = []
    for layout in layouts:
        alike = together([one.seen for one in layouts if one.bollard == layout.bollard and one.dof is layout.dof])
        found.append(recognised(layout, alike, given) if layout.dof.wraps else layout)
    return found


def _test_of(file: LogFile, columns: ColumnMap) -> SetAside | None:
    """Why a bollard test cannot be read by the map."""
    try:
        require_thruster(read_log(file, columns, dof=YAW))
    except LogError as error:
        return unreadable(file, error)
    return None


def _runs_of(file: LogFile, columns: ColumnMap, dof: Dof) -> tuple[tuple[RunKind, ...], list[SetAside]]:
    try:
        runs, aside = read_runs(LogFile(file.path, file.name, False), columns, dof=dof)
    except LogError as error:  # a guess that does not fit this log
        return (), [unreadable(file, error)]
    return tuple(kind_of(run) for run in runs), aside


def _placed(look: Look, files: Sequence[LogFile], tests: set[LogFile]) -> Look:
    """Each log under the kind of test that it is; those that only an answer makes readable as steps; those that could
    not be read nowhere."""
    placed: dict[str, list[LogFile]] = {kind: [] for kind in KINDS}
    for file in files:
        kind = "thrusters" if file in tests else _kind_of(file, look.runs.get(file, ()), file in look.unread)
        if kind:
            placed[kind].append(file)
    return replace(look, placed={kind: tuple(found) for kind, found in placed.items()})


def _kind_of(file: LogFile, runs: Sequence[RunKind], unread: bool = False) -> str:
    """The kind of test that a log of runs holds; none where nothing is commanded."""
    kinds = Counter(run.kind for run in runs)
    if not unread and (not kinds or set(kinds) == {"idle"}):
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
            runs[file], bad = _runs_of(file, look.maps.given, layout.dof)
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
    there = quantities_of(names)
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
