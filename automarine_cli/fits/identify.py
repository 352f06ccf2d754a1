"""From runs to a yaw fit: which runs serve for what, then both estimators and the preferred model."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from automarine_cli.dofs import Dof
from automarine_cli.errors import FitError, RunError
from automarine_cli.filters.course import make_course
from automarine_cli.filters.nodes import averaged_over
from automarine_cli.fits.drag import FEWEST_A_WAY
from automarine_cli.fits.driven_fit import widened
from automarine_cli.fits.driven_models import STEPS, both_ways, fitted_driven, is_driven
from automarine_cli.fits.driven_use import Judgement, judged_whole, left_out, prefer_driven, use_of
from automarine_cli.fits.known import NOTHING_KNOWN, Known
from automarine_cli.fits.output_error import MANY_RUNS, OutputErrorFit, fit_half_turns, fit_whole_runs, prefer
from automarine_cli.fits.step_response import StepData, half_turn_data
from automarine_cli.fits.velocity_error import VelocityErrorFit, fit_velocity_error
from automarine_cli.fits.ways import by_way
from automarine_cli.fits.yaw_cautions import design_cautions, fit_cautions, seed_cautions
from automarine_cli.fits.yaw_fit import YawFit
from automarine_cli.fits.yaw_warnings import fit_warnings, step_warnings, told
from automarine_cli.runs.channels import AUTO, NOTHING_TO_CHOOSE, choose_channels
from automarine_cli.runs.checks import without_stuck, without_undriven
from automarine_cli.runs.half_turn import HalfTurn
from automarine_cli.runs.run import Run, SetAside
from automarine_cli.runs.steps import find_steps, released
from automarine_cli.simulation.batch import make_batch
from automarine_cli.simulation.rollout import step_for

Map = Callable[[Callable[[str], Any], Sequence[str]], Sequence[Any]]

FEWEST_STEPS = 3
FEWEST_SAMPLES = 20  # of a whole run


def identify_turns(
    dof: Dof,
    turns: tuple[HalfTurn, ...],
    set_aside: tuple[SetAside, ...],
    whole: Callable[[], Sequence[Run]],
    fit_to: str = "auto",
    known: Known = NOTHING_KNOWN,
    each: Map | None = None,
    channels: str = AUTO,
    tail: float | None = None,
    with_effects: Sequence[str] = (),
) -> YawFit:
    """Fit the three models to a motion's half-turns, or to whole runs, which `whole` gives if they are needed.

    `set_aside` are the runs without a half-turn. `fit_to` is "half-turns", "whole-runs", or "auto": half-turns if at
    least three at two sizes of moment serve and they are half of the runs or more, else whole runs. `known` is what
    need not be estimated, or is known with an error, by qualified names; `each` maps a function over the models (to use
    processes), `channels` says which sensors count (`runs.channels.choose_channels`), `tail` [rad or m] where the tails
    of the paper's method start, None: where they are best. Raises RunError where too few runs are left, FitError where
    the data cannot carry a fit.
    """
    each = each or (lambda function, models: [function(model) for model in models])
    runs = len(turns) + len(set_aside)
    sizes = len({round(abs(turn.moment), 9) for turn in turns})
    enough = len(turns) >= FEWEST_STEPS and sizes >= 2
    if fit_to == "half-turns" and not enough:
        steps = f"{_counted(len(turns), dof.words.step)} at {_counted(sizes, 'size')} of {dof.words.force}"
        raise RunError(
            f"{steps} are usable, and at least {FEWEST_STEPS} at 2 are needed; "
            f"{_reasons(set_aside)}give more step runs, or --fit-to whole-runs"
        )
    if not with_effects and (fit_to == "half-turns" or (fit_to == "auto" and enough and 2 * len(turns) >= runs)):
        return _fit_steps(turns, set_aside, known, each, channels, tail)
    if tail is not None:
        raise RunError(
            f"{_counted(len(turns), 'run')} of {runs} can be read by tails, too few for Table 1, and whole runs have "
            "none; leave the tail out, or give more runs from rest at one command"
        )
    return _fit_whole(tuple(whole()), turns, fit_to, known, each, channels, with_effects)


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}{'s' * (number != 1)}"


def _reasons(set_aside: Sequence[SetAside]) -> str:
    return (
        f"the first set aside: {set_aside[0].file}, run {set_aside[0].run}: {set_aside[0].why}; " if set_aside else ""
    )


def _fit_steps(
    turns: tuple[HalfTurn, ...],
    set_aside: tuple[SetAside, ...],
    known: Known,
    each: Map,
    channels: str,
    tail: float | None,
) -> YawFit:
    unit, dof = turns[0].step.run.moment_unit, turns[0].step.run.dof
    chosen = choose_channels([turn.step.run for turn in turns], dof, channels)
    turns = tuple(turn.of(chosen.cleaned(turn.step.run)) for turn in turns)
    data = half_turn_data(turns, chosen.names)
    zero = np.zeros(len(turns))
    few = data.some(MANY_RUNS // 2)
    rough = fit_velocity_error(few, zero[: len(few.names)], moment_unit=unit, models=("1", "3"))
    start = (_inertia_to_begin_with(rough), rough.drag["1"].drag[0], rough.drag["3"].drag[1])
    name = dof.symbols.constant
    constant = {model: fit.estimates[name].value for model, fit in rough.drag.items() if dof.has_constant}
    both = bool(min(sum(sign * turn.turned > 0 for turn in turns) for sign in (1, -1)) >= FEWEST_A_WAY)
    ask = partial(
        _fit_model, data=data, start=start, constant=constant, unit=unit, known=known, both=both
    )  # fmt: skip
    fits = dict(zip("123", each(ask, ("1", "2", "3"))))
    preference = prefer(fits)
    seed = fit_velocity_error(data, zero, fits[preference.number].offset.value, unit, tail=tail)
    noise = float(np.median([turn.noise for turn in turns if not turn.step.run.summed_up] or [0.0]))
    cautions = (
        *design_cautions([turn.moment for turn in turns], unit, dof, of_steps=True),
        *seed_cautions(seed, fits[preference.number].gain_scatter.value, dof),
        *fit_cautions(fits),
    )
    warnings = (
        *step_warnings(turns, seed, dof),
        *fit_warnings(fits, preference, data.names, noise),
        *told(cautions, preference),
    )
    return YawFit(
        unit, turns, data, (), fits, seed, "", preference, set_aside, warnings, cautions, dof, chosen, known=known
    )


def _inertia_to_begin_with(rough: VelocityErrorFit) -> float:
    """The paper's inertia of model 3; where noise made it negative, the middle of the sizes."""
    table = rough.inertia["3"]
    return table.overall.value if table.overall.value > 0 else float(np.median(np.abs(table.per_run)))


