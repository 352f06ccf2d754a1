"""`load_runs`: all logs of a campaign become runs; what is unusable is set aside with its reason.

Runs of motion in the plane (`read_planar`) hold heading and moment as in yaw, and as `extras`, where logged, `north`
and `east` [m], `surge` and `sway` [m/s], `yaw_rate` [rad/s], `force_X` and `force_Y` [N]; NaN where a sensor has no
reading of its own.
"""

import contextlib
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from automarine_cli.dofs import SURGE, SWAY, YAW, Dof
from automarine_cli.dofs.motion import PLANAR
from automarine_cli.errors import FitError, LogError, RunError
from automarine_cli.logs import ColumnMap, LogFile, Logs, LogTable, find_logs, read_log, require_motion
from automarine_cli.logs.canonical import driven, names_of
from automarine_cli.pipeline.parallel import ordered_map
from automarine_cli.pipeline.progress import Progress, silent
from automarine_cli.quantities import Floats
from automarine_cli.runs.allocation_limits import AllocationLimit, within_limits
from automarine_cli.runs.checks import IN_OTHER_UNITS, RADIANS_AS_DEGREES, clock_trouble
from automarine_cli.runs.clean import Indices, Mask, NotUsable, clean, too_short
from automarine_cli.runs.run import Run, SetAside, named_apart, own_name

OfOneLog = tuple[list[Run], list[SetAside]]
ANGLE_SLACK = 1.001
RADIANS_SEEN = "wraps at 2 pi where"
"""What the proof says of radians that are called degrees; the others are of degrees called radians."""
Reading = Callable[..., OfOneLog]

MOST_REASONS = 3  # reasons shown when nothing is left
PAYS_FROM = 3000  # logs; to start processes takes longer than to read fewer


@dataclass(frozen=True)
class Campaign:
    """The runs of one campaign on one clock, in file order; what was set aside; the files read (those that have
    bytes to read: no links that lead nowhere); what was commanded beyond the limits of the thrusters."""

    runs: tuple[Run, ...]
    set_aside: tuple[SetAside, ...]
    inputs: tuple[LogFile, ...]
    limits: tuple[AllocationLimit, ...] = ()


def load_runs(
    logs: Logs, columns: ColumnMap | None = None, *, dof: Dof, strict: bool = False, progress: Progress = silent,
    jobs: int = 1, read: Reading | None = None,
) -> Campaign:  # fmt: skip
    """Read and clean the logs of a motion meant by files, directories and globs, on `jobs` processes.

    `read` is what makes runs of logs, by default `read_runs`. Raises LogError or RunError for a log named
    on the command line that cannot be read right, for anything that would be set aside if `strict`, and if no run is
    left.
    """
    files = find_logs(logs)
    work = partial(read or read_runs, columns=columns, dof=dof)
    runs: list[Run] = []
    aside: list[SetAside] = []
    jobs = jobs if len(files) > PAYS_FROM else 1
    for good, bad in ordered_map(work, files, jobs, progress=progress, stage="reading logs"):
        runs += good
        aside += bad
    if strict and aside:
        raise refused_by_strict(aside[0])
    if not runs:
        raise none_left(len(files), aside)
    _refuse_other_units(aside, files, columns, dof)
    limited, limits = within_limits(_one_unit(named_apart(runs)))
    return Campaign(tuple(limited), tuple(aside), tuple(filter(has_bytes, files)), limits)


