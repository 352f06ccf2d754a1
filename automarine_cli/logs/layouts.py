"""Kinds of files in a folder: which columns each has and what they are taken for, which files are one log, and the
column map that fits them all."""

import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path

import numpy as np

from automarine_cli.dofs import DOFS, YAW, Dof
from automarine_cli.errors import LogError
from automarine_cli.logs.canonical import BY, CANONICAL, LABELS, RUN, motion_of
from automarine_cli.logs.columns import OLDEST, ColumnMap, ColumnRule, ColumnsOf, Join, column_rules, matches
from automarine_cli.logs.find import stem_of, whole_logs
from automarine_cli.logs.formats import LogFile
from automarine_cli.logs.reader import whole_log
from automarine_cli.logs.recognise import Recognised, Span, directed, is_called, is_share, recognise, spans
from automarine_cli.logs.table import few_words, means_thruster_test, splitting
from automarine_cli.pipeline.parallel import ordered_map
from automarine_cli.pipeline.progress import Progress, silent
from automarine_cli.pipeline.records import to_mapping
from automarine_cli.quantities import Floats

NEEDED = ("time", YAW.position, YAW.command)
OF_YAW = (*NEEDED, *YAW.thrusters, YAW.velocity, "surge", "sway", "voltage")
BOLLARD = ("n", "force", "time", "voltage")
MOST_LOOKED_INTO = 20  # bollard tests of one layout


@dataclass(frozen=True)
class Layout:
    """Logs with the same columns: whether they are thruster tests, what each column does over all of them, and of which
    motion they are (translations only by columns of those names); what their columns are taken for, and which
    quantities no column looks like."""

    names: tuple[str, ...]
    bollard: bool
    files: tuple[LogFile, ...]
    seen: Mapping[str, Span]
    dof: Dof
    columns: tuple[Recognised, ...] = ()
    lacking: tuple[str, ...] = ()
    words: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def rules(self) -> dict[str, ColumnRule]:
        rules = column_rules({one.key: one.rule for one in self.columns if not one.as_named}, "")
        return rules | {key: ColumnRule(name) for key, name in splitting(self.words, self.bollard).items()}

    @property
    def clock(self) -> "Layout":
        times = tuple(one for one in self.columns if CANONICAL[one.key].quantity == "time")
        return replace(self, columns=times, lacking=(), names=tuple(one.source for one in times))

    def ends(self, one: Recognised) -> tuple[float, float, float] | None:
        """The lowest, the highest and the usual value of a column as its rule reads it."""
        span, rule = self.seen.get(one.source), self.rules.get(one.key, ColumnRule(one.source))
        if span is None or rule.sign_from is not None:
            largest = None if span is None else abs(rule.scale) * span.high
            return None if largest is None else (-largest, largest, 0.0)
        read = [rule.read(value) for value in (span.low, span.high, span.middle)]
        return min(read[:2]), max(read[:2]), read[2]

    @property
    def foreign(self) -> bool:
        of_vehicle = {YAW.position, YAW.velocity, YAW.command, *YAW.thrusters}
        found = {CANONICAL[one.key].quantity for one in self.columns}
        return not self.bollard and self.dof is YAW and not found & of_vehicle


@dataclass(frozen=True)
class Maps:
    """The layouts that share the map of all logs, and those with maps of their own, each with the names by which its
    files are told; which files are one log."""

    shared: tuple[Layout, ...] = ()
    own: tuple[tuple[tuple[str, ...], tuple[Layout, ...]], ...] = ()
    join: tuple[Join, ...] = ()
    given: ColumnMap = field(default_factory=ColumnMap)

    def columns(self) -> ColumnMap:
        parts = tuple(ColumnsOf(names, merged(layouts)) for names, layouts in self.own)
        return replace(self.given, columns=merged(self.shared), columns_of=parts, join=self.join)


