"""Sections of `fit-thrusters`: coefficients, forms, voltages, flagged points; and the points as CSV."""

import csv
import io
import re
from collections.abc import Iterator
from functools import partial
from itertools import count

import numpy as np

from automarine_cli.report.figures.thrusters import thruster_figure
from automarine_cli.report.sections import Content, Sections, numbers, sections
from automarine_cli.report.tables import MISSING, Table, interval, number
from automarine_cli.thrusters.fit import Analysis, FormScore, Parameter
from automarine_cli.thrusters.forms import SIDES
from automarine_cli.thrusters.result import ThrusterFit, scaled

SHOWN = 12  # flagged points on the terminal and in the report; thrusters.csv has all


@sections.register
def _(fit: ThrusterFit) -> Sections:
    printed: list[Table | str] = [*tables(fit), *sentences(fit)]
    blocks = [part.to_markdown().rstrip("\n") if isinstance(part, Table) else f"- {part}" for part in printed]
    maps = _maps(fit)
    files: dict[str, Content] = {
        "thrusters.json": fit.to_json(),
        "thrusters.csv": points_csv(fit),
        "thrusters.md": "\n\n".join(["# Thruster map", *blocks]) + "\n",
        **{name: of_part.to_json() for name, of_part in maps.items()},
    }
    figures = {"thrusters": partial(thruster_figure, fit)}
    listed = ("thrusters.json", "thrusters.csv", "thrusters.md", "thrusters.png", *maps)
    return Sections(printed, files, figures, listed, tuple(_rows(fit)))


def _maps(fit: ThrusterFit) -> dict[str, ThrusterFit]:
    """The map of each thruster by the name of its file; no two of one name."""
    maps: dict[str, ThrusterFit] = {}
    for part, of_part in fit.parts.items():
        stem = "thrusters_" + (re.sub(r"[^A-Za-z0-9.+-]+", "_", part).strip("_.") or "unnamed")
        name = next(name for i in count(1) if (name := f"{stem}{f'_{i}' * (i > 1)}.json") not in maps)
        if not isinstance(of_part, str):
            maps[name] = of_part
    return maps


def _rows(fit: ThrusterFit) -> Iterator[dict[str, object]]:
    analysis = fit.analysis
    if not _square(analysis):
        for (name, side), parameter in analysis.estimates.items():
            yield {"direction": side, "form": analysis.chosen.form.name, "parameter": name} | cells(parameter)
    for side, law in analysis.square.items():
        yield {"direction": side, "form": "square", "parameter": "a"} | numbers(law)


def cells(parameter: Parameter) -> dict[str, object]:
    """Give a parameter as the cells of a row; without an interval where a bound holds it."""
    if parameter.estimate is None:
        return {"value": parameter.value, "unit": parameter.unit}
    return numbers(parameter.estimate)


def tables(result: ThrusterFit) -> tuple[Table, ...]:
    """All tables that the result has something for, in the order of reading: the map that is used leads."""
    found = [coefficients(result), forms(result), parameters(result)]
    if not _square(result.analysis):
        found = [parameters(result), forms(result), coefficients(result)]
    if result.voltages:
        found.append(voltages(result))
    if any(result.exponents.values()):
        found.append(exponents(result))
    if result.parts:
        found.insert(0, thrusters(result))
    if np.any(result.points.flag != ""):
        found.append(flagged(result))
    return tuple(found)


def sentences(result: ThrusterFit) -> tuple[str, ...]:
    """The choice, the tare, what was left out, and notes."""
    dropped = result.reduction.dropped
    parts = [f"{count} {name.replace('_', ' ')}" for name, count in dropped.items() if count]
    said = [result.analysis.because, result.tare.says]
    if result.reduction.plateaus:
        left = f"; left out: {', '.join(parts)}" if parts else ""
        said.append(f"{result.reduction.samples} samples were reduced to {result.reduction.plateaus} plateaus{left}.")
    if result.logs.missing:
        said.append(f"{result.logs.missing} rows without a control signal or a force were left out.")
    return (*said, *result.notes)


