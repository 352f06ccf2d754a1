"""`fit-yaw`: step runs -> drag (Table 1), inertia (Table 2), yaw model, figures; whole runs where there are
no steps. The fits of translations do the same for position against force."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from automarine_cli import effects
from automarine_cli.comparison.result_files import of_model
from automarine_cli.dofs import DOFS, YAW, Dof
from automarine_cli.errors import SettingError
from automarine_cli.fits.channel_noise import noise_words
from automarine_cli.fits.driven import wanted_effects
from automarine_cli.fits.identify import identify_turns
from automarine_cli.fits.known import names_in
from automarine_cli.fits.linear_mixed import in_words_of
from automarine_cli.fits.output_error import OutputErrorFit
from automarine_cli.fits.tails import asked_tail
from automarine_cli.fits.yaw_fit import YawFit, effect_estimates
from automarine_cli.logs import given_columns
from automarine_cli.pipeline.parallel import ordered_map
from automarine_cli.pipeline.results_folder import ResultFolder
from automarine_cli.report import outcomes, yaw_report
from automarine_cli.report.figures import yaw as figures
from automarine_cli.report.figures.files import write_figures
from automarine_cli.results.kinds import MODELS
from automarine_cli.runs.channels import AUTO, wanted_channels
from automarine_cli.runs.half_turn import UNTRIMMED, Trim
from automarine_cli.runs.load import load_half_turns, load_runs, refused_by_strict, told_beside
from automarine_cli.runs.run import Run
from automarine_cli.workflows.command import SELDOM, Command, ReadBack, Runner
from automarine_cli.workflows.moments import moment_maker
from automarine_cli.workflows.shared import Beforehand, Ending, Lever, OfLogs, Thrusters, aligned, counted, numbers
from automarine_cli.workflows.view import Figures, Row, View

FIT_TO = ("auto", "half-turns", "whole-runs")
STEPS = "steps"  # what translations have in place of half-turns


@dataclass(frozen=True, kw_only=True)
class _Fitted:
    """What of the runs is fitted, and where tails start (None: where drag and inertia are expected to be off least)."""

    fit_to: str = FIT_TO[0]
    tail: float | None = None


@dataclass(frozen=True, kw_only=True)
class _Sensors:
    """The sensors that count, and the effects that models of driven runs have beside drag."""

    channels: str = field(default=AUTO, metadata=SELDOM)
    with_effects: tuple[str, ...] = field(default=(), metadata=SELDOM)


@dataclass(frozen=True, kw_only=True)
class FitYawOptions(_Sensors, Beforehand, Ending, _Fitted, Lever, OfLogs):
    """`thrusters` and `arm` [m] turn thruster commands into moments; `tail` is a turned angle [degrees]."""

    @property
    def trim(self) -> Trim:
        """How far a step is followed."""
        return UNTRIMMED


@dataclass(frozen=True, kw_only=True)
class _Follow(Thrusters):
    within: float | None = None


@dataclass(frozen=True, kw_only=True)
class FollowedOptions(_Sensors, Beforehand, Ending, _Fitted, _Follow, OfLogs):
    """Steps and whole runs are followed for `within` [m] of their start, before the wall is felt (None: to their end);
    `tail` is the distance [m] covered."""

    arm = None

    @property
    def trim(self) -> Trim:
        """How far a step is followed. Raises SettingError for no length."""
        if self.within is not None and not self.within > 0:
            raise SettingError(f"within is {self.within:g}; expected metres above 0")
        return Trim(self.within)


@dataclass(frozen=True, kw_only=True)
class _Window(Thrusters):
    depths: tuple[float, float] | None = None


@dataclass(frozen=True, kw_only=True)
class WindowedOptions(_Sensors, Beforehand, Ending, _Fitted, _Window, OfLogs):
    """Steps and whole runs are followed while the depth [m] is in the window `depths`, clear of surface and bottom
    (None: to their end); `tail` is the distance [m] covered."""

    arm = None

    @property
    def trim(self) -> Trim:
        """Where a step is followed. Raises SettingError for no window."""
        if self.depths is None:
            return UNTRIMMED
        if not self.depths[0] < self.depths[1]:
            raise SettingError(f"depths are {self.depths[0]:g} and {self.depths[1]:g}; expected the smaller one first")
        return Trim(None, *self.depths)


FitOptions = FitYawOptions | FollowedOptions | WindowedOptions


def _fit(dof: Dof, asked: FitOptions, runner: Runner) -> YawFit:
    """The fit of any motion."""
    trim, start = asked.trim, asked_tail(asked.tail, dof)
    if asked.fit_to not in (*FIT_TO, STEPS):
        raise SettingError(f"fit_to: found {asked.fit_to!r}, expected {', '.join(FIT_TO[:2])} or {FIT_TO[2]}")
    if asked.tail is not None and asked.fit_to == FIT_TO[2]:
        raise SettingError("tail is given, but whole runs have no tails; leave it out, or fit to steps")
    wanted_channels(asked.channels, dof)
    wanted = wanted_effects(asked.with_effects, dof)
    own = [f"{name}.{one}" for name in wanted for one in effects.get(name).names_in(dof)]
    known = asked.known.named(names_in(dof, own), signed=(dof.parameter("constant"), *own))
    if wanted and asked.fit_to not in (FIT_TO[0], FIT_TO[2]):
        raise SettingError(f"--with fits whole runs; leave out --fit-to {asked.fit_to}")
    names, jobs, progress = given_columns(asked.columns), runner.jobs, runner.progress
    kind = FIT_TO[1] if asked.fit_to == STEPS else asked.fit_to
    drive = moment_maker(asked.thrusters, asked.arm, names, dof)
    campaign = load_half_turns(
        asked.logs, names, drive, dof=dof, trim=trim, strict=asked.strict, progress=progress, jobs=jobs
    )
    limits = list(campaign.limits)

    def whole() -> Sequence[Run]:
        again = load_runs(asked.logs, names, dof=dof, progress=progress, jobs=jobs)
        limits[:] = again.limits
        return [trim.of_whole(run if drive is None else drive(run)) for run in again.runs]

    def each(function: Callable[[str], OutputErrorFit], models: Sequence[str]) -> Sequence[OutputErrorFit]:
        return ordered_map(function, models, jobs, progress=progress, stage="fitting models")

    def work() -> YawFit:
        with told_beside(campaign.set_aside), in_words_of(dof):
            fit = identify_turns(
                dof, campaign.turns, campaign.not_turned, whole, kind, known, each, asked.channels, start, wanted
            )  # fmt: skip
        beyond = [*campaign.warnings, *(one.warning for one in limits if one.dof is dof)]
        fit = replace(fit, set_aside=(*campaign.set_aside, *fit.set_aside), warnings=(*beyond, *fit.warnings))
        if asked.strict and fit.set_aside:
            raise refused_by_strict(fit.set_aside[0])
        return fit

    def write(folder: ResultFolder, fit: YawFit) -> None:
        folder.write_json(f"{dof.name}_model.json", fit.to_json())
        for name, content in yaw_report.files(fit):
            folder.write(name, content)
        write_figures(folder, yaw_report.drawings(fit), asked.figure_formats)

    return runner.results(replace(asked, with_effects=wanted), work, write)


def _files(fit: YawFit) -> tuple[str, ...]:
    """What a fit to half-turns (steps), or to whole runs, leaves in its folder."""
    names = (fit.dof.steps_key, "drag", "inertia", "collapse") if fit.turns else ("whole_runs",)
    tables = "table1 and table2 (.csv, .md, .tex)"
    return (f"{fit.dof.name}_model.json", tables, "runs.parquet", *(f"{name}.png" for name in names))


def _lines(fit: YawFit) -> Iterator[str]:
    dof = fit.dof
    own = dof.symbols
    to = f"{dof.words.step}s" if fit.turns else "whole runs"
    used, aside = counted(fit.used, "run"), len(fit.set_aside)
    yield f"{dof.name.capitalize()} model {fit.preference.number}, fitted to {to} of {used}; {aside} set aside"
    names = {
        own.quadratic: own.quadratic_print,
        **{name: name.replace("_", " ") for name in (own.constant, own.difference)},
    }
    found = {names.get(name, name): one for name, one in fit.preferred.estimates.items()}
    if fit.preferred.inertial_turn_angle is not None:
        found[f"{own.inertia}/{own.quadratic_print}"] = fit.preferred.inertial_turn_angle
    elif fit.time_constant is not None:
        found[f"{own.inertia}/{own.linear}"] = fit.time_constant
    for effect, group in effect_estimates(fit.preferred).items():
        found |= {f"{effect} {name}": one for name, one in group.items() if one.stderr > 0}
    yield from aligned(found)
    yield f"  {noise_words(fit.preferred.mixed, dof)}; {counted(len(fit.warnings), 'warning')}"


def _rows(fit: YawFit) -> Iterator[Row]:
    for model, ml in fit.output_error.items():
        fitted = {f"{e} {name}": one for e, group in effect_estimates(ml).items() for name, one in group.items()}
        for name, one in {**ml.estimates, **fitted}.items():
            yield {"model": model, "method": "maximum likelihood", "parameter": name} | numbers(one)
    if fit.seed_method is None:
        return
    for model, drag in fit.seed_method.drag.items():
        if model not in fit.output_error:  # with a constant moment: a test of symmetry, no model of its own
            continue
        found = dict(drag.estimates)
        if model in fit.seed_method.inertia:
            found[fit.dof.symbols.inertia] = fit.seed_method.inertia[model].overall
        for name, one in found.items():
            yield {"model": model, "method": "velocity error", "parameter": name} | numbers(one)


def _figures(fit: YawFit) -> Figures:
    seed, data = fit.seed_method, fit.data
    if seed is None or data is None:
        return {"whole-runs": yaw_report.drawings(fit)["whole_runs"]}
    return {
        "drag": lambda: figures.drag_figure(fit, seed),
        "inertia": lambda: figures.inertia_figure(fit, seed),
        f"{fit.dof.words.step}s": lambda: figures.half_turns_figure(fit),
        "collapse": lambda: figures.collapse_figure(fit, data),
    }


VIEW = View[YawFit](
    lambda fit: [*yaw_report.tables(fit, short=True), *yaw_report.sentences(fit)], _lines, _rows, _figures
)


def _command(dof: Dof) -> Command[Any, YawFit]:
    """The fit of a motion."""
    options = FitYawOptions if dof is YAW else WindowedOptions if dof.windowed else FollowedOptions

    def run(asked: FitOptions, runner: Runner) -> YawFit:
        return _fit(dof, asked, runner)

    run.__doc__ = dof.fill(
        f"Identify the {{motion}} model of a vehicle from its logs: {{position}} against {{force}}.\n\n"
        f"{options.__doc__}\n\n"
        f'`known` is what is known beforehand: {{{{"{dof.symbols.inertia}": (915, 50)}}}}, values with or without a '
        "standard error, in the unit of the fit. `fit_to` as in `fits.identify.identify_turns`, `channels` as in "
        "`runs.channels.choose_channels`. "
        "Raises LogError, RunError, FitError, SettingError or OutputError."
    )
    kept = ReadBack(MODELS[dof.name], outcomes.of_model, of_model)
    return Command(f"fit-{dof.name}", options, run, {YawFit: VIEW}, _files, kept)


FITS = {name: _command(dof) for name, dof in DOFS.items()}
"""What fits each motion, by its name."""
fit_yaw = FITS[YAW.name]