def _refuse_other_units(
    aside: Sequence[SetAside], files: Sequence[LogFile], columns: ColumnMap | None, dof: Dof
) -> None:
    """Raise RunError where a log proves that a column of angles is in another unit than it was read in, and other logs
    that were read alike look so too: they are as wrong, and only smoother."""
    proof = next((run for run in aside if run.why.startswith(IN_OTHER_UNITS)), None)
    if proof is None:
        return
    maps = {file.name: (columns or ColumnMap()).of(file.path).columns for file in files}
    bad = {run.file for run in aside}
    others = [file for file in files if file.name not in bad and maps[file.name] == maps[proof.file]]
    spans = []
    for file in others:
        with contextlib.suppress(LogError):
            position = read_log(file, columns, dof=dof).columns.get(dof.position)
            spans += [] if position is None else [float(np.nanmax(position) - np.nanmin(position))]
    radians = RADIANS_SEEN in proof.why
    turn = RADIANS_AS_DEGREES if radians else dof.turn
    alike = sum(0.5 * turn < span <= ANGLE_SLACK * turn if radians else span > ANGLE_SLACK * turn for span in spans)
    if alike > 0.5 * len(spans):
        many = f"{alike} other log{'s' * (alike != 1)}"
        raise RunError(
            f"{proof.file}, run {proof.run!r}: {proof.why}. The same column of {many} looks so too, and nothing "
            "was used; where only one log differs, give it a map of its own under [[columns_of]]"
        )


def has_bytes(file: LogFile) -> bool:
    """Whether a log has bytes that can be told by their hash: a link that leads nowhere has none."""
    return file.content is not None or (file.path.is_file() and os.access(file.path, os.R_OK))


def refused_by_strict(first: SetAside) -> RunError:
    """The refusal of `--strict` for the first run that would be set aside."""
    return RunError(f"{first.file}, run {first.run!r}: {first.why} (refused because of --strict)")


def none_left(files: int, aside: Sequence[SetAside]) -> RunError:
    """The refusal of a campaign of which nothing is left, with the first reasons."""
    why: dict[str, list[str]] = {}
    for one in aside:
        why.setdefault(one.why, []).append(one.file)
    told = list(why.items())[:MOST_REASONS]
    reasons = [f"{names[0]}{f' and {len(names) - 1} more' * (len(names) > 1)}: {said}" for said, names in told]
    if left := len(aside) - sum(len(names) for _, names in told):
        reasons.append(f"and {left} more")
    return RunError(f"no usable run in {files} log{'s' * (files != 1)}: {'; '.join(reasons)}")


@contextlib.contextmanager
def told_beside(aside: Sequence[SetAside]) -> Iterator[None]:
    """Whoever is refused for want of runs is also told how many were set aside before, and why the first was."""
    try:
        yield
    except (FitError, RunError) as refusal:
        if not aside:
            raise
        count = f"{len(aside)} runs were" if len(aside) > 1 else "1 run was"
        first = f"{', the first' * (len(aside) > 1)}: {aside[0].file}, run {aside[0].run!r}: {aside[0].why}"
        raise type(refusal)(f"{refusal} ({count} set aside before{first})") from None


def read_runs(file: LogFile, columns: ColumnMap | None = None, *, dof: Dof | None) -> OfOneLog:
    """Read the runs of a log of a motion (None: whichever its columns show), and those set aside. Raises LogError or
    RunError if the log was named and is unreadable.
    """
    try:
        return runs_of_table(file, read_log(file, columns, dof=dof))
    except LogError as error:
        return [], [unreadable(file, error)]


def unreadable(file: LogFile, error: Exception, run: str | None = None) -> SetAside:
    """A log, or a run of it, that was found and cannot be read right. Raises the error where the log was named."""
    if file.named:
        raise error
    why = str(error).removeprefix(file.name).lstrip(":, ")  # the result has the file's name in a field of its own
    return SetAside(file.name, own_name(file.name) if run is None else run, why)


def runs_of_table(file: LogFile, table: LogTable) -> OfOneLog:
    """The runs of a table, and those set aside. Raises LogError or RunError if the log was named and is unusable, or
    is none of its motion."""
    require_motion(table)
    runs: list[Run] = []
    aside: list[SetAside] = []
    for name, rows in rows_of_runs(table):
        try:
            parts = clean(table, rows, name)
        except NotUsable as error:
            aside.append(SetAside(file.name, name, str(error)))
            continue
        except RunError as error:
            aside.append(unreadable(file, error, name))
            continue
        for part in parts:
            why = (clock_trouble(part.time) or too_short(part)) if len(parts) > 1 else None
            if why is None:
                runs.append(part)
            else:
                aside.append(SetAside(file.name, part.name, f"{why} ({part.notes[-1]})"))
    return runs, aside