def _fit_model(
    number: str,
    data: StepData,
    start: tuple[float, float, float],
    constant: Mapping[str, float],
    unit: str,
    known: Known,
    both: bool,
) -> OutputErrorFit:
    inertia, linear, quadratic = start
    if number == "1":  # its inertia from the same tails: equation 7 against equation 9
        inertia *= 0.7
    begin = (inertia, linear if number == "1" else 0.02 * linear, quadratic)
    always = constant.get(number, constant.get("3", 0.0))

    def fit(sided: bool) -> OutputErrorFit:
        return fit_half_turns(data, number, begin, unit, known, always, sided)

    return by_way(fit, data.dof, both)


def _fit_whole(
    runs: tuple[Run, ...],
    turns: Sequence[HalfTurn],
    fit_to: str,
    known: Known,
    each: Map,
    channels: str,
    with_effects: Sequence[str],
) -> YawFit:
    steered, undriven = without_undriven(runs)
    serves = [bool(np.any(run.command != 0)) and len(run) >= FEWEST_SAMPLES for run in steered]
    kept, stuck = without_stuck([run for run, good in zip(steered, serves) if good])
    chosen = choose_channels(kept, kept[0].dof, channels) if kept else NOTHING_TO_CHOOSE
    moving = tuple(chosen.cleaned(run) for run in kept)
    short = tuple(SetAside(run.source, run.name, _too_little(run)) for run, good in zip(steered, serves) if not good)
    short += undriven + stuck
    if not moving:
        raise RunError(
            f"none of {_counted(len(runs), 'run')} can be fitted; {_reasons(short)}look at them with `automarine check`"
        )
    dof = moving[0].dof
    at_rest = np.array([starts_at_rest(run) for run in moving])
    driven = is_driven(moving, at_rest, chosen.names, with_effects)
    if driven:
        course = make_course(moving, at_rest, channels=chosen.names)
        fits, refused = fitted_driven(moving, course, each, with_effects, known.parameters)
    else:
        refused = {}
        ask = partial(_fit_whole_model, runs=moving, at_rest=at_rest, channels=chosen.names, known=known)
        fits = dict(zip("123", each(ask, ("1", "2", "3"))))
    words = dof.words
    how = "by output error, for the evidence asks for no disturbance"
    if driven:
        how = f"from forecasts by a filter{', for they are disturbed' * (not with_effects)}"
        period = float(np.median([run.sample_period for run in moving]))
        if averaged_over(period) > 1:
            how += (
                f"; readings at {1 / period:.3g} Hz were averaged over {averaged_over(period) * period:.2g} s, "
                "commands count exactly"
            )
    why = (
        f"The whole runs were fitted {how}, as asked ({'--with' if with_effects else '--fit-to whole-runs'}); steady "
        f"{words.speed}s and velocity errors are of {words.step}s only"
        if fit_to == "whole-runs" or with_effects
        else f"{len(turns)} of {len(runs)} runs hold a constant {words.force} from rest through a {words.step}, too "
        f"few for steady {words.speed}s and velocity errors; the whole runs were fitted {how}"
    )
    ahead = left_out(course, fits) if driven else {}
    preference = (prefer_driven(fits, ahead, dof) if driven else None) or prefer(fits)
    proposed: dict[str, float] = {}
    if driven:
        fits[preference.number], proposed = widened(course, fits[preference.number])
    if estimator := fits[preference.number].estimator:
        preference = replace(preference, because=f"{preference.because} Its parameters are {estimator}.")
    unit, levels = moving[0].moment_unit, np.unique(np.concatenate([run.command for run in moving]))
    cautions = (*design_cautions(levels.tolist(), unit, dof, of_steps=False), *fit_cautions(fits))
    warnings = (*fit_warnings(fits, preference, [run.name for run in moving]), *told(cautions, preference))
    number, use = preference.number, Judgement((), 0)
    if not driven:
        use = judged_whole(make_course(moving, at_rest, channels=chosen.names), fits[number])
        warnings = (*use.warnings(dof), *warnings)
    else:
        use = use_of(course, fits[number], ahead[number], proposed)
        missing = (f"Model {absent} could not be fitted: {reason}." for absent, reason in refused.items())
        warnings = (*use.warnings(dof), *missing, *warnings)
    return YawFit(
        unit, (), None, moving, fits, None, why, preference, short, warnings, cautions, dof, chosen, use, known
    )


