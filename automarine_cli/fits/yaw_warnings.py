"""What a person must know before trusting a yaw fit: said in sentences, from the fit itself."""

from collections.abc import Mapping, Sequence

import numpy as np

from automarine_cli.dofs import Dof
from automarine_cli.fits.drag import identity_gap
from automarine_cli.fits.mixed_problem import SWITCH
from automarine_cli.fits.output_error import OutputErrorFit, Preference
from automarine_cli.fits.run_effects import GAIN
from automarine_cli.fits.tail_choice import BIAS_LIMIT
from automarine_cli.fits.velocity_error import VelocityErrorFit
from automarine_cli.fits.yaw_cautions import Caution
from automarine_cli.runs.half_turn import HalfTurn

UNEXPLAINED = 1.3
"""Ratio of what a model leaves to the noise of the headings from which on something is missing."""

DECIDES = 0.8
"""Share of the spread over fits without one run from which on that run decides alone."""

WILD_GAIN = 0.25
"""Scatter of the thrust from run to run beyond what batteries and water do."""

SURE = 3.0
"""Standard errors."""

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
            f"{100 * max(map(abs, seed.bias)):.1f} %, which was removed with a rough model; trust the maximum "
            "likelihood, which needs no tail."
        )
    unsteady = [turn.name for turn in turns if not turn.steady]
    if unsteady:
        found.append(f"{len(unsteady)} {words.step}s end before the {words.speed} is steady, {unsteady[0]} first.")
    pooled = len(seed.drag["3"].estimates) == 1 if "3" in seed.drag else False  # no constant force, no two ways
    if pooled and "2" in seed.drag and len(seed.drag["2"].estimates) == 2:
        rate, two = seed.tails.rate, seed.drag["2"].drag
        gap = identity_gap(rate, seed.drag["3"].drag[1], two[1], two[0], seed.drag["2"].variance)
        if abs(gap) > 1e-6 * abs(two[1]):
            v = dof.symbols.velocity
            found.append(
                f"Table 1 breaks the identity k3 = k2 + {dof.symbols.linear} sum|{v}|^3/sum {v}^4 by {gap:.2g}: the "
                "fit is ill-conditioned."
            )
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
    `position_noise` [rad] that the headings have by themselves. On its parameters see yaw_cautions.py."""
    fit = fits[preference.number]
    dof = fit.model.dof
    words, mark, base = dof.words, dof.units.mark, dof.units.base
    found = [*_one_run_that_decides(fit, names_of_runs), *_wild_gains(fit, names_of_runs)]
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


def _wild_gains(fit: OutputErrorFit, names_of_runs: Sequence[str]) -> list[str]:
    """A sentence where the runs' gains differ by more than thrusters do."""
    if fit.gain_scatter.value <= WILD_GAIN:
        return []
    gains = np.exp(fit.mixed.own(GAIN)[:, 0])
    odd = int(np.argmax(np.abs(np.log(gains / np.median(gains)))))
    force = fit.model.dof.words.force
    return [
        f"The thrust seems to scatter by {100 * fit.gain_scatter.value:.0f} % from run to run, and "
        f"{names_of_runs[odd]} has {gains[odd] / np.median(gains):.2g} times the gain of the others: check its "
        f"{force} and its unit."
    ]
