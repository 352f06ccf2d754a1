"""`load_runs`: all logs of a campaign become runs; what is unusable is set aside with its reason."""

import contextlib
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np

from automarine_cli.dofs import Dof
from automarine_cli.errors import FitError, LogError, RunError
from automarine_cli.logs import ColumnMap, LogFile, Logs, LogTable, find_logs, read_log, require_motion
from automarine_cli.logs.canonical import names_of
from automarine_cli.pipeline.parallel import ordered_stream
from automarine_cli.pipeline.progress import Progress, silent
from automarine_cli.runs.allocation_limits import AllocationLimit, within_limits
from automarine_cli.runs.clean import NotUsable, clean, plain_rows, too_short
from automarine_cli.runs.flat import Indices
from automarine_cli.runs.half_turn import UNTRIMMED, HalfTurn, Trim
from automarine_cli.runs.run import Run, SetAside, command_warnings, named_apart, own_name
from automarine_cli.runs.sense import clock_trouble
from automarine_cli.runs.trimmed import Trimmed, trimmed

Kept = TypeVar("Kept")
Reading = Callable[..., tuple[list[Run], list[SetAside]]]

MOST_REASONS = 3  # reasons shown when nothing is left
PAYS_FROM = 3000  # logs from which processes are started to read them


@dataclass(frozen=True)
class Campaign:
    """The runs of one campaign on one clock, in file order; what was set aside; the files read (those that have
    bytes to read: no links that lead nowhere); what was commanded beyond the limits of the thrusters."""

    runs: tuple[Run, ...]
    set_aside: tuple[SetAside, ...]
    inputs: tuple[LogFile, ...]
    limits: tuple[AllocationLimit, ...] = ()


def load_runs(
    logs: Logs,
    columns: ColumnMap | None = None,
    *,
    dof: Dof,
    strict: bool = False,
    progress: Progress = silent,
    jobs: int = 1,
    read: Reading | None = None,
) -> Campaign:
    """Read and clean the logs of a motion meant by files, directories and globs, on `jobs` processes.

    `read` is what makes runs of one log, by default `read_runs`. Raises LogError or RunError for a log named
    on the command line that cannot be read right, for anything that would be set aside if `strict`, and if no run is
    left.
    """
    files = find_logs(logs)
    runs, aside = _gathered(partial(read or read_runs, columns=columns, dof=dof), files, strict, progress, jobs)
    limited, limits = within_limits(_one_unit(named_apart(runs)))
    return Campaign(tuple(limited), aside, tuple(filter(has_bytes, files)), limits)


@dataclass(frozen=True)
class HalfTurnCampaign:
    """The half-turns of a campaign without what came after them: `turns` that serve, in file order, `not_turned` the
    runs without one and why; the rest as in `Campaign`. `count` is the number of runs, `warnings` say how their
    thruster commands do not fit the map.
    """

    turns: tuple[HalfTurn, ...]
    not_turned: tuple[SetAside, ...]
    count: int
    set_aside: tuple[SetAside, ...]
    inputs: tuple[LogFile, ...]
    limits: tuple[AllocationLimit, ...] = ()
    warnings: tuple[str, ...] = ()


def load_half_turns(
    logs: Logs,
    columns: ColumnMap | None = None,
    drive: Callable[[Run], Run] | None = None,
    *,
    dof: Dof,
    trim: Trim = UNTRIMMED,
    strict: bool = False,
    progress: Progress = silent,
    jobs: int = 1,
) -> HalfTurnCampaign:
    """As `load_runs`, but of each run only its half-turn is kept, trimmed where it is read: what a campaign takes in
    memory does not grow with the length of its logs. `drive` gives runs of thruster commands their moment, `trim` is
    how far a step is followed.
    """
    files = find_logs(logs)
    read = partial(_read_trimmed, columns=columns, drive=drive, dof=dof, trim=trim)
    found, aside = _gathered(read, files, strict, progress, jobs)
    runs = _one_unit(named_apart([one.run for one in found]))
    limited, limits = within_limits(runs)
    named = [
        one.of(run) if run is now or one.turn is None else trimmed([now], trim)[0]
        for one, run, now in zip(found, runs, limited)
    ]
    return HalfTurnCampaign(
        turns=tuple(one.turn for one in named if one.turn is not None),
        not_turned=tuple(SetAside(one.run.source, one.run.name, one.why) for one in named if one.turn is None),
        count=len(named),
        set_aside=aside,
        inputs=tuple(filter(has_bytes, files)),
        limits=limits,
        warnings=command_warnings(runs),
    )


