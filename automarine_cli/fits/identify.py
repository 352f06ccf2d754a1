"""From runs to a yaw fit: which runs serve for what, then both estimators, the preferred model, and
what a person must know before trusting it: said in sentences, from the fit itself."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from automarine_cli import effects
from automarine_cli.dofs import Dof
from automarine_cli.errors import FitError, RunError
from automarine_cli.estimate import Estimate
from automarine_cli.filters.course import averaged_over, make_course
from automarine_cli.fits import driven, whole_runs
from automarine_cli.fits.innovations import channel_noises, channels_json, random_estimates
from automarine_cli.fits.known import NOTHING_KNOWN, Known
from automarine_cli.fits.linear_mixed import GAIN
from automarine_cli.fits.paper import BIAS_LIMIT, MIN_A_WAY, MODELS, VelocityErrorFit, fit_velocity_error, nested_test
from automarine_cli.fits.preference import Preference, prefer, prefer_driven
from automarine_cli.fits.step_fit import Consistency, Start, fit_halves, fit_whole_or_half, starting
from automarine_cli.fits.steps import StepData, data_of_steps
from automarine_cli.fits.whole_runs import OutputErrorFit
from automarine_cli.models.store import effects_json, model_head
from automarine_cli.models.yaw_model import COMMAND_DELAY, YawModel, steady_rate
from automarine_cli.pipeline.parallel import Each, alone
from automarine_cli.pipeline.records import Document, Shown, json_document
from automarine_cli.quantities import Floats
from automarine_cli.runs.channels import AUTO, NOTHING_TO_CHOOSE, ChannelChoice, choose_channels
from automarine_cli.runs.checks import without_stuck, without_undriven
from automarine_cli.runs.half_turn import HalfTurn, find_steps, released, without_contrary
from automarine_cli.runs.run import ExcludedRun, Run, runs_json
from automarine_cli.simulation.batch import make_batch
from automarine_cli.simulation.rollout import step_for
from automarine_cli.text import plural


def covariance_json(
    names: Sequence[str], theta: Floats, positive: NDArray[np.bool_], covariance: Floats
) -> dict[str, object] | None:
    """Covariance of the first parameters of theta (p,), named, from that of phi (p, p), in which positive ones are
    logarithms; in the products of the parameters' units. None where it is not finite."""
    count = len(names)
    scale = np.where(positive, theta, 1.0)[:count]
    matrix = covariance[:count, :count] * np.outer(scale, scale)
    return {"parameters": list(names), "matrix": matrix.tolist()} if np.all(np.isfinite(matrix)) else None


def valid_range(moments: Iterable[float], model: YawModel) -> dict[str, object] | None:
    """The moments that were fitted, smallest and largest with their signs, and the steady rates that they lead to.

    None without moments; the rates are None where the drag leaves no steady rate.
    """
    levels = [float(moment) for moment in moments]
    if not levels:
        return None
    ends = np.array([min(levels), max(levels)])
    rates = steady_rate(*model.acting(ends))
    return {
        model.dof.words.force: ends.tolist(),
        model.dof.velocity_key: rates.tolist() if np.all(np.isfinite(rates)) else None,
    }


CORRELATED = 0.95  # correlation of two estimates from which on only a combination of them is known
INERTIA, DRAG = "inertia", ("quadratic", "linear")
EVERY = (INERTIA, *DRAG)
REMEDY = {
    "inertia": "add runs from rest, logged faster",
    "quadratic": "add runs at larger {forces}, each held until the {speed} is steady",
    "linear": "add runs at smaller {forces}, each held until the {speed} is steady",
}
"""What shows a parameter, by what it is."""


@dataclass(frozen=True)
class Caution:
    """A sentence on `parameters` (by what they are) of one model ("" for every model): on drag it stands below Table 1,
    on inertia below Table 2. `grave` is one that a person must hear of even where another model is preferred."""

    model: str
    parameters: tuple[str, ...]
    sentence: str
    grave: bool = False


