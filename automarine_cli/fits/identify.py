"""From runs to a yaw fit: which runs serve for what, then both estimators, and the preferred model."""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from automarine_cli import effects
from automarine_cli.dofs import Dof
from automarine_cli.errors import FitError, RunError
from automarine_cli.estimate import Estimate
from automarine_cli.filters.course import Course, averaged_over, make_course
from automarine_cli.fits import driven, whole_runs
from automarine_cli.fits.characteristics import Buoyancy, Nomoto, Swing, answer_to_rudder, swing_of
from automarine_cli.fits.innovations import channel_noises, channels_json, random_estimates
from automarine_cli.fits.paper import MIN_A_WAY, MODEL_NUMBERS, VelocityErrorFit, fit_velocity_error
from automarine_cli.fits.preference import (
    COMPARISON_HORIZONS_S,
    STEERED_HORIZONS_S,
    Preference,
    forecast_losses,
    is_ahead,
    prefer,
    prefer_driven,
    prefer_quiet,
)
from automarine_cli.fits.steps import (
    Consistency,
    Start,
    StepData,
    data_of_steps,
    fit_halves,
    fit_whole_or_half,
    starting,
)
from automarine_cli.models.model import COMMAND_DELAY, Model, main_drag, steady_rate
from automarine_cli.models.parameter import NOTHING_KNOWN, Prior, Priors
from automarine_cli.models.store import ROLES, effects_json, model_head
from automarine_cli.pipeline.parallel import Each, alone
from automarine_cli.pipeline.records import Document, Shown, json_document
from automarine_cli.quantities import STEERED
from automarine_cli.runs.channels import AUTO, NOTHING_TO_CHOOSE, ChannelChoice, choose_channels
from automarine_cli.runs.checks import coasts, still, without_stuck, without_undriven
from automarine_cli.runs.half_turn import HalfTurn, released, segments, start_at_rest, without_contrary
from automarine_cli.runs.run import ExcludedRun, Run, runs_json
from automarine_cli.simulation.batch import make_batch
from automarine_cli.simulation.rollout import step_for
from automarine_cli.text import plural

Fits = dict[str, whole_runs.OutputErrorFit]  # by the number of the model


def valid_range(moments: Iterable[float], model: Model) -> dict[str, object] | None:
    """The moments that were fitted, smallest and largest with their signs, and the steady rates that they lead to.

    None without moments; the rates are None where nothing leaves a steady rate.
    """
    levels = [float(moment) for moment in moments]
    if not levels:
        return None
    ends = np.array([min(levels), max(levels)])
    rates = steady_rate(*model.acting(ends)) if not model.dof.restoring else np.full(2, np.nan)
    return {
        model.dof.words.force: ends.tolist(),
        model.dof.velocity_key: rates.tolist() if np.all(np.isfinite(rates)) else None,
    }


