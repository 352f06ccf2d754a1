"""Named, nothing missing, or unexplained: what a search is entitled to say, and how sure it is."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from automarine_cli import effects
from automarine_cli.diagnosis.gap import Gap, residuals
from automarine_cli.diagnosis.outlook import Outlook
from automarine_cli.diagnosis.scores import fitted_parameters, penalty
from automarine_cli.diagnosis.study import Study
from automarine_cli.diagnosis.trials import LEVEL, MOST_EFFECTS, Found, Trial
from automarine_cli.dofs import Dof
from automarine_cli.fits.estimate import Estimate
from automarine_cli.fits.output_error import estimate_of
from automarine_cli.fits.run_effects import GAIN
from automarine_cli.fits.whole_runs import varying_terms

Floats = NDArray[np.float64]

WELL_ABOVE = 0.05
FLOOR_ERROR = 1.5
"""Residual noise may exceed the floor by this share, or by three standard errors of the floor (FLOOR_ERROR over the
root of the samples), before runs may hold something more."""
LEFT_OVER = 0.3
"""Share of the excess variance over the floor that may stay when an effect is named."""
STANDS = 1.3
"""Times the floor above which residuals that hang together are unexplained, however much larger they were before."""
ASTRAY = 1.1
"""Growth of the gap on runs held out at which an explanation cannot be right."""
MANY = 0.25
"""Excess variance that the base must leave before as many effects as may be named are believed: small gaps that take
three are rather one effect that the library lacks."""

FEWEST_GAINS = 10
"""Runs from which the order of their gains says anything."""


@dataclass(frozen=True)
class NamedRival:
    """Another explanation that these runs cannot exclude, its weight, and the run that would tell."""

    name: str
    confidence: float
    split_by: str


@dataclass(frozen=True)
class NamedEffect:
    """An effect that is missing from the base model, with its parameters, how sure that is, and its rivals."""

    name: str
    says: str
    parameters: Mapping[str, Estimate]
    confidence: float
    p_value: float
    rivals: tuple[NamedRival, ...]


def verdict_of(
    study: Study, found: Found, held_out: Gap | None = None, ahead: Outlook | None = None
) -> tuple[str, str]:
    """ "named", "suspected", "nothing-missing" or "unexplained", and why effects are only suspected.

    Of driven runs `ahead`, the outlook on runs held out, has a veto. See `_of_whole_runs` for the others.
    """
    if not study.driven:
        return _of_whole_runs(study, found, held_out), ""
    if not found.final.added:
        return "nothing-missing", ""
    doubt = "" if ahead is None else ahead.doubt(study.base.dof)
    if doubt:
        return "suspected", f"The runs that were held out do not bear it out: {doubt}."
    return "named", ""


def _of_whole_runs(study: Study, found: Found, held_out: Gap | None) -> str:
    """The verdict on runs that are simulated whole.

    Unexplained are runs whose residuals stand well above the floor and hang together in time, when what was added
    closes less than most of that gap: the candidate then only fits least badly. So are runs whose own gains of thrust
    wander with the campaign's clock, for a gain a run can follow anything that changes slowly, and no residual shows;
    and runs that would take more effects than anybody should believe; and an explanation that leads runs held out
    astray.
    """
    if held_out is not None and held_out.after > ASTRAY * held_out.before:
        return "unexplained"
    excess = [
        max((trial.fit.noise / study.sensor_floor) ** 2 - 1.0, 0.0) for trial in (found.base, found.final)
    ]
    margin = max(WELL_ABOVE, 3.0 * FLOOR_ERROR / float(np.sqrt(study.batch.seen.sum())))
    loud = found.final.fit.noise > (1.0 + margin) * study.sensor_floor
    if (
        loud
        and hangs_together(study, found.final)
        and (
            not found.final.added
            or excess[1] > LEFT_OVER * excess[0]
            or found.final.fit.noise > STANDS * study.sensor_floor
        )
    ):
        return "unexplained"
    scatter = [trial.fit.factor(GAIN) ** 2 for trial in (found.base, found.final)]
    unnamed = not found.final.added or scatter[1] > LEFT_OVER * scatter[0]
    if unnamed and gains_wander(study, found.final):
        return "unexplained"
    many = len(found.final.added) == MOST_EFFECTS and excess[0] < MANY
    if found.more or many:
        return "unexplained"
    return "named" if found.final.added else "nothing-missing"


def gains_wander(study: Study, trial: Trial) -> bool:
    """Whether runs made one after the other have more alike gains than chance allows (p < 0.001).

    Von Neumann's ratio of the mean squared successive difference to the variance of the gains in the order of the
    clock; independent gains give 2 n/(n - 1), with a variance of about 4/n (von Neumann, 1941, Ann. Math. Stat. 12).
    """
    gains = trial.fit.own(GAIN)[np.argsort(study.batch.start), 0]
    count, spread = len(gains), float(((gains - gains.mean()) ** 2).sum())
    if count < FEWEST_GAINS or spread < 1e-12:
        return False
    alike = 1.0 - 0.5 * float((np.diff(gains) ** 2).sum()) / spread
    return bool(alike * np.sqrt((count**2 - 1) / (count - 2)) > stats.norm.isf(1e-3))


def hangs_together(study: Study, trial: Trial) -> bool:
    """Whether neighbouring residuals agree more than chance allows (lag-one correlation over all runs, p < 0.001)."""
    left = residuals(study, trial, fitted=True)
    seen = study.batch.seen[:, 1:]
    product = (left[:, 1:] * left[:, :-1])[seen].sum()
    correlation = product / max((left**2).sum(), 1e-300)
    return bool(correlation * np.sqrt(seen.sum()) > stats.norm.isf(1e-3))


def parameter_estimates(study: Study, trial: Trial, name: str) -> dict[str, Estimate]:
    """Estimates of one effect's parameters with the run as the unit, by their names in files."""
    found = _estimates(study, trial)
    own = effects.get(name).names_in(trial.model.dof)
    return {one: found[trial.model.index(f"{name}.{one}")] for one in own}


