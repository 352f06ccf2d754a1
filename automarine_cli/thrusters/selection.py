"""Forms of the thrust curve cross-validated over levels, and the simplest that is good enough."""

from dataclasses import dataclass, replace

import numpy as np

from automarine_cli.errors import FitError
from automarine_cli.quantities import Floats
from automarine_cli.thrusters.curves import fit_direction
from automarine_cli.thrusters.fit import Side, best_curve
from automarine_cli.thrusters.forms import FORMS, Curve, Form

EQUAL = 1e-5  # errors below this share of full scale are rounding, not evidence


@dataclass(frozen=True)
class FormScore:
    """One form on the same points as the others; errors [N] over all points, weighted as in the fit.

    `cv_rmse` is None where a direction has too few levels to leave one out; `behind` is the cross-validated
    mean square error [N^2] above the best form's, `behind_stderr` its standard error over the levels left
    out.
    """

    form: Form
    curves: dict[str, Curve]
    at_bound: dict[str, tuple[str, ...]]
    rmse: float
    cv_rmse: float | None
    behind: float = 0.0
    behind_stderr: float = 0.0

    @property
    def both_ways(self) -> tuple[Curve | None, Curve | None]:
        """The curves forward and backward."""
        return self.curves.get("forward"), self.curves.get("backward")

    @property
    def within_reach(self) -> bool:
        """Within one standard error of the best form."""
        return self.cv_rmse is not None and self.behind <= self.behind_stderr


@dataclass(frozen=True)
class Selection:
    """All forms in the order of the family, the one that was chosen, and why in one sentence."""

    scores: tuple[FormScore, ...]
    chosen: FormScore
    because: str


def select_form(
    sides: dict[str, Side], zero_squares: float, total_weight: float, full_scale: float, forced: str | None = None
) -> Selection:
    """The simplest form within one standard error of the best by leave-one-level-out cross-validation.

    `zero_squares` [N^2] and `total_weight` carry the points at zero command, where every form says zero.
    Breiman et al. 1984, section 3.4.3 (the one-standard-error rule). Raises FitError for an unknown form.
    """
    if forced is not None and forced not in FORMS:
        raise FitError(f"no thrust curve is called {forced!r}; choose one of {', '.join(FORMS)}")
    scores, losses = [], {}
    for form in FORMS.values():
        found = {name: best_curve(side, form) for name, side in sides.items()}
        curves = {name: curve for name, (curve, _) in found.items()}
        squares = zero_squares + sum(
            float(side.weight @ (side.thrust - curves[name].thrust(side.magnitude)) ** 2)
            for name, side in sides.items()
        )
        cross = None
        if all(side.groups >= form.parameters + 2 for side in sides.values()):
            losses[form.name] = np.concatenate([left_out_losses(side, form) for side in sides.values()])
            cross = float(np.sqrt((zero_squares + losses[form.name].sum()) / total_weight))
        bounds = {name: at_bound for name, (_, at_bound) in found.items()}
        scores.append(FormScore(form, curves, bounds, float(np.sqrt(squares / total_weight)), cross))
    return _choose(scores, losses, total_weight, full_scale, forced)


def left_out_losses(side: Side, form: Form) -> Floats:
    """Weighted squared error [N^2] of each group, shape (G,), predicted by a fit without that group."""
    numbers = np.unique(side.group)
    out = side.group[None, :] == numbers[:, None]
    fits = fit_direction(side.magnitude, side.thrust, np.where(out, 0.0, side.weight[None, :]), form)
    error = side.thrust[None, :] - fits.thrust(side.magnitude)
    return np.asarray(np.sum(np.where(out, side.weight[None, :] * error**2, 0.0), axis=1))


def _choose(
    scores: list[FormScore], losses: dict[str, Floats], total_weight: float, full_scale: float, forced: str | None
) -> Selection:
    judged = [score for score in scores if score.form.name in losses]
    if not judged:
        chosen = scores[0] if forced is None else next(score for score in scores if score.form.name == forced)
        why = "too few levels to leave one out" if forced is None else "it was asked for (--form)"
        return Selection(tuple(scores), chosen, f"The {chosen.form.name} form is used: {why}.")
    best = min(judged, key=lambda score: (losses[score.form.name].sum(), score.form.parameters))
    ranked = []
    for score in scores:
        if score.form.name in losses:
            gap = losses[score.form.name] - losses[best.form.name]
            stderr = float(np.sqrt(len(gap)) * np.std(gap, ddof=1)) / total_weight + (EQUAL * full_scale) ** 2
            score = replace(score, behind=float(gap.sum()) / total_weight, behind_stderr=stderr)
        ranked.append(score)
    near = [score for score in ranked if score.within_reach]
    simplest = min(near, key=lambda score: (score.form.parameters, score.cv_rmse))
    if forced is not None:
        chosen = next(score for score in ranked if score.form.name == forced)
        return Selection(
            tuple(ranked),
            chosen,
            f"The {forced} form is used because it was asked for (--form); "
            f"cross-validation would choose {simplest.form.name}.",
        )
    best = next(score for score in ranked if score.form.name == best.form.name)
    return Selection(tuple(ranked), simplest, _sentence(simplest, best, ranked, full_scale))


def _sentence(chosen: FormScore, best: FormScore, ranked: list[FormScore], full_scale: float) -> str:
    """Why this form, with the numbers: cross-validated errors in percent of full scale."""

    def percent(score: FormScore) -> str:
        return f"{100.0 * (score.cv_rmse or 0.0) / full_scale:.3g} %"

    count = chosen.form.parameters
    each = f"{count} parameter{'s' if count > 1 else ''} a direction"
    start = f"The {chosen.form.name} form ({each}, cross-validated error {percent(chosen)} of full scale)"
    if chosen.form.name == best.form.name:
        simpler = [score for score in ranked if score.cv_rmse is not None and score.form.parameters < count]
        if not simpler:
            return f"{start} is chosen: it has the smallest cross-validated error, and no form is simpler."
        rival = min(simpler, key=lambda score: score.cv_rmse or 0.0)
        return (
            f"{start} is chosen: it has the smallest cross-validated error, and the best simpler form "
            f"({rival.form.name}, {percent(rival)}) is worse by more than one standard error."
        )
    return (
        f"{start} is chosen: it is the simplest within one standard error of the best "
        f"({best.form.name}, {best.form.parameters} parameters, {percent(best)})."
    )
