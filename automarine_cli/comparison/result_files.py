"""Result files as sides of a comparison: their parameters with intervals, and what else they say of themselves."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from automarine_cli.comparison.side_by_side import OverRuns
from automarine_cli.results.estimate import Estimate, Given
from automarine_cli.results.judged import DiagnosisFile, ValidationFile
from automarine_cli.results.kinds import DIAGNOSIS, MODELS, THRUSTER_MAP, VALIDATION, ResultKind
from automarine_cli.results.models import ModelFile, ThrusterFile
from automarine_cli.results.records import ResultRecord

Contents = tuple[dict[str, Estimate], dict[str, str]]


def shared_models(files: Sequence[ResultRecord]) -> tuple[str, ...]:
    """Models that some result prefers and all have; else all that all have."""
    fits = [one for one in files if isinstance(one, ModelFile)]
    common = [n for n in ("1", "2", "3") if fits and all(n in one.models for one in fits)]
    preferred = {one.preferred for one in fits}
    return tuple(number for number in common if number in preferred) or tuple(common)


def of_model(file: ModelFile, models: Sequence[str]) -> Contents:
    """What the file of a fit says, of the models in `models`. Raises ModelError for a number without an interval."""
    dof, own = file.dof, file.dof.symbols
    names = {
        "quadratic": own.quadratic_print,
        "linear": own.linear,
        "inertia": own.inertia,
        "ratio": f"{own.inertia}/{own.quadratic_print}",
        "constant": "constant force",
        "difference": "half the difference of drag",
    }
    parameters = {}
    for number_ in models:
        beside = f", model {number_}" if len(models) > 1 else ""
        for name, told in names.items():
            given: Given | None = getattr(file.models[number_], name, None)
            if given is not None:
                parameters[f"{told}{beside}"] = given.known(
                    f"models.{number_}.{dof.parameters.get(name, dof.ratio_key)}"
                )
    if file.gain_scatter is not None:
        parameters["scatter of thrust"] = file.gain_scatter.known("gain_scatter")
    facts = {"preferred model": file.preferred}
    if file.noise is not None:
        facts[f"{dof.words.position} noise [{dof.units.shown}]"] = _short(file.noise)
    return parameters, facts


def of_thrusters(file: ThrusterFile, models: Sequence[str]) -> Contents:
    """What a thruster map says. Raises ModelError for a number without an interval."""
    parameters, facts = dict[str, Estimate](), {"form": file.form}
    if file.chosen is not None and file.chosen.rmse_percent_of_full_scale is not None:
        facts["error of it [% of full scale]"] = _short(file.chosen.rmse_percent_of_full_scale)
    sides = (("forward", file.forward, file.parameters.forward), ("backward", file.backward, file.parameters.backward))
    for side, square, curve in sides:
        if square.a is not None:
            parameters[f"a {side}, square law"] = square.a.known(f"{side}.a")
        for name, value in (curve.named if curve and file.form != "square" else {}).items():
            if value.estimate or value.at_bound:  # else the form fixes it
                _place(f"{name} {side}, form {file.form}", value, parameters, facts)
    return parameters, facts


def _place(name: str, value: Given, parameters: dict[str, Estimate], facts: dict[str, str]) -> None:
    """A parameter with an interval is compared; one that a bound holds is a fact."""
    if (estimate := value.estimate) is not None:
        parameters[name] = estimate
    else:
        facts[name] = str(value.at_bound) if value.value is None else f"{_short(value.value)}, {value.at_bound}"


def of_validation(file: ValidationFile, models: Sequence[str]) -> Contents:
    """What a validation says of the model that the fit preferred: its errors, to be compared run by run."""
    number_ = file.preferred_by_fit if file.preferred_by_fit in file.models else file.best
    unit, each = file.dof.units.shown, file.models[number_].runs
    samples = {run: f"{run} ({log.samples} samples)" for run, log in file.logs.items()}
    found: dict[str, Mapping[str, float | None]] = {
        "free run rmse": {run: one.rmse for run, one in each.items()},
        "restarted rmse": {run: one.restarted for run, one in each.items()},
    }
    for ahead in file.prediction.get(number_, ()):
        found[f"error {ahead.horizon_s:g} s ahead"] = ahead.runs
    parameters = {}
    for name, by_run in found.items():
        told = {samples.get(run, run): value for run, value in by_run.items() if value is not None}
        if len(told) > 1:
            parameters[name] = OverRuns.of(told, unit)
    return dict(parameters), {"preferred model": number_}


def of_diagnosis(file: DiagnosisFile, models: Sequence[str]) -> Contents:
    """What a diagnosis says, of whatever motion. Raises ModelError for a number without an interval."""
    own, parameters = file.dof.symbols, dict[str, Estimate]()
    names = ", ".join(effect.name for effect in file.effects)
    facts = {"verdict": file.verdict + (f": {names}" if names else "")}
    for effect in file.effects:
        for name, value in effect.parameters.items():
            if value.stderr != 0:  # a choice of law has no interval
                _place(f"{effect.name}: {name}", value, parameters, facts)
    for name, moved in file.base.items():
        told = own.quadratic_print if name == own.quadratic else name
        parameters[f"{told} with what was missing"] = moved.after.known(f"base.{name}.after")
    gap = file.gap.fitted_runs
    for size, name in ((gap.before, "gap before"), (gap.after, "gap after"), (gap.noise_floor, "noise")):
        facts[f"{name} [{file.unit}]"] = _short(size)
    return parameters, facts


def _short(value: float) -> str:
    return f"{value:.3g}"


COMPARED: Mapping[ResultKind[Any], Callable[[Any, Sequence[str]], Contents]] = {
    **dict.fromkeys(MODELS.values(), of_model),
    THRUSTER_MAP: of_thrusters,
    VALIDATION: of_validation,
    DIAGNOSIS: of_diagnosis,
}
"""What `compare` takes of each kind of result: parameters and facts, of the models that it is asked for."""
