"""Is a model good enough: five numbers with a verdict each, of which the worst one decides."""

from collections.abc import Iterator, Mapping, Sequence

from automarine_cli.comparison.validation import ValidationFile
from automarine_cli.diagnosis.diagnose import NAMED, NOTHING, SUSPECTED, UNEXPLAINED
from automarine_cli.estimate import Estimate
from automarine_cli.fits.driven import JUDGED_HORIZON_S
from automarine_cli.models.store import DiagnosisFile
from automarine_cli.pipeline.records import RunsUsed
from automarine_cli.report.tables import MISSING, number
from automarine_cli.text import plural

GOOD, CLOSER, UNFIT = GRADES = "good", "look closer", "do not use"
MIN_RUNS_USED, MAX_SET_ASIDE_SHARE = 6, 0.1  # runs; share of them
RELATIVE_HALF_WIDTHS = (0.05, 1.0)  # of the interval, as a share of the number; beyond 1 it contains zero
RESTARTED_ERROR_RATIOS = (1.5, 3.0)  # times the error of a right model
AHEAD_ERROR_RATIOS = (0.5, 1.0)  # of the error of the better constant
DIAGNOSED = {NOTHING: GOOD, NAMED: GOOD, SUSPECTED: CLOSER, UNEXPLAINED: UNFIT}
LIMITS = {
    "runs used": (f"{MIN_RUNS_USED} or more, nearly all", MISSING),
    "95 % intervals": ("within ± 5 %", "zero inside, or at a bound"),
    "restarted error": (f"below {RESTARTED_ERROR_RATIOS[0]:g} times", f"above {RESTARTED_ERROR_RATIOS[1]:g} times"),
    f"error {JUDGED_HORIZON_S:g} s ahead": ("half of the better constant's", "above it"),
    "diagnosis": ("nothing missing, or named", "unexplained"),
}
"""What is looked at: when it is good, and when the model must not be used."""
_, _, *MEASURED, DIAGNOSIS_ROW = LIMITS
MEASURES = (("error", *MEASURED), (DIAGNOSIS_ROW, DIAGNOSIS_ROW))


def five_numbers(
    runs: RunsUsed, estimates: Mapping[str, Estimate | None], validation: ValidationFile | None,
    diagnosis: DiagnosisFile | None,
) -> Iterator[dict[str, str]]:  # fmt: skip
    """Give a row of each number with its verdict, a dash for what was not measured."""
    of_restarts, of_ahead = _errors(validation) if validation else (("not validated", ""),) * 2
    found = (_runs(runs), _interval(estimates), of_restarts, of_ahead, _diagnosis(diagnosis))
    for (name, (good, unfit)), (value, verdict) in zip(LIMITS.items(), found):
        row = {"look at": name, "verdict": verdict or MISSING, "value": value}
        yield {**row, f"{GOOD} if": good, f"{UNFIT} if": unfit}


def worst(rows: Sequence[Mapping[str, str]]) -> str:
    """Return the verdict that decides, and what it is for or what was not measured; empty where there are no rows."""
    grades = {row["look at"]: row["verdict"] for row in rows}
    for grade in (UNFIT, CLOSER):
        if bad := [name for name, verdict in grades.items() if verdict == grade]:
            return f"{grade} ({', '.join(bad)})"
    unknown = [name for name, *ways in MEASURES if rows and all(grades[way] == MISSING for way in ways)]
    return (f"{GOOD}, but not known: " if unknown else GOOD * bool(rows)) + ", ".join(unknown)


def _graded(value: float, limits: tuple[float, float]) -> str:
    return GRADES[sum(value > limit for limit in limits)]


def _runs(runs: RunsUsed) -> tuple[str, str]:
    every = runs.used + len(runs.set_aside)
    few = runs.used < MIN_RUNS_USED or len(runs.set_aside) > MAX_SET_ASIDE_SHARE * every
    return f"{runs.used} of {every}", CLOSER if few else GOOD


def _interval(estimates: Mapping[str, Estimate | None]) -> tuple[str, str]:
    """Judge the widest interval."""
    widths = [(max(e.ci95[1] - e.value, e.value - e.ci95[0]) / max(abs(e.value), 1e-300), name)
              for name, e in estimates.items() if e is not None]  # fmt: skip
    if bound := [name for name, e in estimates.items() if e is not None and e.at_bound]:
        return f"{bound[0]} at its bound", UNFIT
    if not widths:
        return MISSING, ""
    width, name = max(widths)
    return f"± {number(100 * width, 2)} % ({name})", _graded(width, RELATIVE_HALF_WIDTHS)


def _errors(file: ValidationFile) -> tuple[tuple[str, str], tuple[str, str]]:
    """Judge the restarted error, of driven runs that of predictions instead."""
    model, unit = file.judged, file.dof.units.shown
    score, ahead = file.models[model], {entry.horizon_s: entry for entry in file.prediction.get(model, ())}
    if (entry := ahead.get(JUDGED_HORIZON_S)) is not None and entry.rmse is not None:
        constant = min(size for size in (entry.constant_rate, entry.constant, float("inf")) if size is not None)
        value = f"{number(entry.rmse, 3)} {unit}, the better constant's {number(constant, 3)} {unit}"
        return ("driven runs", ""), (value, _graded(entry.rmse / max(constant, 1e-9), AHEAD_ERROR_RATIOS))
    if score.restarted is None or not file.expected:
        return (MISSING if score.restarted is None else f"{number(score.restarted, 3)} {unit}", ""), (MISSING, "")
    ratio = score.restarted / file.expected
    right = f"{number(ratio, 2)} times the {number(file.expected, 2)} {unit} of a right model"
    value = f"{number(score.restarted, 3)} {unit}, {right}"
    return (value, _graded(ratio, RESTARTED_ERROR_RATIOS)), ("not of driven runs", "")


def _diagnosis(file: DiagnosisFile | None) -> tuple[str, str]:
    if file is None:
        return "not diagnosed", ""
    rivals = sum(len(effect.rivals) for effect in file.effects)
    names = ", ".join(effect.name for effect in file.effects)
    value = file.verdict.replace("-", " ") + (f": {names}" if names else "")
    verdict = DIAGNOSED.get(file.verdict, CLOSER)
    if file.verdict == NAMED and rivals:
        return f"{value}, {plural(rivals, 'rival')} not excluded", CLOSER
    return value, verdict
