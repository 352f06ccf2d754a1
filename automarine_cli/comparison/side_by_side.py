"""Results of one command side by side: how far their parameters are apart, with intervals, and whether that is
chance."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from scipy import special

from automarine_cli.comparison.validation import VALIDATION, ValidationFile
from automarine_cli.errors import ModelError, SettingError
from automarine_cli.estimate import Estimate, Given
from automarine_cli.models.store import DIAGNOSIS, MODELS, DiagnosisFile, ModelFile
from automarine_cli.pipeline.manifest import MANIFEST, Input, is_manifest, read_manifest
from automarine_cli.pipeline.result_files import ResultKind, ResultRecord
from automarine_cli.pipeline.words import listed, printable
from automarine_cli.thrusters.map import THRUSTER_MAP, ThrusterFile

DIFFERS, MAY_DIFFER, ALIKE = "differs", "may differ", "no difference shown"
LEVEL = 0.05
Z95 = float(special.ndtri(0.975))


@dataclass(frozen=True)
class Side:
    """One of the results: what it is called, its parameters by name, and what else it says of itself in words."""

    name: str
    parameters: Mapping[str, Estimate]
    facts: Mapping[str, str]
    runs: int


@dataclass(frozen=True)
class OverRuns(Estimate):
    """The mean of a number over runs, with the interval that their scatter gives it, and the number `by_run`."""

    by_run: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, by_run: Mapping[str, float], unit: str) -> "OverRuns":
        values = np.array(list(by_run.values()))
        middle, stderr = float(values.mean()), float(values.std(ddof=1) / np.sqrt(len(values)))
        half = float(special.stdtrit(len(values) - 1, 0.975)) * stderr
        return cls(middle, stderr, (middle - half, middle + half), unit, by_run=by_run)


@dataclass(frozen=True)
class Difference:
    """One parameter of the result `of` less that of the result `base`.

    `p_value` is two-sided, None where neither is uncertain; `verdict` allows for how many were compared.
    """

    parameter: str
    of: str
    base: str
    difference: Estimate
    relative: tuple[float, float, float] | None
    p_value: float | None
    verdict: str

    def to_json(self) -> dict[str, object]:
        return {
            "parameter": self.parameter, "of": self.of, "less": self.base, "difference": self.difference.to_json(),
            "relative_percent": self.relative and list(self.relative), "p_value": self.p_value, "verdict": self.verdict,
        }  # fmt: skip


def difference(one: Estimate, other: Estimate) -> Estimate:
    """`one` less `other`, both from data of their own; of means over runs run by run, of two that both have or more.

    The interval takes the distance of each end from its value from the two intervals, so that it is as skew as
    they are (Zou and Donner 2008, Statistics in Medicine 27:1693, equation 9).
    """
    if isinstance(one, OverRuns) and isinstance(other, OverRuns):
        both = {run: value - other.by_run[run] for run, value in one.by_run.items() if run in other.by_run}
        return OverRuns.of(both, one.unit)
    apart = one.value - other.value
    low = apart - math.hypot(one.value - one.ci95[0], other.ci95[1] - other.value)
    high = apart + math.hypot(one.ci95[1] - one.value, other.value - other.ci95[0])
    return Estimate(apart, math.hypot(one.stderr, other.stderr), (low, high), one.unit)


def comparable(one: Estimate, other: Estimate) -> bool:
    """Whether a difference has an interval: means over runs need two in common."""
    if isinstance(one, OverRuns) and isinstance(other, OverRuns):
        return len(set(one.by_run) & set(other.by_run)) > 1
    return True


def p_value(apart: Estimate) -> float | None:
    """Two-sided p of no difference, at 0.05 just where the interval ends at zero."""
    toward = apart.value - apart.ci95[0] if apart.value > 0 else apart.ci95[1] - apart.value
    if toward <= 0:
        return None
    return float(2 * special.ndtr(-Z95 * abs(apart.value) / toward))


def holm(p_values: Sequence[float]) -> list[float]:
    """p-values that allow for their number (Holm 1979, Scandinavian Journal of Statistics 6:65)."""
    order = np.argsort(p_values, kind="stable")
    factor = np.arange(len(order), 0, -1)
    adjusted = np.empty(len(order))
    adjusted[order] = np.maximum.accumulate(factor * np.asarray(p_values)[order])
    return [float(min(1.0, p)) for p in adjusted]


def differences(sides: Sequence[Side]) -> tuple[Difference, ...]:
    """Each result against the first, parameter by parameter, for all parameters that both have in one unit."""
    found = []
    base = sides[0]
    for side in sides[1:]:
        for name, own in side.parameters.items():
            first = base.parameters.get(name)
            if first is None or first.unit != own.unit or not comparable(own, first):
                continue
            apart = difference(own, first)
            p = p_value(apart)
            verdict = ALIKE if apart.value == 0 or (p is not None and p >= LEVEL) else MAY_DIFFER
            found.append(Difference(name, side.name, base.name, apart, _relative(apart, first), p, verdict))
    adjusted = holm([0.0 if one.p_value is None else one.p_value for one in found])
    return tuple(
        replace(one, verdict=DIFFERS) if one.verdict == MAY_DIFFER and p < LEVEL else one
        for one, p in zip(found, adjusted)
    )


def _relative(apart: Estimate, base: Estimate) -> tuple[float, float, float] | None:
    """The difference and its ends in percent of the first's value; None where that is not well away from zero."""
    low, high = base.ci95
    if low <= 0 <= high or base.value == 0:
        return None
    scale = 100.0 / abs(base.value)
    return scale * apart.value, scale * apart.ci95[0], scale * apart.ci95[1]


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
        "quadratic": own.quadratic_print, "linear": own.linear, "inertia": own.inertia,
        "ratio": f"{own.inertia}/{own.quadratic_print}", "constant": "constant force",
        "difference": "half the difference of drag",
    }  # fmt: skip
    parameters = {
        f"{label}{f', model {number}' * (len(models) > 1)}": given.known(
            f"models.{number}.{dof.parameters.get(role, dof.ratio_key)}"
        )
        for number in models
        for role, label in names.items()
        if (given := getattr(file.models[number], role, None)) is not None
    }
    if file.gain_scatter is not None:
        parameters["scatter of thrust"] = file.gain_scatter.known("gain_scatter")
    noise = {} if file.noise is None else {f"{dof.words.position} noise [{dof.units.shown}]": _short(file.noise)}
    return parameters, {"preferred model": file.preferred, **noise}