def _gathered(
    read: Callable[[LogFile], tuple[list[Kept], list[SetAside]]],
    files: Sequence[LogFile],
    strict: bool,
    progress: Progress,
    jobs: int,
) -> tuple[list[Kept], tuple[SetAside, ...]]:
    """What is read of all files, and what is set aside."""
    kept: list[Kept] = []
    aside: list[SetAside] = []
    for good, bad in ordered_stream(read, files, _paying(files, jobs), progress=progress, stage="reading logs"):
        kept += good
        aside += bad
    if strict and aside:
        raise refused_by_strict(aside[0])
    if not kept:
        raise none_left(len(files), aside)
    return kept, tuple(aside)


def _paying(files: Sequence[LogFile], jobs: int) -> int:
    """`jobs` where they pay, else one: to start processes takes longer than to read few logs, and of few large ones
    handing over what was read takes as long as reading it."""
    return jobs if len(files) > PAYS_FROM else 1


def _read_trimmed(
    file: LogFile, columns: ColumnMap | None, drive: Callable[[Run], Run] | None, dof: Dof, trim: Trim
) -> tuple[list[Trimmed], list[SetAside]]:
    runs, aside = read_runs(file, columns, dof=dof)
    return trimmed([run if drive is None else drive(run) for run in runs], trim), aside


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
    reasons = "; ".join(
        f"{names[0]}{f' and {len(names) - 1} more' if len(names) > 1 else ''}: {said}" for said, names in told
    )
    left = len(aside) - sum(len(names) for _, names in told)
    more = f"; and {left} more" if left else ""
    return RunError(f"no usable run in {files} log{'s' * (files != 1)}: {reasons}{more}")


@contextlib.contextmanager
def told_beside(aside: Sequence[SetAside]) -> Iterator[None]:
    """Whoever is refused for want of runs is also told how many were set aside before, and why the first was."""
    try:
        yield
    except (FitError, RunError) as refusal:
        if not aside:
            raise
        count = f"{len(aside)} run was" if len(aside) == 1 else f"{len(aside)} runs were"
        first = f"{aside[0].file}, run {aside[0].run!r}: {aside[0].why}"
        raise type(refusal)(
            f"{refusal} ({count} set aside before{', the first' * (len(aside) > 1)}: {first})"
        ) from None


def read_runs(file: LogFile, columns: ColumnMap | None = None, *, dof: Dof | None) -> tuple[list[Run], list[SetAside]]:
    """The runs of one log of a motion (None: whichever its columns show), and those set aside. Raises LogError or
    RunError if the log was named and is unreadable.
    """
    try:
        table = read_log(file, columns, dof=dof)
    except LogError as error:
        if file.named:
            raise
        return [], [unreadable(file, error)]
    return runs_of_table(table, file)


def unreadable(file: LogFile, error: Exception) -> SetAside:
    """A log that was found, not named, and cannot be read right."""
    return SetAside(file.name, own_name(file.name), _without_source(str(error), file.name))


def runs_of_table(table: LogTable, file: LogFile) -> tuple[list[Run], list[SetAside]]:
    """The runs of a table already read, and those set aside. Raises LogError or RunError as `read_runs`."""
    try:
        require_motion(table)
    except LogError as error:
        if file.named:
            raise
        return [], [unreadable(file, error)]
    runs: list[Run] = []
    aside: list[SetAside] = []
    names, order, edges = _split(table)
    plain, positions = plain_rows(table, order, edges)
    for name, good, start, stop in zip(names, plain.tolist(), edges.tolist(), edges[1:].tolist()):
        chosen = slice(start, stop) if order is None else order[start:stop]
        try:
            parts = clean(table, chosen, name, positions[start:stop] if good else None)
        except NotUsable as error:
            aside.append(SetAside(file.name, name, str(error)))
            continue
        except RunError as error:
            if file.named:
                raise
            aside.append(SetAside(file.name, name, _without_source(str(error), file.name)))
            continue
        for part in parts:
            why = (clock_trouble(part.time) or too_short(part)) if len(parts) > 1 else None
            if why is None:
                runs.append(part)
            else:
                aside.append(SetAside(file.name, part.name, f"{why} ({part.notes[-1]})"))
    return runs, aside


def _split(table: LogTable) -> tuple[Sequence[str], Indices | None, Indices]:
    """The names of the runs in the order in which they begin in the file, the order of rows in which they stand one
    behind the other (None: their own), and where each begins and ends in it."""
    names, code = table.run_names, table.run_code
    if code is None:
        return [own_name(table.source)], None, np.array([0, len(table)])
    begins = np.flatnonzero(code[1:] != code[:-1]) + 1
    if len(begins) + 1 == len(names):
        return names, None, np.concatenate([[0], begins, [len(code)]])
    order = np.argsort(code, kind="stable")  # the runs take turns
    return names, order, np.searchsorted(code[order], np.arange(len(names) + 1))


def _without_source(sentence: str, source: str) -> str:
    """The reason alone: the result has the file's name in a field of its own."""
    return sentence.removeprefix(source).lstrip(":, ")


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
