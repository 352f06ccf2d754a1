"""`fit-yaw`: step runs -> drag (Table 1), inertia (Table 2), yaw model, figures; whole runs where there are
no steps. The fits of translations do the same for position against force."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from automarine_cli.dofs import TRANSLATIONS, YAW, Dof
from automarine_cli.errors import SettingError
from automarine_cli.fits.driven import wanted_effects
from automarine_cli.fits.identify import NOTHING_KNOWN, identify_turns
from automarine_cli.fits.linear_mixed import in_words_of
from automarine_cli.fits.output_error import OutputErrorFit
from automarine_cli.fits.step_response import Known
from automarine_cli.fits.tails import asked_tail
from automarine_cli.fits.yaw_fit import YawFit
from automarine_cli.logs import ColumnMap, given_columns
from automarine_cli.pipeline.manifest import Input, given_as
from automarine_cli.pipeline.outputs import result_folder
from automarine_cli.pipeline.parallel import ordered_map
from automarine_cli.pipeline.progress import Progress, silent
from automarine_cli.report import yaw_report
from automarine_cli.report.figures.files import refuse_unknown, write_figures
from automarine_cli.runs.channels import AUTO, asked_channels, wanted_channels
from automarine_cli.runs.half_turn import UNTRIMMED, Trim
from automarine_cli.runs.load import load_half_turns, load_runs, refused_by_strict, told_beside
from automarine_cli.runs.run import Run
from automarine_cli.thrusters.map import ThrusterMap
from automarine_cli.workflows.moments import moment_maker

FIT_TO = ("auto", "half-turns", "whole-runs")
STEPS = "steps"  # what translations have in place of half-turns


def fit_yaw(
    logs: Sequence[str | Path],
    *,
    columns: Path | ColumnMap | None = None,
    thrusters: Path | ThrusterMap | None = None,
    arm: float | None = None,
    fit_to: str = "auto",
    tail: float | None = None,
    known: Known = NOTHING_KNOWN,
    channels: str = AUTO,
    with_effects: Sequence[str] = (),
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
    `fits.identify.identify`, `channels` as in `runs.channels.choose_channels`. `tail` is the turned angle [degrees]
    from which on the paper's method takes a half-turn for steady; None: where drag and inertia are expected to be off
    least. `with_effects` names effects that the models of driven runs have beside drag.

    Raises LogError, RunError, FitError, SettingError or OutputError.
    """
    return _fit(
        YAW, UNTRIMMED, {"arm": arm}, logs, columns=columns, thrusters=thrusters, fit_to=fit_to, tail=tail, known=known,
        channels=channels, with_effects=with_effects, out=out, figure_formats=figure_formats, overwrite=overwrite,
        strict=strict, jobs=jobs, progress=progress,
    )  # fmt: skip


def _followed(dof: Dof) -> Callable[..., YawFit]:
    """The fit of a translation whose steps are followed for a length."""

    def fit(
        logs: Sequence[str | Path],
        *,
        columns: Path | ColumnMap | None = None,
        thrusters: Path | ThrusterMap | None = None,
        within: float | None = None,
        fit_to: str = "auto",
        tail: float | None = None,
        known: Known = NOTHING_KNOWN,
        channels: str = AUTO,
        with_effects: Sequence[str] = (),
        out: Path | None = None,
        figure_formats: tuple[str, ...] = ("png",),
        overwrite: bool = False,
        strict: bool = False,
        jobs: int = 1,
        progress: Progress = silent,
    ) -> YawFit:
        """Identify the {motion} model of a vehicle: {position} against force, as `fit_yaw` does heading against moment.

        Steps and whole runs are followed for `within` [m] of their start, before the wall is felt; None: to their end;
        `tail` as in `fit_yaw`, but the distance [m] covered.
        Thruster commands become forces through the map `thrusters`. Raises as `fit_yaw`.
        """
        if within is not None and not within > 0:
            raise SettingError(f"within is {within:g}; expected metres above 0")
        return _fit(
            dof, Trim(within), {"within": within}, logs, columns=columns, thrusters=thrusters, fit_to=fit_to,
            tail=tail, known=known, channels=channels, with_effects=with_effects, out=out,
            figure_formats=figure_formats, overwrite=overwrite, strict=strict, jobs=jobs, progress=progress,
        )  # fmt: skip

    return _named(fit, dof)


