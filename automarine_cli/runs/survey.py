"""A folder of logs at a first look: what its columns are taken for, its runs, and what kind of test each log is."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from automarine_cli.dofs import DOFS, SURGE, SWAY, YAW, Dof
from automarine_cli.dofs.motion import PLANAR
from automarine_cli.errors import LogError
from automarine_cli.logs import ColumnMap, LogFile, read_log, require_thruster
from automarine_cli.logs.canonical import driven, names_of
from automarine_cli.logs.layouts import Layout, Maps, layouts_of, quantities_of
from automarine_cli.logs.recognise import Recognised
from automarine_cli.pipeline.parallel import ordered_map
from automarine_cli.pipeline.progress import Progress, silent
from automarine_cli.runs.command_range import CommandRange, misfit_of
from automarine_cli.runs.load import read_runs, unreadable
from automarine_cli.runs.look import RunKind, kind_of
from automarine_cli.runs.run import SetAside

HELD_BACK = ("valid", "hold", "verif")  # how folders of runs begin that no fit may see
VALIDATION = "_validation"  # and how they may end
TURNED_ROUND = 0.8  # share of the steps that turn against their moment, from which a sign is asked for

Placed = Mapping[str, tuple[LogFile, ...]]
"""Logs by the kind of test that they are."""


@dataclass(frozen=True)
class Survey:
    """Everything that was seen: kinds of files with what their columns are taken for, the map of all columns, the runs
    of each log, what could not be read; the logs of yaw and the bollard tests by kind, and those of other motions.
    `unread` are logs that show what they are only once a question is answered, `strangers` are files of no vehicle.
    """

    folder: Path
    layouts: tuple[Layout, ...]
    maps: Maps
    runs: Mapping[LogFile, tuple[RunKind, ...]]
    set_aside: tuple[SetAside, ...]
    placed: Placed
    forces: Mapping[str, Placed]
    unread: tuple[LogFile, ...]
    strangers: tuple[LogFile, ...]

    @property
    def count(self) -> int:
        bad = {run.file for run in self.set_aside}
        return sum(file.name not in bad for layout in self.layouts for file in layout.files)

    @property
    def columns(self) -> tuple[Recognised, ...]:
        every = [column for layout in self.layouts for column in layout.columns]
        unique = {(column.key, column.source, str(column.rule)): column for column in reversed(every)}
        return tuple(unique.values())[::-1]

    @property
    def thrusters_drive(self) -> bool:
        return self.commands != () and not {column.key for column in self.columns} & set(names_of(YAW.command))

    @property
    def commands(self) -> tuple[str, ...]:
        """The columns of the commands of both thrusters, none where the logs do not hold both."""
        sides = {column.key: column.source for column in self.columns if column.key in YAW.thrusters}
        return tuple(sides.values()) if driven(YAW, sides.keys()) else ()

    @property
    def misfit(self) -> str:
        """How the commands of the logs do not fit those of the bollard tests, which would make their map; "" where
        they do."""
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
        others = {file for kinds in self.forces.values() for files in kinds.values() for file in files}
        kinds = [kind for file, runs in self.runs.items() if file not in others for kind in runs]
        return sum(kind.with_moment for kind in kinds), sum(kind.against for kind in kinds)

    @property
    def turned_round(self) -> bool:
        """Whether nearly all turn against their moment: heading or moment counts the other way."""
        good, bad = self.turns
        return bad >= 2 and bad >= TURNED_ROUND * (good + bad)


def survey(
    folder: Path, files: Sequence[LogFile], columns: ColumnMap, jobs: int = 1, progress: Progress = silent
) -> Survey:
    """Look at every log: its columns first (by the map `columns` where the user has one), then which files are one
    log, then its runs by what the columns are taken for, then its kind."""
    layouts = layouts_of(folder, files, columns, jobs, progress)
    taken_for = layouts.maps.columns()
    layout_of = {file: layout for layout in layouts for file in layout.files}
    tests = [file for file, layout in layout_of.items() if layout.bollard]
    yaw = [file for file, layout in layout_of.items() if layout.dof.wraps and not layout.bollard]
    aside = [unreadable(file, error) for file, error in layouts.unread.items()]
    aside += [bad for bad in ordered_map(partial(_test_of, columns=taken_for), tests, jobs) if bad]
    read = ordered_map(
        partial(_runs_of, columns=taken_for, dof=YAW), yaw, jobs, progress=progress, stage="looking at runs"
    )
    runs = {file: kinds for file, (kinds, _) in zip(yaw, read)}
    headed = any(YAW.position not in layout.lacking for layout in layouts if not layout.bollard)
    unread = set()
    for file in yaw:
        lacking, columns_open = layout_of[file].lacking, any(column.open for column in layout_of[file].columns)
        if (lacking or columns_open) and not runs[file] and not (headed and YAW.position in lacking):
            unread.add(file)
    aside += [run for file, (_, bad) in zip(yaw, read) if file not in unread for run in bad]
    unusable = {run.file for run in aside}
    placed: dict[str, list[LogFile]] = {kind: [] for kind in ("thrusters", "steps", "manoeuvres", "validation")}
    forces: dict[str, dict[str, list[LogFile]]] = {}
    for file in layouts.logs:
        layout = layout_of.get(file)
        if file in runs and (kind := _kind_of(file, runs[file], file in unread)):
            placed[kind].append(file)
        elif layout and layout.bollard and file.name not in unusable:
            placed["thrusters"].append(file)
        if layout and not (dof := layout.dof).wraps:
            runs[file], bad = _runs_of(file, columns, dof)
            aside += bad
            if kind := _kind_of(file, runs[file]):
                kinds = forces.setdefault(dof.name, {name: [] for name in ("steps", "manoeuvres", "validation")})
                kinds[kind].append(file)
    forces = {motion: forces[motion] for motion in DOFS if motion in forces}
    together = {file for file in yaw + tests if layout_of[file].dof is YAW and _of_three(layout_of[file].names)}
    if together:
        held_back = [file for file in placed["validation"] if file in together]
        driving = [file for files in placed.values() for file in files if file in together and file not in held_back]
        forces[PLANAR.name] = {"runs": driving, "validation": held_back}
        placed = {kind: [file for file in files if file not in together] for kind, files in placed.items()}

    def fixed(kinds: Mapping[str, Sequence[LogFile]]) -> Placed:
        return {kind: tuple(files) for kind, files in kinds.items()}

    return Survey(
        folder, layouts.layouts, layouts.maps, runs, tuple(aside), fixed(placed),
        {motion: fixed(kinds) for motion, kinds in forces.items()},
        tuple(file for file in yaw if file in unread), layouts.strangers,
    )  # fmt: skip


def _test_of(file: LogFile, columns: ColumnMap) -> SetAside | None:
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


def _kind_of(file: LogFile, runs: Sequence[RunKind], unread: bool = False) -> str:
    """The kind of test that a log of runs holds; none where nothing is commanded. A log that only an answer makes
    readable is taken for steps."""
    kinds = Counter(run.kind for run in runs)
    if not unread and (not kinds or set(kinds) == {"idle"}):
        return ""
    if any(part.lower().startswith(HELD_BACK) or part.lower().endswith(VALIDATION) for part in file.name.split("/")):
        return "validation"
    return "manoeuvres" if kinds["manoeuvre"] else "steps"


def _of_three(names: Sequence[str]) -> bool:
    there = quantities_of(names)
    pushed = {SURGE.command, SWAY.command} & there
    moved = {SURGE.velocity, SWAY.velocity} & there or {"north", "east"} <= there
    return YAW.position in there and bool(pushed) and bool(moved)
