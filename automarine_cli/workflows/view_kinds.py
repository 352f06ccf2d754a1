"""What each kind of result shows of itself in Python: its lines, its rows, its tables, its figures."""

from collections.abc import Iterator, Mapping
from typing import Any

from automarine_cli.comparison.scores import SCORES, score_key
from automarine_cli.diagnosis.budget import budget
from automarine_cli.diagnosis.naming_key import naming_key
from automarine_cli.fits.channel_noise import noise_words
from automarine_cli.fits.yaw_fit import YawFit
from automarine_cli.report import (
    compare_tables,
    diagnosis_tables,
    plan_tables,
    thruster_diagnosis,
    thruster_tables,
    yaw_report,
)
from automarine_cli.report.figures import compare as compare_figures
from automarine_cli.report.figures import plan as plan_figures
from automarine_cli.report.figures import thruster_diagnosis as thruster_diagnosis_figures
from automarine_cli.report.figures import thrusters as thruster_figures
from automarine_cli.report.figures import validation as validation_figures
from automarine_cli.report.figures import yaw as yaw_figures
from automarine_cli.report.figures.diagnosis_gap import before_after_figure
from automarine_cli.report.figures.diagnosis_where import where_figure
from automarine_cli.report.figures.diagnosis_why import why_figure
from automarine_cli.report.tables import number
from automarine_cli.thrusters.diagnosis import ThrusterDiagnosis
from automarine_cli.thrusters.fit import Parameter
from automarine_cli.thrusters.result import ThrusterFit
from automarine_cli.workflows import planar_views
from automarine_cli.workflows.check import Check
from automarine_cli.workflows.compare import ResultComparison
from automarine_cli.workflows.diagnose import YawDiagnosis
from automarine_cli.workflows.plan import Plan
from automarine_cli.workflows.simulate import Simulation
from automarine_cli.workflows.slice import Slices
from automarine_cli.workflows.validate import Validation
from automarine_cli.workflows.view import Figures, Row, View, aligned, counted, numbers

# fit_yaw


def _yaw_lines(fit: YawFit) -> Iterator[str]:
    dof = fit.dof
    own = dof.symbols
    to = f"{dof.words.step}s" if fit.turns else "whole runs"
    used, aside = counted(fit.used, "run"), len(fit.set_aside)
    yield f"{dof.name.capitalize()} model {fit.preference.number}, fitted to {to} of {used}; {aside} set aside"
    names = {
        own.quadratic: own.quadratic_print,
        **{name: name.replace("_", " ") for name in (own.constant, own.difference)},
    }
    found = {names.get(name, name): one for name, one in fit.preferred.estimates.items()}
    if fit.inertial_turn_angle is not None:
        found[f"{own.inertia}/{own.quadratic_print}"] = fit.inertial_turn_angle
    yield from aligned(found)
    yield f"  {noise_words(fit.preferred.mixed, dof)}; {counted(len(fit.warnings), 'warning')}"


def _yaw_rows(fit: YawFit) -> Iterator[Row]:
    for model, ml in fit.output_error.items():
        for name, one in ml.estimates.items():
            yield {"model": model, "method": "maximum likelihood", "parameter": name} | numbers(one)
    if fit.seed_method is None:
        return
    for model, drag in fit.seed_method.drag.items():
        if model not in fit.output_error:  # with a constant moment: a test of symmetry, no model of its own
            continue
        found = dict(drag.estimates)
        if model in fit.seed_method.inertia:
            found[fit.dof.symbols.inertia] = fit.seed_method.inertia[model].overall
        for name, one in found.items():
            yield {"model": model, "method": "velocity error", "parameter": name} | numbers(one)


def _yaw_figures(fit: YawFit) -> Figures:
    seed, data = fit.seed_method, fit.data
    if seed is None or data is None:
        return {"whole-runs": lambda: yaw_figures.whole_runs_figure(fit)}
    return {
        "drag": lambda: yaw_figures.drag_figure(fit, seed),
        "inertia": lambda: yaw_figures.inertia_figure(fit, seed),
        f"{fit.dof.words.step}s": lambda: yaw_figures.half_turns_figure(fit),
        "collapse": lambda: yaw_figures.collapse_figure(fit, data),
    }


# fit_thrusters


