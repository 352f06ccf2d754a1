"""Which of several models to prefer: the simplest one that is not worse than the best at predicting runs left out."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from automarine_cli.dofs import Dof
from automarine_cli.filters.kalman import Predicted
from automarine_cli.fits.whole_runs import OutputErrorFit
from automarine_cli.quantities import Floats

COMPARISON_HORIZONS_S = (2.0, 5.0)  # ahead, over which models and estimators are compared
STEERED_HORIZONS_S = (5.0, 15.0)  # the same of what is steered
MAX_CHANCE_ERRORS = 2.0  # standard errors over units up to which a lead may be chance


@dataclass(frozen=True)
class Preference:
    """Which model and why; `biased` where forecasts prefer another one, along commands that answer disturbances."""

    number: str
    because: str
    biased: bool = False


def lead_of(loss: Floats, rival: Floats) -> tuple[float, float]:
    """Give the sum by which losses (U,) by unit are below a rival's, and the standard error of that over the units."""
    gap = rival - loss
    error = np.sqrt(len(gap)) * np.std(gap, ddof=1) if len(gap) > 1 else np.inf
    return float(gap.sum()), float(error)


def simplest_within(losses: Mapping[str, Floats], parameters: Mapping[str, int]) -> str:
    """Choose the model with fewest parameters of those that no more than MAX_CHANCE_ERRORS standard errors over units
    tell from the best; of several with as few the best.

    `losses` are those (U,) of each unit left out of the fit, by model, which are summed (Vehtari, Gelman and Gabry
    2017, Statistics and Computing 27:1413).
    """
    total = {model: float(loss.sum()) for model, loss in losses.items()}
    best = min(total, key=lambda model: total[model])
    fewest = parameters[best]
    for model, loss in losses.items():
        behind, error = lead_of(losses[best], loss)
        if behind <= MAX_CHANCE_ERRORS * error:
            fewest = min(fewest, parameters[model])
    return min((model for model in losses if parameters[model] == fewest), key=lambda model: total[model])


def prefer(fits: Mapping[str, OutputErrorFit], judged: NDArray[np.bool_] | None = None) -> Preference:
    """Choose the model by the log density of each run under the fit to the others; of one run by Akaike's criterion.
    Only runs that are `judged` (R,) count: no others predict the one run that shows the inertia."""
    parameters = {number: len(fit.model.theta) - 1 for number, fit in fits.items()}
    if all(len(fit.mixed.predictive) == 1 for fit in fits.values()):  # none to predict
        cost = {number: 2.0 * (parameters[number] - fit.mixed.log_likelihood) for number, fit in sorted(fits.items())}
        chosen = min(cost, key=lambda number: cost[number])
        rivals = [f"model {n}'s is higher by {cost[n] - cost[chosen]:.1f}" for n in cost if n != chosen]
        because = f"With one run there is no cross-validation; by Akaike's criterion model {chosen} is best"
        return Preference(chosen, f"{because}, {' and '.join(rivals)}.")
    every = slice(None) if judged is None else judged
    losses, parts = {number: -fit.mixed.predictive[every] for number, fit in sorted(fits.items())}, []
    chosen = simplest_within(losses, parameters)
    for number, loss in losses.items():
        gap, error = lead_of(losses[chosen], loss)
        if number == chosen:
            continue
        if gap < 0:
            parts.append(f"model {number} leads by {-gap:.1f} ± {error:.1f}, not enough to justify another parameter")
        elif gap <= MAX_CHANCE_ERRORS * error:
            parts.append(f"level with model {number} ({gap:+.1f} ± {error:.1f})")
        else:
            parts.append(f"{gap:+.1f} ± {error:.1f} over model {number}")
    return Preference(chosen, f"Preferred: model {chosen}. Cross-validated log likelihood: {'; '.join(parts)}.")


def forecast_losses(
    ahead: Mapping[str, tuple[Predicted, ...]], runs: int, horizons: tuple[float, ...] = COMPARISON_HORIZONS_S
) -> dict[str, Floats] | None:
    """Give the losses (U,) by run of predictions of runs left out of fits, by fit: squares over some `horizons` [s],
    each as a share of what the best fit misses. None where the runs are too short, or one alone, to tell."""
    judged = {fit: [p for p in predicted if p.horizon in horizons and len(p.error)] for fit, predicted in ahead.items()}
    if runs < 2 or len({len(predicted) for predicted in judged.values()} - {0}) != 1 or not all(judged.values()):
        return None
    reached = np.unique(np.concatenate([p.run for p in next(iter(judged.values()))]))
    least = np.min([[p.rmse() for p in predicted] for predicted in judged.values()], axis=0)
    losses = {}
    for fit, predicted in judged.items():
        shares = [
            np.bincount(p.run, p.error**2, runs)[reached] / (len(p.error) * size**2)
            for p, size in zip(predicted, least)
        ]
        losses[fit] = np.sum(shares, axis=0)
    return losses


