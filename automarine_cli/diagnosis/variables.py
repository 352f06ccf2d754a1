"""What the gap between simulation and measurement is looked at against: motion, command, clock, logged columns."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from automarine_cli.diagnosis.study import Study
from automarine_cli.dofs import DOFS, Dof
from automarine_cli.effects.thruster_imbalance import PARTS
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import ASKED

FEWEST_IN_A_BIN = 2
"""Runs that a bin needs: one run alone says nothing about chance."""
OF_THE_RUN = 0.1
"""A column that varies within runs by less than this share of its whole spread is a property of the run."""
UNITS = {"voltage": "V", "sway": "m/s"}
"""Of columns that are no velocity of a motion."""
VELOCITIES = {one.velocity: one.units for one in DOFS.values()}


@dataclass(frozen=True)
class Column:
    """One variable: values (R, N) with NaN where it means nothing, or (R,) for a property of the whole run; `logged`
    ones are columns of the logs, called as these call them."""

    name: str
    unit: str
    values: Floats
    logged: bool = False

    @property
    def of_the_run(self) -> bool:
        """Whether each run has one value."""
        return self.values.ndim == 1


def columns(study: Study, fitted: Floats) -> list[Column]:
    """Every variable of the runs of `study`; `fitted` (R, N) are headings smooth enough to differentiate [rad]."""
    batch = study.batch
    seen, time, dof = batch.seen, study.time, study.base.dof
    words = dof.words
    moment = commanded(study)
    start = np.array([float(np.median(run.position[:5])) for run in study.runs])
    measured = np.where(seen, batch.position, np.nan)
    clock = batch.start
    order = np.argsort(np.argsort(clock, kind="stable"), kind="stable").astype(np.float64) + 1.0
    found = [
        Column("time-since-command-change", "s", since_change(moment, time)),
        Column("time-in-run", "s", time),
        Column(_hyphened(words.travelled), dof.units.shown, dof.shown(fitted - fitted[:, :1])),
        Column(words.position, dof.units.shown, _once_round(dof.shown(measured), dof)),
        Column(_hyphened(words.rate), f"{dof.units.shown}/s", dof.shown(rates(fitted, time, seen))),
        Column(words.force, study.base.moment_unit, moment),
        Column(words.force, study.base.moment_unit, of_runs(study)),
        Column(f"{words.force}-size", study.base.moment_unit, np.abs(of_runs(study))),
        Column(f"start-{words.position}", dof.units.shown, _once_round(dof.shown(start), dof)),
        Column("run-order", "", order),
        Column("campaign-clock", "s", clock),
    ]
    shared = set.intersection(*(set(run.extras) for run in study.runs)) - {ASKED, *PARTS}
    for name in sorted(shared):
        values = np.full(seen.shape, np.nan)
        for row, run in zip(values, study.runs):
            row[: len(run)] = run.extras[name]
        units = VELOCITIES.get(name)
        scale, unit = (1.0, UNITS.get(name, "")) if units is None else (units.per_base, f"{units.log}/s")
        column = of_run_or_sample(name, unit, scale * values)
        found.append(replace(column, name=_hyphened(dof.words.rate) if name == dof.velocity else name))
    columns_ = [c if c.of_the_run else replace(c, values=np.where(seen, c.values, np.nan)) for c in found]
    kept: dict[tuple[str, bool], Column] = {}
    for column in columns_:
        if np.isfinite(column.values).any() and np.nanmax(column.values) > np.nanmin(column.values):
            kept.setdefault((column.name, column.of_the_run), column)
    return list(kept.values())


def _hyphened(words: str) -> str:
    return words.replace(" ", "-")


def _once_round(shown: Floats, dof: Dof) -> Floats:
    """Headings within a turn; positions that never come back as they are."""
    return shown % 360.0 if dof.wraps else shown


def of_runs(study: Study) -> Floats:
    """The first moment of each run (R,), NaN where a run has moments of several sizes or none."""
    first = np.full(len(study.runs), np.nan)
    for i, run in enumerate(study.runs):
        pushed = run.command[run.command != 0]
        if len(pushed) and np.ptp(np.abs(pushed)) < 1e-6 * np.abs(pushed).max():
            first[i] = pushed[0]
    return first


def commanded(study: Study) -> Floats:
    """Moment commanded at each sample, (R, N), NaN in the padding."""
    moment = np.full(study.batch.seen.shape, np.nan)
    for row, run in zip(moment, study.runs):
        row[: len(run)] = run.command
    return moment


def direction(study: Study) -> Floats:
    """Sign of the last moment that was not zero, (R, N); that of the first one before it."""
    return last_side(np.nan_to_num(commanded(study)))


def last_side(moment: Floats) -> Floats:
    """The same of moments (R, N)."""
    signs = np.sign(moment)
    at = np.where(signs != 0, np.arange(moment.shape[1]), -1)
    at = np.maximum.accumulate(at, axis=1)
    first = np.argmax(signs != 0, axis=1)
    return np.take_along_axis(signs, np.where(at < 0, first[:, None], at), axis=1)


def rates(heading: Floats, time: Floats, seen: NDArray[np.bool_]) -> Floats:
    """Yaw rate [rad/s] of each run's headings (R, N), zero in the padding."""
    out = np.zeros_like(heading)
    for row, psi, t, here in zip(out, heading, time, seen):
        row[here] = np.gradient(psi[here], t[here])
    return out


