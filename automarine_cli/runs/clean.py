"""A log's rows become runs: the clock rises, the position is unwrapped, everything dropped is counted."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise

import numpy as np

from automarine_cli.dofs import Dof
from automarine_cli.errors import RunError
from automarine_cli.logs import LogTable
from automarine_cli.logs.table import is_velocity_only
from automarine_cli.pipeline.words import listed
from automarine_cli.quantities import Floats
from automarine_cli.runs.checks import beyond, clock_trouble, position_trouble, stuck
from automarine_cli.runs.noise import NORMAL, fresh_readings, median, slope
from automarine_cli.runs.run import Run
from automarine_cli.runs.unwrap import Indices, Mask, find_glitches, find_jumps, unwrap, wrapped

GAP_IN_PERIODS = 3.0 + 1e-6  # more than three periods, clocks being rounded
LARGEST_COMMAND = 1e12  # of any unit; beyond it arithmetic overflows
COARSE = 0.2  # of the rows: more repeated stamps than this are no accident
COUNTS = ("rows", "missing", "duplicates", "glitches", "gaps", "jumps")
SHORTEST_PART = 5.0  # s; what is left between two jumps has to be worth fitting a start of its own


class NotUsable(RunError):
    """An unusable run: the reason, with a hint."""


def clean(table: LogTable, chosen: Indices | slice, name: str) -> tuple[Run, ...]:
    """Clean the rows `chosen` (indices into the table, shape (N,), or a slice) of one run; a wide gap may split it
    into several.

    Rows without time, position or command are dropped and counted, as are repeated stamps and spikes of the position.
    Raises RunError with the row for a clock that steps back, NotUsable for a run that cannot be used.
    """
    columns = {key: values[chosen] for key, values in {**table.extras, **table.columns}.items()}
    dof, summed = table.dof, is_velocity_only(table)
    commands = (dof.command,) if dof.command in table.columns else dof.thrusters
    measured = dof.velocity if summed else dof.position
    rows, counts = table.rows[chosen], dict.fromkeys(COUNTS, 0)
    counts["rows"] = len(rows)
    missing = np.isnan(columns["time"])
    for key in (measured, *commands):
        missing |= np.isnan(columns[key])
    counts["missing"] = int(np.count_nonzero(missing))
    if counts["missing"]:
        columns, rows = _only(columns, ~missing), rows[~missing]
        if not len(rows):
            what = measured.replace("_", " ")
            raise NotUsable(
                f"no row has time, {what} and command ({counts['missing']} rows lack one); check the columns"
            )
    fresh = _rising(columns["time"], rows, table, name)
    if len(rows) > 1 and not fresh[1:].any():
        raise NotUsable(clock_trouble(columns["time"]) or "the clock stands still")
    counts["duplicates"] = len(fresh) - int(np.count_nonzero(fresh))
    columns = _only(columns, fresh)
    _refuse(clock_trouble(columns["time"]))
    if not summed:
        _refuse(position_trouble(columns["time"], columns[dof.position], dof))
    for key in commands:
        if (largest := float(np.abs(columns[key]).max(initial=0.0))) > LARGEST_COMMAND:
            what = dof.words.force if key == dof.command else "thruster command"
            raise NotUsable(f"units look wrong: a {what} of {largest:.3g}. Check which column is the {what}")
    if summed:
        return _bridged(_summed_up(_run(table, columns, name, counts)))
    glitch = find_glitches(columns["time"], columns[dof.position], dof) | beyond(columns[dof.position], dof)
    counts["glitches"] = int(np.count_nonzero(glitch))
    if counts["glitches"]:
        columns = _only(columns, ~glitch)
        _refuse(clock_trouble(columns["time"]))
    run = _run(table, columns, name, counts)
    _refuse(stuck(run.position, _any_command(run), dof))
    return _bridged(run)


def _run(table: LogTable, columns: Mapping[str, Floats], name: str, counts: Mapping[str, int]) -> Run:
    dof = table.dof
    extras = {key: values for key, values in columns.items() if key not in ("time", dof.position, dof.command)}
    notes, repeated = table.notes, counts["duplicates"]
    if repeated > COARSE * counts["rows"]:
        notes += (f"{repeated} of {counts['rows']} stamps repeat the one before: the clock is coarser than the log",)
    return Run(
        name=name,
        source=table.source,
        time=columns["time"],
        position=columns.get(dof.position, np.zeros(len(columns["time"]))),
        moment=columns.get(dof.command),
        moment_unit=table.moment_unit or "",
        extras=extras,
        counts=counts,
        notes=notes,
        reading=table.notes,
        dof=dof,
    )


def _summed_up(run: Run) -> Run:
    dof = run.dof
    velocity = run.extras[dof.velocity]
    fresh = fresh_readings(velocity)  # a held reading is as old as it is long held
    instant = np.interp(run.time, run.time[fresh], velocity[fresh])
    position = summed_position(run.time, instant, _any_command(run), dof)
    note = f"no {dof.words.position} in the log: the {dof.words.rate} is summed up to trim by and to look at"
    return replace(run, position=position, summed_up=True, notes=(*run.notes, note), reading=(*run.reading, note))


def _only(columns: Mapping[str, Floats], kept: Mask) -> dict[str, Floats]:
    return dict(columns) if kept.all() else {key: values[kept] for key, values in columns.items()}


def _refuse(why: str | None) -> None:
    if why is not None:
        raise NotUsable(why)


def _rising(time: Floats, rows: Indices, table: LogTable, name: str) -> Mask:
    """Which samples have a new stamp. Raises RunError where the clock steps back."""
    steps = np.diff(time)
    back = np.flatnonzero(steps < 0)
    if back.size:
        i = int(back[0])
        raise RunError(
            f"{table.source}, row {rows[i + 1]}, run {name!r}: the clock steps back from {time[i]:.10g} s to "
            f"{time[i + 1]:.10g} s; expected a rising clock. {_other_run(table, rows[i], rows[i + 1])}; else sort or "
            "correct the rows"
        )
    return np.concatenate([[True], steps > 0]) if len(time) else np.zeros(0, dtype=bool)


def _other_run(table: LogTable, before: int, after: int) -> str:
    """What to do where another run may begin: by the column of words that changes between the two rows, if one does."""
    here, there = np.searchsorted(table.rows, [before, after])
    for name, labels in table.words.items():
        if labels.code[here] != labels.code[there]:
            return (
                f"The column {name} names something else from there on ({listed(labels.names)}): if these are runs, "
                f'write run = "{name}" under [columns] in a file and give it with --columns FILE.toml'
            )
    return "If two runs share the file, tell them apart by a column run"


def _any_command(run: Run) -> Floats:
    """Something that is not zero while any thruster works, shape (N,)."""
    if run.moment is not None:
        return run.moment
    return np.asarray(sum(np.abs(run.extras[name]) for name in run.dof.thrusters))


def _bridged(run: Run) -> tuple[Run, ...]:
    """Unwrap the position; gaps that can be bridged are flagged, at the others and at jumps the run is split."""
    steps = np.diff(run.time)
    gaps = np.flatnonzero(steps > GAP_IN_PERIODS * median(steps))
    dof, words = run.dof, run.dof.words
    jumps = find_jumps(run.time, run.position, dof)
    result = unwrap(run.time, run.position, gaps, dof)
    widest = f"{steps[gaps].max():.3g} s" if gaps.size else ""
    notes = run.notes
    if (jumps := jumps[~np.isin(jumps, gaps)] if jumps.size else jumps).size:
        sizes = dof.shown(np.abs(wrapped(np.diff(run.position)[jumps], dof.turn)))
        notes += (
            f"split at {_counted(len(jumps), 'jump')} of up to {sizes.max():.0f} {words.units} from one sample to the "
            f"next, which no vehicle makes: samples are missing there, or the {words.sensor} slipped",
        )
    if result.broken_after:
        notes += (
            f"split at {_counted(len(result.broken_after), 'gap')} of up to {widest}, "
            f"across which the {words.position} cannot be followed",
        )
    elif gaps.size:
        bridged = f", bridged by the {words.speed}s beside them" if dof.wraps else ""
        notes += (f"{_counted(gaps.size, 'gap')} of up to {widest}{bridged}",)
    edges = [0, *(int(i) + 1 for i in sorted({*result.broken_after, *jumps})), len(run)]
    if len(edges) == 2:
        return (replace(run, position=result.position, counts={**run.counts, "gaps": int(gaps.size)}, notes=notes),)
    run, parts = replace(run, position=result.position), []
    for number, (start, stop) in enumerate(pairwise(edges), 1):
        part = run.cut(start, stop)
        inner = int(((gaps >= start) & (gaps < stop - 1)).sum())
        counts = {**(run.counts if number == 1 else dict.fromkeys(COUNTS, 0)), "gaps": inner}
        counts["jumps"] = int((start - 1 in jumps) + (stop - 1 in jumps))
        parts.append(replace(part, name=f"{run.name}.{number}", counts=counts, notes=notes))
    return tuple(parts)


def too_short(part: Run) -> str | None:
    """Why a part of a run that was split at a jump is unusable, or None."""
    length = float(part.time[-1] - part.time[0])
    if not part.counts["jumps"] or length >= SHORTEST_PART:
        return None
    name = part.dof.position
    return f"only {length:.2g} s are left beside a jump of the {name}; at least {SHORTEST_PART:g} s are needed"


def _counted(number: int, thing: str) -> str:
    return f"{number} {thing}{'s' * (number != 1)}"


FEWEST = 5  # Samples of a standstill
SURE = 4.0  # Standard errors within which the readings of a standstill show no trend


def summed_position(time: Floats, velocity: Floats, command: Floats, dof: Dof) -> Floats:
    """Positions (N,) from zero on, by the trapezium over the samples; all arguments (N,)."""
    still = velocity - standstill(time, velocity, command, dof)
    steps = 0.5 * (still[1:] + still[:-1]) * np.diff(time)
    return np.concatenate([[0.0], np.cumsum(steps)])


def standstill(time: Floats, velocity: Floats, command: Floats, dof: Dof) -> float:
    """What the sensor reads before the first command, if the vehicle stands still there; else zero.

    It does if the readings have no trend, and are of a size that a sensor may have as a bias.
    """
    acting = command != (command[0] if dof.has_constant else 0.0)
    first = int(np.argmax(acting)) if acting.any() else 0
    if first < FEWEST:
        return 0.0
    read = velocity[:first]
    trend, doubt = slope(time[:first], read)
    steps = np.diff(read)
    noise = NORMAL * median(np.abs(steps - np.median(steps))) / np.sqrt(2.0)
    level = float(np.median(read))
    return level if abs(trend) <= SURE * doubt * noise + 1e-12 and abs(level) <= 3.0 * dof.limits.bias_sd else 0.0
