"""`fit-thrusters`: bollard tests -> thruster map (the source paper's section 3.1, equations 2 and 3)."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import count

from automarine_cli.comparison.result_files import of_thrusters
from automarine_cli.errors import SettingError
from automarine_cli.logs import ColumnMap, given_columns
from automarine_cli.pipeline.results_folder import ResultFolder
from automarine_cli.report import outcomes, thruster_tables
from automarine_cli.report.figures.files import write_figures
from automarine_cli.report.figures.thrusters import thruster_figure
from automarine_cli.report.tables import number
from automarine_cli.results.kinds import THRUSTER_MAP
from automarine_cli.runs.load import told_beside
from automarine_cli.thrusters.fit import Parameter
from automarine_cli.thrusters.fit_records import fit_records
from automarine_cli.thrusters.records import load_thruster_logs
from automarine_cli.thrusters.result import ONE_PULLED, ThrusterFit
from automarine_cli.workflows.command import Command, ReadBack, Runner
from automarine_cli.workflows.shared import Columns, Ending, OfLogs, aligned, counted, numbers
from automarine_cli.workflows.view import Row, View

FILES = ("thrusters.json", "thrusters.csv", "thrusters.md", "thrusters.png")


@dataclass(frozen=True, kw_only=True)
class _Tests:
    """How many equal thrusters pulled together (None: the column map's `[defaults]`, else 1), and the thrust curve
    (None: chosen by cross-validation)."""

    thrusters_per_test: int | None = None
    form: str | None = None


@dataclass(frozen=True, kw_only=True)
class FitThrustersOptions(Columns, Ending, _Tests, OfLogs):
    """Bollard tests, and how they are read and fitted."""


def _fit_thrusters(asked: FitThrustersOptions, runner: Runner) -> ThrusterFit:
    """Fit the thruster map of one thruster to bollard tests in which `thrusters_per_test` equal thrusters pulled.

    Raises LogError, RunError, FitError, SettingError or OutputError.
    """
    names = given_columns(asked.columns)
    loaded = load_thruster_logs(asked.logs, names, strict=asked.strict, progress=runner.progress)

    def work() -> ThrusterFit:
        together = thrusters_pulling(asked.thrusters_per_test, names)
        said = asked.thrusters_per_test is not None or "thrusters_per_test" in names.defaults
        with told_beside(loaded.set_aside):
            fit = fit_records(loaded, together, loaded.n_unit, asked.form, runner.jobs, runner.progress)
        return fit if said else replace(fit, notes=(ONE_PULLED, *fit.notes))

    def write(folder: ResultFolder, result: ThrusterFit) -> None:
        folder.write_json("thrusters.json", result.to_json())
        folder.write("thrusters.csv", thruster_tables.points_csv(result))
        folder.write("thrusters.md", thruster_tables.markdown(result))
        for name, one in _maps(result).items():
            folder.write_json(name, one.to_json())
        write_figures(folder, {"thrusters": lambda: thruster_figure(result)}, asked.figure_formats)

    return runner.results(asked, work, write)


def _maps(fit: ThrusterFit) -> dict[str, ThrusterFit]:
    """The map of each thruster by the name of its file; no two of one name."""
    found: dict[str, ThrusterFit] = {}
    for part, one in fit.parts.items():
        stem = "thrusters_" + (re.sub(r"[^A-Za-z0-9.+-]+", "_", part).strip("_.") or "unnamed")
        name = next(name for i in count(1) if (name := f"{stem}{f'_{i}' * (i > 1)}.json") not in found)
        if not isinstance(one, str):
            found[name] = one
    return found


def thrusters_pulling(given: int | None, columns: ColumnMap, usual: int = 1) -> int:
    """Equal thrusters that pulled together: the option, else the column map's default, else the usual number."""
    value = columns.defaults.get("thrusters_per_test", usual) if given is None else given
    if isinstance(value, str) or value != int(value) or value < 1:
        raise SettingError(f"thrusters_per_test is {value!r}; expected a whole number of thrusters, 1 or more")
    return int(value)


def _lines(fit: ThrusterFit) -> Iterator[str]:
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
    if ONE_PULLED in fit.notes:
        yield f"  {ONE_PULLED}"


def _rows(fit: ThrusterFit) -> Iterator[Row]:
    found = fit.analysis
    if found.chosen.form.name != "square":
        for (name, side), one in found.estimates.items():
            yield {"direction": side, "form": found.chosen.form.name, "parameter": name} | cells(one)
    for side, law in found.square.items():
        yield {"direction": side, "form": "square", "parameter": "a"} | numbers(law)


def cells(one: Parameter) -> Row:
    """A parameter as the cells of a row; without an interval where a bound holds it."""
    return {"value": one.value, "unit": one.unit} if one.estimate is None else numbers(one.estimate)


fit_thrusters = Command(
    "fit-thrusters", FitThrustersOptions, _fit_thrusters,
    {ThrusterFit: View(
        lambda fit: [*thruster_tables.tables(fit), *thruster_tables.sentences(fit)], _lines, _rows,
        lambda fit: {"map": lambda: thruster_figure(fit)},
    )},
    files=lambda fit: (*FILES, *_maps(fit)), kept=ReadBack(THRUSTER_MAP, outcomes.of_thrusters, of_thrusters),
)  # fmt: skip