def fit_cautions(fits: Mapping[str, OutputErrorFit]) -> Iterator[Caution]:
    for number, fit in sorted(fits.items()):
        if not fit.mixed.converged:
            after = f"had not converged after {fit.mixed.iterations} iterations"
            says = f"Model {number} {after}; its numbers are rough: do not use them, or add runs."
            yield Caution(number, EVERY, says, grave=True)
        dof = fit.model.dof
        for role in EVERY:
            estimate = fit.estimates.get(dof.parameters[role])
            if estimate is not None and not estimate.known:
                stuck = _stuck(fit, role)
                if sentence := stuck or _odd(role, estimate, dof):
                    yield Caution(number, (role,), f"Model {number}: {sentence}", grave=bool(stuck))
        yield from _correlations(fit)


def _stuck(fit: OutputErrorFit, role: str) -> str:
    """A parameter at its bound, or one that the runs never moved."""
    dof = fit.model.dof
    name, remedy = dof.parameters[role], dof.fill(REMEDY[role])
    i = list(fit.estimates).index(name)
    if i in fit.mixed.at_bound:
        return f"{name} stands at a bound of its range, so its interval is meaningless; {remedy}."
    if fit.covariance[i, i] <= 0.0:
        value = float(fit.mixed.theta[i])
        return f"{name} never moved from its start, {value:.3g}: these runs hold no information on it; {remedy}."
    return ""


def _odd(role: str, estimate: Estimate, dof: Dof) -> str:
    """A negative parameter, or one whose interval is wider than its value."""
    (low, high), remedy = estimate.ci95, dof.fill(REMEDY[role])
    value = f"{dof.parameters[role]} is {estimate.value:.3g} [{low:.3g}, {high:.3g}]"
    if estimate.value < 0:
        why = f"a negative {dof.words.inertia}" if role == INERTIA else "a drag that drives the vehicle"
        mend = "something else acts on these runs: look for it with `automarine diagnose`"
        mend = f"the interval holds zero: take a model without it, or {remedy}" if high >= 0 else mend
        return f"{value}, {why}, which no vehicle has; {mend}."
    if high - low > estimate.value:
        return f"{value}, an interval wider than the value; these runs hold little information on it: {remedy}."
    return ""


def _correlations(fit: OutputErrorFit) -> list[Caution]:
    """Pairs of parameters of which the runs show a combination only; two drags that are one take the inertia along,
    and stand alone. By the likelihood's covariance: that of a few runs left out scatters by itself."""
    dof, cautions = fit.model.dof, []
    roles = {name: role for role, name in dof.parameters.items()}
    names = list(fit.estimates)
    covariance = fit.mixed.covariance
    deviation = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
    for i, j in combinations(range(len(names)), 2):
        product = deviation[i] * deviation[j]
        share = float(covariance[i, j] / product) if product > 0 else 0.0
        pair = (roles[names[i]], roles[names[j]])
        if abs(share) > CORRELATED and set(pair) <= set(EVERY) and not {i, j} & set(fit.mixed.at_bound):
            says = f"{names[i]} and {names[j]} are correlated by {share:.3f}; {_combination(pair, share, dof)}"
            cautions.append(Caution(fit.number, pair, f"Model {fit.number}: {says}"))
    joint = [caution for caution in cautions if caution.parameters == DRAG]
    return joint or cautions


def _combination(pair: tuple[str, str], share: float, dof: Dof) -> str:
    force, speed = dof.words.force, dof.words.speed
    if set(pair) == set(DRAG):
        return f"these runs determine only their total drag: add runs at much smaller and much larger {force}s."
    if share > 0:
        return "only their ratio is well determined: the thrust scatters; add runs, or measure thrust or voltage."
    more = dof.fill(REMEDY[pair[0]])
    return f"these runs hardly separate them: hold each {force} until the {speed} is steady, and {more}."


