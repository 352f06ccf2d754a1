"""What a person must know before trusting a yaw fit: said in sentences, from the fit itself."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from automarine_cli.dofs import Dof
from automarine_cli.estimate import Estimate
from automarine_cli.fits.linear_mixed import GAIN
from automarine_cli.fits.mixed_model import SWITCH
from automarine_cli.fits.paper import BIAS_LIMIT, VelocityErrorFit
from automarine_cli.fits.whole_runs import OutputErrorFit, Preference
from automarine_cli.models.yaw_model import YawModel, steady_rate
from automarine_cli.quantities import Floats
from automarine_cli.runs.half_turn import HalfTurn


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
    given = [float(moment) for moment in moments]
    if not given:
        return None
    ends = np.array([min(given), max(given)])
    rates = steady_rate(*model.acting(ends))
    return {
        model.dof.words.force: ends.tolist(),
        model.dof.velocity_key: rates.tolist() if np.all(np.isfinite(rates)) else None,
    }


CORRELATED = 0.95  # correlation of two estimates from which on only a combination of them is known
DILUTED = 0.04  # scatter of the thrust from run to run from which on it is said that Table 1 is corrected for it
UNMOVED = 1e-9  # relative change from its start below which a parameter never moved
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
                if sentence := stuck or _negative(role, estimate, dof) or _wide(role, estimate, dof):
                    yield Caution(number, (role,), f"Model {number}: {sentence}", grave=bool(stuck))
        yield from _correlations(fit)


def _stuck(fit: OutputErrorFit, role: str) -> str:
    """A parameter at its bound, or one that the runs never moved."""
    dof = fit.model.dof
    name, remedy = dof.parameters[role], dof.fill(REMEDY[role])
    i = list(fit.estimates).index(name)
    if i in fit.mixed.at_bound:
        return f"{name} stands at a bound of its range, so its interval is meaningless; {remedy}."
    value, start = float(fit.mixed.theta[i]), float(fit.start[i])
    if abs(value - start) <= UNMOVED * abs(start) or fit.covariance[i, i] <= 0.0:
        return f"{name} never moved from its start, {value:.3g}: these runs hold no information on it; {remedy}."
    return ""


def _negative(role: str, estimate: Estimate, dof: Dof) -> str:
    if estimate.value >= 0:
        return ""
    why = f"a negative {dof.words.inertia}" if role == INERTIA else "a drag that drives the vehicle"
    low, high = estimate.ci95
    told = f"{dof.parameters[role]} is {estimate.value:.3g} [{low:.3g}, {high:.3g}], {why}, which no vehicle has; "
    if high >= 0:
        return told + f"the interval holds zero: take a model without it, or {dof.fill(REMEDY[role])}."
    return told + "something else acts on these runs: look for it with `automarine diagnose`."


def _wide(role: str, estimate: Estimate, dof: Dof) -> str:
    low, high = estimate.ci95
    if high - low <= abs(estimate.value):
        return ""
    return (
        f"{dof.parameters[role]} is {estimate.value:.3g} [{low:.3g}, {high:.3g}], an interval wider than the value; "
        f"these runs hold little information on it: {dof.fill(REMEDY[role])}."
    )


def _correlations(fit: OutputErrorFit) -> list[Caution]:
    """Pairs of parameters of which the runs show a combination only; two drags that are one take the inertia along,
    and stand alone. By the likelihood's covariance: that of a few runs left out scatters by itself."""
    dof, found = fit.model.dof, []
    roles = {name: role for role, name in dof.parameters.items()}
    names = list(fit.estimates)
    covariance = fit.mixed.covariance
    deviation = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
    for i in range(len(names)):
        for j in range(i + 1, len(names)):
            product = deviation[i] * deviation[j]
            share = float(covariance[i, j] / product) if product > 0 else 0.0
            pair = (roles[names[i]], roles[names[j]])
            if abs(share) > CORRELATED and set(pair) <= set(EVERY) and not {i, j} & set(fit.mixed.at_bound):
                says = f"{names[i]} and {names[j]} are correlated by {share:.3f}; {_combination(pair, share, dof)}"
                found.append(Caution(fit.number, pair, f"Model {fit.number}: {says}"))
    joint = [caution for caution in found if caution.parameters == DRAG]
    return joint or found