def merged(layouts: Sequence[Layout]) -> dict[str, ColumnRule]:
    return {key: rule for layout in reversed(layouts) for key, rule in layout.rules.items()}


def recognised(layout: Layout, alike: Mapping[str, Span], given: ColumnMap) -> Layout:
    """The layout with what its columns are taken for: first as `given`, then by name and by what they do in all logs
    of the kind (`alike`)."""
    known = {}
    for key, rule in given.of(layout.files[0].path).columns.items():
        if key not in LABELS and rule.source in layout.names:
            known[CANONICAL[key].quantity] = _given(key, rule, layout.seen)
    taken = {one.source for one in known.values()}
    names = [name for name in layout.names if name not in taken]
    seen = {name: alike[name] for name in names if name in alike}
    wanted = BOLLARD if layout.bollard else OF_YAW
    found = {quantity: known.get(quantity) or recognise(quantity, names, seen) for quantity in wanted}
    found |= {quantity: one for quantity, one in known.items() if quantity not in found}
    if layout.bollard:
        found |= _tests(found, layout, known)
    elif not all(found[side] is not None for side in YAW.thrusters):
        found |= {side: known.get(side) for side in YAW.thrusters}
    commanded = all(found.get(side) is not None for side in YAW.thrusters)  # in place of a moment
    needed = BOLLARD[:2] if layout.bollard else NEEDED[:2] if commanded else NEEDED
    lacking = tuple(quantity for quantity in needed if found.get(quantity) is None)
    # a column that was recognised as two quantities is the first of them
    first = {column.source: column for column in reversed(list(found.values())) if column is not None}
    return replace(layout, columns=tuple(first.values())[::-1], lacking=lacking)


def _given(key: str, rule: ColumnRule, seen: Mapping[str, Span]) -> Recognised:
    keys = {"source": "from"}
    defaults = ColumnRule(rule.source)
    more = {keys.get(name, name): value for name, value in to_mapping(rule).items()
            if name not in ("source", "unit") and value != getattr(defaults, name)}  # fmt: skip
    if "sign_from" in more and rule.sign_from is not None:
        more["sign_from"] = {"from": rule.sign_from.source, "subtract": rule.sign_from.subtract}
    span = seen.get(rule.source)
    told = "" if span is None or span.stamps else f", {span.low:.5g} to {span.high:.5g}"
    return Recognised(key, rule.source, f"as --columns says{told}", rule.unit, more=more)


def _tests(
    found: Mapping[str, Recognised | None], layout: Layout, known: Mapping[str, Recognised]
) -> dict[str, Recognised | None]:
    n, force = found["n"], found["force"]
    if n is None and force is not None:  # a throttle called thrust, beside a force with its unit
        free = [name for name in layout.names if name.lower().startswith("thrust") and name != force.source]
        throttle = next((name for name in free if name in layout.seen and is_share(layout.seen[name])), None)
        if throttle is not None:
            span = layout.seen[throttle]
            n = Recognised("n", throttle, f"{span.low:.5g} to {span.high:.5g}, a throttle beside {force.source}")
    if n is None or force is None or n.source == force.source or known.keys() & {"n", "force"}:
        return {"n": None if n is not None and force is not None and n.source == force.source else n, "force": force}
    if not force.open or force.unit_open:
        n, force = directed(n, force, _numbers(layout), layout.seen)
    return {"n": n, "force": force}


def _numbers(layout: Layout) -> dict[str, Floats]:
    """The columns of numbers of the tests of a layout, one test after the other."""
    raws = [whole_log(file, ColumnMap()) for file in layout.files[:MOST_LOOKED_INTO]]
    found = {}
    for i, name in enumerate(layout.names):
        if name in layout.seen and not layout.seen[name].stamps:
            arrays = [np.asarray(raw.arrays[i].to_numpy(zero_copy_only=False), dtype=float) for raw in raws]
            found[name] = np.concatenate(arrays)
    return found


