"""What `run` says of each result in a few words."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from automarine_cli.dofs.motion import PLANAR
from automarine_cli.errors import AutomarineError
from automarine_cli.report.tables import number
from automarine_cli.results.judged import CheckFile, DiagnosisFile, TuningFile, ValidationFile
from automarine_cli.results.kinds import (
    CHECK,
    DIAGNOSIS,
    KINDS,
    MODELS,
    PLANAR_MODEL,
    THRUSTER_MAP,
    TUNING,
    VALIDATION,
    ResultKind,
)
from automarine_cli.results.models import ModelFile, PlanarFile, ThrusterFile


def of_check(file: CheckFile) -> str:
    """How many logs and runs, and how many of them serve nothing."""
    used, aside = file.runs.used, len(file.runs.set_aside)
    idle = sum(run.step is None for run in file.yaw_runs)
    said = f"{file.logs} log{'s' * (file.logs != 1)}, {used} run{'s' * (used != 1)}" + (
        f", {idle} without a half-turn" if idle else ""
    )
    return said + (f", {aside} set aside" if aside else "")


def of_thrusters(file: ThrusterFile) -> str:
    """The law, and how well it fits."""
    if (chosen := file.chosen) is None:
        return ""
    error = number(chosen.rmse_percent_of_full_scale, 2)
    return f"{chosen.form} law, R² {number(chosen.r2)}, error {error} % of full scale"


def of_model(file: ModelFile) -> str:
    """The preferred model and its parameters; first that it is not usable, where so."""
    values = [f"{name} {number(given.value)}" for name, given in file.main_parameters()]
    return f"{_unusable(file)}model {file.preferred}: {', '.join(values)}"


def of_final(file: ModelFile, found: DiagnosisFile) -> str:
    """The model with what a diagnosis named, its parameters without that behind; empty where nothing was named."""
    keys = {file.dof.symbols.quadratic_print: file.dof.symbols.quadratic}
    moved = {name: found.base.get(keys.get(name, name)) for name, _ in file.main_parameters()}
    if found.verdict != "named" or found.of_thrusters or not all(moved.values()):
        return ""
    values = [f"{name} {number(one.after.value)}" for name, one in moved.items() if one is not None]
    alone = ", ".join(number(given.value) for _, given in file.main_parameters())
    names = ", ".join(effect.name for effect in found.effects)
    return f"{_unusable(file)}model {file.preferred} with {names}: {', '.join(values)} (without: {alone})"


def _unusable(file: ModelFile | PlanarFile) -> str:
    return "not usable: " if file.prediction.refusal else ""


def of_planar(file: PlanarFile) -> str:
    """What the model is made of."""
    return f"{_unusable(file)}{file.structure}"


def of_validation(file: ValidationFile) -> str:
    """How far the best model is from what was measured."""
    best, unit = file.models[file.best], file.dof.units.key
    unusable = "no model is of use: " if file.use.refusal else ""
    if file.motion == PLANAR.name:
        return f"heading {number(best.rmse, 3)} deg free run"
    return (
        f"{unusable}model {file.best}: {number(best.rmse, 3)} {unit} free run, "
        f"{number(best.restarted, 3)} {unit} restarted, noise {number(file.noise_floor, 2)} {unit}"
    )


def of_tuning(file: TuningFile) -> str:
    """The verdict, and of which target."""
    return f"{file.verdict.replace('-', ' ')} for {file.target}"


def of_diagnosis(file: DiagnosisFile) -> str:
    """The verdict, what was named, and the gap."""
    gap, unit = file.gap.fitted_runs, file.unit
    names = ", ".join(effect.name for effect in file.effects)
    said = file.verdict.replace("-", " ") + (f": {names}" if names else "")
    return f"{said}; gap {number(gap.before, 3)} to {number(gap.after, 3)} {unit}"


_OUTCOMES: Mapping[ResultKind[Any], Callable[[Any], str]] = {
    CHECK: of_check, THRUSTER_MAP: of_thrusters, **dict.fromkeys(MODELS.values(), of_model), PLANAR_MODEL: of_planar,
    VALIDATION: of_validation, DIAGNOSIS: of_diagnosis, TUNING: of_tuning,
}  # fmt: skip


def kind_of(command: str) -> ResultKind[Any] | None:
    """Return the kind of result that a command writes, if it is one that a campaign tells of."""
    return next((kind for kind in KINDS if kind.writer == command and kind in _OUTCOMES), None)


def outcome(command: str, folder: Path) -> str:
    """Say in a few words what the result of a command in a folder is; empty where its file cannot be read."""
    if (kind := kind_of(command)) is None:
        return ""
    try:
        return _OUTCOMES[kind](kind.read(folder / kind.file))
    except AutomarineError:
        return ""
