"""Records of bollard tests -> the fit of one thruster: over all points, and at each voltage."""

from functools import partial

import numpy as np

from automarine_cli.errors import FitError
from automarine_cli.logs import ColumnRule
from automarine_cli.logs.canonical import likely_column
from automarine_cli.logs.recognise import is_called
from automarine_cli.pipeline.parallel import ordered_map
from automarine_cli.pipeline.progress import Progress, silent
from automarine_cli.pipeline.words import listed
from automarine_cli.thrusters.analysis import Analysis, analyse
from automarine_cli.thrusters.contradictions import flag_contradictions
from automarine_cli.thrusters.fit import FEWEST_LEVELS, Side
from automarine_cli.thrusters.plateaus import reduce_series
from automarine_cli.thrusters.points import Ints, Points, levels_of, voltage_steps
from automarine_cli.thrusters.records import ThrusterLogs
from automarine_cli.thrusters.result import ThrusterFit
from automarine_cli.thrusters.tare import Tare, subtract_tare
from automarine_cli.thrusters.voltage import VoltageExponent, voltage_exponents

STRONG = 0.2
"""Share of the largest thrust from which readings tell whether a command always gives the same."""
APART = 0.3
"""Share of a thrust by which readings at one command differ where something else changed."""
FELT = 0.2  # exponent of thrust against voltage from which one map for all voltages misleads


def fit_records(
    loaded: ThrusterLogs, thrusters: int, n_unit: str, form: str | None, jobs: int, progress: Progress
) -> ThrusterFit:
    """The map of one thruster from tests in which `thrusters` equal ones pulled; `form` None chooses by
    cross-validation, `n_unit` is the control signal's. Raises FitError where no direction can be fitted."""
    where = loaded.inputs[0].name if len(loaded.inputs) == 1 else f"{len(loaded.inputs)} logs"
    reduction = reduce_series(list(loaded.records))
    points = reduction.points.divided(thrusters)
    step = voltage_steps(points.voltage)
    unsorted = _without_voltages(points, step)
    differ = _differ(loaded, points, thrusters, where)
    logged = points
    points, apart = (points, differ) if differ else _flagged(loaded, points, step)
    points, tare = subtract_tare(points)
    varied = step if step is not None and step.max() > 0 else None
    try:
        analysis, _ = analyse(points, varied, tare.stderr if tare.subtracted else 0.0, n_unit, form, where)
    except FitError as refusal:
        raise _with_rest(refusal, logged, thrusters, loaded.rule) from None
    voltages, exponents, notes = _by_voltage(points, step, tare, n_unit, form, jobs, progress)
    return ThrusterFit(
        loaded,
        reduction,
        analysis,
        tare,
        thrusters,
        voltages,
        exponents,
        (*apart, *reduction.notes, *unsorted, *_notes(points), *notes),
        _by_part(loaded, thrusters, n_unit, form) if loaded.asked else {},
    )


def _differ(loaded: ThrusterLogs, points: Points, thrusters: int, where: str) -> tuple[str, ...]:
    """What to know where one command gave very different thrusts and no voltage tells why. Raises FitError where a
    column may hold the supply."""
    if np.any(np.isfinite(points.voltage)) or len(loaded.parts) > 1:
        return ()
    level, size = levels_of(points.n), np.abs(points.force)
    ends = []
    for number in np.unique(level[size > STRONG * size.max(initial=0.0)]):
        force = points.force[level == number]
        if len(force) > 1 and not np.any(points.raw[level == number]):
            ends.append((float(np.ptp(force)) / float(np.abs(force).max()), int(number)))
    if len(ends) < FEWEST_LEVELS or np.median([apart for apart, _ in ends]) < APART:
        return ()
    _, number = max(ends)
    at, force = float(np.mean(points.n[level == number])), thrusters * points.force[level == number]
    said = f"the same command {at:.4g} gave {force.min():.3g} to {force.max():.3g} N"
    others = {name: np.concatenate([r.extras[name] for r in loaded.records]) for name in loaded.records[0].extras
              if all(name in r.extras for r in loaded.records)}  # fmt: skip
    varied = [name for name, values in others.items() if np.nanmin(values) < (1.0 - APART) * np.nanmax(values)]
    called = next((name for name in varied if is_called("voltage", [name])), None)
    if (supply := called or likely_column("voltage", varied)) is not None:
        low, high = np.nanmin(others[supply]), np.nanmax(others[supply])
        raise FitError(
            f"{where}: {said}; does {supply} ({low:.4g} to {high:.4g}) hold the supply? Then write "
            f'voltage_V = "{supply}" under [columns] in a file and give it with --columns FILE.toml'
        )
    return (f"{said[0].upper()}{said[1:]}: something else changed between tests, and the map is a mean over that.",)


def _with_rest(refusal: FitError, points: Points, thrusters: int, rule: ColumnRule | None) -> FitError:
    """A refusal, and the force at zero command where that is none: then the sensor has an offset."""
    rest = points.force[points.n == 0.0]
    if not len(rest) or abs(float(np.median(rest))) <= STRONG * np.ptp(points.force):
        return refusal
    force = thrusters * float(np.median(rest))
    read = ColumnRule("NAME") if rule is None else rule
    offset = read.subtract + force / (read.sign * read.scale)
    return FitError(
        f"{str(refusal).partition(';')[0]}; the force at command 0 is {force:.4g} N, which looks like the offset of "
        f"the load cell. Write subtract = {offset:.4g} in the line of the force under [columns] in the --columns file"
    )