def rows_of_runs(table: LogTable) -> Iterator[tuple[str, Indices]]:
    """Return the names of the runs of a table, in the order in which they begin, and the rows of each."""
    code = table.run_code
    if code is None:
        return iter([(own_name(table.source), np.arange(len(table)))])
    order = np.argsort(code, kind="stable")  # runs may take turns
    return zip(table.run_names, np.split(order, np.searchsorted(code[order], np.arange(1, len(table.run_names)))))


def _one_unit(runs: Sequence[Run]) -> tuple[Run, ...]:
    """All commands of a campaign in one unit. Raises RunError where normalised ones and others are mixed."""
    units = {run.moment_unit: run for run in runs if run.moment is not None}
    if len(units) > 1:
        first, second = list(units.values())[:2]
        raise RunError(
            f"{first.source} gives its {first.dof.words.force} in {first.moment_unit}, {second.source} in "
            f"{second.moment_unit}; expected one unit in a campaign. Analyse them apart, or map both "
            f"columns to {' or to '.join(names_of(first.dof.command))} with --columns"
        )
    return tuple(runs)


EQUATORIAL_RADIUS, FLATTENING = 6_378_137.0, 1 / 298.257223563  # m; World Geodetic System 1984
SENSORS = (("north", "east"), ("surge",), ("sway",), ("yaw_rate",))  # Quantities that come out of one sensor each


def read_planar(file: LogFile, columns: ColumnMap | None = None, *, dof: Dof = YAW) -> OfOneLog:
    """Read the runs of a log of motion in the plane, and those set aside. Raises LogError or RunError if the log was
    named and is unreadable, or drives nothing but the heading."""
    try:
        table = read_log(file, columns, dof=dof, motion=PLANAR)
        _require_forces(table)
        runs, aside = runs_of_table(file, _with_forces(table))
    except LogError as error:
        return [], [unreadable(file, error)]
    return [_with_fresh_readings(_on_the_water(run)) for run in runs], aside


def local_plane(latitude: Floats, longitude: Floats) -> tuple[Floats, Floats]:
    """Metres north and east of the first fix, of latitudes and longitudes [rad] (N,) of which some may be NaN.

    Radii of curvature of the meridian and the prime vertical at the first fix (WGS 84); Fossen (2021), chapter 2. A
    kilometre away the error is below 0.2 m at the latitudes where ships go. A fix of exactly 0, 0 is none.
    """
    none = ~(np.isfinite(latitude) & np.isfinite(longitude)) | ((latitude == 0) & (longitude == 0))
    if none.all():
        return np.full(len(none), np.nan), np.full(len(none), np.nan)
    first = int(np.argmin(none))
    eccentricity2 = FLATTENING * (2.0 - FLATTENING)
    below = 1.0 - eccentricity2 * np.sin(latitude[first]) ** 2
    prime_vertical = EQUATORIAL_RADIUS / np.sqrt(below)
    meridian = prime_vertical * (1.0 - eccentricity2) / below
    east = (longitude - longitude[first] + np.pi) % (2.0 * np.pi) - np.pi  # across the date line too
    north = meridian * (latitude - latitude[first])
    east = prime_vertical * np.cos(latitude[first]) * east
    return np.where(none, np.nan, north), np.where(none, np.nan, east)