def design_cautions(levels: Sequence[float], unit: str, dof: Dof) -> Iterator[Caution]:
    """What the moments of a campaign, `levels`, cannot show."""
    sides = {float(np.sign(level)) for level in levels if level}
    sizes = sorted({round(abs(level), 9) for level in levels if level})
    words, force, speed = dof.words, dof.words.force, dof.words.speed
    if len(sides) == 1:
        way, opposite = words.to_ways if sides == {1.0} else words.to_ways[::-1]
        says = (
            f"Every run {words.moves} {way}: a {force} that always acts, or thrusters that push less one way, would "
            f"bias {words.inertia} and drag unnoticed; add runs {opposite} at the same {force}s."
        )
        yield Caution("", EVERY, says)
    if len(sizes) == 1:
        says = (
            f"Every run commands the same size of {force}, {sizes[0]:g} {unit}: how drag grows with the {speed} shows "
            f"only in how each {words.move} begins; add runs at {0.5 * sizes[0]:.3g} and {2.0 * sizes[0]:.3g} {unit}, "
            "or as much as the thrusters give."
        )
        yield Caution("", DRAG, says)


UNEXPLAINED = 1.3  # ratio of what a model leaves to the noise of the headings from which on something is missing
DECIDES = 0.8  # share of the spread over fits without one run from which on that run decides alone
WILD_GAIN = 0.25  # scatter of the thrust from run to run beyond what batteries and water do
SURE = 3.0  # standard errors


def warned_of(cautions: Sequence[Caution], preference: Preference) -> list[str]:
    """The cautions that are warnings: grave ones, and those on every model or on the preferred one; the others only
    stand below the tables."""
    return [caution.sentence for caution in cautions if caution.grave or caution.model in ("", preference.number)]


def fit_warnings(
    fits: Mapping[str, OutputErrorFit],
    preference: Preference,
    names_of_runs: Sequence[str],
    position_noise: float | None = None,
) -> list[str]:
    """Sentences on the preferred maximum likelihood: implausible, resting on one run, late, or leaving more than the
    `position_noise` [rad] that the headings have by themselves."""
    fit = fits[preference.number]
    dof = fit.model.dof
    words, mark, base = dof.words, dof.units.mark, dof.units.base
    sentences = _one_run_that_decides(fit, names_of_runs)
    if fit.gain_scatter.value > WILD_GAIN:
        gains = np.exp(fit.mixed.own(GAIN)[:, 0])
        gains = gains / np.median(gains)
        odd = int(np.argmax(np.abs(np.log(gains))))
        sentences.append(
            f"The thrust seems to scatter by {100 * fit.gain_scatter.value:.0f} % from run to run, and "
            f"{names_of_runs[odd]} has {gains[odd]:.2g} times the gain of the others: check its {words.force} and its "
            "unit."
        )
    if position_noise and fit.noise and fit.noise > UNEXPLAINED * position_noise:
        sentences.append(
            f"Model {preference.number} leaves {dof.shown(fit.noise):.2g}{mark} of the {words.position}s unexplained; "
            f"they scatter by {dof.shown(position_noise):.2g}{mark} about smooth curves. An effect is missing, perhaps "
            "a delay: `automarine diagnose` looks for it."
        )
    turn = fit.inertial_turn_angle or (fits["3"].inertial_turn_angle if "3" in fits else None)
    low, high = dof.limits.plausible
    if turn is not None and not low <= turn.value <= high:
        sentences.append(
            f"The {words.inertial_length} of {turn.value:.3g} {base} lies outside {low:g} to {high:g} {base}, where "
            f"small vehicles are: check the units of time and {words.position}, and whether the thrusters or the log "
            "lag."
        )
    early = fit.mixed.names.index(COMMAND_DELAY) in fit.mixed.at_bound and fit.delay.value < 0.0
    if early and COMMAND_DELAY not in fit.mixed.parameters.known:
        says = "The {force} seems to act half a sample interval or more before the log shows it. Check the clocks of "
        sentences.append(dof.fill(says + "{position} and command."))
    return sentences