def _thruster_lines(fit: ThrusterFit) -> Iterator[str]:
    found, form = fit.analysis, fit.analysis.chosen.form
    law = "F = a |n| n" if form.name == "square" else form.equation
    yield f"Thruster map of one thruster from {counted(len(fit.points), 'point')}: {law}; form chosen: {form.name}"
    known = {f"{name} {side}": one.estimate for (name, side), one in found.estimates.items() if one.estimate}
    yield from aligned(known)
    yield from (f"  {name} {side}  {one.why}" for (name, side), one in found.estimates.items() if one.why)
    yield f"  R² {number(found.chosen_r2)}, rmse {number(found.percent(found.chosen.rmse), 3)} % of full scale"
    if form.name != "square":
        error = number(found.percent(found.law.rmse), 3)
        yield f"  The square law: R² {number(found.r2)}, rmse {error} % of full scale"


def _thruster_rows(fit: ThrusterFit) -> Iterator[Row]:
    found = fit.analysis
    if found.chosen.form.name != "square":
        for (name, side), one in found.estimates.items():
            yield {"direction": side, "form": found.chosen.form.name, "parameter": name} | _cells(one)
    for side, law in found.square.items():
        yield {"direction": side, "form": "square", "parameter": "a"} | numbers(law)


def _cells(one: Parameter) -> Row:
    """A parameter as the cells of a row; without an interval where a bound holds it."""
    return {"value": one.value, "unit": one.unit} if one.estimate is None else numbers(one.estimate)


# validate


def _validation_lines(result: Validation) -> Iterator[str]:
    found, dof = result.comparison, result.stored.dof
    runs, aside = counted(len(found.runs), "run"), len(result.set_aside)
    yield f"Validation on {runs}: model {found.best} is best; {aside} set aside"
    if result.ahead is not None:
        yield f"  {result.ahead.sentence}"
    for model, scored in found.models.items():
        score = scored.overall["rmse"]
        ends = "" if score.ci95 is None else f" [{number(score.ci95[0], 3)}, {number(score.ci95[1], 3)}]"
        error = f"{dof.position} rmse {number(score.value, 3)}{ends} {dof.units.shown}"
        said = "runs away" if score.value is None else error
        yield f"  model {model}  {said}"
    yield f"  noise of the {dof.position} {number(found.floor, 3)} {dof.units.shown}"


def _validation_rows(result: Validation) -> Iterator[Row]:
    found = result.comparison
    for model, scored in found.models.items():
        for run, one in zip(found.runs, scored.scores):
            scores: Row = {score_key(name, run.dof): one.value(name) for name in SCORES}
            yield {"run": run.name, "model": model} | scores


def _validation_figures(result: Validation) -> Figures:
    found = result.comparison

    def draw(i: int) -> Any:
        free = {model: scored.free[i] for model, scored in found.models.items()}
        return validation_figures.validation_figure(free, found.floors[i])

    return {run.name: lambda i=i: draw(i) for i, run in enumerate(found.runs)}  # type: ignore[misc]


# diagnose


def _diagnosis_lines(result: YawDiagnosis) -> Iterator[str]:
    yield diagnosis_tables.verdict_sentence(result.diagnosis)
    for effect in result.diagnosis.effects:
        yield f"  {effect.name}, confidence {effect.confidence:.0%}"
        yield from (f"  {line}" for line in aligned(effect.parameters))
        yield from (f"    or {rival.name}, {rival.confidence:.0%}" for rival in effect.rivals)


def _diagnosis_rows(result: YawDiagnosis) -> Iterator[Row]:
    for effect in result.diagnosis.effects:
        for name, one in effect.parameters.items():
            yield {"effect": effect.name, "confidence": effect.confidence, "parameter": name} | numbers(one)


def _diagnosis_figures(result: YawDiagnosis) -> Figures:
    found = result.diagnosis
    last = found.found
    return {
        "before-after": lambda: before_after_figure(found, budget(found)),
        "where": lambda: where_figure(found),
        "why": lambda: why_figure(found, naming_key(found.study, last.base, last.final)),
    }


def _thruster_diagnosis_rows(result: ThrusterDiagnosis) -> Iterator[Row]:
    for effect in result.effects:
        for name, one in effect.parameters.items():
            row: Row = {"effect": effect.name, "confidence": effect.confidence, "parameter": name}
            yield row | _cells(one)


