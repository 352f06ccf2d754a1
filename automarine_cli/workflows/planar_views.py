"""What results of motion in the plane show of themselves in Python."""

from collections.abc import Iterator, Mapping

from automarine_cli.fits.planar_fit import PlanarFit
from automarine_cli.report import planar_report
from automarine_cli.workflows.simulate_planar import PlanarSimulation
from automarine_cli.workflows.view import Row, View, aligned, counted, numbers


def _lines(fit: PlanarFit) -> Iterator[str]:
    used, aside = counted(len(fit.runs), "run"), len(fit.set_aside)
    yield f"Planar model ({fit.structure}), fitted to {used}; {aside} set aside"
    yield from aligned(fit.estimates)
    yield f"  {counted(len(fit.assumptions), 'assumption')}, {counted(len(fit.warnings), 'warning')}"


def _rows(fit: PlanarFit) -> Iterator[Row]:
    for name, one in fit.estimates.items():
        yield {"parameter": name, **numbers(one)}


def _simulation_lines(result: PlanarSimulation) -> Iterator[str]:
    samples = sum(len(one.columns["time_s"]) for one in result.runs)
    yield f"{counted(len(result.runs), 'simulated run')} of motion in the plane, {samples} samples, seed {result.seed}"


def _simulation_rows(result: PlanarSimulation) -> Iterator[Row]:
    for one in result.runs:
        yield {"file": one.file, "run": one.name, "samples": len(one.columns["time_s"]), "gain": one.gain}


VIEWS: Mapping[type, View] = {
    PlanarFit: View(_lines, _rows, planar_report.tables, lambda fit: {}),
    PlanarSimulation: View(_simulation_lines, _simulation_rows, PlanarSimulation.tables, lambda result: {}),
}
