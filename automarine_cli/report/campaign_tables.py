"""What `run` shows of a campaign: one line a step, and cautions that only the whole campaign gives."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from automarine_cli.dofs import DOFS, YAW, Dof
from automarine_cli.dofs.motion import PLANAR
from automarine_cli.errors import SettingError
from automarine_cli.pipeline.recipe import read_mapping
from automarine_cli.report.tables import MISSING, Table, number

FILES = {
    "check": "check.json",
    "fit-thrusters": "thrusters.json",
    "validate": "validation.json",
    "diagnose": "diagnosis.json",
    **{f"fit-{name}": f"{name}_model.json" for name in (*DOFS, PLANAR.name)},
}


def steps_table(rows: Sequence[tuple[str, str, str, str]]) -> Table:
    """Step, what was done, why, and what its result says."""
    cells = tuple(
        (name, did if did != "made" else "done", why or MISSING, says or MISSING) for name, did, why, says in rows
    )
    return Table("", ("step", "", "because", "result"), cells)


ALIKE = 1.03  # voltages that differ by less are one, as in the thruster fit
SAID = ("fit-yaw", "validate", "diagnose")


def campaigns_table(rows: Sequence[tuple[str, Mapping[str, str], Sequence[str]]]) -> Table:
    """Of several campaigns: name, what the steps that matter most say, and what was refused."""
    cells = tuple(
        (name, *(says.get(step, "") or MISSING for step in SAID), "; ".join(refused) or MISSING)
        for name, says, refused in rows
    )
    return Table("", ("campaign", *SAID, "refused"), cells)


def outcome(step: str, folder: Path) -> str:
    """The result of a step in a few words; empty where its file cannot be read."""
    try:
        command = step if step in FILES else step.rpartition("-")[0]
        dof = DOFS.get(step.rpartition("-")[2], YAW)
        data: dict[str, Any] = dict(read_mapping(folder / FILES[command]))
        return (_model if command == f"fit-{dof.name}" else _IN_WORDS[command])(data, dof)
    except (SettingError, KeyError, TypeError, AttributeError):
        return ""


def cautions(thrusters: Path, supply: float | None) -> list[str]:
    """Sentences about what does not fit together: thruster tests at other voltages than the vehicle's supply."""
    if supply is None or not (thrusters / FILES["fit-thrusters"]).is_file():
        return []
    data: dict[str, Any] = dict(read_mapping(thrusters / FILES["fit-thrusters"]))
    if data.get("voltage_range_V") is None:
        return []
    low, high = data["voltage_range_V"]
    if low / ALIKE <= supply <= high * ALIKE:
        return []
    nearest = low if supply < low else high
    tested = " to ".join(dict.fromkeys(number(one, 3) for one in (low, high)))
    found = [
        one["thrust_at_fixed_n"]["value"]
        for one in (data.get("voltage_exponent") or {}).values()
        if one and one["thrust_at_fixed_n"]
    ]
    power = sum(found) / len(found) if found else None
    size = (
        f" Thrust grows with the voltage to the power {number(power, 3)}, so expect it to be "
        f"{number((supply / nearest) ** power, 3)} times that at {number(nearest, 3)} V."
        if power
        else ""
    )
    return [
        f"The thrusters were tested at {tested} V, the vehicle's supply is {number(supply, 3)} V: the map is "
        f"extrapolated.{size} Test at the supply voltage."
    ]


def _check(data: dict[str, Any], _: Dof) -> str:
    used, aside = data["runs"]["used"], len(data["runs"]["set_aside"])
    idle = sum(run["half_turn"] is None for run in data["yaw_runs"])
    said = f"{data['logs']} log{'s' * (data['logs'] != 1)}, {used} run{'s' * (used != 1)}" + (
        f", {idle} without a half-turn" if idle else ""
    )
    return said + (f", {aside} set aside" if aside else "")


def _thrusters(data: dict[str, Any], _: Dof) -> str:
    chosen = data["chosen"]
    error = number(chosen["rmse_percent_of_full_scale"], 2)
    return f"{chosen['form']} law, R² {number(chosen['r2'])}, error {error} % of full scale"


def _model(data: dict[str, Any], dof: Dof) -> str:
    model, own = data["models"][data["preferred"]], dof.symbols
    names = {own.quadratic: own.quadratic_print, own.linear: own.linear, own.inertia: own.inertia}
    values = [f"{names[key]} {number(model[key]['value'])}" for key in names if model.get(key)]
    return f"model {data['preferred']}: {', '.join(values)}"


def _planar(data: dict[str, Any], _: Dof) -> str:
    return str(data["structure"])


def _validation(data: dict[str, Any], dof: Dof) -> str:
    if data.get("motion") == PLANAR.name:
        error = data["models"][PLANAR.name]["heading_rmse_deg"]
        return f"heading {number(error, 3)} deg free run"
    best, unit = data["models"][data["best"]], dof.units.key
    return (
        f"model {data['best']}: {number(best[f'rmse_{unit}'], 3)} {unit} free run, "
        f"{number(best[f'restarted_rmse_{unit}'], 3)} {unit} restarted, "
        f"noise {number(data[f'noise_floor_{unit}'], 2)} {unit}"
    )


def _diagnosis(data: dict[str, Any], dof: Dof) -> str:
    gap, unit = data["gap"]["fitted_runs"], dof.units.key
    names = ", ".join(effect["name"] for effect in data["effects"])
    said = str(data["verdict"]).replace("-", " ") + (f": {names}" if names else "")
    return f"{said}; gap {number(gap[f'before_{unit}'], 3)} to {number(gap[f'after_{unit}'], 3)} {unit}"


_IN_WORDS: Mapping[str, Callable[[dict[str, Any], Dof], str]] = {
    "check": _check,
    "fit-thrusters": _thrusters,
    "fit-planar": _planar,
    "validate": _validation,
    "diagnose": _diagnosis,
}
