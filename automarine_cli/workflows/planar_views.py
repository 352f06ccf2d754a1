"""What results of motion in the plane show of themselves in Python."""

from collections.abc import Iterator, Mapping

from automarine_cli.comparison.planar import SCORES, overall
from automarine_cli.fits.planar_fit import PlanarFit
from automarine_cli.report import planar_report
from automarine_cli.report.figures.planar import planar_figure
from automarine_cli.report.figures.planar_diagnosis import before_after_figure, where_figure, why_figure
from automarine_cli.report.planar_diagnosis_report import verdict_sentence
from automarine_cli.report.tables import number
from automarine_cli.workflows.diagnose_planar import PlanarDiagnosis
from automarine_cli.workflows.simulate_planar import PlanarSimulation
from automarine_cli.workflows.validate_planar import NAME, PlanarValidation
from automarine_cli.workflows.view import Figures, Row, View, aligned, counted, numbers


def _lines(fit: PlanarFit) -> Iterator[str]:
    used, aside = counted(len(fit.runs), "run"), len(fit.set_aside)
    yield f"Planar model ({fit.structure}), fitted to {used}; {aside} set aside"
    yield from aligned(fit.estimates)
    yield f"  {counted(len(fit.assumptions), 'assumption')}, {counted(len(fit.warnings), 'warning')}"


def _rows(fit: PlanarFit) -> Iterator[Row]:
    for name, one in fit.estimates.items():
        yield {"parameter": name, **numbers(one)}


def _validation_lines(result: PlanarValidation) -> Iterator[str]:
    runs, aside, scores = counted(len(result.free), "run"), len(result.set_aside), overall(result.free)
    yield f"Validation of a planar model on {runs}; {aside} set aside"
    told = ((name, scores[name]) for name in SCORES)
    yield from (f"  {name}  {number(value, 3)}" for name, value in told if value is not None)


def _validation_rows(result: PlanarValidation) -> Iterator[Row]:
    for one in result.free:
        yield {"run": one.run.name, "model": NAME, **one.scores}


def _validation_figures(result: PlanarValidation) -> Figures:
    return {one.run.name: lambda one=one: planar_figure(one) for one in result.free}  # type: ignore[misc]


def _simulation_lines(result: PlanarSimulation) -> Iterator[str]:
    samples = sum(len(one.columns["time_s"]) for one in result.runs)
    yield f"{counted(len(result.runs), 'simulated run')} of motion in the plane, {samples} samples, seed {result.seed}"


def _simulation_rows(result: PlanarSimulation) -> Iterator[Row]:
    for one in result.runs:
        yield {"file": one.file, "run": one.name, "samples": len(one.columns["time_s"]), "gain": one.gain}


def _diagnosis_lines(result: PlanarDiagnosis) -> Iterator[str]:
    yield verdict_sentence(result.found)
    for one in result.found.named:
        yield from (f"  {line}" for line in aligned(result.estimates_of(one)))


def _diagnosis_rows(result: PlanarDiagnosis) -> Iterator[Row]:
    for one in result.found.named:
        for name, estimate in result.estimates_of(one).items():
            yield {"effect": one.candidate.name, "parameter": name, **numbers(estimate)}


def _diagnosis_figures(result: PlanarDiagnosis) -> Figures:
    found, where = result.found, result.where
    if where is None:
        return {"why": lambda: why_figure(found)}
    return {
        "before-after": lambda: before_after_figure(found),
        "where": lambda: where_figure(found, where),
        "why": lambda: why_figure(found),
    }


VIEWS: Mapping[type, View] = {
    PlanarFit: View(_lines, _rows, planar_report.tables, lambda fit: {}),
    PlanarValidation: View(_validation_lines, _validation_rows, PlanarValidation.tables, _validation_figures),
    PlanarDiagnosis: View(_diagnosis_lines, _diagnosis_rows, PlanarDiagnosis.tables, _diagnosis_figures),
    PlanarSimulation: View(_simulation_lines, _simulation_rows, PlanarSimulation.tables, lambda result: {}),
}
