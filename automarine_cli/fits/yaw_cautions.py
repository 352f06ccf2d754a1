"""What a fit cannot know: parameters at a bound, never moved, hardly shown, tied to another or against physics, and
campaigns that cannot tell them apart; each with the runs to add."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from automarine_cli.dofs import Dof
from automarine_cli.fits.output_error import OutputErrorFit
from automarine_cli.fits.velocity_error import VelocityErrorFit
from automarine_cli.results.estimate import Estimate

CORRELATED = 0.95
"""Correlation of two estimates from which on only a combination of them is known."""

DILUTED = 0.04
"""Scatter of the thrust from run to run from which on it is said that Table 1 is corrected for it."""

UNMOVED = 1e-9
"""Relative change from its start below which a parameter never moved."""

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


def fit_cautions(fits: Mapping[str, OutputErrorFit]) -> list[Caution]:
    """What to know of the parameters of each maximum-likelihood fit."""
    found = []
    for number, fit in sorted(fits.items()):
        if not fit.mixed.converged:
            found.append(
                Caution(
                    number,
                    EVERY,
                    f"Model {number} had not converged after {fit.mixed.iterations} iterations; its numbers are rough: "
                    "do not use them, or add runs.",
                    grave=True,
                )
            )
        dof = fit.model.dof
        for role in EVERY:
            estimate = fit.estimates.get(dof.parameters[role])
            if estimate is not None and not estimate.known:
                stuck = _stuck(fit, role)
                sentence = stuck or _negative(role, estimate, dof) or _wide(role, estimate, dof)
                if sentence:
                    found.append(Caution(number, (role,), f"Model {number}: {sentence}", grave=bool(stuck)))
        found += _correlations(fit)
    return found


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
    """A drag that drives the vehicle, or an inertia below zero."""
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
            asked = set(pair) <= set(EVERY) and not {i, j} & set(fit.mixed.at_bound)
            if abs(share) > CORRELATED and asked:
                found.append(
                    Caution(
                        fit.number,
                        pair,
                        f"Model {fit.number}: {names[i]} and {names[j]} are correlated by {share:.3f}; "
                        f"{_combination(pair, share, dof)}",
                    )
                )
    joint = [caution for caution in found if caution.parameters == DRAG]
    return joint or found


def _combination(pair: tuple[str, str], share: float, dof: Dof) -> str:
    """What of a correlated pair is known, and what would part them."""
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


def seed_cautions(seed: VelocityErrorFit, gain_scatter: float, dof: Dof) -> list[Caution]:
    """What to know of Tables 1 and 2 by the paper's method; `gain_scatter` is the maximum likelihood's."""
    found = []
    words = dof.words
    if gain_scatter > DILUTED:
        found.append(
            Caution(
                "",
                EVERY,
                f"Thrust scatters by {100 * gain_scatter:.1f} % from run to run: least squares of the commanded "
                f"{words.force} on the {words.speed} underestimate the drag. This bias was removed, "
                "assuming normal scatter of the thrust alone; the maximum likelihood needs no such correction.",
            )
        )
    for number, drag in sorted(seed.drag.items()):
        for role in DRAG:
            estimate = drag.estimates.get(dof.parameters[role])
            if number in ("1", "2", "3") and estimate is not None:
                sentence = _negative(role, estimate, dof) or _wide(role, estimate, dof)
                if sentence:
                    found.append(Caution(number, (role,), f"Least squares of model {number}: {sentence}"))
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
            found.append(Caution(number, (INERTIA,), f"Velocity errors of model {number}: {sentence}"))
    return found


def design_cautions(levels: Sequence[float], unit: str, dof: Dof, of_steps: bool) -> list[Caution]:
    """What the moments of a campaign cannot show; `levels` are the moments commanded, `of_steps` one for each run."""
    sides = {float(np.sign(level)) for level in levels if level}
    sizes = sorted({round(abs(level), 9) for level in levels if level})
    found, words = [], dof.words
    force, speed = words.force, words.speed
    if len(sides) == 1:
        here, there = words.to_ways if sides == {1.0} else words.to_ways[::-1]
        found.append(
            Caution(
                "",
                EVERY,
                f"Every run {words.moves} {here}: a {force} that always acts, or thrusters that push less one way, "
                f"would bias {words.inertia} and drag unnoticed; add runs {there} at the same {force}s.",
            )
        )
    if len(sizes) == 1:
        found.append(
            Caution(
                "",
                DRAG,
                f"Every run commands the same size of {force}, {sizes[0]:g} {unit}: how drag grows with the {speed} "
                f"shows only in how each {words.move} begins; add runs at {0.5 * sizes[0]:.3g} and "
                f"{2.0 * sizes[0]:.3g} {unit}, or as much as the thrusters give.",
            )
        )
    if of_steps and len(sizes) == 2:
        found.append(
            Caution(
                "",
                DRAG,
                f"The runs command two sizes of {force}, {sizes[0]:g} and {sizes[1]:g} {unit}: model 2 goes through "
                f"any two, so Table 1 cannot tell how drag grows with the {speed}; add runs at "
                f"{_third(sizes[0], sizes[1]):.3g} {unit}.",
            )
        )
    return found


def _third(low: float, high: float) -> float:
    """A size of moment that two others leave out: between them if they are far apart, else half the smaller."""
    return 0.5 * (low + high) if high > 2.0 * low else 0.5 * low