def maps_of(layouts: Sequence[Layout], files: Sequence[LogFile], folder: Path, given: ColumnMap) -> Maps:
    """The maps of layouts, of which the first to come has the map of all logs; those that would read each other's
    columns wrong have maps of their own."""
    shared: list[Layout] = []
    own: list[list[Layout]] = []
    for layout in layouts:
        groups = (part for part in (shared, *own) if all(_fits(layout, o) and _fits(o, layout) for o in part))
        group = next(groups, None)
        if group is None:
            own.append(group := [])
        group.append(layout)
    named = []
    for group in own:
        named.append((_names([file for layout in group for file in layout.files], files, folder), tuple(group)))
    return Maps(tuple(shared), tuple(named), given.join, given)


def _fits(one: Layout, other: Layout) -> bool:
    """Whether the rules of `one` read nothing of `other` but what its own rules read."""
    theirs = {taken.key: taken.rule for taken in other.columns}
    quantities = {CANONICAL[key].quantity: key for key in theirs}
    for taken in one.columns:
        key = quantities.get(CANONICAL[taken.key].quantity)
        same = key == taken.key and theirs[taken.key] == taken.rule
        if not same and not taken.as_named and (key == taken.key or taken.source in other.names):
            return False
    return True


def _names(wanted: Sequence[LogFile], every: Sequence[LogFile], folder: Path) -> tuple[str, ...]:
    inner = {file: _within(folder, file).as_posix() for file in every}
    names = []
    for place in places_of([inner[file] for file in wanted], list(inner.values())):
        stray = any(file not in wanted and matches(file.path, place) for file in every)
        names.append(f"{folder.resolve().name}/{place}" if stray else place)
    return tuple(names)


def _within(folder: Path, file: LogFile) -> Path:
    return Path(os.path.relpath(file.path.resolve(), folder.resolve()))


def joins_of(kinds: Sequence[Layout], folder: Path) -> tuple[Join, ...]:
    """Return which files of a folder are one log, by their names: those that hold what moves beside those that hold
    what drives."""
    moving = [layout for layout in kinds if _moves(layout) and not _drives(layout)]
    main = [_within(folder, file) for layout in moving for file in layout.files]
    driving = [
        layout for layout in kinds if not _moves(layout) and (_drives(layout) or _goes_with(layout, main, folder))
    ]
    others = [_within(folder, file) for layout in driving for file in layout.files]
    found: dict[tuple[str, str], None] = {}
    for path in main:
        pair = next(filter(None, (_pattern(path, other) for other in others)), None)
        near = [other for other in others if other.parent == path.parent]
        if pair is None and len(near) == 1:
            pair = path.name, near[0].name
        if pair is not None:
            found.setdefault(pair)
    longest = max(map(_longest_gap, driving), default=0.0)
    age = OLDEST if longest < OLDEST else float(np.ceil(1.1 * longest))
    return tuple(Join(*pair, max_age_s=age) for pair in found)


def _goes_with(layout: Layout, main: Sequence[Path], folder: Path) -> bool:
    """Whether each file with a clock stands, by its name, beside one that holds what moves: then it holds what drives,
    whatever that is called."""
    paired = all(any(_pattern(other, _within(folder, file)) for other in main) for file in layout.files)
    clock, signal = (recognise(quantity, layout.names, layout.seen) for quantity in ("time", "n"))
    return paired and clock is not None and not (layout.bollard and signal is not None)


def _moves(layout: Layout) -> bool:
    return is_called(YAW.position, layout.names) or is_called(YAW.velocity, layout.names)


def _drives(layout: Layout) -> bool:
    sides = all(is_called(side, layout.names) for side in YAW.thrusters)
    return not layout.bollard and (sides or any(is_called(dof.command, layout.names) for dof in DOFS.values()))