def base_estimates(study: Study, trial: Trial) -> dict[str, Estimate]:
    """Estimates of the base model's parameters, inertia first, by their names in files."""
    return dict(zip(study.base.short_names, _estimates(study, trial)))


def _estimates(study: Study, trial: Trial) -> list[Estimate]:
    """Estimates of a model's parameters, in the order of theta."""
    model, covariance = trial.model, study.covariance(trial.model, trial.fit)
    units = [model.dof.unit_of("inertia", model.moment_unit)]
    for term in model.terms:
        units += [p.unit for p in effects.get(term.name).card(model.dof, model.moment_unit).parameters]
    found = [estimate_of(trial.fit, covariance, i, unit) for i, unit in enumerate(units)]
    for varying in varying_terms(model):
        size = effects.get(varying).names_in(model.dof)[0]
        found[model.index(f"{varying}.{size}")] = _amplitude(study, trial, varying)
    return found


def _amplitude(study: Study, trial: Trial, name: str) -> Estimate:
    """Amplitude of what every run has a share of its own of, from the likelihood of their spread."""
    scale = float(np.sqrt(2.0) * (1.0 if study.driven else study.largest))
    low, high = (scale * end for end in trial.fit.factor_interval(name))
    value, unit = scale * trial.fit.factor(name), trial.model.moment_unit
    return Estimate(value, (high - low) / (2.0 * float(stats.norm.ppf(0.975))), (low, high), unit)


def detectable(study: Study, found: Found) -> dict[str, float]:
    """Smallest size of each candidate's first parameter that these runs would have shown four times in five."""
    last = found.rounds[-1]
    sizes = {}
    for score in last.scores.ranked:
        needed = last.threshold + penalty(fitted_parameters(score.effect), len(study.runs))
        sizes[score.effect] = float(score.unit_size) * float(np.sqrt(max(needed, 1.0)) + stats.norm.ppf(0.8))
    return sizes


def named_effects(
    study: Study, found: Found, split_by: Mapping[tuple[str, str], str]
) -> tuple[NamedEffect, ...]:
    """The final model's effects as the verdict names them; `split_by` by (effect, rival)."""
    named, dof = [], study.base.dof
    for name in found.final.added:
        own = [rival for rival in found.rivals if rival.replaces == name]
        weight = found.weight(name)
        rivals = tuple(
            NamedRival(
                rival.name,
                weight * float(np.exp(-0.5 * rival.behind)),
                split_by.get((name, rival.name), effects.get(name).card(dof).separated_by),
            )
            for rival in own
        )
        sure = weight * (1.0 - found.p_values.get(name, LEVEL))
        parameters = parameter_estimates(study, found.final, name)
        p_value = found.p_values.get(name, LEVEL)
        says = effects.get(name).card(dof).says
        named.append(NamedEffect(name, says, parameters, sure, p_value, rivals))
    return tuple(named)


def gap_json(gap: Gap, dof: Dof) -> dict[str, float]:
    """The contract's form, in the unit in which people see positions."""
    key = dof.units.key
    return {
        f"before_{key}": float(dof.shown(gap.before)),
        f"after_{key}": float(dof.shown(gap.after)),
        f"noise_floor_{key}": float(dof.shown(gap.floor)),
    }
