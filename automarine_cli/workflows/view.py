"""How a kind of result is shown in Python, and what such views share."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from automarine_cli.fits.estimate import Estimate
from automarine_cli.report.tables import Table, interval

Row = dict[str, object]
Figures = Mapping[str, Callable[[], Any]]


@dataclass(frozen=True)
class View:
    """How one kind of result is shown; the first of its figures is drawn where none is asked for."""

    lines: Callable[[Any], Iterator[str]]
    rows: Callable[[Any], Iterator[Row]]
    tables: Callable[[Any], Sequence[Table | str]]
    figures: Callable[[Any], Figures]


def counted(count: int, what: str) -> str:
    """A count and what is counted: 1 run, 2 runs."""
    return f"{count} {what}{'s' * (count != 1)}"


def numbers(estimate: Estimate) -> Row:
    """An estimate as the cells of a row."""
    low, high = estimate.ci95
    return {
        "value": estimate.value,
        "stderr": estimate.stderr,
        "low": low,
        "high": high,
        "unit": estimate.unit,
    }


def aligned(estimates: Mapping[str, Estimate]) -> Iterator[str]:
    """Names, numbers with their intervals, units: one line each."""
    width = max((len(name) for name in estimates), default=0)
    for name, one in estimates.items():
        unit = "" if one.unit in ("", "1") else f" {one.unit}"
        yield f"  {name:<{width}}  {interval(one)}{unit}"