def edges(values: Floats, most: int) -> Floats:
    """Edges (B + 1,) of at most `most` bins of about equal numbers of `values`; one bin a value where there are few."""
    values = values[np.isfinite(values)]
    different = np.unique(np.round(values, 9))
    if len(different) <= most:
        inner = 0.5 * (different[1:] + different[:-1])
        margin = 0.5 * float(np.min(np.diff(different), initial=np.inf))
        margin = margin if np.isfinite(margin) else 0.5
        return np.concatenate([[different[0] - margin], inner, [different[-1] + margin]])
    cut = np.unique(np.quantile(values, np.linspace(0.0, 1.0, most + 1)))
    far = [b for a, b in pairwise(cut) if b - a > 1e-9 * np.ptp(cut)]
    cut = np.array([cut[0], *far])
    if cut[0] < 0 < cut[-1] and len(cut) > 2:
        cut[1 + int(np.argmin(np.abs(cut[1:-1])))] = 0.0  # no bin mixes the two sides
        cut = np.unique(cut)
    cut[-1] += 1e-9 * max(abs(cut[-1]), 1.0)
    return cut


def since_change(moment: Floats, time: Floats) -> Floats:
    """Time since the command last changed, NaN before it ever did."""
    changed = np.zeros(moment.shape, dtype=bool)
    changed[:, 1:] = np.diff(moment, axis=1) != 0
    changed[:, 0] = moment[:, 0] != 0
    at = np.maximum.accumulate(np.where(changed, np.arange(moment.shape[1]), -1), axis=1)
    since = time - np.take_along_axis(time, np.maximum(at, 0), axis=1)
    return np.where(at >= 0, since, np.nan)


def of_run_or_sample(name: str, unit: str, values: Floats) -> Column:
    """A logged column as a property of the run, (R,), where it hardly changes within runs (R, N)."""
    with_data = np.isfinite(values).any(axis=1)
    if not with_data.all():
        return Column(name, unit, values, logged=True)
    whole = float(np.nanstd(values))
    within = float(np.sqrt(np.nanmean((values - np.nanmean(values, axis=1, keepdims=True)) ** 2)))
    if within < OF_THE_RUN * whole or within < 1e-12:
        return Column(name, unit, np.asarray(np.nanmean(values, axis=1)), logged=True)
    return Column(name, unit, values, logged=True)