def _one_run_that_decides(fit: OutputErrorFit, names_of_runs: Sequence[str]) -> list[str]:
    """A sentence where leaving one run out moves a parameter by more than all other runs together, and by much."""
    mixed = fit.mixed
    if len(names_of_runs) < 4:
        return []
    moved = (mixed.left_out - mixed.phi)[:, : len(fit.estimates)]
    total = np.maximum((moved**2).sum(axis=0), 1e-300)
    likely = np.sqrt(np.diagonal(mixed.covariance))[: len(fit.estimates)]
    decides = (moved**2 > DECIDES * total) & (np.abs(moved) > SURE * likely) & (likely > 0)
    if not decides.any():
        return []
    run, i = (int(k) for k in np.argwhere(decides)[0])
    name, estimate = list(fit.estimates.items())[i]
    without = np.exp(mixed.left_out[run, i]) if mixed.parameters.log[i] else mixed.left_out[run, i]
    changes = f"{name} of model {fit.number} from {without:.3g} to {estimate.value:.3g} {estimate.unit}"
    check = f"check its log, and whether its {fit.model.dof.words.position} jumps"
    return [f"{names_of_runs[run]} alone changes {changes}, more than all other runs together: {check}."]


GRAVITY = 9.81  # m/s²; within 0.3 % of what it is anywhere


