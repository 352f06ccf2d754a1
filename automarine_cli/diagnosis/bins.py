"""The gap in the bins of each variable, and whether chance gives as much.

A run is the unit: samples within one hang together. Variables that change within runs are judged by turning the sign
of whole runs, variables that belong to a whole run by dealing the runs in another order; the largest mean of a
variable is compared with the largest that chance gives. All variables are judged in the same draws.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from automarine_cli.diagnosis.variables import FEWEST_IN_A_BIN, Column, edges
from automarine_cli.quantities import Floats

STANDS_OUT = 0.05
SURE = 0.01
"""Share of campaigns with nothing missing in which any variable may have bins that stand out: beside one that has,
something is missing."""
MOST_BINS = 12
THRUST, SIZE = "thrust", "size"
"""The gaps of whole runs: in their own gain of the thrust, and in how large theirs is."""


@dataclass(frozen=True)
class Row:
    """One way to average the gap in bins: `mean` (B,) with its standard error over runs, `t` (B,) and p (B,).

    `directed` means that gaps count along the moment: what mirrors with the command adds up. `p` is family-wise over
    the variable's bins and rows; degrees for headings, the moment's unit, or per cent for the thrust gain.
    """

    kind: str
    directed: bool
    unit: str
    mean: Floats
    error: Floats
    t: Floats
    p: Floats


@dataclass(frozen=True)
class Variable:
    """The gap in the bins of one variable; `p_value` is corrected for the number of variables, and `logged`
    is whether it is called as the logs call it."""

    name: str
    unit: str
    of_the_run: bool
    edges: Floats
    middle: Floats
    rows: tuple[Row, ...]
    p_value: float
    stands_out: NDArray[np.bool_]
    logged: bool = False

    @property
    def telling(self) -> Row:
        """The row that stands out most."""
        return max(self.rows, key=lambda row: float(np.nanmax(np.abs(row.t), initial=0.0)))


def of_samples(
    column: Column, kinds: Mapping[str, tuple[str, Floats]], sign: Floats, flips: Floats
) -> tuple[Variable, Floats] | None:
    """Bin samples; compare sums over runs with those of runs whose signs are turned at random."""
    cut = edges(column.values, MOST_BINS)
    count = len(cut) - 1
    if count < 2:
        return None
    which = np.where(np.isfinite(column.values), np.digitize(np.nan_to_num(column.values), cut[1:-1]), -1)
    member = which[None] == np.arange(count)[:, None, None]  # (B, R, N)
    samples = member.sum(axis=2).T.astype(float)  # (R, B)
    enough = (samples > 0).sum(axis=0) >= FEWEST_IN_A_BIN
    rows, chance = [], np.zeros(len(flips))
    for kind, (unit, gap) in kinds.items():
        for directed in (False, True):
            values = gap * sign if directed else gap
            sums = np.einsum("brn,rn->rb", member, values)
            spread = np.sqrt(np.maximum((sums**2).sum(axis=0), 1e-300))
            t = np.where(enough, sums.sum(axis=0) / spread, 0.0)
            chance = np.maximum(chance, np.abs((flips @ sums)[:, enough] / spread[enough]).max(axis=1, initial=0))
            total = np.maximum(samples.sum(axis=0), 1.0)
            mean = np.where(enough, sums.sum(axis=0) / total, np.nan)
            around = sums - samples * np.nan_to_num(mean)
            error = np.where(enough, np.sqrt((around**2).sum(axis=0)) / total, np.nan)
            rows.append(Row(kind, directed, unit, mean, error, t, np.ones(count)))
    middle = np.array([np.mean(column.values[which == b]) if (which == b).any() else np.nan for b in range(count)])
    return _tested(column, cut, middle, rows, chance)


def of_runs(
    column: Column, gain: Floats, mirrored: Floats, size: Floats, drawn: Floats, unit: str = "%"
) -> tuple[Variable, Floats] | None:
    """Bin runs; compare the bins' mean gain [unit], and size of the gap, with those of runs drawn in another order."""
    have = np.isfinite(column.values)
    values, count = column.values[have], int(have.sum())
    cut = edges(values, int(np.clip(count // 4, 4, MOST_BINS)))
    bins = len(cut) - 1
    if bins < 2 or count < 2 * FEWEST_IN_A_BIN:
        return None
    which = np.digitize(values, cut[1:-1])
    member = (which[:, None] == np.arange(bins)).astype(float)
    number = member.sum(axis=0)
    enough = (number >= FEWEST_IN_A_BIN) & (number < count)
    orders = np.argsort(drawn[:, have], axis=1)
    rows, chance = [], np.zeros(len(drawn))
    looks = ((THRUST, False, unit, gain), (THRUST, True, unit, gain * mirrored), (SIZE, False, "log", size))
    for kind, directed, unit, look in looks:
        centred = look[have] - look[have].mean()
        error = max(float(centred.std(ddof=1)), 1e-12) / np.sqrt(np.maximum(number, 1.0))
        mean = np.where(number > 0, centred @ member / np.maximum(number, 1.0), np.nan)
        t = np.where(enough, np.nan_to_num(mean) / error, 0.0)
        by_chance = centred[orders] @ member / np.maximum(number, 1.0) / error
        chance = np.maximum(chance, np.abs(by_chance[:, enough]).max(axis=1, initial=0))
        rows.append(Row(kind, directed, unit, mean, error, t, np.ones(bins)))
    middle = np.array([np.mean(values[which == b]) if (which == b).any() else np.nan for b in range(bins)])
    return _tested(column, cut, middle, rows, chance)


def _tested(column: Column, cut: Floats, middle: Floats, rows: list[Row], chance: Floats) -> tuple[Variable, Floats]:
    """The variable with p-values from the largest |t| that chance gives over all its bins and rows."""
    found = []
    for row in rows:
        above = _as_large(chance, np.abs(row.t))
        found.append(replace(row, p=np.asarray((1.0 + above) / (1.0 + len(chance)), dtype=float)))
    p_value = min(float(row.p.min()) for row in found)
    nothing = np.zeros(len(middle), dtype=bool)
    variable = Variable(
        column.name, column.unit, column.of_the_run, cut, middle, tuple(found), p_value, nothing, column.logged
    )
    return variable, chance


def _as_large(chance: Floats, values: Floats) -> NDArray[np.int64]:
    """How many draws give as much as each value or more. Few runs have few different draws, so many are the same but
    for rounding, which must not decide."""
    return np.asarray(len(chance) - np.searchsorted(np.sort(chance), values * (1 - 1e-9), side="left"))


def over_variables(found: list[tuple[Column, Variable, Floats]]) -> list[tuple[Column, Variable]]:
    """Step-down least p over the variables (Westfall and Young 1993): like Holm's, but variables that say the same,
    such as run order and clock, count once because all are judged in the same draws."""
    if not found:
        return []
    draws = len(found[0][2])
    null = np.array([_as_large(chance, chance) / draws for _, _, chance in found])
    order = sorted(range(len(found)), key=lambda i: found[i][1].p_value)
    corrected, least = {}, 0.0
    for rank, i in enumerate(order):
        smallest = np.sort(null[order[rank:]].min(axis=0))
        bins = np.min([row.p for row in found[i][1].rows], axis=0)
        own = (1.0 + np.searchsorted(smallest, bins, side="right")) / (1.0 + draws)
        least = max(least, float(own.min()))
        corrected[i] = (np.maximum(own, least), least)
    return [
        (column, replace(variable, p_value=p, stands_out=(bins < STANDS_OUT) & (p < SURE)))
        for (column, variable, _), (bins, p) in zip(found, (corrected[i] for i in range(len(found))))
    ]
