"""Thruster commands of a log -> yaw moment, or force, through a thruster map."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from math import isfinite

import numpy as np

from automarine_cli.dofs import DOFS, SURGE, SWAY, YAW, Dof
from automarine_cli.effects.thruster_imbalance import PARTS
from automarine_cli.errors import AutomarineError, ModelError, RunError, SettingError
from automarine_cli.logs import ColumnMap, Logs
from automarine_cli.models.allocation import twin_forces
from automarine_cli.pipeline.progress import Progress, silent
from automarine_cli.pipeline.records import Source
from automarine_cli.quantities import Floats
from automarine_cli.runs.load import Campaign, load_runs, none_left, read_planar, refused_by_strict
from automarine_cli.runs.run import Run, SetAside
from automarine_cli.thrusters.map import ThrusterMap


def thrust_of(run: Run, thrusters: ThrusterMap, arm: float) -> list[Floats]:
    """Thrust [N] of each thruster of a run's motion by its commands.

    Raises RunError for a run without these, and ModelError for an arm [m] that is no length or a direction that the map
    lacks."""
    names = run.dof.thrusters
    if lacking := [name for name in names if name not in run.extras]:
        raise RunError(
            f"{run.source}, run {run.name!r}: no thruster command {' or '.join(lacking)} in the log, which "
            f"--thrusters needs; map the log's columns to {' and '.join(names)} with --columns, or leave "
            "--thrusters out"
        )
    try:
        if run.dof.levered and not (isfinite(arm) and arm > 0):
            raise ModelError(f"the arm of a thruster is {arm!r}; expected a positive length in metres")
        return [thrusters.force(run.extras[name]) for name in names]
    except ModelError as error:
        raise ModelError(f"{run.source}, run {run.name!r}: {error}") from None


def drive_run_by_thrusters(run: Run, thrusters: ThrusterMap, arm: float) -> Run:
    """The run with the moment [N m] that two equal thrusters `arm` [m] off the centre line make of their commands, the
    port one ahead to starboard; in surge and heave with the force [N], whatever the arm.

    A moment that is in the log gives way. Raises RunError and ModelError as `thrust_of` does."""
    dof, thrust = run.dof, thrust_of(run, thrusters, arm)
    lever = arm if dof.levered else 1.0
    moment = np.asarray(lever * sum(side * force for side, force in zip(dof.sides, thrust)))
    shares = [side * lever * force for side, force in zip(dof.sides, thrust)]
    commanded = thrusters.compared(dof.thrusters, [run.extras[name] for name in dof.thrusters])
    return run.with_moment(moment, dof.units.forces[1], parts_of(shares, dof), commanded)


def parts_of(shares: Sequence[Floats], dof: Dof) -> dict[str, Floats]:
    """What each thruster gives forward and backward, by the names of PARTS, of its share (N,) of the moment or force;
    none for a motion of another number of thrusters than two."""
    ways = [side * way(side * one, 0.0) for side, one in zip(dof.sides, shares) for way in (np.maximum, np.minimum)]
    return dict(zip(PARTS, ways)) if len(ways) == len(PARTS) else {}


def moment_maker(
    thrusters: Source | ThrusterMap | None, arm: float | None, columns: ColumnMap, dof: Dof
) -> Callable[[Run], Run] | None:
    """What makes the moment or force of thruster commands, at lever arm `arm` [m] (default: the column map's `arm_m`).

    None without a map: then the logs hold it. Raises SettingError where map or arm is given alone."""
    given = map_and_arm(thrusters, arm, columns, dof)
    return None if given is None else partial(drive_run_by_thrusters, thrusters=given[0], arm=given[1])


def map_and_arm(
    thrusters: Source | ThrusterMap | None, arm: float | None, columns: ColumnMap, dof: Dof
) -> tuple[ThrusterMap, float] | None:
    """The map and the lever arm [m] as given, or None without a map; see `moment_maker`."""
    if not dof.levered and arm is not None:
        levered = " and ".join(one.name for one in DOFS.values() if one.levered)
        raise SettingError(f"--arm is of {levered}; in {dof.name} thrusters push as hard at any arm, so leave it out")
    if thrusters is not None and not dof.thrusters:
        remedy = f"leave it out, and name the {dof.words.force}'s column with --columns"
        raise SettingError(f"--thrusters makes no {dof.words.full_force}; {remedy}")
    if thrusters is None:
        if arm is not None:
            raise SettingError("--arm goes with the thrusters' map; give --thrusters MAP.json too")
        return None
    length = columns.defaults.get("arm_m") if arm is None else arm
    if not dof.levered:
        length = 1.0  # of no account
    if not isinstance(length, int | float):
        force = dof.words.force
        raise SettingError(f"--thrusters makes {force}s only with the thrusters' lever arm; give --arm METRES")
    known = ThrusterMap.load(thrusters) if isinstance(thrusters, Source) else thrusters
    return known, float(length)


def load_planar(
    logs: Logs, columns: ColumnMap, thrusters: Source | ThrusterMap | None = None, arm: float | None = None, *,
    strict: bool = False, jobs: int = 1, progress: Progress = silent,
) -> Campaign:  # fmt: skip
    """The runs of the logs, driven by forces ahead and abeam and a moment.

    `thrusters` and `arm` [m] make force and moment of the commands of two thrusters that push ahead. Raises LogError,
    RunError and SettingError as the fits of one motion do."""
    given = map_and_arm(thrusters, arm, columns, YAW)
    campaign = load_runs(logs, columns, dof=YAW, strict=strict, jobs=jobs, progress=progress, read=read_planar)
    good: list[Run] = []
    aside: list[SetAside] = []
    for run in campaign.runs:
        try:
            good.append(driven(run if given is None else by_two_thrusters(run, *given)))
        except AutomarineError as error:
            why = str(error).removeprefix(f"{run.source}, run {run.name!r}: ")
            aside.append(SetAside(run.source, run.name, why))
    if strict and aside:
        raise refused_by_strict(aside[0])
    if not good:
        raise none_left(len(campaign.inputs), (*campaign.set_aside, *aside))
    return replace(campaign, runs=tuple(good), set_aside=(*campaign.set_aside, *aside))


def by_two_thrusters(run: Run, thrusters: ThrusterMap, arm: float) -> Run:
    """The run driven by two equal thrusters `arm` [m] off the centre line; raises as `thrust_of` does."""
    ahead, abeam, moment = twin_forces(np.stack(thrust_of(run, thrusters, arm)), arm)
    extras = {**run.extras, SURGE.command: ahead, SWAY.command: abeam}
    commanded = thrusters.compared(YAW.thrusters, [run.extras[name] for name in YAW.thrusters])
    return replace(run.with_moment(moment, YAW.units.forces[1], commanded=commanded), extras=extras)


def driven(run: Run) -> Run:
    """The run with a force of zero along each axis for which it has none, which its notes tell.

    Raises RunError for a run without any command, or whose commands are all zero."""
    _ = run.command  # refused where there is none
    lacking = [dof for dof in (SURGE, SWAY) if dof.command not in run.extras]
    zero = {dof.command: np.zeros(len(run)) for dof in lacking}
    told = tuple(f"no {dof.words.full_force} in the log: none is taken to act" for dof in lacking)
    run = replace(run, extras={**run.extras, **zero}, notes=(*run.notes, *told), reading=(*run.reading, *told))
    if not any(np.any(run.command_of(dof)) for dof in (SURGE, SWAY, YAW)):
        raise RunError(
            f"{run.source}, run {run.name!r}: every command is zero: something that is not logged steers the vehicle; "
            "log what drives it, or leave the run out"
        )
    return run
