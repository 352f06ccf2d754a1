"""Logs of motion in the plane -> runs: heading and moment as in yaw, beside them what else moves and drives.

Of each run `extras` hold, where logged, `north` and `east` [m], `surge` and `sway` [m/s], `yaw_rate` [rad/s], `force_X`
and `force_Y` [N]; NaN where a sensor has no reading of its own (see `held`).
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from automarine_cli.dofs import SURGE, SWAY, YAW, Dof
from automarine_cli.dofs.motion import PLANAR
from automarine_cli.errors import LogError
from automarine_cli.logs import ColumnMap, LogFile, LogTable, read_log
from automarine_cli.logs.canonical import driven
from automarine_cli.quantities import Floats
from automarine_cli.runs.load import OfOneLog, runs_of_table, unreadable
from automarine_cli.runs.run import Run

EQUATORIAL_RADIUS, FLATTENING = 6_378_137.0, 1 / 298.257223563  # m; World Geodetic System 1984
SENSORS = (("north", "east"), ("surge",), ("sway",), ("yaw_rate",))  # Quantities that come out of one sensor each


def read_planar(file: LogFile, columns: ColumnMap | None = None, *, dof: Dof = YAW) -> OfOneLog:
    """Read the runs of a log of motion in the plane, and those set aside.

    Raises LogError or RunError if the log was named and is unreadable, or drives nothing but the heading.
    """
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
    missing = np.zeros(len(table), dtype=bool)
    for dof in (SURGE, SWAY):
        if dof.command in table.columns:
            missing |= np.isnan(table.columns[dof.command])
    if not missing.any() or YAW.position not in table.columns:
        return table
    heading = np.where(missing, np.nan, table.columns[YAW.position])
    return replace(table, columns={**table.columns, YAW.position: heading})


def _on_the_water(run: Run) -> Run:
    if not {"lat", "lon"} <= run.extras.keys() or {"north", "east"} <= run.extras.keys():
        return run
    north, east = local_plane(run.extras["lat"], run.extras["lon"])
    left = {name: column for name, column in run.extras.items() if name not in ("lat", "lon")}
    return replace(run, extras={**left, "north": north, "east": east})


def _with_fresh_readings(run: Run) -> Run:
    changed: dict[str, Floats] = {}
    told = []
    for names in SENSORS:
        if not all(name in run.extras for name in names):
            continue
        again = repeats(*(run.extras[name] for name in names))
        if not again.any():
            continue
        changed |= {name: np.where(again, np.nan, run.extras[name]) for name in names}
        share, which = 100 * float(again.mean()), " and ".join(names).replace("_", " ")
        told.append(
            f"{which}: {share:.0f} % of the rows repeat the reading before them, as of a slow sensor, and do not count"
        )
    if not changed:
        return run
    return replace(run, extras={**run.extras, **changed}, notes=(*run.notes, *told), reading=(*run.reading, *told))


Flags = NDArray[np.bool_]

FEWEST = 8  # Changes of a value that tell anything of its sensor
FINE = 5.0  # A median step of so many of the smallest steps or more: two readings in a row are then hardly ever equal
COARSE = 2.0  # The same below which a value that stands may as well be one that creeps
FEW = 0.1  # Share of repeats below which they are chance, and cost nothing
BESIDE = 0.1
"""Share of changes that follow each other without a row between, up to which a coarse sensor counts as held."""


def repeats(*columns: Floats) -> Flags:
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