def _longest_gap(layout: Layout) -> float:
    """The longest time [s] between two rows of a file that is written seldom; none of one that pauses now and then."""
    clock = recognise("time", layout.names, layout.seen)
    if clock is None:
        return 0.0
    unit = {"time_ms": 1e-3, "time_us": 1e-6}.get(clock.key, 1.0)
    span = layout.seen[clock.source]
    return unit * span.largest_step if 3 * unit * span.median_step > OLDEST else 0.0


def _pattern(one: Path, other: Path) -> tuple[str, str] | None:
    """Patterns of two names that differ in one word: nav_*.csv and cmd_*.csv, or nav/*.csv and cmd/*.csv."""
    if one.name == other.name and one.parent.parent == other.parent.parent and one.parent != other.parent:
        return f"{one.parent.name}/*{one.suffix}", f"{other.parent.name}/*{other.suffix}"
    stems = [stem_of(path.name) for path in (one, other)]
    words = [re.split(r"([_\-. ]+)", stem) for stem in stems]
    if one.parent != other.parent or len(words[0]) != len(words[1]) or len(words[0]) < 3:
        return None
    differ = [i for i, (mine, theirs) in enumerate(zip(*words)) if mine != theirs]
    if len(differ) != 1:
        return None
    i = differ[0]
    before = "*" + words[0][i - 1] if i else ""
    after = words[0][i + 1] + "*" if i + 1 < len(words[0]) else ""
    endings = [path.name[len(stem) :] for path, stem in zip((one, other), stems)]
    return f"{before}{words[0][i]}{after}{endings[0]}", f"{before}{words[1][i]}{after}{endings[1]}"


def together(seen: Sequence[Mapping[str, Span]]) -> dict[str, Span]:
    spans: dict[str, Span] = {}
    for part in seen:
        spans |= {name: spans[name] + span if name in spans else span for name, span in part.items()}
    return spans


def quantities_of(names: Iterable[str]) -> set[str]:
    return {CANONICAL[name].quantity for name in names if name in CANONICAL}


@dataclass(frozen=True)
class Layouts:
    """Kinds of files of a folder, with what their columns are taken for, and the maps that read them; `logs` are whole
    logs, `strangers` those of no vehicle, `unread` what cannot be read, each with its reason."""

    logs: tuple[LogFile, ...]
    layouts: tuple[Layout, ...]
    maps: Maps
    strangers: tuple[LogFile, ...]
    unread: Mapping[LogFile, LogError]

    def __iter__(self) -> Iterator[Layout]:
        return iter(self.layouts)


def layouts_of(
    folder: Path, files: Sequence[LogFile], given: ColumnMap, jobs: int = 1, progress: Progress = silent
) -> Layouts:
    """Look at the columns of every log (as `given` where the user has a map), and find which files are one log."""
    logs = whole_logs(files, given)
    layout_of = partial(_layout_of, columns=given)
    seen = dict(zip(logs, ordered_map(layout_of, logs, jobs, progress=progress, stage="looking at columns")))
    beside: list[Layout] = []
    if not given.join:
        apart = [layout for layout in _recognised(seen.values(), given) if layout.dof.wraps]
        given = replace(given, join=joins_of(apart, folder))
        clocks = maps_of([layout.clock for layout in apart], logs, folder, given).columns()
        logs = whole_logs(logs, given)
        beside = [layout.clock for layout in apart if not set(layout.files) & set(logs)]
        seen |= {file: _layout_of(file, clocks) for file in logs if any(join.places(file.path) for join in given.join)}
        seen = {file: seen[file] for file in logs}
    layouts = _recognised(seen.values(), given)
    ours = {file for layout in layouts if not layout.foreign for file in layout.files}
    strangers = tuple(file for file in logs if ours and file not in ours)
    if strangers:  # what their columns do says nothing of columns of that name in the logs
        names = {layout.names for layout in layouts if ours & set(layout.files)}
        layouts = _recognised(
            [part for part in seen.values() if isinstance(part, Layout) and part.names in names], given
        )
    maps = maps_of([*(layout for layout in layouts if layout.dof.wraps), *beside], files, folder, given)
    unread = {file: error for file, error in seen.items() if isinstance(error, LogError)}
    return Layouts(tuple(logs), tuple(layouts), maps, strangers, unread)