@dataclass(frozen=True, repr=False)
class YawFit(Shown):
    """Everything that a yaw identification found.

    `turns` are the half-turns used and `data` what was fitted of these steps: all of it if `whole_steps`, and
    `consistency` says why (empty and None for whole runs); `runs` are the whole runs (or empty), `output_error` and
    `seed_method` the two estimators by model, `why_no_seed_method` a sentence where there is none; `cautions` are on
    single parameters, of which those that matter are `warnings` as well; `channels` are the sensors that count; `use`
    is what the model predicts, of whole runs; `prior` is what was known beforehand.
    """

    moment_unit: str
    turns: tuple[HalfTurn, ...]
    data: StepData | None
    runs: tuple[Run, ...]
    output_error: Mapping[str, whole_runs.OutputErrorFit]
    seed_method: VelocityErrorFit | None
    why_no_seed_method: str
    preference: Preference
    set_aside: tuple[ExcludedRun, ...]
    warnings: tuple[str, ...]
    cautions: tuple[Caution, ...]
    dof: Dof
    channels: ChannelChoice = NOTHING_TO_CHOOSE
    use: driven.Judgement | None = None
    prior: Known = NOTHING_KNOWN
    consistency: Consistency | None = None
    whole_steps: bool = False

    @property
    def preferred(self) -> whole_runs.OutputErrorFit:
        return self.output_error[self.preference.number]

    @property
    def read(self) -> Sequence[Run]:
        return self.runs or [turn.step.run for turn in self.turns]

    def document(self, option: str) -> Document:
        return json_document(f"{self.dof.name}_model.json", self.to_json())

    def to_json(self) -> dict[str, object]:
        fit, turn, dof = self.preferred, self.preferred.inertial_turn_angle, self.dof
        ends = [end for run in self.runs for end in (run.command.min(), run.command.max())]
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
            "warnings": list(self.warnings),
            "runs": runs_json(len(self.read), self.set_aside, self.read),
        }  # fmt: skip

    @property
    def is_late(self) -> bool:
        """Whether commands act later than any logger's convention makes them, beyond doubt."""
        half = 0.5 * float(np.median([run.sample_period for run in self.read]))
        return self.preferred.delay.ci95[0] > half

    @property
    def fitted_to(self) -> str:
        """The data that carry the answer."""
        if not self.turns:
            return "whole runs"
        return "whole steps" if self.whole_steps and self.dof.wraps else f"{self.dof.words.step}s"

    @property
    def told_of_known(self) -> tuple[str, ...]:
        dof = self.dof
        units = {dof.parameter(role): dof.unit_of(role, self.moment_unit) for role in ("inertia", *DRAG, "constant")}
        units[COMMAND_DELAY] = "s"
        sentences = self.prior.sentences(units, self.preferred.mixed.names)
        paper = ("The velocity errors of the paper do not use it.",) if sentences and self.seed_method else ()
        return (*sentences, *paper)

    @property
    def buoyancy(self) -> "Buoyancy | None":
        return Buoyancy(self.preferred.estimates[self.dof.symbols.constant]) if self.dof.has_constant else None

    def _driven_json(self) -> dict[str, object]:
        """What only whole runs have: what the model predicts of runs left out, and of driven ones what is random."""
        mixed, use, json = self.preferred.mixed, self.use, dict[str, object]()
        if use is None:
            return json
        if mixed.driven:
            random = random_estimates(mixed, self.preferred.covariance, self.dof)
            json = {"driven": True, "random": random, "proposed": dict(use.proposed)}
        return json | {"prediction": use.to_json(self.dof)}

    def _model_json(self, number: str) -> dict[str, object]:
        fit, dof = self.output_error[number], self.dof
        symbols = dof.symbols
        order = (symbols.quadratic, symbols.linear, symbols.inertia, symbols.constant, symbols.difference)
        estimates = {name: fit.estimates[name].to_json() for name in order if name in fit.estimates}
        content: dict[str, object] = dict(estimates)
        content[dof.ratio_key] = fit.inertial_turn_angle and fit.inertial_turn_angle.to_json()
        content["output_error"] = {
            **estimates,
            "log_likelihood": fit.mixed.log_likelihood,
            "log_density_of_left_out_runs": float(fit.mixed.predictive.sum()),
            **_scatter_json(fit),
            "covariance": covariance_json(
                list(fit.estimates), fit.mixed.theta, fit.mixed.parameters.log, fit.covariance
            ),
            "converged": fit.mixed.converged,
        }
        if added := effect_estimates(fit):
            content["effects"] = effects_json(added)
        if fit.ways is not None:
            content["sides"] = fit.ways.to_json()
        seed = self.seed_method
        if seed is None or number not in seed.drag:
            why = self.why_no_seed_method or f"too few {dof.words.step}s for two drag terms"
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
            "f_test_against_2": nested_test(drag, seed.drag["2"]) if number != "2" and "2" in seed.drag else None,
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
        names, card = effect.names_in(model.dof), effect.card(model.dof, model.moment_unit)
        estimates[term.name] = {
            name: whole_runs.estimate_of(fit.mixed, fit.covariance, model.index(f"{term.name}.{name}"), parameter.unit)
            for name, parameter in zip(names, card.parameters)
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


@dataclass(frozen=True)
class Buoyancy:
    """The constant force of a model, positive down, told as what a diver would do about it."""

    force: Estimate

    @property
    def ballast(self) -> Estimate | None:
        """Mass [kg], weighed in water, that balances the vehicle; None for a normalised force."""
        value, stderr, low, high = (x / GRAVITY for x in (self.force.value, self.force.stderr, *self.force.ci95))
        return Estimate(-value, stderr, (-high, -low), "kg") if self.force.unit == "N" else None

    @property
    def says(self) -> str:
        low, high = self.force.ci95
        if low < 0 < high:
            return f"Buoyancy: not significant; the force is {low:.2g} to {high:.2g} {self.force.unit} down."

        def size(of: Estimate) -> str:
            low, high = sorted(map(abs, of.ci95))
            return f"{abs(of.value):.3g} {of.unit} [{low:.3g}, {high:.3g}]"

        way, action = ("up", "add") if self.force.value < 0 else ("down", "take off")
        text = f"Buoyancy: a constant force of {size(self.force)} {way}"
        if self.ballast is None:
            return f"{text}, in the unit of the command."
        return f"{text}: to balance it {action} {size(self.ballast)} of ballast, weighed in water."

    def to_json(self) -> dict[str, object]:
        ballast = self.ballast and self.ballast.to_json()
        return {"constant_force": self.force.to_json(), "ballast_in_water": ballast, "says": self.says}


FITTING = "fitting models"
MIN_STEPS = 3
FEWEST_SAMPLES = 20  # of a whole run


def identify_turns(
    dof: Dof,
    turns: tuple[HalfTurn, ...],
    set_aside: tuple[ExcludedRun, ...],
    load_runs: Callable[[], Sequence[Run]],
    fit_to: str = "auto",
    prior: Known = NOTHING_KNOWN,
    map_jobs: Each = alone,
    channels: str = AUTO,
    tail: float | None = None,
    with_effects: Sequence[str] = (),
) -> YawFit:
    """Fit the three models to a motion's steps, or to whole runs, which `load_runs` gives if they are needed.

    `set_aside` are the runs without a half-turn. `fit_to` is "half-turns", "whole-runs", or "auto": steps if at least
    three at two sizes of moment serve and they are half of the runs or more, else whole runs. Steps count whole, unless
    what comes after the first half-turns disagrees with them (see step_fit.py). `prior` is what
    need not be estimated, or is known with an error, by qualified names; `map_jobs` maps a function over the models (on
    processes), `channels` says which sensors count (`runs.channels.choose_channels`), `tail` [rad or m] where the tails
    of the paper's method start, None: where they are best. Raises RunError where too few runs are left, FitError where
    the data cannot carry a fit.
    """
    runs = len(turns) + len(set_aside)
    sizes = len({round(abs(turn.moment), 9) for turn in turns})
    enough = len(turns) >= MIN_STEPS and sizes >= 2
    if fit_to == "half-turns" and not enough:
        steps = f"{plural(len(turns), dof.words.step)} at {plural(sizes, 'size')} of {dof.words.force} are usable"
        remedy = f"{_reasons(set_aside)}give more step runs, or --fit-to whole-runs"
        raise RunError(f"{steps}, and at least {MIN_STEPS} at 2 are needed; {remedy}")
    if not with_effects and (fit_to == "half-turns" or (fit_to == "auto" and enough and 2 * len(turns) >= runs)):
        return _fit_steps(turns, set_aside, fit_to, prior, map_jobs, channels, tail)
    if tail is not None:
        raise RunError(
            f"{plural(len(turns), 'run')} of {runs} can be read by tails, too few for Table 1, and whole runs have "
            "none; leave the tail out, or give more runs from rest at one command"
        )
    return _fit_whole(tuple(load_runs()), turns, fit_to, prior, map_jobs, channels, with_effects)


def _reasons(set_aside: Sequence[ExcludedRun]) -> str:
    return "".join(f"the first set aside: {run.file}, run {run.run}: {run.why}; " for run in set_aside[:1])


def _fit_steps(
    turns: tuple[HalfTurn, ...],
    set_aside: tuple[ExcludedRun, ...],
    fit_to: str,
    prior: Known,
    map_jobs: Each,
    channels: str,
    tail: float | None,
) -> YawFit:
    unit, dof = turns[0].step.run.moment_unit, turns[0].step.run.dof
    chosen = choose_channels([turn.step.run.cut(*turn.looked_at) for turn in turns], dof, channels)
    turns = tuple(turn.of(chosen.cleaned(turn.step.run)) for turn in turns)
    half, zero = data_of_steps(turns, chosen.names), np.zeros(len(turns))
    few = starting(half)
    rough = fit_velocity_error(few, np.zeros(len(few.moment)), moment_unit=unit, models=("1", "3"))
    two_way = bool(min(sum(sign * turn.turned > 0 for turn in turns) for sign in (1, -1)) >= MIN_A_WAY)
    starts = {number: _rough_start(rough, dof, number) for number in MODELS}
    if fit_to == "half-turns":
        answer = fit_halves(half, starts, unit, prior, two_way, map_jobs)
    else:
        whole = data_of_steps(turns, chosen.names, whole=True)
        answer = fit_whole_or_half(whole, half, starts, unit, prior, two_way, map_jobs)
    fits, preference = answer.fits, answer.preference
    seed = fit_velocity_error(half, zero, fits[preference.number].delay.value, unit, tail=tail)
    noise = float(np.median([turn.step.run.noise for turn in turns if not turn.step.run.summed_up] or [0.0]))
    listed = (*design_cautions([turn.moment for turn in turns], unit, dof), *fit_cautions(fits))
    unsteady = (
        f"{dof.words.reach.capitalize()} is too short for a steady speed: every tail is biased by more than "
        f"{100 * BIAS_LIMIT:.1f} %. The one from {dof.shown(seed.tail_from):.0f} {dof.units.shown} on is biased by "
        f"{100 * np.abs(seed.expected.bias).max():.1f} %, which was removed with a rough model. Trust the maximum "
        "likelihood, which needs no tail."
    )
    warnings = (
        *([] if seed.steady else [unsteady]),
        *fit_warnings(fits, preference, half.names, noise),
        *warned_of(listed, preference),
    )
    return YawFit(
        unit, turns, answer.data, (), fits, seed, "", preference, set_aside, warnings, listed, dof, chosen,
        prior=prior, consistency=answer.consistency, whole_steps=answer.data is not half,
    )  # fmt: skip


def _rough_start(rough: VelocityErrorFit, dof: Dof, number: str) -> Start:
    """Values by role from which the fit of a model begins, by the tails of half-turns."""
    table = rough.inertia["3"]  # where noise made it negative, the middle of the sizes
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


def _fit_whole(
    runs: tuple[Run, ...],
    turns: Sequence[HalfTurn],
    fit_to: str,
    prior: Known,
    map_jobs: Each,
    channels: str,
    with_effects: Sequence[str],
) -> YawFit:
    steered, undriven = without_undriven(runs)
    serves = [bool(np.any(run.command != 0)) and len(run) >= FEWEST_SAMPLES for run in steered]
    loose, stuck = without_stuck([run for run, good in zip(steered, serves) if good])
    usable, contrary = without_contrary(loose)
    chosen = choose_channels(usable, usable[0].dof, channels) if usable else NOTHING_TO_CHOOSE
    moving = tuple(chosen.cleaned(run) for run in usable)
    short = tuple(ExcludedRun(run.source, run.name, _too_little(run)) for run, good in zip(steered, serves) if not good)
    short += undriven + stuck + contrary
    if not moving:
        raise RunError(
            f"none of {plural(len(runs), 'run')} can be fitted; {_reasons(short)}look at them with `automarine check`"
        )
    dof = moving[0].dof
    at_rest = np.array([starts_at_rest(run) for run in moving])
    words, refused = dof.words, dict[str, str]()
    use: driven.Judgement
    signals = tuple(dict.fromkeys(need for name in with_effects for need in effects.get(name).needs))
    # until it is let go, something that no model knows holds the vehicle against its constant force
    free = [run.cut(max(released(run) - 1, 0), len(run)) for run in moving] if dof.has_constant else moving
    course = make_course(free, at_rest, signals, channels=chosen.names)
    if not driven.is_driven(moving, at_rest, chosen.names, with_effects):
        ask = partial(_fit_whole_model, runs=moving, at_rest=at_rest, channels=chosen.names, prior=prior)
        fits = dict(zip(MODELS, map_jobs(ask, MODELS, FITTING)))
        preference = prefer(fits)
        fit = fits[preference.number]
        worth = {dof.position: driven.worth_of(driven.whole_predictions(course, fit))}
        use = driven.Judgement(worth, len(moving), large=driven.unknown_push(fit, moving))
        how = "by output error, for the evidence asks for no disturbance"
    else:
        fits, refused = driven.fitted_driven(moving, course, map_jobs, with_effects, prior.parameters)
        predict = partial(driven.predictions_of, course)
        ahead = dict(zip(fits, map_jobs(predict, [*fits.values()], "predicting runs left out")))
        preference = prefer_driven(fits, ahead, dof) or prefer(fits)
        number = preference.number
        [(fits[number], proposed)] = map_jobs(
            partial(driven.inflate_for_missing, course), [fits[number]], "widening intervals"
        )
        fit, worth = fits[number], {dof.position: driven.worth_of(ahead[number])}
        large = driven.large_disturbance(course, np.array([fit.model.inertia]), fit.mixed.of_chance)
        use = driven.Judgement(worth, len(moving), ahead[number], course, proposed, large)
        how = f"from forecasts by a filter{', for they are disturbed' * (not with_effects)}"
        period = float(np.median([run.sample_period for run in moving]))
        if (count := averaged_over(period)) > 1:
            over = f"averaged over {count * period:.2g} s, commands count exactly"
            how += f"; readings at {1 / period:.3g} Hz were {over}"
    why = (
        f"The whole runs were fitted {how}, as asked ({'--with' if with_effects else '--fit-to whole-runs'}); steady "
        f"{words.speed}s and velocity errors are of {words.step}s only"
        if fit_to == "whole-runs" or with_effects
        else f"{len(turns)} of {len(runs)} runs hold a constant {words.force} from rest through a {words.step}, too "
        f"few for steady {words.speed}s and velocity errors; the whole runs were fitted {how}"
    )
    unit, levels = moving[0].moment_unit, np.unique(np.concatenate([run.command for run in moving]))
    listed = (*design_cautions(levels.tolist(), unit, dof), *fit_cautions(fits))
    warnings = (
        *use.warnings(dof),
        *(f"Model {absent} could not be fitted: {reason}." for absent, reason in refused.items()),
        *fit_warnings(fits, preference, [run.name for run in moving]),
        *warned_of(listed, preference),
    )
    return YawFit(unit, (), None, moving, fits, None, why, preference, short, warnings, listed, dof, chosen, use, prior)


def _too_little(run: Run) -> str:
    words, longer = run.dof.words, f"log for longer, at least {FEWEST_SAMPLES} samples"
    if len(run) < FEWEST_SAMPLES:
        return f"{len(run)} samples say nothing of drag or {words.inertia}; {longer}"
    return f"no {words.force} acts in this run; it shows the noise, but neither drag nor {words.inertia}"


def _fit_whole_model(
    number: str, runs: Sequence[Run], at_rest: NDArray[np.bool_], channels: tuple[str, ...] | None, prior: Known
) -> whole_runs.OutputErrorFit:
    largest = max(float(np.abs(run.command).max()) for run in runs)
    two_way = driven.both_ways(runs)
    for step in driven.STEPS:
        batch = make_batch(runs, step, channels=channels)
        fit = whole_runs.fit_by_direction(
            partial(whole_runs.fit_whole_runs, batch, number, at_rest, prior=prior), batch.dof, two_way
        )
        if step_for(fit.model, largest) >= 0.5 * step:
            return fit
    answers = f"model {number} answers within {1000 * fit.model.fastest(largest):.0f} ms, faster than these logs show"
    raise FitError(f"{answers}; check the units of {runs[0].dof.words.force} and time")


def starts_at_rest(run: Run) -> bool:
    """Whether the run begins with the vehicle standing still at zero moment, or where a constant force acts at any."""
    if run.dof.has_constant:
        return bool(released(run))
    steps = find_steps(run)
    return bool(steps) and steps[0].rest is not None and steps[0].rest.start <= 2