def _combination(pair: tuple[str, str], share: float, dof: Dof) -> str:
    force, speed = dof.words.force, dof.words.speed
    if set(pair) == set(DRAG):
        return f"these runs determine only their total drag: add runs at much smaller and much larger {force}s."
    if share > 0:
        return (
            "only their ratio is well determined, as where the thrust scatters from run to run: add runs, "
            "or measure thrust or voltage."
        )
    return (
        f"these runs hardly separate them: hold each {force} until the {speed} is steady, and "
        f"{dof.fill(REMEDY[pair[0]])}."
    )


def seed_cautions(seed: VelocityErrorFit, gain_scatter: float, dof: Dof) -> Iterator[Caution]:
    """What to know of Tables 1 and 2 by the paper's method; `gain_scatter` is the maximum likelihood's."""
    words = dof.words
    if gain_scatter > DILUTED:
        says = (
            f"Thrust scatters by {100 * gain_scatter:.1f} % from run to run: least squares of the commanded "
            f"{words.force} on the {words.speed} underestimate the drag. This bias was removed, assuming normal "
            "scatter of the thrust alone; the maximum likelihood needs no such correction."
        )
        yield Caution("", EVERY, says)
    for number, drag in sorted(seed.drag.items()):
        for role in DRAG:
            estimate = drag.estimates.get(dof.parameters[role])
            if number not in ("1", "2", "3") or estimate is None:
                continue
            if sentence := _negative(role, estimate, dof) or _wide(role, estimate, dof):
                yield Caution(number, (role,), f"Least squares of model {number}: {sentence}")
    for number, table in sorted(seed.inertia.items()):
        value, (low, high) = table.overall.value, table.overall.ci95
        sentence = _negative(INERTIA, table.overall, dof)
        if not sentence and high - low > value:
            sentence = (
                f"{dof.symbols.inertia} is {value:.3g} [{low:.3g}, {high:.3g}], an interval wider than the value; its "
                f"means at each {words.force} differ, as where the model is wrong or the runs are few: add runs at "
                f"each {words.force}."
            )
        if sentence:
            yield Caution(number, (INERTIA,), f"Velocity errors of model {number}: {sentence}")


def design_cautions(levels: Sequence[float], unit: str, dof: Dof, of_steps: bool) -> Iterator[Caution]:
    """What the moments of a campaign cannot show; `levels` are the moments commanded, `of_steps` one for each run."""
    sides = {float(np.sign(level)) for level in levels if level}
    sizes = sorted({round(abs(level), 9) for level in levels if level})
    words, force, speed = dof.words, dof.words.force, dof.words.speed
    if len(sides) == 1:
        here, there = words.to_ways if sides == {1.0} else words.to_ways[::-1]
        says = (
            f"Every run {words.moves} {here}: a {force} that always acts, or thrusters that push less one way, would "
            f"bias {words.inertia} and drag unnoticed; add runs {there} at the same {force}s."
        )
        yield Caution("", EVERY, says)
    if len(sizes) == 1:
        says = (
            f"Every run commands the same size of {force}, {sizes[0]:g} {unit}: how drag grows with the {speed} shows "
            f"only in how each {words.move} begins; add runs at {0.5 * sizes[0]:.3g} and {2.0 * sizes[0]:.3g} {unit}, "
            "or as much as the thrusters give."
        )
        yield Caution("", DRAG, says)
    if of_steps and len(sizes) == 2:
        third = 0.5 * (sizes[0] + sizes[1]) if sizes[1] > 2.0 * sizes[0] else 0.5 * sizes[0]  # that these leave out
        says = (
            f"The runs command two sizes of {force}, {sizes[0]:g} and {sizes[1]:g} {unit}: model 2 goes through any "
            f"two, so Table 1 cannot tell how drag grows with the {speed}; add runs at "
            f"{third:.3g} {unit}."
        )
        yield Caution("", DRAG, says)


