"""What results of motion in the plane show of themselves in Python."""

from collections.abc import Iterator, Mapping

from automarine_cli.fits.planar_fit import PlanarFit
from automarine_cli.report import planar_report
from automarine_cli.workflows.view import Row, View, aligned, counted, numbers


def _lines(fit: PlanarFit) -> Iterator[str]:
    used, aside = counted(len(fit.runs), "run"), len(fit.set_aside)
    yield f"Planar model ({fit.structure}), fitted to {used}; {aside} set aside"
    yield from aligned(fit.estimates)
    yield f"  {counted(len(fit.assumptions), 'assumption')}, {counted(len(fit.warnings), 'warning')}"


def _rows(fit: PlanarFit) -> Iterator[Row]:
    for name, one in fit.estimates.items():
        yield {"parameter": name, **numbers(one)}


VIEWS: Mapping[type, View] = {
    PlanarFit: View(_lines, _rows, planar_report.tables, lambda fit: {}),
}