def thrusters(result: ThrusterFit) -> Table:
    """One row a thruster where a column names them: its square law, and whether it differs from the others."""
    rows = []
    for one in result.compared:
        if one.why:
            rows.append((one.name, *[MISSING] * 5, one.why))
            continue
        laws = [interval(one.law.get(side)) for side, _ in SIDES]
        off = [f"{one.percent[side]:+.1f} %" if side in one.percent else MISSING for side, _ in SIDES]
        verdict = "differs" if one.differs else "alike"
        rows.append((one.name, str(one.points), laws[0], off[0], laws[1], off[1], verdict))
    unit = next(iter(result.analysis.square.values())).unit
    header = (
        result.logs.by, "points", f"a forward [{unit}]", "from the others", f"a backward [{unit}]", "from the others",
        "beyond chance",
    )  # fmt: skip
    note = (
        "Square laws [95 % interval] against the median of the others; a thruster differs where chance is below 5 % "
        "over all of them. The map below is of all together; each has its own file."
    )
    return Table(f"Each thruster by itself (column {result.logs.by})", header, tuple(rows), notes=(note,))


def coefficients(result: ThrusterFit) -> Table:
    """Equation 2 for one thruster, and for all that pulled together (equation 3), with 95 % intervals."""
    analysis, count = result.analysis, result.thrusters_per_test
    rows = []
    for name, sign in SIDES:
        estimate = analysis.square.get(name)
        points = str(np.count_nonzero(analysis.points.n * sign > 0))
        if estimate is None:
            values, unit = (MISSING, MISSING), analysis.without.get(name, "")
        else:
            values, unit = (interval(estimate), interval(scaled(estimate, count))), estimate.unit
        rows.append((name, *values[: min(count, 2)], unit, points, str(analysis.levels.get(name, 0))))
    header = ("a, one thruster", f"a, {count} thrusters together")
    return Table(
        "Square law F = a |n| n, least squares [95 % interval]",
        ("direction", *header[: min(count, 2)], "unit", "points", "levels"),
        tuple(rows),
        notes=(_errors(analysis, analysis.law, analysis.r2),),
    )


def forms(result: ThrusterFit) -> Table:
    """All forms on the same points; errors in percent of full scale; a star marks the chosen one."""
    analysis = result.analysis
    rows = []
    for score in analysis.scores:
        chosen = score.form.name == analysis.chosen.form.name
        bounds = [f"{name} {', '.join(at)}" for name, at in score.at_bound.items() if at]
        rows.append(
            (
                score.form.name + (" *" if chosen else ""),
                str(score.form.parameters),
                number(score.cv_rmse, 3),
                number(analysis.percent(score.cv_rmse), 3),
                number(score.rmse, 3),
                number(analysis.percent(score.rmse), 3),
                "yes" if score.within_reach else "no",
                "; ".join(bounds),
            )
        )
    header = (
        "form", "parameters", "cv rmse [N]", "cv [% of full scale]", "rmse [N]", "rmse [% of full scale]",
        "within 1 s.e. of best", "at bound",
    )  # fmt: skip
    return Table(
        "Forms side by side, cross-validated over levels (parameters in each direction; * chosen)", header, tuple(rows)
    )


def parameters(result: ThrusterFit) -> Table:
    """The chosen form's parameters in each direction, and how well it fits; the square law says that beside its a."""
    analysis, chosen = result.analysis, result.analysis.chosen
    rows = [(side, name, _parameter(one), one.unit) for (name, side), one in analysis.estimates.items()]
    return Table(
        f"Chosen form {chosen.form.name}: {chosen.form.equation}",
        ("direction", "parameter", "value [95 % interval]", "unit"),
        tuple(rows),
        notes=() if _square(analysis) else (_errors(analysis, chosen, analysis.chosen_r2),),
    )


def _square(analysis: Analysis) -> bool:
    return analysis.chosen.form.name == "square"


def _parameter(one: Parameter) -> str:
    if one.estimate is not None:
        return interval(one.estimate)
    return one.why if one.value is None else f"{number(one.value)}, {one.why}"


