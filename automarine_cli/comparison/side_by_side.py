"""Results of one command side by side: how far their parameters are apart, with intervals, and whether that is
chance."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from scipy import special

from automarine_cli.comparison.validation import VALIDATION, ValidationFile
from automarine_cli.errors import ModelError, SettingError
from automarine_cli.estimate import Estimate, Given
from automarine_cli.models.store import DIAGNOSIS, MODELS, DiagnosisFile, ModelFile
from automarine_cli.pipeline.records import ResultKind
from automarine_cli.text import listed, printable
from automarine_cli.thrusters.map import THRUSTER_MAP, ThrusterFile

DIFFERS, MAY_DIFFER, NOT_SHOWN = "differs", "may differ", "no difference shown"
SIGNIFICANCE = 0.05
Z95 = float(special.ndtri(0.975))


@dataclass(frozen=True)
class ComparedResult:
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
        stderr = float(values.std(ddof=1) / np.sqrt(len(values)))
        return cls(**vars(Estimate.from_stderr(float(values.mean()), stderr, len(values) - 1, unit)), by_run=by_run)


@dataclass(frozen=True)
class Difference:
    """One parameter of the result `of` less that of the result `base`; `p_value` is two-sided, None where neither is
    uncertain; `verdict` allows for how many were compared."""

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


def difference(estimate: Estimate, other: Estimate) -> Estimate | None:
    """Subtract `other`, from data of its own; means over runs run by run. None where no interval can be given: for
    other units, and for means with less than two runs in common. The interval takes the distance of each end from its
    value from the two intervals, so that it is as skew as they are (Zou and Donner 2008, Statistics in Medicine
    27:1693, equation 9)."""
    if isinstance(estimate, OverRuns) and isinstance(other, OverRuns):
        common = {run: value - other.by_run[run] for run, value in estimate.by_run.items() if run in other.by_run}
        return OverRuns.of(common, estimate.unit) if len(common) > 1 else None
    if estimate.unit != other.unit:
        return None
    apart = estimate.value - other.value
    low = apart - math.hypot(estimate.value - estimate.ci95[0], other.ci95[1] - other.value)
    high = apart + math.hypot(estimate.ci95[1] - estimate.value, other.value - other.ci95[0])
    return Estimate(apart, math.hypot(estimate.stderr, other.stderr), (low, high), estimate.unit)


def p_value(apart: Estimate) -> float | None:
    """Return the two-sided p of no difference, at 0.05 just where the interval ends at zero."""
    toward = apart.value - apart.ci95[0] if apart.value > 0 else apart.ci95[1] - apart.value
    if toward <= 0:
        return None
    return float(2 * special.ndtr(-Z95 * abs(apart.value) / toward))


def holm(p_values: Sequence[float]) -> list[float]:
    """Adjust p-values for their number (Holm 1979, Scandinavian Journal of Statistics 6:65)."""
    order = np.argsort(p_values, kind="stable")
    adjusted = np.empty(len(order))
    adjusted[order] = np.maximum.accumulate(np.arange(len(order), 0, -1) * np.asarray(p_values)[order])
    return np.minimum(1.0, adjusted).tolist()


def differences(sides: Sequence[ComparedResult]) -> tuple[Difference, ...]:
    """Compare each result with the first, parameter by parameter, for all parameters that both have in one unit."""
    compared, (base, *later) = list[Difference](), sides
    for side in later:
        for name, estimate in side.parameters.items():
            first = base.parameters.get(name)
            if first is None or (apart := difference(estimate, first)) is None:
                continue
            p = p_value(apart)
            verdict = NOT_SHOWN if apart.value == 0 or (p is not None and p >= SIGNIFICANCE) else MAY_DIFFER
            percent = None  # where the first's value is not well away from zero
            if not first.ci95[0] <= 0 <= first.ci95[1] and first.value != 0:
                scale = 100.0 / abs(first.value)
                percent = (scale * apart.value, scale * apart.ci95[0], scale * apart.ci95[1])
            compared.append(Difference(name, side.name, base.name, apart, percent, p, verdict))
    adjusted = holm([apart.p_value or 0.0 for apart in compared])
    return tuple(
        replace(apart, verdict=DIFFERS) if apart.verdict == MAY_DIFFER and p < SIGNIFICANCE else apart
        for apart, p in zip(compared, adjusted)
    )


Statements = Iterator[tuple[str, Given | Estimate | str | float | None]]
"""Labels and values of what a result says; None for nothing."""


def contents(statements: Statements) -> tuple[dict[str, Estimate], dict[str, str]]:
    """Sort into parameters, which are compared, and facts in words."""
    parameters, facts = dict[str, Estimate](), dict[str, str]()
    for label, value in statements:
        if isinstance(value, Given):
            bound = str(value.at_bound) if value.value is None else f"{value.value:.3g}, {value.at_bound}"
            value = value.estimate or bound
        if isinstance(value, Estimate):
            parameters[label] = value
        elif value is not None:
            facts[label] = value if isinstance(value, str) else f"{value:.3g}"
    return parameters, facts


def of_model(file: ModelFile, models: Sequence[str]) -> Statements:
    """Yield the parameters of the models. Raises ModelError with the place of a number that has no interval."""
    dof, symbols = file.dof, file.dof.symbols
    names = {
        "quadratic": symbols.quadratic, "linear": symbols.linear, "inertia": symbols.inertia,
        "ratio": f"{symbols.inertia}/{symbols.quadratic}", "constant": "constant force",
        "difference": "half the difference of drag",
    }  # fmt: skip
    for number in models:
        suffix = f", model {number}" if len(models) > 1 else ""
        for role, label in names.items():
            if (value := getattr(file.models[number], role, None)) is not None:
                yield label + suffix, value.known(f"models.{number}.{dof.parameters.get(role, dof.ratio_key)}")
    if file.gain_scatter is not None:
        yield "scatter of thrust", file.gain_scatter.known("gain_scatter")
    yield "preferred model", file.preferred
    yield f"{dof.words.position} noise [{dof.units.shown}]", file.noise


def of_thrusters(file: ThrusterFile, models: Sequence[str]) -> Statements:
    yield "form", file.form
    yield "error of it [% of full scale]", file.error_percent
    for side in ("forward", "backward"):
        if (law := getattr(file, f"a_{side}")) is not None:
            yield f"a {side}, square law", law.known(f"{side}.a")
        curve = getattr(file.parameters, side) if file.form != "square" else None
        for name, value in curve.values.items() if curve else ():
            if value and (value.estimate or value.at_bound):  # else the form fixes it
                yield f"{name} {side}, form {file.form}", value


def of_validation(file: ValidationFile, models: Sequence[str]) -> Statements:
    """Yield the errors of the model that the fit preferred, as means over the runs."""
    number = file.preferred_by_fit if file.preferred_by_fit in file.models else file.best
    scores = file.models[number].runs
    samples = {run: f"{run} ({log['samples']} samples)" for run, log in file.logs.items()}
    errors: dict[str, Mapping[str, float | None]] = {
        "free run rmse": {run: score.rmse for run, score in scores.items()},
        "restarted rmse": {run: score.restarted for run, score in scores.items()},
        **{f"error {ahead.horizon_s:g} s ahead": ahead.runs for ahead in file.prediction.get(number, ())},
    }
    for name, by_run in errors.items():
        values = {samples.get(run, run): value for run, value in by_run.items() if value is not None}
        if len(values) > 1:
            yield name, OverRuns.of(values, file.dof.units.shown)
    yield "preferred model", number


def of_diagnosis(file: DiagnosisFile, models: Sequence[str]) -> Statements:
    names = ", ".join(effect.name for effect in file.effects)
    yield "verdict", file.verdict + (f": {names}" if names else "")
    for effect in file.effects:
        for name, value in effect.parameters.items():
            if value.stderr != 0:  # a choice of law has no interval
                yield f"{effect.name}: {name}", value
    for name, moved in file.base.items():
        yield f"{name} with what was missing", moved.after.known(f"base.{name}.after")
    sizes = {"gap": file.gap, "held-out gap": file.gap_held_out, "held out, from commands:": file.from_commands}
    for what, word in product(sizes, ("before", "after")):
        yield f"{what} {word} [{file.unit}]", getattr(sizes[what], word, None)
    yield f"noise [{file.unit}]", file.gap.noise_floor


STATEMENTS_OF: Mapping[ResultKind[Any], Callable[[Any, Sequence[str]], Statements]] = {
    **dict.fromkeys(MODELS.values(), of_model),
    THRUSTER_MAP: of_thrusters,
    VALIDATION: of_validation,
    DIAGNOSIS: of_diagnosis,
}
"""What each kind of result says, of the models that are compared."""


def locate(results: Sequence[Path]) -> dict[str, tuple[Path, ResultKind[Any]]]:
    """Find the result file in each folder (or named itself), by the last parts of its place that tell it apart. Raises
    SettingError for fewer than two, for one that is given twice, and for a folder without a result."""
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
    for kind in STATEMENTS_OF:
        if (path := folder / kind.file).is_file():
            return path, kind
    raise SettingError(
        f"{folder} holds no result of fit-thrusters, fit-yaw, validate or diagnose; expected one of the files "
        f"{listed(kind.file for kind in STATEMENTS_OF)}; of a campaign compare one step"
    )


def read_sides(results: Sequence[Path]) -> tuple[str, tuple[ComparedResult, ...], list[str]]:
    """Read results of one command: its name, the sides, and notes on what must be known of them. Raises SettingError
    for results that cannot be compared, ModelError for a file that is not as automarine wrote it."""
    places = locate(results)
    files = {name: kind.read(path, f"{name}/{path.name}") for name, (path, kind) in places.items()}
    commands = {name: kind.writer for name, (_, kind) in places.items()}
    commands |= {name: "diagnose of thrusters" for name, file in files.items() if getattr(file, "of_thrusters", False)}
    units = {name: getattr(file, "force_unit", None) or "" for name, file in files.items()}
    force = next(iter(files.values())).dof.words.force
    for subject, values, only in (
        ("results of", commands, "results of one command"),
        ("results in", {name: file.dof.name for name, file in files.items()}, "results of one motion"),
        (f"{force}s in", units, "results in one unit: there is no factor between the two"),
    ):
        if len(different := dict.fromkeys(values.values())) > 1:
            listing = "; ".join(f"{name}: {value}" for name, value in values.items())
            raise SettingError(f"{subject} {' and '.join(different)} cannot be compared ({listing}); compare {only}")
    fits, sides = [file for file in files.values() if isinstance(file, ModelFile)], []
    common = [n for n in ("1", "2", "3") if fits and all(n in fit.models for fit in fits)]
    models = [number for number in common if any(number == fit.preferred for fit in fits)] or common
    for name, (path, kind) in places.items():
        try:
            sides.append(
                ComparedResult(name, *contents(STATEMENTS_OF[kind](files[name], models)), files[name].runs.used)
            )
        except ModelError as problem:
            raise ModelError(f"{name}/{path.name}: {problem}") from None
    return next(iter(commands.values())), tuple(sides), list(_notes(sides))


def _notes(sides: Sequence[ComparedResult]) -> Iterator[str]:
    """Yield what must be known of the sides: facts that differ, and what means over runs are."""
    for fact in ("preferred model", "form", "verdict"):
        values = {side.name: side.facts[fact] for side in sides if fact in side.facts}
        if len(set(values.values())) > 1:
            yield f"Not the same {fact}: {'; '.join(f'{name}: {value}' for name, value in values.items())}."
    if any(isinstance(parameter, OverRuns) for parameter in sides[0].parameters.values()):
        yield "Means over runs; differences are run by run, over the runs that both have."
