"""The model that a diagnosis leaves behind: its base with the effects that were named."""

import numpy as np

from automarine_cli.diagnosis.search import Trial, gain_exponent
from automarine_cli.diagnosis.study import Study
from automarine_cli.diagnosis.verdict import base_estimates, parameter_estimates
from automarine_cli.estimate import Estimate
from automarine_cli.fits.cautions import covariance_json, valid_range
from automarine_cli.fits.innovations import InnovationsFit, random_estimates
from automarine_cli.fits.linear_mixed import GAIN
from automarine_cli.models.store import StoredModels, model_json


def extended_model(study: Study, trial: Trial, stored: StoredModels, parent_sha256: str) -> dict[str, object]:
    """A yaw-model file of one model with its effects, and the hash of the file that it grew from."""
    base, model, dof = base_estimates(study, trial), trial.model, study.base.dof
    roles = ("quadratic", "linear", "inertia", "constant", "difference")
    own = {role: dof.parameters[role] for role in roles if dof.parameter(role) in model.parameter_names}
    drag = {name: base[name].to_json() for name in own.values()}
    ratio, covariance, fit = None, study.covariance(model, trial.fit), trial.fit
    told = drag | {"covariance": covariance_json(model.short_names, fit.theta, fit.positive, covariance)}
    if "quadratic" in own and base[own["quadratic"]].value > 0:
        i, k = (model.index(dof.parameter(role)) for role in ("inertia", "quadratic"))
        spread = float(np.sqrt(max(covariance[i, i] + covariance[k, k] - 2.0 * covariance[i, k], 0.0)))
        ratio = Estimate.from_log(
            base[own["inertia"]].value / base[own["quadratic"]].value, spread, len(study.runs) - 1, dof.unit_of("ratio")
        ).to_json()
    added = [term.name for term in model.terms if not term.own]
    return {
        **model_json(
            dof, unit=stored.moment_unit, fitted_to="whole runs",
            models={stored.preferred: {**drag, "output_error": told, "velocity_error": None, "sse": None}},
            preferred=stored.preferred, because=f"Model {stored.preferred} was the base of the diagnosis.", ratio=ratio,
            valid_range=valid_range(
                (end for run in study.runs for end in (run.command.min(), run.command.max())), model
            ),
            effects=[
                {
                    "name": name,
                    "parameters": {k: e.to_json() for k, e in parameter_estimates(study, trial, name).items()},
                }
                for name in added
            ],
        ),
        f"{dof.words.position}_noise_{dof.units.key}": float(dof.shown(trial.fit.noise))
        if study.position_counts
        else None,
        **(
            {"driven": True, "random": random_estimates(fit, covariance, dof)}
            if isinstance(fit, InnovationsFit)
            else {}
        ),
        **_scatter(study, trial),
        "parent": {"file": stored.source, "sha256": parent_sha256},
    }  # fmt: skip


def _scatter(study: Study, trial: Trial) -> dict[str, object]:
    """What the gains of single runs still scatter by, and the power of the command's size that they go with."""
    exponent = gain_exponent(study, trial.fit)
    return {
        "gain_scatter": float(trial.fit.factor(GAIN)),
        "gain_exponent": None if exponent is None else exponent.to_json(),
    }