def of_thrusters(file: ThrusterFile, models: Sequence[str]) -> Contents:
    """What a thruster map says. Raises ModelError for a number without an interval."""
    parameters, facts = dict[str, Estimate](), {"form": file.form}
    if file.rmse_percent is not None:
        facts["error of it [% of full scale]"] = _short(file.rmse_percent)
    for side in ("forward", "backward"):
        square, curve = getattr(file, f"a_{side}"), getattr(file.parameters, side)
        if square is not None:
            parameters[f"a {side}, square law"] = square.known(f"{side}.a")
        for name, value in vars(curve).items() if curve and file.form != "square" else ():
            if value and (value.estimate or value.at_bound):  # else the form fixes it
                _place(f"{name} {side}, form {file.form}", value, parameters, facts)
    return parameters, facts


def _place(name: str, value: Given, parameters: dict[str, Estimate], facts: dict[str, str]) -> None:
    """A parameter with an interval is compared; one that a bound holds is a fact."""
    if (estimate := value.estimate) is not None:
        parameters[name] = estimate
    else:
        facts[name] = str(value.at_bound) if value.value is None else f"{_short(value.value)}, {value.at_bound}"


def of_validation(file: ValidationFile, models: Sequence[str]) -> Contents:
    number = file.preferred_by_fit if file.preferred_by_fit in file.models else file.best
    each = file.models[number].runs
    samples = {run: f"{run} ({log['samples']} samples)" for run, log in file.logs.items()}
    errors: dict[str, Mapping[str, float | None]] = {
        "free run rmse": {run: score.rmse for run, score in each.items()},
        "restarted rmse": {run: score.restarted for run, score in each.items()},
        **{f"error {ahead.horizon_s:g} s ahead": ahead.runs for ahead in file.prediction.get(number, ())},
    }
    parameters = dict[str, Estimate]()
    for name, by_run in errors.items():
        known = {samples.get(run, run): value for run, value in by_run.items() if value is not None}
        if len(known) > 1:
            parameters[name] = OverRuns.of(known, file.dof.units.shown)
    return parameters, {"preferred model": number}


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
        label = own.quadratic_print if name == own.quadratic else name
        parameters[f"{label} with what was missing"] = moved.after.known(f"base.{name}.after")
    sizes = {"gap before": file.gap.before, "gap after": file.gap.after, "noise": file.gap.noise_floor}
    return parameters, facts | {f"{name} [{file.unit}]": _short(size) for name, size in sizes.items()}


def _short(value: float) -> str:
    return f"{value:.3g}"


COMPARED: Mapping[ResultKind[Any], Callable[[Any, Sequence[str]], Contents]] = {
    **dict.fromkeys(MODELS.values(), of_model),
    THRUSTER_MAP: of_thrusters,
    VALIDATION: of_validation,
    DIAGNOSIS: of_diagnosis,
}
"""Parameters and facts of each kind of result, of the models that are compared."""