def is_ahead(loss: Floats, rival: Floats) -> bool:
    """Whether losses (U,) are below a rival's by more than chance."""
    lead, error = lead_of(loss, rival)
    return lead > MAX_CHANCE_ERRORS * error


def outweighs(density: Floats, rival: Floats, unexplained: float) -> bool:
    """Whether log densities (R,) of runs lead a rival's by more than chance, and by more than is `unexplained`.

    Then they decide against forecasts: a model that leaves white innovations has the law of nature, and predictions
    along commands that answer disturbances are biased (Forssell, Ljung 1999, Automatica 35:1215)."""
    lead, error = lead_of(-density, -rival)
    return lead > MAX_CHANCE_ERRORS * error and lead > unexplained


def prefer_driven(
    fits: Mapping[str, OutputErrorFit],
    ahead: Mapping[str, tuple[Predicted, ...]],
    dof: Dof,
    horizons: tuple[float, ...] = COMPARISON_HORIZONS_S,
    unexplained: Callable[[OutputErrorFit], float] = lambda fit: np.inf,
) -> Preference | None:
    """Choose the model by predictions of runs left out of its fit over these `horizons` [s]. None where the runs are
    too short, or one alone, to tell.

    Likelihood would weigh what happens within a reading or two; where none of the models has the law of nature, that is
    not what they are used for. It decides between those whose predictions chance alone tells apart, and where it
    `outweighs` what is `unexplained` of a fit.
    """
    runs = max((len(fit.mixed.left_out) for fit in fits.values()), default=0)
    if (losses := forecast_losses(ahead, runs, horizons)) is None:
        return None
    sizes = {
        number: [p.rmse() for p in predicted if p.horizon in horizons and len(p.error)]
        for number, predicted in ahead.items()
    }
    best = min(losses, key=lambda number: float(losses[number].sum()))
    level = [number for number in losses if not is_ahead(losses[best], losses[number])]
    parameters = {number: len(fits[number].model.theta) for number in level}
    chosen = simplest_within({number: -fits[number].mixed.predictive for number in level}, parameters)
    errors = {n: " and ".join(f"{dof.shown(error):.3g}" for error in size) for n, size in sorted(sizes.items())}
    rivals = [f"model {number} {error}" for number, error in errors.items() if number != chosen]
    listed = ", ".join([f"{errors[chosen]} {dof.units.shown}", *rivals])
    how = "best" if chosen == best else "as well as any"
    over = " and ".join(f"{horizon:g}" for horizon in horizons[: len(sizes[chosen])])
    likely = prefer({number: fits[number] for number in losses})
    density, rival = (fits[number].mixed.predictive for number in (likely.number, chosen))
    if likely.number != chosen and outweighs(density, rival, unexplained(fits[likely.number])):
        ahead_of = f"{over} s ahead {errors[chosen]} for {errors[likely.number]} {dof.units.shown}"
        flatters = f"Commands that answer disturbances flatter model {chosen}: {ahead_of}."
        return Preference(likely.number, f"{likely.because} {flatters}", biased=True)
    return Preference(chosen, f"Model {chosen} predicts runs left out of the fit {how} {over} s ahead, to {listed}.")


def prefer_quiet(
    fits: Mapping[str, OutputErrorFit], ahead: Mapping[str, tuple[Predicted, ...]], dof: Dof,
    judged: NDArray[np.bool_] | None = None,
) -> Preference:  # fmt: skip
    """Choose the model by likelihood, unless another one predicts runs left out better by more than chance."""
    likely, runs = prefer(fits, judged), len(next(iter(fits.values())).mixed.left_out)
    ahead = {number: predicted for number, predicted in ahead.items() if predicted}
    losses = forecast_losses(ahead, runs) if likely.number in ahead else None
    rivals = [] if losses is None else [n for n in losses if is_ahead(losses[n], losses[likely.number])]
    return (prefer_driven(fits, ahead, dof) if rivals else None) or likely