UNEXPLAINED = 1.3  # ratio of what a model leaves to the noise of the headings from which on something is missing
DECIDES = 0.8  # share of the spread over fits without one run from which on that run decides alone
WILD_GAIN = 0.25  # scatter of the thrust from run to run beyond what batteries and water do
SURE = 3.0  # standard errors
LATE = (
    "The {force} seems to act half a sample interval or more after the log shows it: a delay or a lag of the "
    "thrusters, which inflates the {inertia}."
)
EARLY = (
    "The {force} seems to act half a sample interval or more before the log shows it: check the clocks of {position} "
    "and command."
)


def step_warnings(turns: Sequence[HalfTurn], seed: VelocityErrorFit, dof: Dof) -> list[str]:
    """Sentences on the half-turns and on the paper's method: not steady, or a Table 1 that breaks its identity."""
    found, words = [], dof.words
    if not seed.steady:
        found.append(
            f"{words.reach.capitalize()} is too short for a steady speed: every tail is biased by more than "
            f"{100 * BIAS_LIMIT:.1f} % by itself, the one from {dof.shown(seed.tail_from):.0f} {dof.units.shown} on by "
            f"{100 * np.abs(seed.expected.bias).max():.1f} %, which was removed with a rough model; trust the maximum "
            "likelihood, which needs no tail."
        )
    unsteady = [turn.name for turn in turns if not turn.steady]
    if unsteady:
        found.append(f"{len(unsteady)} {words.step}s end before the {words.speed} is steady, {unsteady[0]} first.")
    return found


def told(cautions: Sequence[Caution], preference: Preference) -> list[str]:
    """The cautions that are warnings: grave ones, and those on every model or on the preferred one; the others only
    stand below the tables."""
    return [one.sentence for one in cautions if one.grave or one.model in ("", preference.number)]


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
    found = _one_run_that_decides(fit, names_of_runs)
    if fit.gain_scatter.value > WILD_GAIN:
        gains = np.exp(fit.mixed.own(GAIN)[:, 0])
        odd = int(np.argmax(np.abs(np.log(gains / np.median(gains)))))
        found.append(
            f"The thrust seems to scatter by {100 * fit.gain_scatter.value:.0f} % from run to run, and "
            f"{names_of_runs[odd]} has {gains[odd] / np.median(gains):.2g} times the gain of the others: check its "
            f"{words.force} and its unit."
        )
    if position_noise and fit.noise and fit.noise > UNEXPLAINED * position_noise:
        found.append(
            f"Model {preference.number} leaves {dof.shown(fit.noise):.2g}{mark} of the {words.position}s unexplained, "
            f"which scatter by {dof.shown(position_noise):.2g}{mark} about smooth curves: an effect is missing, "
            "perhaps a delay; look for it with `automarine diagnose`."
        )
    turn = fit.inertial_turn_angle or (fits["3"].inertial_turn_angle if "3" in fits else None)
    low, high = dof.limits.plausible
    if turn is not None and not low <= turn.value <= high:
        found.append(
            f"The {words.inertial_length} of {turn.value:.3g} {base} lies outside {low:g} to {high:g} {base}, where "
            f"small vehicles are: check the units of time and {words.position}, and whether the thrusters or the log "
            "lag."
        )
    for i in fit.mixed.at_bound:
        if i == len(fit.estimates) and fit.mixed.names[i] == SWITCH:
            found.append(dof.fill(LATE if fit.mixed.theta[i] > 0 else EARLY))
    return found


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
    without = np.exp(mixed.left_out[run, i]) if mixed.positive[i] else mixed.left_out[run, i]
    return [
        f"{names_of_runs[run]} alone changes {name} of model {fit.number} from {without:.3g} to {estimate.value:.3g} "
        f"{estimate.unit}, more than all other runs together: check its log, and whether its "
        f"{fit.model.dof.words.position} jumps."
    ]
