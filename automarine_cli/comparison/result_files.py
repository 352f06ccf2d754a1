"""Result files as sides of a comparison: their parameters with intervals, and what else they say of themselves."""

from collections.abc import Mapping, Sequence
from typing import Any

from automarine_cli.dofs import DOFS, YAW, Dof
from automarine_cli.fits.estimate import Estimate

Contents = tuple[dict[str, Estimate], dict[str, str]]


def shared_models(files: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    """Models that some result prefers and all have; else all that all have."""
    common = [n for n in ("1", "2", "3") if all(n in one.get("models", {}) for one in files)]
    preferred = {str(one.get("preferred")) for one in files}
    return tuple(number for number in common if number in preferred) or tuple(common)


def of_model(data: Mapping[str, Any], models: Sequence[str], dof: Dof) -> Contents:
    """What the file of a fit says, of the models in `models`.

    These raise KeyError, TypeError, ValueError or AttributeError for a file that automarine did not write so.
    """
    own = dof.symbols
    names = {
        own.quadratic: own.quadratic_print,
        own.linear: own.linear,
        own.inertia: own.inertia,
        dof.ratio_key: f"{own.inertia}/{own.quadratic_print}",
        own.constant: "constant force",
        own.difference: "half the difference of drag",
    }
    parameters = {}
    for number_ in models:
        beside = f", model {number_}" if len(models) > 1 else ""
        for key, told in names.items():
            if data["models"][number_].get(key) is not None:
                parameters[f"{told}{beside}"] = Estimate.from_json(data["models"][number_][key])
    if data.get("gain_scatter"):
        parameters["scatter of thrust"] = Estimate.from_json(data["gain_scatter"])
    facts = {"preferred model": str(data["preferred"])}
    noise = f"{dof.words.position}_noise_{dof.units.key}"
    if data.get(noise) is not None:
        facts[f"{dof.words.position} noise [{dof.units.shown}]"] = _short(data[noise])
    return parameters, facts


def of_thrusters(data: Mapping[str, Any], models: Sequence[str]) -> Contents:
    """What a thruster map says."""
    parameters, form = {}, str(data["form"])
    facts = {"form": form, "error of it [% of full scale]": _short(data["chosen"]["rmse_percent_of_full_scale"])}
    for side in ("forward", "backward"):
        if data[side]["a"] is not None:
            parameters[f"a {side}, square law"] = Estimate.from_json(data[side]["a"])
        chosen = (data.get("parameters") or {}).get(side) or {}
        for name, value in chosen.items():
            if form != "square" and isinstance(value, dict):
                _place(f"{name} {side}, form {form}", value, parameters, facts)
    return parameters, facts


def _place(name: str, value: dict[str, Any], parameters: dict[str, Estimate], facts: dict[str, str]) -> None:
    """A parameter with an interval is compared; one that a bound holds is a fact."""
    if value["ci95"] is not None:
        parameters[name] = Estimate.from_json(value)
    elif value["value"] is None:
        facts[name] = str(value["at_bound"])
    else:
        facts[name] = f"{_short(value['value'])}, {value['at_bound']}"


def of_diagnosis(data: Mapping[str, Any], models: Sequence[str]) -> Contents:
    """What a diagnosis says, of whatever motion."""
    dof = DOFS[str(data.get("motion", YAW.name))]
    own, parameters = dof.symbols, dict[str, Estimate]()
    names = ", ".join(str(effect["name"]) for effect in data["effects"])
    facts = {"verdict": str(data["verdict"]) + (f": {names}" if names else "")}
    for effect in data["effects"]:
        for name, value in effect["parameters"].items():
            if value["stderr"] != 0:  # a choice of law has no interval
                _place(f"{effect['name']}: {name}", value, parameters, facts)
    for name, moved in data.get("base", {}).items():
        told = own.quadratic_print if name == own.quadratic else name
        parameters[f"{told} with what was missing"] = Estimate.from_json(moved["after"])
    gap = data["gap"]["fitted_runs"]
    unit = dof.units.key if f"before_{dof.units.key}" in gap else "N"
    for key, name in (("before", "gap before"), ("after", "gap after"), ("noise_floor", "noise")):
        facts[f"{name} [{unit}]"] = _short(gap[f"{key}_{unit}"])
    return parameters, facts


def _short(value: float) -> str:
    return f"{float(value):.3g}"
