"""Where one long log falls into runs: where a mode, an arming state or a constant command begins and ends."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from automarine_cli.errors import LogError
from automarine_cli.logs import LogTable, require
from automarine_cli.logs.columns import ARMED, MODE, RUN
from automarine_cli.logs.table import GIVE_IT
from automarine_cli.quantities import Floats
from automarine_cli.runs.checks import MIN_RUN_SAMPLES
from automarine_cli.runs.half_turn import SAME_MOMENT, SHORT_REST_SAMPLES
from automarine_cli.text import listed

By = Literal["mode", "arm", "moment"]
NOT_LOGGED, AT_REST = "?", "no command acts"
NOT_ARMED = ("disarmed", "0", "false", "no", "off", "")


@dataclass(frozen=True)
class Slice:
    """Rows `first` to `stop - 1` of a table, of one run; `state` is the mode, "armed", or the constant command.
    `moving`: the vehicle did not stand still before. `why` it became no run (else empty)."""

    first: int
    stop: int
    state: str
    moving: bool = False
    why: str = ""


def find_slices(
    table: LogTable, by: By, keep: tuple[str, ...] = (), lead: float = 2.0, shortest: float = 1.0
) -> list[Slice]:
    """Cut a table into runs and what lies between them. `keep` are the modes to keep (all if empty), `lead` [s] the
    rest kept before a constant command, `shortest` [s] the shortest run. Raises LogError without the column."""
    require(table, ("time",))
    time, modes = table.columns["time"], {word.lower() for word in keep}
    slices: list[Slice] = []
    stretches = list(_stretches(table, by))
    for i, (first, stop, state, follows) in enumerate(stretches):
        why = _why_not(by, state, modes, time[first:stop], shortest)
        passed = follows and bool(slices[-1].why)
        if why:
            if passed and slices[-1].why == why:
                first = slices.pop().first
            slices.append(Slice(first, stop, state, why=why))
            continue
        start = first
        if passed and slices[-1].why == AT_REST:
            rest = slices.pop()
            start = rest.first + int(np.searchsorted(time[rest.first : first], time[first] - lead))
            if start > rest.first:
                slices.append(replace(rest, stop=start))
        moving = False
        if by == "moment" and follows:  # something acted right before, or so shortly before that nobody knows the rest
            begin, end, earlier, goes_on = stretches[i - 1]
            moving = earlier != NOT_LOGGED if earlier else goes_on and end - begin < SHORT_REST_SAMPLES
        slices.append(Slice(start, stop, state, moving))
    return slices


def _why_not(by: By, state: str, modes: set[str], time: Floats, shortest: float) -> str:
    if state == "":
        return {"mode": "no mode known yet", "arm": "not armed", "moment": AT_REST}[by]
    if state == NOT_LOGGED:
        return "no command known yet"
    if modes and state.lower() not in modes:
        return f"mode {state} is not asked for"
    length = float(time[-1] - time[0])
    if length < shortest or len(time) < MIN_RUN_SAMPLES:
        return f"shorter than {shortest:g} s, or fewer than {MIN_RUN_SAMPLES} samples"
    return ""


def _stretches(table: LogTable, by: By) -> Iterator[tuple[int, int, str, bool]]:
    """First row, last row and one, and state of every stretch of one state; whether it goes on from the one before."""
    names, code = _commands(table) if by == "moment" else _states(table, MODE if by == "mode" else ARMED)
    anew = np.diff(table.columns["time"]) < 0
    if runs := table.labels.get(RUN):
        anew |= np.diff(runs.code) != 0
    edges = [0, *(np.flatnonzero(anew | (np.diff(code) != 0)) + 1).tolist(), len(code)]
    for first, stop in pairwise(edges):
        yield first, stop, names[int(code[first])], first > 0 and not anew[first - 1]


def _states(table: LogTable, name: str) -> tuple[list[str], NDArray[np.int64]]:
    """Words and the word of each row; "" where nothing is known or the vehicle is not armed."""
    if name not in table.labels:
        lacking = f"{table.source}: no {name}; found the columns {listed(table.names)}; expected a column {name}"
        raise LogError(f'{lacking}. If it has another name, write {name} = "NAME" {GIVE_IT}')
    labels = table.labels[name]
    words = [*labels.names, ""]
    if name == ARMED:
        words = ["" if word.lower() in NOT_ARMED else "armed" for word in words]
    order = list(dict.fromkeys(words))
    return order, np.array([order.index(word) for word in words])[labels.code]


def _commands(table: LogTable) -> tuple[list[str], NDArray[np.int64]]:
    dof = table.dof
    names = (dof.command,) if dof.command in table.columns else dof.thrusters
    require(table, names if {*names} & set(table.columns) else (dof.command,))
    logged = np.array([table.columns[name] for name in names])
    last = np.maximum.accumulate(np.where(np.isnan(logged), 0, np.arange(len(table))), axis=1)
    commands = np.take_along_axis(logged, last, axis=1)  # NaN before the first
    logged_all = ~np.isnan(commands).any(axis=0)
    least = SAME_MOMENT * np.nanmax(np.abs(commands), axis=1, initial=0.0)[:, None]
    changes = (np.abs(np.diff(commands)) > least).any(axis=0) | (logged_all[1:] != logged_all[:-1])
    code = np.concatenate([[0], np.cumsum(changes)])
    firsts = np.concatenate([[0], np.flatnonzero(changes) + 1])
    words = []
    for first in firsts:
        values = commands[:, first]
        acts = (np.abs(values) > least[:, 0]).any()
        text = "_".join(f"{value:+.4g}" for value in values + 0.0)
        words.append(NOT_LOGGED if not logged_all[first] else text if acts else "")
    return words, code
