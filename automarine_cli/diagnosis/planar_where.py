"""Where a planar model and its runs disagree: stretches of motion, command and clock that stand out against chance.

Looked at are the heading measured less predicted some seconds before, and the forces and the moment that the filter
needed beside the model (inertia by disturbing accelerations), as `where` does for one motion. Runs are few and long
here, so that not they but stretches of them are the unit whose sign chance turns: longer than errors hang together.
Runs held out count too, for nothing is fitted here.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from automarine_cli.diagnosis.planar import PlanarSearch, fit_of
from automarine_cli.diagnosis.study import JUDGED
from automarine_cli.diagnosis.variables import Column, last_side, of_run_or_sample, since_change
from automarine_cli.diagnosis.where import Gap, Where, look
from automarine_cli.dofs import YAW
from automarine_cli.dofs.motion import PLANAR
from automarine_cli.filters.course import Course
from automarine_cli.filters.prediction import Predicted
from automarine_cli.fits.planar_structure import CHANNELS
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import Run

STRETCH = 10.0
"""Length [s] of a stretch: twice the horizon, and several time constants of usual disturbances."""


def find_planar_where(search: PlanarSearch, seed: int) -> Where | None:
    """Look at the gap of the model before anything was added against every variable; `seed` draws the signs. None where
    all runs are too short for predictions."""
    every, before = search.every, search.before
    course, runs, fit = every.course, every.runs, fit_of(before)
    found = judged(search.foretold[0][YAW.position])
    if not len(found.error):
        return None
    residual, seen = np.zeros(course.time.shape), np.zeros(course.time.shape, dtype=bool)
    residual[found.run, found.target], seen[found.run, found.target] = found.error, True
    problem = every.problem(before.model)
    followed = problem.follow(problem.search(fit.theta)[None], keep=True)
    assert followed.states is not None
    places, states = followed.places, followed.states[:, 0]
    (inertia,) = before.model.inertia_matrix(fit.of_model[None])
    missing = np.einsum("ij,jrk->irk", inertia, states[list(places.pushed)])
    command = np.stack([_at_nodes(course, [run.command_of(dof) for run in runs], runs) for dof in PLANAR.dofs])
    sign: Floats = np.where(seen, last_side(command[-1]), 0.0)
    gain = 100.0 * followed.states[places.gain, 0, :, -1]
    kinds = {YAW.words.position: (YAW.units.shown, np.asarray(YAW.shown(residual)))}
    for dof, force in zip(PLANAR.dofs, missing):
        if dof in every.seen.dofs:
            kinds[dof.words.full_force] = (dof.units.forces[1], np.where(seen, force, 0.0))
    floor, columns = float(before.noises[YAW.position]), _columns(runs, course, states, command, seen)
    r, part = _stretches(course, seen)
    pieces = {name: (unit, part * values[r]) for name, (unit, values) in kinds.items()}
    gap = Gap(
        tuple(course.names[i] for i in r),
        part * residual[r],
        part * residual[r],
        np.where(part, sign[r], 0.0),
        part,
        gain[r],
        floor,
        shown=YAW.shown,
    )
    looked = look([replace(one, values=np.where(part, one.values[r], np.nan)) for one in columns], pieces, gap, seed)
    kept = {one.name: one for one in columns}
    return Where(
        variables=looked.variables,
        columns=tuple(kept[one.name] for one in looked.variables),
        regions=tuple(replace(one, runs=tuple(dict.fromkeys(one.runs))) for one in looked.regions),
        names=course.names,
        residual=residual,
        moment=np.where(seen, missing[-1], 0.0),
        sign=sign,
        gain=gain,
        mean_moment=np.array([float(run.command.mean()) for run in runs]),
        time=course.time,
        seen=seen,
        floor=floor,
        moment_unit=course.moment_unit,
        dof=YAW,
    )


def judged(each: tuple[Predicted, ...]) -> Predicted:
    """The predictions over the horizon that shows the gap, or the longest below it that any run is long enough for."""
    some = [one for one in each if len(one.error) and one.horizon <= JUDGED]
    return max(some or each[:1], key=lambda one: one.horizon)


def _columns(
    runs: tuple[Run, ...], course: Course, states: Floats, command: Floats, seen: NDArray[np.bool_]
) -> list[Column]:
    """Motion as filtered, products of velocities, commands, clocks and what else all runs log, at the nodes (R, K)."""
    heading = np.asarray(YAW.shown(states[2]))
    (u, v), turning = states[3:5], np.asarray(YAW.shown(states[5]))
    number = np.any(np.diff(command, axis=2, prepend=0.0) != 0.0, axis=0).cumsum(axis=1).astype(float)
    found = [
        Column("surge", "m/s", u),
        Column("sway", "m/s", v),
        Column("yaw-rate", "deg/s", turning),
        Column("surge times yaw-rate", "m/s deg/s", u * turning),
        Column("surge times sway", "m²/s²", u * v),
        Column(YAW.words.position, YAW.units.shown, heading % 360.0),
        *(
            Column(dof.words.full_force.replace(" ", "-"), dof.units.forces[1], force)
            for dof, force in zip(PLANAR.dofs, command)
        ),
        Column("time-in-run", "s", course.time),
        Column("time-since-command-change", "s", since_change(number, course.time)),
    ]
    forces = {dof.command for dof in PLANAR.dofs}
    for name in sorted(set.intersection(*(set(run.extras) for run in runs)) - {*CHANNELS, *forces}):
        found.append(of_run_or_sample(name, "", _at_nodes(course, [run.extras[name] for run in runs], runs)))
    kept = [replace(one, values=np.where(seen, one.values, np.nan)) for one in found if not one.of_the_run]
    return [one for one in kept if np.nanmax(one.values) > np.nanmin(one.values)]


def _stretches(course: Course, seen: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """The run of each stretch, (S,), and which of its nodes are in it, (S, K)."""
    number = np.floor(course.time / STRETCH)
    each = [
        (r, own)
        for r in range(len(seen))
        for n in np.unique(number[r, seen[r]])
        if (own := seen[r] & (number[r] == n)).any()
    ]
    return np.array([r for r, _ in each]), np.array([own for _, own in each])


def _at_nodes(course: Course, columns: list[Floats], runs: tuple[Run, ...]) -> Floats:
    """What is held at the filter's nodes, (R, K)."""
    out = np.zeros(course.time.shape)
    for row, column, run, time in zip(out, columns, runs, course.time):
        at = np.searchsorted(run.time - run.time[0], time + 1e-9, side="right") - 1
        row[:] = column[np.clip(at, 0, len(column) - 1)]
    return out
