"""Logs -> runs of motion in the plane, with every force that drives them; what `fit-planar` and `validate` share."""

from dataclasses import replace
from functools import partial

import numpy as np

from automarine_cli.dofs import SURGE, SWAY, YAW
from automarine_cli.errors import AutomarineError, ModelError, RunError
from automarine_cli.logs import ColumnMap, Logs
from automarine_cli.models.allocation import Allocation
from automarine_cli.pipeline.progress import Progress, silent
from automarine_cli.pipeline.records import Source
from automarine_cli.runs.load import Campaign, load_runs, none_left, refused_by_strict
from automarine_cli.runs.planar import read_planar
from automarine_cli.runs.run import Run, SetAside
from automarine_cli.thrusters.map import ThrusterMap
from automarine_cli.thrusters.moments import map_and_arm


def load_planar(
    logs: Logs,
    columns: ColumnMap,
    thrusters: Source | ThrusterMap | None = None,
    arm: float | None = None,
    *,
    strict: bool = False,
    jobs: int = 1,
    progress: Progress = silent,
) -> Campaign:
    """The runs of the logs, driven by forces ahead and abeam and a moment.

    `thrusters` and `arm` [m] make force and moment of the commands of two thrusters that push ahead. Raises LogError,
    RunError and SettingError as the fits of one motion do.
    """
    given = map_and_arm(thrusters, arm, columns, YAW)
    campaign = load_runs(logs, columns, dof=YAW, strict=strict, jobs=jobs, progress=progress, read=partial(read_planar))
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
    """The run driven by two equal thrusters `arm` [m] off the centre line, of its commands `n_port` and `n_stbd`.

    Raises RunError for a run without them, ModelError for a direction that the map lacks.
    """
    lacking = [name for name in YAW.thrusters if name not in run.extras]
    if lacking:
        raise RunError(
            f"{run.source}, run {run.name!r}: no thruster command {' or '.join(lacking)} in the log, which --thrusters "
            f"needs; map the log's columns to {' and '.join(YAW.thrusters)} with --columns, or leave --thrusters out"
        )
    try:
        thrust = np.stack([thrusters.force(run.extras[name]) for name in YAW.thrusters])
    except ModelError as error:
        raise ModelError(f"{run.source}, run {run.name!r}: {error}") from None
    ahead, abeam, moment = Allocation.twin(arm).forces(thrust)
    extras = {**run.extras, SURGE.command: ahead, SWAY.command: abeam}
    given = thrusters.compared(YAW.thrusters, [run.extras[name] for name in YAW.thrusters])
    return replace(run.with_moment(moment, YAW.units.forces[1], commanded=given), extras=extras)


def driven(run: Run) -> Run:
    """The run with a force of zero along each axis for which it has none, which its notes tell.

    Raises RunError for a run without any command, or whose commands are all zero.
    """
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