def _too_little(run: Run) -> str:
    words, longer = run.dof.words, f"log for longer, at least {FEWEST_SAMPLES} samples"
    if len(run) < FEWEST_SAMPLES:
        return f"{len(run)} samples say nothing of drag or {words.inertia}; {longer}"
    return f"no {words.force} acts in this run; it shows the noise, but neither drag nor {words.inertia}"


def _fit_whole_model(
    number: str, runs: Sequence[Run], at_rest: NDArray[np.bool_], channels: tuple[str, ...] | None, known: Known
) -> OutputErrorFit:
    """Fit, and fit again with finer steps where the model turns out to be faster than the first ones."""
    largest = max(float(np.abs(run.command).max()) for run in runs)
    both = both_ways(runs)
    for step in STEPS:
        batch = make_batch(runs, step, channels=channels)
        fit = by_way(partial(fit_whole_runs, batch, number, at_rest, known=known), batch.dof, both)
        if step_for(fit.model, largest) >= 0.5 * step:
            return fit
    raise FitError(
        f"model {number} answers within {1000 * fit.model.fastest(largest):.0f} ms, faster than these logs "
        "can show; "
        f"check the units of {runs[0].dof.words.force} and time"
    )


def starts_at_rest(run: Run) -> bool:
    """Whether the run begins with the vehicle standing still at zero moment, or where a constant force acts at any."""
    if run.dof.has_constant:
        return bool(released(run))
    steps = find_steps(run)
    return bool(steps) and steps[0].rest is not None and steps[0].rest.start <= 2