def _flagged(loaded: ThrusterLogs, points: Points, step: Ints | None) -> tuple[Points, tuple[str, ...]]:
    """Points with contradictions flagged, each thruster's among themselves: where a column names thrusters and nobody
    asked for them, if that leaves fewer, which is then told."""
    if len(loaded.parts) < 2:
        return flag_contradictions(points, step), ()
    number = {name: i for i, name in enumerate(("", *loaded.parts))}
    part = np.array([number[record.part] for record in loaded.records])[points.record]
    apart = flag_contradictions(points, part if step is None else part * (int(step.max()) + 1) + step)
    if loaded.asked:
        return apart, ()
    pooled = flag_contradictions(points, step)
    before, after = (int(np.count_nonzero(one.flag != "")) for one in (pooled, apart))
    if before <= after:
        return pooled, ()
    told = (
        f"The column {loaded.by} names {len(loaded.parts)} parts ({listed(loaded.parts)}): taken together {before} of "
        f"{len(points)} points contradict their neighbours, each by itself {after}. They may be thrusters that differ: "
        f'write by = "{loaded.by}" under [columns] in a file and give it with --columns FILE.toml for a map of each.'
    )
    return apart, (told,)


def _by_part(loaded: ThrusterLogs, thrusters: int, n_unit: str, form: str | None) -> dict[str, ThrusterFit | str]:
    """The fit of each thruster by itself, or why there is none."""
    found: dict[str, ThrusterFit | str] = {}
    for name in loaded.parts:
        try:
            found[name] = fit_records(loaded.of(name), thrusters, n_unit, form, 1, silent)
        except FitError as refusal:
            found[name] = str(refusal)
    return found


def _by_voltage(
    points: Points, step: Ints | None, tare: Tare, n_unit: str, form: str | None, jobs: int, progress: Progress
) -> tuple[tuple[tuple[float, Analysis], ...], dict[str, VoltageExponent | None], tuple[str, ...]]:
    """A map for each voltage step, and the exponents of thrust against voltage."""
    if step is None or step.max() == 0:
        return (), {}, ()
    stderr = tare.stderr if tare.subtracted else 0.0
    groups = [points.where(step == number) for number in np.unique(step)]
    judge = partial(_one_voltage, tare_stderr=stderr, n_unit=n_unit, form=form)
    found = ordered_map(judge, groups, jobs, progress=progress, stage="voltages")
    notes = [f"No map at this voltage: {one}." for one in found if isinstance(one, str)]
    fits = [(volts, analysis) for volts, analysis, _ in (one for one in found if not isinstance(one, str))]
    sides = [one[2] for one in found if not isinstance(one, str)]
    laws = [{name: estimate.value for name, estimate in analysis.square.items()} for _, analysis in fits]
    exponents = voltage_exponents(np.array([volts for volts, _ in fits]), sides, laws) if len(fits) > 1 else {}
    powers = [found.exponent.value for found in exponents.values() if found and found.exponent]
    if powers and max(abs(power) for power in powers) > FELT:
        notes.append(
            f"Thrust at the same control signal grows with the voltage to the power {np.mean(powers):.2f}: "
            "the map over all voltages is a mean; for a known voltage use that voltage's map."
        )
    return tuple(fits), exponents, tuple(notes)


def _one_voltage(
    points: Points, *, tare_stderr: float, n_unit: str, form: str | None
) -> tuple[float, Analysis, dict[str, Side]] | str:
    """Voltage, analysis and sides of one step, or why there is none."""
    volts = float(np.median(points.voltage))
    try:
        analysis, sides = analyse(points, None, tare_stderr, n_unit, form, f"{volts:.4g} V")
    except FitError as refusal:
        return str(refusal)
    return volts, analysis, sides


def _without_voltages(points: Points, step: Ints | None) -> tuple[str, ...]:
    """Why there is no map for each voltage although voltages were logged."""
    if step is not None or not np.any(np.isfinite(points.voltage)):
        return ()
    missing = int(np.count_nonzero(~np.isfinite(points.voltage)))
    why = f"{missing} of {len(points)} points have none" if missing else "it drifts without steps"
    return (f"The supply voltage is not used: {why}.",)


def _notes(points: Points) -> tuple[str, ...]:
    """What a person should know of the points: exact zeros at a command may never have been measured."""
    silent_points = (points.n != 0.0) & (points.force == 0.0) & (points.flag == "")
    count = int(np.count_nonzero(silent_points))
    if count == 0:
        return ()
    largest = float(np.max(np.abs(points.n[silent_points])))
    return (
        f"{count} point{'s have' if count > 1 else ' has'} exactly zero thrust at a command (up to |n| = "
        f"{largest:.4g}): a dead band, or readings that were set to zero or never taken; they are kept.",
    )