def locate(results: Sequence[Path]) -> dict[str, tuple[Path, ResultKind[Any]]]:
    """Find the result file in each folder (or named itself), by the last parts of its place that tell it apart.

    Raises SettingError for fewer than two, for one that is given twice, and for a folder without a result.
    """
    folders = [path.parent if path.is_file() else path for path in results]
    if len(folders) < 2:
        raise SettingError("one result was given; give two or more folders of results to compare")
    parts = [folder.resolve().parts for folder in folders]
    for count in range(1, max(map(len, parts)) + 1):
        names = [printable("/".join(place[-count:]).lstrip("/")) for place in parts]
        if len(set(names)) == len(names):
            return dict(zip(names, map(_result_file, folders)))
    twice = next(folder for i, folder in enumerate(folders) if parts[i] in parts[:i])
    raise SettingError(f"{twice} is given twice; give two or more different folders of results")


def _result_file(folder: Path) -> tuple[Path, ResultKind[Any]]:
    for kind in COMPARED:
        if (path := folder / kind.file).is_file():
            return path, kind
    files = [kind.file for kind in COMPARED]
    inside = sorted(path.parent for name in files for path in folder.glob(f"*/{name}"))
    there = f"; {inside[0]} does: compare one step of each campaign" if inside else ""
    raise SettingError(
        f"{folder} holds no result of fit-thrusters, fit-yaw, validate or diagnose; expected one of the files "
        f"{listed(files)}{there}"
    )


def inputs_of(results: Sequence[Path]) -> list[Input]:
    """List the result files as inputs of a manifest, then the manifests beside them."""
    places = {name: path for name, (path, _) in locate(results).items()}
    manifests = {name: path.with_name(MANIFEST) for name, path in places.items()}
    return [
        *(Input(f"{name}/{path.name}", path, "result") for name, path in places.items()),
        *(Input(f"{name}/{MANIFEST}", path, "manifest") for name, path in manifests.items() if is_manifest(path)),
    ]


def read_sides(results: Sequence[Path]) -> tuple[str, tuple[Side, ...], list[str]]:
    """Read results of one command: its name, the sides, and notes on what must be known of them.

    Raises SettingError for results that cannot be compared, ModelError for a file that is not as automarine wrote it.
    """
    places = locate(results)
    files = {name: kind.read(path, f"{name}/{path.name}") for name, (path, kind) in places.items()}
    commands = {
        name: f"{kind.writer} of thrusters" if getattr(files[name], "of_thrusters", False) else kind.writer
        for name, (_, kind) in places.items()
    }
    units = {name: str(getattr(file, "force_unit", None) or "") for name, file in files.items()}
    motions = {name: file.dof.name for name, file in files.items()}
    force = next(iter(files.values())).dof.words.force
    for what, values, only in (
        ("results of", commands, "results of one command"),
        ("results in", motions, "results of one motion"),
        (f"{force}s in", units, "results in one unit: there is no factor between the two"),
    ):
        different = dict.fromkeys(values.values())
        if len(different) > 1:
            listing = "; ".join(f"{name}: {value}" for name, value in values.items())
            raise SettingError(f"{what} {' and '.join(different)} cannot be compared ({listing}); compare {only}")
    models = shared_models(list(files.values()))
    sides = []
    for name, (path, kind) in places.items():
        try:
            parameters, facts = COMPARED[kind](files[name], models)
        except ModelError as problem:
            raise ModelError(f"{name}/{path.name}: {problem}") from None
        sides.append(Side(name, parameters, facts, files[name].runs.used))
    notes = [*_contrasts(sides), *_shared_logs(sides, {name: path for name, (path, _) in places.items()})]
    return next(iter(commands.values())), tuple(sides), notes


def _contrasts(sides: Sequence[Side]) -> list[str]:
    notes = []
    for fact in ("preferred model", "form", "verdict"):
        values = {side.name: side.facts[fact] for side in sides if fact in side.facts}
        if len(set(values.values())) > 1:
            notes.append(f"Not the same {fact}: {'; '.join(f'{name}: {value}' for name, value in values.items())}.")
    return notes


def _shared_logs(sides: Sequence[Side], places: Mapping[str, Path]) -> list[str]:
    """Logs that two results were both made from, told by their content; of what is compared run by run how many."""
    if any(isinstance(parameter, OverRuns) for parameter in sides[0].parameters.values()):
        return ["Means over runs; differences are run by run, over the runs that both have."]
    logs = {
        name: {entry.sha256 for entry in read_manifest(manifest).inputs if entry.role == "log" and entry.sha256}
        for name, path in places.items()
        if is_manifest(manifest := path.with_name(MANIFEST))
    }
    return [
        f"{a} and {b} share {count} log{'s' * (count != 1)}: the intervals of their differences, which assume "
        "independent results, tend to be too wide."
        for a, b in combinations(logs, 2)
        if (count := len(logs[a] & logs[b]))
    ]