def _errors(analysis: Analysis, score: FormScore, r2: float) -> str:
    """How well one form fits, in a sentence."""
    cross = "" if score.cv_rmse is None else f", {number(analysis.percent(score.cv_rmse), 3)} % cross-validated"
    said = (
        f"R² {r2:.4f}, rmse {number(score.rmse, 3)} N = {number(analysis.percent(score.rmse), 3)} % of "
        f"full scale ({number(analysis.full_scale)} N){cross}."
    )
    less = int(np.count_nonzero(analysis.points.flag != ""))
    if not less:
        return said
    whole = number(analysis.over_all(score), 3)
    return f"{said} Over all points alike the rmse is {whole} N: {less} of {len(analysis.points)} weigh less above."


def voltages(result: ThrusterFit) -> Table:
    """One row a voltage: the square law's coefficients and error, the chosen form and its error."""
    rows = []
    for volts, analysis in result.voltages:
        chosen = analysis.chosen
        errors = [number(analysis.percent(score.rmse), 3) for score in (analysis.law, chosen)]
        laws = [interval(analysis.square.get(name)) for name, _ in SIDES]
        rows.append((number(volts), *laws, errors[0], chosen.form.name, errors[1], number(analysis.full_scale)))
    unit = next(iter(result.analysis.square.values())).unit
    header = (
        "voltage [V]", f"a forward [{unit}]", f"a backward [{unit}]", "square law [%]", "chosen form",
        "chosen form [%]", "full scale [N]",
    )  # fmt: skip
    return Table("A map for each voltage (errors in percent of that voltage's full scale)", header, tuple(rows))


def exponents(result: ThrusterFit) -> Table:
    """Thrust against voltage as a power law, at a fixed control signal and through a."""
    rows = []
    for name, _ in SIDES:
        found = result.exponents.get(name)
        if found is None:
            continue
        pairs = ", ".join(f"{p:.2f} ({low:.4g}–{high:.4g} V)" for low, high, p in found.between) or MISSING
        drift = f"{found.drift_percent:+.1f} %"
        rows.append((name, interval(found.exponent), pairs, interval(found.coefficient), drift))
    return Table(
        "Exponent p of thrust against voltage, F ~ V^p at the same control signal [95 % interval]",
        ("direction", "p", "between neighbouring voltages", "exponent of a", "drift of a, lowest to highest"),
        tuple(rows),
    )


def flagged(result: ThrusterFit) -> Table:
    """Points that contradict their neighbours, with weight and reason; the heaviest contradictions first."""
    points = result.points
    order = sorted(np.flatnonzero(points.flag != ""), key=lambda index: (points.weight[index], index))
    rows = tuple(
        (
            result.place(int(i)), number(points.n[i]), number(points.force[i]), number(points.weight[i], 2),
            str(points.flag[i]),
        )
        for i in order[:SHOWN]
    )  # fmt: skip
    more = (f"and {len(order) - SHOWN} more, see thrusters.csv",) if len(order) > SHOWN else ()
    title = f"{len(order)} of {len(points)} points have reduced weight: outliers from their neighbours"
    return Table(title, ("log", "n", "thrust [N]", "weight", "why"), rows, notes=more)


def points_csv(result: ThrusterFit) -> str:
    """Every point of one thruster with the chosen form and the square law at it; missing values are empty."""
    points, analysis = result.points, result.analysis
    fitted, square = analysis.fitted(points.n), analysis.fitted(points.n, square=True)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    columns = {
        "n": points.n, "force_N": points.force, "spread_N": points.spread, "count": points.count,
        "stderr_N": points.stderr, "voltage_V": points.voltage, "fitted_N": fitted, "square_law_N": square,
        "residual_N": points.force - fitted, "weight": points.weight,
    }  # fmt: skip
    writer.writerow(("file", "run", *columns, "flag"))
    for i in range(len(points)):
        record = result.logs.records[int(points.record[i])]
        values = (_cell(column[i]) for column in columns.values())
        writer.writerow((record.source, record.run, *values, str(points.flag[i])))
    return text.getvalue()


def _cell(value: float) -> str:
    """Ten significant digits, nothing for a missing value, no negative zero."""
    return "" if not np.isfinite(value) else f"{value + 0.0:.10g}"