def _thruster_diagnosis_figures(result: ThrusterDiagnosis) -> Figures:
    return {
        "before-after": lambda: thruster_diagnosis_figures.before_after_figure(result),
        "where": lambda: thruster_diagnosis_figures.where_figure(result),
        "why": lambda: thruster_diagnosis_figures.why_figure(result),
    }


# check, simulate, slice, compare


def _check_lines(result: Check) -> Iterator[str]:
    runs, tests = counted(len(result.runs), "yaw run"), counted(len(result.tests), "thruster test")
    yield f"Look at {counted(result.logs, 'log')}: {runs}, {tests}; {len(result.set_aside)} set aside"
    yield from (f"  {one.file}, run {one.run}: {one.why}" for one in result.set_aside)


def _check_rows(result: Check) -> Iterator[Row]:
    content: Any = result.to_json()
    yield from ({"kind": "yaw run"} | run for run in content["yaw_runs"])
    yield from ({"kind": "thruster test"} | test for test in content["thruster_tests"])


def _simulation_lines(result: Simulation) -> Iterator[str]:
    names = ", ".join(effect.name for effect in result.specification.effects) or "none"
    yield f"Simulated campaign of {counted(len(result.runs), 'run')}, seed {result.seed}; effects: {names}"


def _simulation_rows(result: Simulation) -> Iterator[Row]:
    content: Any = result.to_json()
    yield from content["made"]


def _slices_lines(result: Slices) -> Iterator[str]:
    cuts = counted(len(result.cuts), "run")
    yield f"{counted(len(result.sources), 'log')} cut by {result.by} into {cuts}; {len(result.set_aside)} set aside"


def _slices_rows(result: Slices) -> Iterator[Row]:
    yield from result.to_json()["slices"]


def _comparison_rows(result: ResultComparison) -> Iterator[Row]:
    for one in result.differences:
        row: Row = {"parameter": one.parameter, "of": one.of, "less": one.base} | numbers(one.difference)
        yield row | {"p_value": one.p_value, "verdict": one.verdict}


# plan


def _plan_lines(result: Plan) -> Iterator[str]:
    yield from plan_tables.total_sentences(result.campaign)
    dof = result.campaign.fitting.model.dof
    yield "Predicted, of the new runs alone:"
    yield from aligned({plan_tables.in_print(name, dof): one for name, one in result.campaign.alone.items()})


def _plan_rows(result: Plan) -> Iterator[Row]:
    content: Any = result.to_json()
    yield from content["planned"]


VIEWS: Mapping[type, View] = {
    YawFit: View(_yaw_lines, _yaw_rows, lambda fit: yaw_report.tables(fit, short=True), _yaw_figures),
    **planar_views.VIEWS,
    ThrusterFit: View(
        _thruster_lines, _thruster_rows, thruster_tables.tables,
        lambda fit: {"map": lambda: thruster_figures.thruster_figure(fit)},
    ),
    Validation: View(_validation_lines, _validation_rows, Validation.tables, _validation_figures),
    YawDiagnosis: View(_diagnosis_lines, _diagnosis_rows, YawDiagnosis.tables, _diagnosis_figures),
    ThrusterDiagnosis: View(
        lambda result: iter([thruster_diagnosis.verdict_sentence(result)]), _thruster_diagnosis_rows,
        thruster_diagnosis.tables, _thruster_diagnosis_figures,
    ),
    Check: View(_check_lines, _check_rows, Check.tables, lambda result: {}),
    Plan: View(
        _plan_lines, _plan_rows, Plan.tables,
        lambda result: {"precision": lambda: plan_figures.plan_figure(result.campaign)},
    ),
    Simulation: View(_simulation_lines, _simulation_rows, Simulation.tables, lambda result: {}),
    Slices: View(_slices_lines, _slices_rows, Slices.tables, lambda result: {}),
    ResultComparison: View(
        lambda result: iter([compare_tables.summary(result.differences), *(f"  {s}" for s in result.sentences()[1:])]),
        _comparison_rows, ResultComparison.tables,
        lambda result: {"intervals": lambda: compare_figures.compare_figure(result.sides)},
    ),
}  # fmt: skip
