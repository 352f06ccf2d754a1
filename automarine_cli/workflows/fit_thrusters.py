"""`fit-thrusters`: bollard tests -> thruster map (the source paper's section 3.1, equations 2 and 3)."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from automarine_cli.comparison.result_files import of_thrusters
from automarine_cli.errors import FitError, SettingError
from automarine_cli.logs import ColumnMap, given_columns
from automarine_cli.pipeline.outputs import ResultFolder
from automarine_cli.pipeline.parallel import ordered_map
from automarine_cli.pipeline.progress import Progress
from automarine_cli.report import thruster_tables
from automarine_cli.report.figures.files import write_figures
from automarine_cli.report.figures.thrusters import thruster_figure
from automarine_cli.report.tables import number
from automarine_cli.runs.load import told_beside
from automarine_cli.thrusters.analysis import Analysis, analyse
from automarine_cli.thrusters.contradictions import flag_contradictions
from automarine_cli.thrusters.fit import Parameter, Side
from automarine_cli.thrusters.map import SCHEMA
from automarine_cli.thrusters.plateaus import reduce_series
from automarine_cli.thrusters.points import Ints, Points, voltage_steps
from automarine_cli.thrusters.records import ThrusterLogs, load_thruster_logs
from automarine_cli.thrusters.result import ThrusterFit
from automarine_cli.thrusters.tare import Tare, subtract_tare
from automarine_cli.thrusters.voltage import VoltageExponent, voltage_exponents
from automarine_cli.workflows.command import Command, Compared, Runner
from automarine_cli.workflows.shared import Columns, Ending, OfLogs, aligned, counted, numbers
from automarine_cli.workflows.view import Row, View

FELT = 0.2  # exponent of thrust against voltage from which one map for all voltages misleads
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
        count = _thrusters(asked.thrusters_per_test, names)
        with told_beside(loaded.set_aside):
            return _fit_points(loaded, names, count, asked.form, runner.jobs, runner.progress)

    def write(folder: ResultFolder, result: ThrusterFit) -> None:
        folder.write_json("thrusters.json", result.to_json())
        folder.write("thrusters.csv", thruster_tables.points_csv(result))
        folder.write("thrusters.md", thruster_tables.markdown(result))
        write_figures(folder, {"thrusters": lambda: thruster_figure(result)}, asked.figure_formats)

    return runner.results(asked, work, write)


def _fit_points(
    loaded: ThrusterLogs, columns: ColumnMap, count: int, form: str | None, jobs: int, progress: Progress
) -> ThrusterFit:
    where = loaded.inputs[0].name if len(loaded.inputs) == 1 else f"{len(loaded.inputs)} logs"
    rule = columns.columns.get("n")
    n_unit = (rule.unit or "") if rule is not None else ""
    reduction = reduce_series(list(loaded.records))
    points = reduction.points.divided(count)
    step = voltage_steps(points.voltage)
    unsorted = _without_voltages(points, step)
    points, tare = subtract_tare(flag_contradictions(points, step))
    varied = step if step is not None and step.max() > 0 else None
    analysis, _ = analyse(points, varied, tare.stderr if tare.subtracted else 0.0, n_unit, form, where)
    voltages, exponents, notes = _by_voltage(points, step, tare, n_unit, form, jobs, progress)
    return ThrusterFit(
        loaded,
        reduction,
        analysis,
        tare,
        count,
        voltages,
        exponents,
        (*reduction.notes, *unsorted, *_notes(points), *notes),
    )


def _thrusters(given: int | None, columns: ColumnMap) -> int:
    """Equal thrusters that pulled together: the option, else the column map's default, else 1."""
    value = columns.defaults.get("thrusters_per_test", 1) if given is None else given
    if isinstance(value, str) or value != int(value) or value < 1:
        raise SettingError(
            f"thrusters_per_test is {value!r}; expected a whole number of thrusters, 1 or more"
        )
    return int(value)


def _by_voltage(
    points: Points,
    step: Ints | None,
    tare: Tare,
    n_unit: str,
    form: str | None,
    jobs: int,
    progress: Progress,
) -> tuple[tuple[tuple[float, Analysis], ...], dict[str, VoltageExponent | None], tuple[str, ...]]:
    """A map for each voltage step, and the exponents of thrust against voltage."""
    if step is None or step.max() == 0:
        return (), {}, ()
    stderr = tare.stderr if tare.subtracted else 0.0
    groups = [points.where(step == number) for number in np.unique(step)]
    judge = partial(_one_voltage, tare_stderr=stderr, n_unit=n_unit, form=form)
    found = ordered_map(judge, groups, jobs, progress=progress, stage="voltages")
    notes = [f"No map at this voltage: {one}." for one in found if isinstance(one, str)]
    fits = [(volts, analysis) for volts, analysis, _ in (one for one in found if not isinstance(one, str))]
    sides = [one[2] for one in found if not isinstance(one, str)]
    laws = [{name: estimate.value for name, estimate in analysis.square.items()} for _, analysis in fits]
    exponents = (
        voltage_exponents(np.array([volts for volts, _ in fits]), sides, laws) if len(fits) > 1 else {}
    )
    powers = [found.exponent.value for found in exponents.values() if found and found.exponent]
    if powers and max(abs(power) for power in powers) > FELT:
        notes.append(
            f"Thrust at the same control signal grows with the voltage to the power {np.mean(powers):.2f}: "
            "the map over all voltages is a mean; for a known voltage use that voltage's map."
        )
    return tuple(fits), exponents, tuple(notes)


def _one_voltage(
    points: Points, *, tare_stderr: float, n_unit: str, form: str | None
) -> tuple[float, Analysis, dict[str, Side]] | str:
    """Voltage, analysis and sides of one step, or why there is none."""
    volts = float(np.median(points.voltage))
    try:
        analysis, sides = analyse(points, None, tare_stderr, n_unit, form, f"{volts:.4g} V")
    except FitError as refusal:
        return str(refusal)
    return volts, analysis, sides


def _without_voltages(points: Points, step: Ints | None) -> tuple[str, ...]:
    """Why there is no map for each voltage although voltages were logged."""
    if step is not None or not np.any(np.isfinite(points.voltage)):
        return ()
    missing = int(np.count_nonzero(~np.isfinite(points.voltage)))
    why = f"{missing} of {len(points)} points have none" if missing else "it drifts without steps"
    return (f"The supply voltage is not used: {why}.",)


def _notes(points: Points) -> tuple[str, ...]:
    """What a person should know of the points: exact zeros at a command may never have been measured."""
    silent_points = (points.n != 0.0) & (points.force == 0.0) & (points.flag == "")
    count = int(np.count_nonzero(silent_points))
    if count == 0:
        return ()
    largest = float(np.max(np.abs(points.n[silent_points])))
    return (
        f"{count} point{'s have' if count > 1 else ' has'} exactly zero thrust at a command (up to |n| = "
        f"{largest:.4g}): a dead band, or readings that were set to zero or never taken; they are kept.",
    )


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
    files=lambda fit: FILES, compared=Compared("thrusters.json", SCHEMA, of_thrusters),
)  # fmt: skip