def _require_forces(table: LogTable) -> None:
    """Refuse a table that drives nothing but the heading, or in normalised units, of which each has a scale of its
    own."""
    for dof in PLANAR.dofs:
        unit, newtons = table.units.get(dof.command), dof.units.forces[1]
        if unit not in (None, newtons):
            name = dof.column(dof.command, str(unit))
            raise LogError(
                f"{table.source}: {dof.command.replace('_', ' ')} is normalised ({name}); motions that are coupled "
                f"need newtons and newton metres. Map it with a scale, such as {dof.column(dof.command, newtons)} = "
                f'{{ from = "{name}", scale = 40 }}, in a --columns file'
            )
    pushed = any(dof.command in table.columns for dof in (SURGE, SWAY))
    if not pushed and not driven(YAW, table.columns.keys()):
        wanted = " or ".join(dof.column(dof.command, "N") for dof in (SURGE, SWAY))
        raise LogError(
            f"{table.source}: no force in the log ({wanted}), by which surge and sway are driven; name its column "
            "with --columns, or give the log to automarine fit-yaw"
        )


def _with_forces(table: LogTable) -> LogTable:
    """The table without headings where a force is missing: `clean` drops these rows, and counts them."""
    heading = table.columns.get(YAW.position)
    if heading is None:
        return table
    for dof in (SURGE, SWAY):
        heading = np.where(np.isnan(table.columns.get(dof.command, heading)), np.nan, heading)
    return replace(table, columns={**table.columns, YAW.position: heading})


def _on_the_water(run: Run) -> Run:
    if not {"lat", "lon"} <= run.extras.keys() or {"north", "east"} <= run.extras.keys():
        return run
    north, east = local_plane(run.extras["lat"], run.extras["lon"])
    left = {name: column for name, column in run.extras.items() if name not in ("lat", "lon")}
    return replace(run, extras={**left, "north": north, "east": east})


def _with_fresh_readings(run: Run) -> Run:
    for names in SENSORS:
        again = repeats(*(run.extras[name] for name in names)) if run.extras.keys() >= {*names} else np.zeros(1)
        if not again.any():
            continue
        fresh = {name: np.where(again, np.nan, run.extras[name]) for name in names}
        share, which = 100 * float(again.mean()), " and ".join(names).replace("_", " ")
        note = (
            f"{which}: {share:.0f} % of the rows repeat the reading before them, as of a slow sensor, and do not count"
        )
        extras, notes, reading = {**run.extras, **fresh}, (*run.notes, note), (*run.reading, note)
        run = replace(run, extras=extras, notes=notes, reading=reading)
    return run


FEWEST = 8  # Changes of a value that tell anything of its sensor
FINE = 5.0  # A median step of so many of the smallest steps or more: two readings in a row are then hardly ever equal
COARSE = 2.0  # The same below which a value that stands may as well be one that creeps
FEW = 0.1  # Share of repeats below which they are chance, and cost nothing
BESIDE = 0.1
"""Share of changes that follow each other without a row between, up to which a coarse sensor counts as held."""


def repeats(*columns: Floats) -> Mask:
    """Which rows (N,) repeat the reading before them; `columns` (N,) come out of one sensor, NaN where it is silent.

    None where the sensor is read in every row: a coarse one may give the same number twice. Of a held one the first
    row is a repeat too, for nobody knows how old its reading is.
    """
    values = np.stack(columns)
    seen = np.all(np.isfinite(values), axis=0)
    found = np.zeros(values.shape[1], dtype=bool)
    steps = np.abs(np.diff(values[:, seen], axis=1))
    changed, sizes = np.any(steps > 0, axis=0), steps[steps > 0]
    if np.count_nonzero(changed) < FEWEST or changed.mean() > 1 - FEW:
        return found
    coarseness, spans = float(np.median(sizes) / sizes.min()), np.diff(np.flatnonzero(changed))
    often = coarseness >= COARSE and bool(np.median(spans) >= 2 and np.mean(spans == 1) <= BESIDE)
    if coarseness < FINE and not often:
        return found
    found[seen] = np.concatenate([[True], ~changed])
    return found