@dataclass(frozen=True, repr=False)
class YawFit(Shown):
    """A model of one motion `dof`, such as yaw, in `moment_unit` (of a translation, its force).

    `output_error` has the maximum-likelihood fit of each model by its number ("1", "2", "3"), `preferred` is the best
    of them, `preference` says why, `is_late` that commands act later than a logger makes them:
    `fit.preferred.estimates["I_r"].ci95`. `velocity_error_fit` is the paper's method, `why_no_velocity_error` a
    sentence where there is none, `refused` why models could not be fitted.

    `turns` are the half-turns used and `data` what was fitted of these steps: all of it if `whole_steps`, and
    `consistency` says why (empty and None for whole runs); `runs` are what was fitted by simulation or a filter (or
    empty), also of steps, `used_runs` those of either kind, `set_aside` the others, each with its reason. `channels`
    are the sensors used; `use` is what the model predicts, of whole runs; `priors` are what was known beforehand,
    `nomoto` the answer to a rudder, `buoyancy` that in heave, `swing` and `swing_of(number)` period and damping in roll
    and pitch. `warnings` are what a report says of all that. `mass` [kg] is that of a vehicle that swings; `of_ratios`:
    its inertia was taken to be one, for nothing showed it, and `ratios` has drag over inertia. `to_json()` is
    yaw_model.json (or that of the motion).

    Frame, a row per model, method and parameter: `model`, `method`, `parameter`, `value`, `stderr`, `low`, `high`,
    `unit`.

    Keys: `schema`, `moment_unit`, `fitted_to`, `models`, `preferred`, `preferred_because`, `inertial_turn_angle_rad`,
    `valid_range`, `effects`, `gain_scatter`, `command_delay_s`, `heading_noise_deg`, `consistency`, `warnings`, `runs`.
    """

    moment_unit: str
    turns: tuple[HalfTurn, ...]
    data: StepData | None
    runs: tuple[Run, ...]
    output_error: Mapping[str, whole_runs.OutputErrorFit]
    velocity_error_fit: VelocityErrorFit | None
    why_no_velocity_error: str
    preference: Preference
    set_aside: tuple[ExcludedRun, ...]
    dof: Dof
    channels: ChannelChoice = NOTHING_TO_CHOOSE
    use: driven.Judgement | None = None
    priors: Priors = field(default_factory=dict)
    consistency: Consistency | None = None
    whole_steps: bool = False
    refused: Mapping[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    mass: float | None = None
    of_ratios: bool = False
    nomoto: Nomoto | None = None

    @property
    def preferred(self) -> whole_runs.OutputErrorFit:
        return self.output_error[self.preference.number]

    @property
    def used_runs(self) -> Sequence[Run]:
        return [turn.step.run for turn in self.turns] or self.runs

    def document(self, option: str) -> Document:
        return json_document(f"{self.dof.name}_model.json", self.to_json())

    def to_json(self) -> dict[str, object]:
        fit, turn, dof = self.preferred, self.preferred.inertial_turn_angle, self.dof
        ends = [end for run in self.runs for end in (run.command.min(), run.command.max())]
        ratios = {f"{name}_over_{dof.symbols.inertia}": ratio.to_json() for name, ratio in self.ratios.items()}
        return {
            **model_head(dof, self.moment_unit),
            "fitted_to": self.fitted_to,
            "models": {number: self._model_json(number) for number in sorted(self.output_error)},
            "preferred": self.preference.number,
            "preferred_because": self.preference.because,
            dof.ratio_key: turn and turn.to_json(),
            "valid_range": valid_range([turn.moment for turn in self.turns] or ends, fit.model),
            "effects": effects_json(effect_estimates(fit)),
            **self._driven_json(),
            **_scatter_json(fit),
            **({"consistency": self.consistency.to_json()} if self.consistency else {}),
            **channels_json(self.channels, channel_noises(fit.mixed, dof)),
            **({"buoyancy": self.buoyancy.to_json()} if self.buoyancy else {}),
            **self._swing_json(self.preference.number),
            **({"ratios": ratios} if self.of_ratios else {}),
            **({"nomoto": self.nomoto.to_json()} if self.nomoto else {}),
            "warnings": list(self.warnings),
            "runs": runs_json(len(self.used_runs), self.set_aside, self.used_runs),
        }  # fmt: skip

    @property
    def is_late(self) -> bool:
        """Whether commands act later than any logger's convention makes them, beyond doubt."""
        half = 0.5 * float(np.median([run.sample_period for run in self.used_runs]))
        return self.preferred.delay.ci95[0] > half

    @property
    def fitted_to(self) -> str:
        """The data that carry the answer."""
        if not self.turns:
            return "whole runs"
        return "whole steps" if self.whole_steps and self.dof.wraps else f"{self.dof.words.step}s"

    @property
    def buoyancy(self) -> Buoyancy | None:
        return Buoyancy(self.preferred.estimates[self.dof.symbols.constant]) if self.dof.has_constant else None

    @property
    def ratios(self) -> dict[str, Estimate]:
        """Drags, and what else acts, over an inertia that nothing shows; empty where something does."""
        units = {"linear": "1/s", "quadratic": f"1/{self.dof.units.base}", "restoring": "1/s²"}
        units |= {"constant": f"{self.dof.units.base}/s²", "difference": units[main_drag(self.preference.number)]}
        names = {role: self.dof.parameters[role] for role in self.preferred.roles[1:] if self.of_ratios}
        return {name: self.preferred.estimates[name].scaled(1.0, units[role]) for role, name in names.items()}

    @property
    def swing(self) -> Swing:
        return self.swing_of(self.preference.number)

    def swing_of(self, number: str) -> Swing:
        """Return how a model of a vehicle that weight turns back swings; empty of other motions."""
        if not self.dof.restoring:
            return {}
        mass = None if self.of_ratios or self.moment_unit != self.dof.units.forces[1] else self.mass
        return swing_of(self.output_error[number], mass)

    def _swing_json(self, number: str) -> dict[str, object]:
        swing = {key: estimate and estimate.to_json() for key, estimate in self.swing_of(number).items()}
        return {"swing": swing} if swing else {}

    def _driven_json(self) -> dict[str, object]:
        """What not every fit has: what the evidence would add, of whole runs what the model predicts of those left out,
        and of driven ones what is random."""
        fit, mixed, use = self.preferred, self.preferred.mixed, self.use
        random = {"driven": True, "random": random_estimates(mixed, fit.covariance, self.dof)} if mixed.driven else {}
        proposed = {"proposed": dict(fit.proposed)} if random or fit.proposed else {}
        return {**random, **proposed, **({} if use is None else {"prediction": use.to_json(self.dof)})}

    def _model_json(self, number: str) -> dict[str, object]:
        fit, dof = self.output_error[number], self.dof
        symbols = [dof.parameters[role] for role in ROLES if role in fit.roles]
        estimates = {symbol: fit.estimates[symbol].to_json() for symbol in symbols}
        content: dict[str, object] = dict(estimates)
        content[dof.ratio_key] = fit.inertial_turn_angle and fit.inertial_turn_angle.to_json()
        content["output_error"] = {
            **estimates,
            "log_likelihood": fit.mixed.log_likelihood,
            "log_density_of_left_out_runs": float(fit.mixed.predictive.sum()),
            **_scatter_json(fit),
            "covariance": whole_runs.covariance_json(
                list(fit.estimates), fit.mixed.theta, fit.mixed.parameters.log, fit.covariance
            ),
            "converged": fit.mixed.converged,
            **({"estimator": fit.estimator} if fit.estimator else {}),
        }
        if added := effect_estimates(fit):
            content["effects"] = effects_json(added)
        content |= self._swing_json(number)
        if fit.ways is not None:
            content["sides"] = fit.ways.to_json()
        seed = self.velocity_error_fit
        if seed is None or number not in seed.drag:
            why = self.why_no_velocity_error or f"too few {dof.words.step}s for two drag terms"
            return content | {"sse": None, "velocity_error": None, "why": why}
        drag, table = seed.drag[number], seed.inertia.get(number)
        if table is None:
            content["why"] = f"the drag of the least squares leaves no steady {dof.words.speed}"
        content["sse"] = drag.sse
        content["velocity_error"] = {
            **{name: e.to_json() for name, e in drag.estimates.items()},
            dof.symbols.inertia: None if table is None else table.overall.to_json(),
            "sse": drag.sse,
            "aicc": drag.aicc if np.isfinite(drag.aicc) else None,
            "f_test_against_2": seed.test_against_2(number),
            "dilution_taken_off": dict(drag.dilution),
            f"tail_from_{dof.units.shown}": float(dof.shown(seed.tail_from)),
            "tail_because": seed.expected.sentence(dof, seed.by_user),
        }
        return content


def effect_estimates(fit: whole_runs.OutputErrorFit) -> dict[str, dict[str, Estimate]]:
    """Estimates of the effects beside drag, by effect and parameter that its law has; standard errors of what is not
    fitted are zero."""
    estimates, model = {}, fit.model
    for term in model.terms:
        if term.base:
            continue
        effect = effects.get(term.name)
        estimates[term.name] = {
            name: whole_runs.estimate_of(fit.mixed, fit.covariance, model.index(f"{term.name}.{name}"))
            for name, parameter in zip(effect.names_in(model.dof), effect.parameters)
            if effect.counts(parameter, term.values)
        }
    return estimates


def _scatter_json(fit: whole_runs.OutputErrorFit) -> dict[str, object]:
    dof = fit.model.dof
    return {
        "gain_scatter": fit.gain_scatter.to_json(),
        "command_delay_s": fit.delay.to_json(),
        f"{dof.words.position}_noise_{dof.units.shown}": None if fit.noise is None else float(dof.shown(fit.noise)),
    }


PREDICTING = "predicting runs left out"
WIDENING_INTERVALS = "widening intervals"
MIN_STEPS = 3
MIN_COMMANDED_SHARE = 0.4  # of the time commanded, that steps from rest take; those of "one way, then back" take half
MIN_DRIVEN = 2  # driven runs from which on each is predicted by the others
FEWEST_SAMPLES = 20  # of a whole run
MIN_NOISE_RATIO = 1.3  # ratio of what a model leaves to the noise of the positions from which on something is missing


def identify_turns(
    dof: Dof, turns: tuple[HalfTurn, ...], set_aside: tuple[ExcludedRun, ...], runs: Sequence[Run],
    fit_to: str = "auto", priors: Priors = NOTHING_KNOWN, map_jobs: Each = alone, channels: str = AUTO,
    tail: float | None = None, with_effects: Sequence[str] = (), mass: float | None = None, length: float | None = None,
) -> YawFit:  # fmt: skip
    """Fit the three models to a motion's steps, or to whole `runs`.

    `set_aside` are the runs without a half-turn. `fit_to` is "half-turns", "whole-runs", or "auto": steps if at least
    three at two sizes of moment serve and take MIN_COMMANDED_SHARE of the time commanded, else whole runs. Steps count
    whole, unless what comes after the first half-turns disagrees with them (see steps.py). `priors` are what need not
    be estimated, or is known with an error, by qualified names; `map_jobs` maps a function over the models (on
    processes), `channels` says which sensors count (`runs.channels.choose_channels`), `tail` [rad or m] where the tails
    of the paper's method start, None: where they are best; `mass` [kg] is that of a vehicle that weight turns back,
    `length` [m] the vehicle's. Raises RunError where too few runs are left, FitError where the data cannot carry a fit.
    """
    sizes = len({round(abs(turn.moment), 9) for turn in turns})
    enough = len(turns) >= MIN_STEPS and sizes >= 2
    if fit_to == "half-turns" and not enough:
        steps = f"{plural(len(turns), dof.words.step)} at {plural(sizes, 'size')} of {dof.words.force} are usable"
        remedy = f"{_reasons(set_aside)}give more step runs, or --fit-to whole-runs"
        raise RunError(f"{steps}, and at least {MIN_STEPS} at 2 are needed; {remedy}")
    # what thrusts beside a rudder may be anything
    steered = dof.wraps and (any(run.moment_unit == STEERED for run in runs) or rudder_beside(runs))
    share = _step_share(turns, runs)
    few_steps = not enough or share < MIN_COMMANDED_SHARE
    stepped = fit_to == "half-turns" or (fit_to == "auto" and not few_steps)
    if stepped and not (with_effects or steered or dof.restoring):
        return _fit_steps(turns, set_aside, fit_to, priors, map_jobs, channels, tail)
    if tail is not None:
        raise RunError(
            f"{plural(len(turns), 'run')} with tails, {100 * share:.0f} % of the time commanded, too few for Table 1; "
            "whole runs have none: leave the tail out, or give more runs from rest at one command"
        )
    fit = _fit_whole(tuple(runs), turns, few_steps, fit_to, priors, map_jobs, channels, with_effects, length)
    return replace(fit, mass=mass)


def _step_share(turns: Sequence[HalfTurn], runs: Sequence[Run]) -> float:
    """Return what the steps that serve take of the time in which anything is commanded."""
    commanded = sum(run.time[b - 1] - run.time[a] for run in runs for a, b, command in segments(run.command) if command)
    of_steps = sum(float(np.ptp(turn.step.run.time[turn.step.first : turn.step.stop])) for turn in turns)
    return float(of_steps / max(commanded, 1e-9))


def _reasons(set_aside: Sequence[ExcludedRun]) -> str:
    return "".join(f"the first set aside: {run.file}, run {run.run}: {run.why}; " for run in set_aside[:1])


def _fit_steps(
    turns: tuple[HalfTurn, ...], set_aside: tuple[ExcludedRun, ...], fit_to: str, priors: Priors, map_jobs: Each,
    channels: str, tail: float | None,
) -> YawFit:  # fmt: skip
    dof = turns[0].step.run.dof
    chosen = choose_channels([turn.step.run.cut(*turn.looked_at) for turn in turns], dof, channels)
    turns = tuple(turn.of(chosen.cleaned(turn.step.run)) for turn in turns)
    half, zero = data_of_steps(turns, chosen.names), np.zeros(len(turns))
    few = starting(half)
    rough = fit_velocity_error(few, np.zeros(len(few.moment)), models=("1", "3"))
    two_way = bool(min(sum(sign * turn.turned > 0 for turn in turns) for sign in (1, -1)) >= MIN_A_WAY)
    starts = {number: _rough_start(rough, dof, number) for number in MODEL_NUMBERS}
    if fit_to == "half-turns":
        answer = fit_halves(half, starts, priors, two_way, map_jobs)
    else:
        whole = data_of_steps(turns, chosen.names, whole=True)
        answer = fit_whole_or_half(whole, half, starts, priors, two_way, map_jobs)
    whole_steps = answer.data is not half
    parts, at_rest = _parts(turns, whole_steps)
    fit = YawFit(
        half.unit, turns, answer.data, (), answer.fits, None, "", answer.preference, set_aside, dof, chosen,
        priors=priors, consistency=answer.consistency, whole_steps=whole_steps,
    )  # fmt: skip
    widen = partial(driven.inflate_for_lag, parts, at_rest, chosen.names)
    if _leaves_more(fit.preferred, parts):
        fit = replace(fit, preference=_prefer_unexplained(fit, parts, at_rest))
        if whole_steps:  # what comes after the steps agrees with them
            parts = [turn.step.run.cut(0, turn.ends) for turn in turns]
            at_rest = start_at_rest(parts)
        course = make_course(parts, at_rest, channels=chosen.names)
        if fit_to == "auto" and (disturbed := _disturbed(fit, tuple(parts), course, map_jobs)):
            fit, widen = disturbed, partial(driven.inflate_for_missing, course)
    [preferred] = map_jobs(widen, [fit.preferred], WIDENING_INTERVALS)
    seed = fit_velocity_error(half, zero, preferred.delay.value, tail=tail)
    fits = {**fit.output_error, fit.preference.number: preferred}
    return replace(fit, output_error=fits, velocity_error_fit=seed)


def _leaves_more(fit: whole_runs.OutputErrorFit, runs: Sequence[Run]) -> bool:
    """Whether a fit leaves more than the noise of the positions: something pushes that no model of steps knows."""
    return fit.noise is not None and fit.noise > MIN_NOISE_RATIO * float(np.median([run.noise for run in runs]))


def _prefer_unexplained(fit: YawFit, runs: Sequence[Run], at_rest: NDArray[np.bool_]) -> Preference:
    """Choose the model of steps that leave more than noise, which likelihood counts as noise from reading to reading,
    by predictions of steps left out."""
    some = np.unique(np.linspace(0, len(runs) - 1, min(len(runs), driven.MAX_RUNS_TRIED)).astype(int))
    course, fits = make_course([runs[i] for i in some], at_rest[some], channels=fit.channels.names), fit.output_error
    tried = [replace(of, mixed=replace(of.mixed, left_out=of.mixed.left_out[some])) for of in fits.values()]
    return prefer_quiet(fits, dict(zip(fits, driven.whole_predictions(course, tried, alone=True))), fit.dof)


def _disturbed(fit: YawFit, runs: tuple[Run, ...], course: Course, map_jobs: Each) -> YawFit | None:
    """The `fit` of steps that leave more than noise by innovations of their `runs`; None where no model can be fitted
    so, or the preferred one predicts steps left out worse."""
    try:
        fits, preference, use, refused, _ = _fit_driven(runs, course, map_jobs, (), fit.priors)
    except FitError:
        return None
    if not driven.predicts_as_well(course, fit.preferred, fits[preference.number]):
        return None
    because = f"{preference.because} The steps are disturbed: they were fitted from forecasts by a filter."
    preference = replace(preference, because=because)
    return replace(fit, data=None, runs=runs, output_error=fits, preference=preference, use=use, refused=refused)


def _parts(turns: Sequence[HalfTurn], to_end: bool) -> tuple[list[Run], NDArray[np.bool_]]:
    """The runs as far as their steps are fitted, and that they begin at rest."""
    stops = [turn.step.stop if to_end and turn.step.run.dof.wraps else turn.kept.stop for turn in turns]
    parts = [turn.step.run.cut(turn.looked_at[0], stop) for turn, stop in zip(turns, stops)]
    return parts, np.ones(len(turns), dtype=bool)


def _rough_start(rough: VelocityErrorFit, dof: Dof, number: str) -> Start:
    """Values by role from which the fit of a model begins, by the tails of half-turns."""
    table = rough.inertia.get("3") or rough.inertia["1"]  # where noise made it negative, the middle of the sizes
    inertia = table.overall.value if table.overall.value > 0 else float(np.median(np.abs(table.per_run)))
    linear, quadratic = rough.drag["1"].drag[0], rough.drag["3"].drag[1]
    constant = rough.drag["1" if number == "1" else "3"].estimates.get(dof.symbols.constant)
    return {
        "inertia": 0.7 * inertia if number == "1" else inertia,  # by the same tails: equation 7 against equation 9
        "linear": linear if number == "1" else 0.02 * linear,
        "quadratic": quadratic,
        "constant": constant.value if constant else 0.0,
        "difference": 0.0,
        COMMAND_DELAY: 0.0,
    }


def usable_runs(runs: Sequence[Run], channels: str) -> tuple[tuple[Run, ...], ChannelChoice, tuple[ExcludedRun, ...]]:
    """Choose the runs that can be fitted whole and the sensors that count; then come the runs set aside.

    Raises RunError where no run is left.
    """
    steered, undriven = without_undriven(runs)
    serves = [len(run) >= FEWEST_SAMPLES and (bool(run.acting.any()) or coasts(run)) for run in steered]
    loose, stuck = without_stuck([run for run, good in zip(steered, serves) if good])
    usable, contrary = without_contrary(loose)
    short = tuple(ExcludedRun(run.source, run.name, _too_little(run)) for run, good in zip(steered, serves) if not good)
    set_aside = (*short, *undriven, *stuck, *contrary)
    if not usable:
        reasons = _reasons(set_aside)
        raise RunError(
            f"none of {plural(len(runs), 'run')} can be fitted; {reasons}look at them with `automarine check`"
        )
    chosen = choose_channels(usable, usable[0].dof, channels)
    return tuple(chosen.cleaned(run) for run in usable), chosen, set_aside


def _fit_whole(
    runs: tuple[Run, ...], turns: Sequence[HalfTurn], few_steps: bool, fit_to: str, priors: Priors, map_jobs: Each,
    channels: str, with_effects: Sequence[str], length: float | None,
) -> YawFit:  # fmt: skip
    moving, chosen, short = usable_runs(runs, channels)
    dof = moving[0].dof
    idle = np.array([not run.acting.any() for run in moving])
    free_decays = bool(idle.all())
    of_ratios = free_decays and dof.parameter("inertia") not in priors
    if of_ratios:
        priors = {dof.parameter("inertia"): Prior(1.0), **priors}
        if not dof.restoring:  # an inertia of 1 is one in no unit of moments
            moving = tuple(replace(run, moment_unit=dof.units.forces[0]) for run in moving)
    at_rest = start_at_rest(moving)
    steered, asked = moving[0].moment_unit == STEERED, with_effects
    with_effects = (*with_effects, *(name for name in effects_of_rudder(moving) if name not in with_effects))
    logged = {name for name in moving[0].extras if all(run.signal(name) is not None for run in moving)}
    signals = tuple(dict.fromkeys(need for name in with_effects for need in effects.get(name).needs_of(logged)))
    # until it is let go, something that no model knows holds the vehicle against its constant force
    free = [run.cut(max(released(run) - 1, 0), len(run)) for run in moving] if dof.has_constant else moving
    course, refused = make_course(free, at_rest, signals, channels=chosen.names), dict[str, str]()
    asks = bool(with_effects) or steered or (not free_decays and driven.is_driven(moving, at_rest, chosen.names))
    by_innovations = partial(_fit_driven, moving, course, map_jobs, with_effects, priors)
    norrbin: whole_runs.OutputErrorFit | None = None
    by_filter = asks and (bool(with_effects) or steered or not driven.mostly_steps(moving))
    if by_filter:
        fits, preference, use, refused, norrbin = by_innovations()
    else:
        ask = partial(_fit_whole_model, runs=moving, at_rest=at_rest, channels=chosen.names, priors=priors)
        fits = dict(zip(MODEL_NUMBERS, map_jobs(ask, MODEL_NUMBERS, driven.FITTING)))
        (predicted,) = map_jobs(partial(driven.whole_predictions, course), [[*fits.values()]], PREDICTING)
        ahead = dict(zip(fits, predicted))
        judged = idle if 0 < len(idle) - idle.sum() < MIN_DRIVEN < len(idle) else None
        # what differs between steps from rest is their thrust
        preference = prefer_quiet(fits, ahead, dof, judged) if few_steps else prefer(fits, judged)
        fit = fits[preference.number]
        worth = {dof.position: driven.worth_of(ahead[preference.number])}
        use = driven.Judgement(worth, len(moving), large=driven.unknown_push(fit, moving))
        if asks and few_steps:
            with suppress(FitError):  # where innovations fit no model
                rivals, best, judgement, without, _ = by_innovations()
                if by_filter := driven.predicts_better(course, fit, rivals[best.number]):
                    fits, preference, refused = rivals, best, without
                    use = replace(judgement, large=judgement.large or use.large)
    of_simulated = partial(driven.inflate_for_lag, moving, at_rest, chosen.names, disturbed=True)
    widen = partial(driven.inflate_for_missing, course) if by_filter else of_simulated
    [fits[preference.number]] = map_jobs(widen, [fits[preference.number]], WIDENING_INTERVALS)
    reason = "which predicts runs left out as well" if asks else "for the evidence asks for no disturbance"
    how = _by_filter(moving, asked) if by_filter else f"by output error, {reason}"
    words, nomoto = dof.words, None
    if steered and "1" in fits:
        fastest = float(course.fastest[0])
        nomoto = answer_to_rudder(moving, fits["1"], norrbin, fits[preference.number].answering, fastest, length)
    option = "--with" if asked else "--fit-to whole-runs"
    shortage = f": {100 * _step_share(turns, runs):.0f} % of the time commanded, too little" if turns else ", too few"
    why = (
        f"Steps end at an angle, not at a {words.speed}, and have no velocity errors; the whole runs were fitted {how}"
        if dof.restoring
        else f"The whole runs were fitted {how}, as asked ({option}); steady "
        f"{words.speed}s and velocity errors are of {words.step}s only"
        if fit_to == "whole-runs" or asked
        else f"{len(turns)} of {len(runs)} runs hold a constant {words.force} from rest through a {words.step}"
        f"{shortage} for steady {words.speed}s and velocity errors; the whole runs were fitted {how}"
    )
    return YawFit(
        moving[0].moment_unit, (), None, moving, fits, None, why, preference, short, dof, chosen, use, priors,
        refused=refused, of_ratios=of_ratios, nomoto=nomoto,
    )  # fmt: skip


MIN_SPEED_SPREAD = 0.05  # share of the mean speed by which it has to vary before its part can be seen


MIN_APART = 0.1  # share of a rudder's variance that commands beside it must leave unexplained


def rudder_beside(runs: Sequence[Run]) -> bool:
    """Tell whether all runs log a rudder that moves beside their commands, and not as they do."""
    if not runs or not all("rudder" in run.extras and run.moment_unit != STEERED for run in runs):
        return False
    angle = np.nan_to_num(np.concatenate([run.extras["rudder"] for run in runs]))
    command = np.concatenate([run.command for run in runs])
    left = angle - command * float(command @ angle) / max(float(command @ command), 1e-12)
    return bool(np.ptp(angle)) and float(left @ left) > MIN_APART * float(angle @ angle)


def effects_of_rudder(runs: Sequence[Run]) -> tuple[str, ...]:
    """Name what a vehicle with a rudder has beside its drag. Beside thrusters the rudder has a moment of its own. One
    that is steered has, where its speed is logged and varies, a moment that follows the square of the speed, and a
    hull's resistance to turns, which is in proportion to the speed."""
    if rudder_beside(runs):
        return ("rudder",)
    speeds = [run.extras["surge"] for run in runs if run.moment_unit == STEERED and "surge" in run.extras]
    every = np.concatenate([*speeds, np.zeros(0)])
    if len(speeds) < len(runs) or not np.isfinite(every).all():
        return ()
    return ("rudder-inflow", "cross-coupling") if np.std(every) > MIN_SPEED_SPREAD * abs(np.mean(every)) else ()


DRIFT = "history-force"
"""A hull that turns drifts, and its drift turns it the more: Nomoto's second order is that of first order with a memory
of the rate (Nomoto et al. 1957; Fossen 2021, Handbook of Marine Craft Hydrodynamics, chapter 7)."""


def _drifting(fits: Fits, wider: whole_runs.OutputErrorFit | None, course: Course) -> Fits:
    """Model 2 with the drift of its hull, the `wider` fit, in place of model 2, where it predicts runs left out clearly
    better than every one of the `fits`, and the factor by which it betters model 2, run by run, is no chance; else
    nothing."""
    if wider is None:
        return {}
    ahead = {number: driven.predictions_of(course, fit) for number, fit in {**fits, DRIFT: wider}.items()}
    losses = forecast_losses(ahead, len(course.names), STEERED_HORIZONS_S)
    if losses is None:
        return {}
    loss, most = losses[DRIFT], (1.0 - driven.MIN_DRIVEN_GAIN) ** 2
    rivals = [losses[number] for number in fits]
    alike = [losses["2"]] if "2" in fits else rivals
    better = all(loss.sum() < most * rival.sum() for rival in rivals)
    better = better and all(is_ahead(np.log(loss), np.log(rival)) for rival in alike)
    return {"2": wider} if better else {}


def _fit_driven(
    runs: tuple[Run, ...], course: Course, map_jobs: Each, with_effects: tuple[str, ...], priors: Priors
) -> tuple[Fits, Preference, driven.Judgement, dict[str, str], whole_runs.OutputErrorFit | None]:
    """Fit the models that driven runs can carry, prefer one and judge it; last come why others are not fitted, and
    Norrbin's model of what is steered. Raises FitError with the first one's refusal where there is none."""
    steered = course.moment_unit == STEERED
    further = {"1": "cubic-drag", "2": DRIFT} if steered else {}
    models = [(number, with_effects) for number in MODEL_NUMBERS]
    models += [(number, (*with_effects, *({name} - {*with_effects}))) for number, name in further.items()]
    outcomes = driven.fit_driven_models(models, runs, course, priors, map_jobs)
    fits = {number: fit for number, (fit, _) in zip(MODEL_NUMBERS, outcomes) if fit is not None}
    refused = {number: why for number, (fit, why) in zip(MODEL_NUMBERS, outcomes) if fit is None}
    if not fits:
        raise FitError(next(iter(refused.values())))
    norrbin, drifts = (fit for fit, _ in outcomes[len(MODEL_NUMBERS) :]) if steered else (None, None)
    drifting = {} if DRIFT in with_effects else _drifting(fits, drifts, course)
    every, fits, dof = {**fits, **drifting}, drifting or fits, course.motion.dofs[0]
    predict = partial(driven.predictions_of, course, alone=driven.by_model_alone(runs))
    ahead = dict(zip(fits, map_jobs(predict, [*fits.values()], PREDICTING)))
    horizons = STEERED_HORIZONS_S if steered else COMPARISON_HORIZONS_S
    preference = prefer_driven(
        fits, ahead, dof, horizons, lambda fit: driven.driven_problem(fit.model, course).unexplained(fit.mixed.phi)
    ) or prefer(fits)
    number, fit = preference.number, fits[preference.number]
    if fit.estimator:
        preference = replace(preference, because=f"{preference.because} Its parameters are {fit.estimator}.")
    large = driven.large_disturbance(course, np.array([fit.model.inertia]), fit.mixed.of_chance)
    worth = {dof.position: driven.worth_of(ahead[number])}
    use = driven.Judgement(worth, len(course.names), ahead[number], course, large, preference.biased)
    return every, preference, use, refused, norrbin


def _by_filter(runs: Sequence[Run], with_effects: Sequence[str]) -> str:
    """Say how driven runs were fitted."""
    how = "from forecasts by a filter" + ("" if with_effects else ", for they are disturbed")
    period = float(np.median([run.sample_period for run in runs]))
    count = averaged_over(period)
    over = f"averaged over {count * period:.2g} s, commands count exactly"
    return how if count == 1 else f"{how}; readings at {1 / period:.3g} Hz were {over}"


def _too_little(run: Run) -> str:
    words, longer = run.dof.words, f"log for longer, at least {FEWEST_SAMPLES} samples"
    if len(run) < FEWEST_SAMPLES:
        return f"{len(run)} samples say nothing of drag or {words.inertia}; {longer}"
    if run.dof.restoring:
        return str(still(run))
    return f"no {words.force} acts in this run, nor does it slow down: it shows neither drag nor {words.inertia}"


def _fit_whole_model(
    number: str, runs: Sequence[Run], at_rest: NDArray[np.bool_], channels: tuple[str, ...] | None, priors: Priors
) -> whole_runs.OutputErrorFit:
    largest = max(float(np.abs(run.command).max()) for run in runs)
    two_way = driven.both_ways(runs)
    needed = np.inf
    for step in driven.MAX_STEPS_S:
        if needed < 0.5 * step:
            continue
        batch = make_batch(runs, step, channels=channels, settled_step=step)
        fit = whole_runs.fit_by_direction(
            partial(whole_runs.fit_whole_runs, batch, number, at_rest, priors=priors), batch.dof, two_way
        )
        needed = step_for(fit.model, largest)
        if needed >= 0.5 * step:
            return fit
    answers = f"model {number} answers within {1000 * fit.model.fastest(largest):.0f} ms, faster than these logs show"
    raise FitError(f"{answers}; check the units of {runs[0].dof.words.force} and time")
