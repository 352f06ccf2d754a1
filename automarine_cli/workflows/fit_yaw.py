"""`fit-yaw`: step runs -> drag (Table 1), inertia (Table 2), yaw model, figures; whole runs where there are
no steps."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from automarine_cli.fits.identify import NOTHING_KNOWN, identify_turns
from automarine_cli.fits.output_error import OutputErrorFit
from automarine_cli.fits.step_response import Known
from automarine_cli.fits.yaw_fit import YawFit
from automarine_cli.logs import ColumnMap, given_columns
from automarine_cli.models.thruster_map import ThrusterMap
from automarine_cli.pipeline.manifest import Input, given_as
from automarine_cli.pipeline.outputs import result_folder
from automarine_cli.pipeline.parallel import ordered_map
from automarine_cli.pipeline.progress import Progress, silent
from automarine_cli.report import yaw_report
from automarine_cli.runs.load import load_half_turns, load_runs, refused_by_strict, told_beside
from automarine_cli.runs.run import Run
from automarine_cli.workflows.moments import moment_maker

FIT_TO = ("auto", "half-turns", "whole-runs")


def fit_yaw(
    logs: Sequence[str | Path],
    *,
    columns: Path | ColumnMap | None = None,
    thrusters: Path | ThrusterMap | None = None,
    arm: float | None = None,
    fit_to: str = "auto",
    known: Known = NOTHING_KNOWN,
    out: Path | None = None,
    figure_formats: tuple[str, ...] = ("png",),
    overwrite: bool = False,
    strict: bool = False,
    jobs: int = 1,
    progress: Progress = silent,
) -> YawFit:
    """Identify the yaw model of a vehicle from its logs; writes the results if `out` is given, figures in the
    `figure_formats` (png, svg, pdf).

    `thrusters` and `arm` [m] turn thruster commands into moments; `fit_to` and `known` as in
    `fits.yaw_fit.identify`. Raises LogError, RunError, FitError, SettingError or OutputError.
    """
    column_map = given_columns(columns)
    drive = moment_maker(thrusters, arm, column_map)
    campaign = load_half_turns(logs, column_map, drive, strict=strict, progress=progress, jobs=jobs)

    def whole() -> Sequence[Run]:
        runs = load_runs(logs, column_map, progress=progress, jobs=jobs).runs
        return runs if drive is None else [drive(run) for run in runs]

    def each(function: Callable[[str], OutputErrorFit], models: Sequence[str]) -> Sequence[OutputErrorFit]:
        return ordered_map(function, models, jobs, progress=progress, stage="fitting models")

    def work() -> YawFit:
        with told_beside(campaign.set_aside):
            fit = identify_turns(campaign.turns, campaign.not_turned, whole, fit_to, known, each)
        fit = replace(fit, set_aside=(*campaign.set_aside, *fit.set_aside))
        if strict and fit.set_aside:
            raise refused_by_strict(fit.set_aside[0])
        return fit

    if out is None:
        return work()
    inputs = [Input(file.name, file.path) for file in campaign.inputs]
    inputs += given_as(columns=columns, dbc=column_map.database, thrusters=thrusters)
    options = {
        "columns": columns,
        "thrusters": thrusters,
        "arm": arm,
        "fit_to": fit_to,
        "known": known,
        "figure_formats": figure_formats,
        "strict": strict,
    }
    with result_folder(
        out, command="fit-yaw", options=options, inputs=inputs, seed=None, overwrite=overwrite
    ) as folder:
        fit = work()
        folder.write_json("yaw_model.json", fit.to_json())
        for name, content in yaw_report.files(fit, figure_formats):
            folder.write(name, content)
    return fit