def _layout_of(file: LogFile, columns: ColumnMap) -> Layout | LogError:
    """The layout of one log; or why it cannot be read."""
    try:
        rules = columns.of(file.path)
        raw = whole_log(file, rules)
    except LogError as error:
        return error
    mapped = {name: rule.source for name, rule in rules.columns.items() if rule.source in raw.names}
    dof = motion_of(raw.names, mapped)
    names = tuple(name for name in raw.names if name)
    labels = few_words(raw, {*LABELS, *mapped.values()})
    split = RUN in raw.names or RUN in rules.columns or BY in rules.columns
    words = {} if split else {key: label.names for key, label in labels.items()}
    bollard = means_thruster_test(quantities_of([*raw.names, *mapped]), names, dof)
    return Layout(names, bollard, (file,), spans(raw), dof, words=words)


def _recognised(parts: Iterable[Layout | LogError], given: ColumnMap) -> list[Layout]:
    """Files of the same columns together, yaw first, and of yaw those with more logs; those of yaw and tests with what
    their columns are taken for: a column of one name does what it does over all logs of the kind."""
    groups: dict[tuple[tuple[str, ...], bool, str], list[Layout]] = {}
    for part in parts:
        if isinstance(part, Layout):
            groups.setdefault((part.names, part.bollard, part.dof.name), []).append(part)
    layouts = [
        replace(group[0], files=tuple(part.files[0] for part in group), seen=together([part.seen for part in group]))
        for group in groups.values()
    ]
    layouts.sort(key=lambda layout: (layout.dof is not YAW, layout.bollard, -len(layout.files)))
    kinds: dict[tuple[bool, str], list[Mapping[str, Span]]] = {}
    for layout in layouts:
        kinds.setdefault((layout.bollard, layout.dof.name), []).append(layout.seen)
    alike = {kind: together(spans_of_kind) for kind, spans_of_kind in kinds.items()}
    return [
        recognised(layout, alike[layout.bollard, layout.dof.name], given) if layout.dof.wraps else layout
        for layout in layouts
    ]


def places_of(wanted: Sequence[str], everywhere: Sequence[str]) -> list[str]:
    """Folders, globs and files (relative, with forward slashes) that mean exactly `wanted` of all logs.

    The folder at the top is never one of them: results that are written into it later would be taken for logs.
    """
    left, found = set(wanted), []
    folders = {"/".join(name.split("/")[:i]) for name in everywhere for i in range(1, name.count("/") + 1)}
    for folder in sorted(folders, key=lambda folder: (folder.count("/"), folder)):  # outer ones first
        if re.search(r"[*?[]", folder):
            continue
        inside = {name for name in everywhere if name.startswith(f"{folder}/")}
        if inside and inside <= left:
            found.append(folder)
            left -= inside
    for glob in _globs(sorted(left)):
        folder = glob.rpartition("/")[0]
        meant = {name for name in everywhere if name.rpartition("/")[0] == folder and fnmatchcase(name, glob)}
        if len(meant & left) > 1 and meant <= set(wanted):
            found.append(glob)
            left -= meant
    return sorted([*found, *left])


def _globs(names: Sequence[str]) -> list[str]:
    wide, narrow = [], []
    for name in names:
        folder, slash, last = name.rpartition("/")
        stem, ending = stem_of(last), last[len(stem_of(last)) :]
        if re.search(r"[*?[]", name):
            continue
        wide.append(f"{folder}{slash}*{ending}")
        word = re.match(r"[A-Za-z]+[_-]?|\d+", stem)
        if word and word[0] != stem:
            narrow += [f"{folder}{slash}{word[0]}*", f"{folder}{slash}{word[0]}*{ending}"]
    return list(dict.fromkeys([*wide, *narrow]))