def _windowed(dof: Dof) -> Callable[..., YawFit]:
    """The fit of a translation whose steps are followed inside a window of positions."""

    def fit(
        logs: Sequence[str | Path],
        *,
        columns: Path | ColumnMap | None = None,
        thrusters: Path | ThrusterMap | None = None,
        depths: tuple[float, float] | None = None,
        fit_to: str = "auto",
        tail: float | None = None,
        known: Known = NOTHING_KNOWN,
        channels: str = AUTO,
        with_effects: Sequence[str] = (),
        out: Path | None = None,
        figure_formats: tuple[str, ...] = ("png",),
        overwrite: bool = False,
        strict: bool = False,
        jobs: int = 1,
        progress: Progress = silent,
    ) -> YawFit:
        """Identify the {motion} model of a vehicle: {position} against force, its buoyancy with it, as `fit_yaw` does
        heading.

        Steps and whole runs are followed while the {position} [m] is in the window `depths`, clear of surface and
        bottom; None: to their end; `tail` as in `fit_yaw`, but the distance [m] covered.
        Thruster commands become forces through the map `thrusters`. Raises as `fit_yaw`.
        """
        if depths is not None and not depths[0] < depths[1]:
            raise SettingError(f"depths are {depths[0]:g} and {depths[1]:g}; expected the smaller one first")
        trim = UNTRIMMED if depths is None else Trim(None, *depths)
        return _fit(
            dof, trim, {"depths": depths}, logs, columns=columns, thrusters=thrusters, fit_to=fit_to, tail=tail,
            known=known, channels=channels, with_effects=with_effects, out=out, figure_formats=figure_formats,
            overwrite=overwrite, strict=strict, jobs=jobs, progress=progress,
        )  # fmt: skip

    return _named(fit, dof)


def _named(fit: Callable[..., YawFit], dof: Dof) -> Callable[..., YawFit]:
    """The fit under its motion's name."""
    fit.__name__ = fit.__qualname__ = f"fit_{dof.name}"
    fit.__doc__ = dof.fill(fit.__doc__ or "")
    return fit


FITS: Mapping[str, Callable[..., YawFit]] = {
    YAW.name: fit_yaw,
    **{name: (_windowed if dof.windowed else _followed)(dof) for name, dof in TRANSLATIONS.items()},
}
"""What fits each motion, by its name."""


def _fit(
    dof: Dof,
    trim: Trim,
    own: dict[str, object],
    logs: Sequence[str | Path],
    *,
    columns: Path | ColumnMap | None,
    thrusters: Path | ThrusterMap | None,
    fit_to: str,
    tail: float | None,
    known: Known,
    channels: str,
    with_effects: Sequence[str],
    out: Path | None,
    figure_formats: tuple[str, ...],
    overwrite: bool,
    strict: bool,
    jobs: int,
    progress: Progress,
) -> YawFit:
    """The fit of any motion; `own` are the options that only it has."""
    start = asked_tail(tail, dof)
    if tail is not None and fit_to == FIT_TO[2]:
        raise SettingError("tail is given, but whole runs have no tails; leave it out, or fit to steps")
    refuse_unknown(figure_formats)
    wanted_channels(channels, dof)
    wanted = wanted_effects(with_effects, dof)
    if wanted and fit_to not in (FIT_TO[0], FIT_TO[2]):
        raise SettingError(f"--with fits whole runs; leave out --fit-to {fit_to}")
    column_map = given_columns(columns)
    arm, kind = own.get("arm"), FIT_TO[1] if fit_to == STEPS else fit_to
    drive = moment_maker(thrusters, arm if isinstance(arm, int | float) else None, column_map, dof)
    campaign = load_half_turns(
        logs, column_map, drive, dof=dof, trim=trim, strict=strict, progress=progress, jobs=jobs
    )

    limits = list(campaign.limits)

    def whole() -> Sequence[Run]:
        again = load_runs(logs, column_map, dof=dof, progress=progress, jobs=jobs)
        limits[:] = again.limits
        return [trim.of_whole(run if drive is None else drive(run)) for run in again.runs]

    def each(function: Callable[[str], OutputErrorFit], models: Sequence[str]) -> Sequence[OutputErrorFit]:
        return ordered_map(function, models, jobs, progress=progress, stage="fitting models")

    def work() -> YawFit:
        with told_beside(campaign.set_aside), in_words_of(dof):
            fit = identify_turns(
                dof, campaign.turns, campaign.not_turned, whole, kind, known, each, channels, start, wanted
            )
        beyond = [one.warning for one in limits if one.dof is dof]
        fit = replace(fit, set_aside=(*campaign.set_aside, *fit.set_aside), warnings=(*beyond, *fit.warnings))
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
        **own,
        "fit_to": fit_to,
        "tail": tail,
        "known": known,
        "figure_formats": figure_formats,
        "strict": strict,
        **asked_channels(channels),
        **({"with_effects": list(wanted)} if wanted else {}),
    }
    command = f"fit-{dof.name}"
    with result_folder(
        out, command=command, options=options, inputs=inputs, seed=None, overwrite=overwrite
    ) as folder:
        fit = work()
        folder.write_json(f"{dof.name}_model.json", fit.to_json())
        for name, content in yaw_report.files(fit):
            folder.write(name, content)
        write_figures(folder, yaw_report.drawings(fit), figure_formats)
    return fit
