"""Sections of `fit-thrusters`: coefficients, forms, voltages, flagged points; and the points as CSV."""

import csv
import io
import re
from collections.abc import Iterator
from functools import partial
from itertools import count

import numpy as np

from automarine_cli.report.figures.thrusters import thruster_figure
from automarine_cli.report.sections import Content, Sections, bullets, document, numbers, sections
from automarine_cli.report.tables import MISSING, Table, escape, interval, number
from automarine_cli.thrusters.fit import Analysis, FormScore, Parameter
from automarine_cli.thrusters.map import SIDES
from automarine_cli.thrusters.result import ThrusterFit, scaled

SHOWN = 12  # flagged points on the terminal and in the report; thrusters.csv has all


@sections.register
def _(fit: ThrusterFit) -> Sections:
    printed: list[Table | str] = [*tables(fit), *sentences(fit)]
    maps = _maps(fit)
    files: dict[str, Content] = {
        "thrusters.json": fit.to_json(),
        "thrusters.csv": points_csv(fit),
        "thrusters.md": document(
            "# Thruster map", "![Thrust](thrusters.png)", *tables(fit), bullets(map(escape, sentences(fit)))
        ),
        **{name: of_part.to_json() for name, of_part in maps.items()},
    }
    figures = {"thrusters": partial(thruster_figure, fit)}
    return Sections(printed, files, figures, rows=tuple(_rows(fit)))


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
    rows, unit = [], next(iter(result.analysis.square.values())).unit
    for part in result.compared:
        row: dict[str, object] = {result.logs.by: part.name, "points": MISSING if part.why else str(part.points)}
        for side, _ in SIDES:
            off = part.percent.get(side)
            row[f"a {side} [{unit}]"] = None if part.why else part.law.get(side)
            row[f"{side} from the others"] = MISSING if part.why or off is None else f"{off:+.1f} %"
        rows.append(row | {"beyond chance": part.why or ("differs" if part.differs else "alike")})
    return Table.of(f"Each thruster by itself (column {result.logs.by})", rows, [
        "Square laws [95 % interval] against the median of the others; a thruster differs where chance is below 5 % "
        "over all of them. The map below is of all together; each has its own file.",
    ])  # fmt: skip


def coefficients(result: ThrusterFit) -> Table:
    """Equation 2 for one thruster, and for all that pulled together (equation 3), with 95 % intervals."""
    analysis, count, rows = result.analysis, result.thrusters_per_test, []
    for side, sign in SIDES:
        law = analysis.square.get(side)
        row = {"direction": side, "a, one thruster": law}
        if count > 1:
            row[f"a, {count} thrusters together"] = None if law is None else scaled(law, count)
        rows.append(row | {
            "unit": analysis.without.get(side, "") if law is None else law.unit,
            "points": np.count_nonzero(analysis.points.n * sign > 0),
            "levels": analysis.levels.get(side, 0),
        })  # fmt: skip
    errors = _errors(analysis, analysis.law, analysis.r2)
    return Table.of("Square law F = a |n| n, least squares [95 % interval]", rows, [errors])


def forms(result: ThrusterFit) -> Table:
    """All forms on the same points; errors in percent of full scale; a star marks the chosen one."""
    analysis = result.analysis
    rows = [
        {
            "form": score.form.name + " *" * (score.form.name == analysis.chosen.form.name),
            "parameters": score.form.parameters,
            "cv rmse [N]": number(score.cv_rmse, 3),
            "cv [% of full scale]": number(analysis.percent(score.cv_rmse), 3),
            "rmse [N]": number(score.rmse, 3),
            "rmse [% of full scale]": number(analysis.percent(score.rmse), 3),
            "within 1 s.e. of best": "yes" if score.within_reach else "no",
            "at bound": "; ".join(f"{name} {', '.join(at)}" for name, at in score.at_bound.items() if at),
        }
        for score in analysis.scores
    ]
    title = "Forms side by side, cross-validated over levels (parameters in each direction; * chosen)"
    return Table.of(title, rows)


def parameters(result: ThrusterFit) -> Table:
    """The chosen form's parameters in each direction, and how well it fits; the square law says that beside its a."""
    analysis, chosen = result.analysis, result.analysis.chosen
    rows = [
        {"direction": side, "parameter": name, "value [95 % interval]": _parameter(value), "unit": value.unit}
        for (name, side), value in analysis.estimates.items()
    ]
    errors = [] if _square(analysis) else [_errors(analysis, chosen, analysis.chosen_r2)]
    return Table.of(f"Chosen form {chosen.form.name}: {chosen.form.equation}", rows, errors)


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
    unit = next(iter(result.analysis.square.values())).unit
    rows = [
        {
            "voltage [V]": volts,
            **{f"a {side} [{unit}]": analysis.square.get(side) for side, _ in SIDES},
            "square law [%]": number(analysis.percent(analysis.law.rmse), 3),
            "chosen form": analysis.chosen.form.name,
            "chosen form [%]": number(analysis.percent(analysis.chosen.rmse), 3),
            "full scale [N]": analysis.full_scale,
        }
        for volts, analysis in result.voltages
    ]
    return Table.of("A map for each voltage (errors in percent of that voltage's full scale)", rows)


def exponents(result: ThrusterFit) -> Table:
    """Thrust against voltage as a power law, at a fixed control signal and through a."""
    rows = [
        {
            "direction": side,
            "p": power.exponent,
            "between neighbouring voltages": ", ".join(f"{p:.2f} ({low:.4g}–{high:.4g} V)" for low, high, p in
                                                       power.between) or MISSING,
            "exponent of a": power.coefficient,
            "drift of a, lowest to highest": f"{power.drift_percent:+.1f} %",
        }
        for side, _ in SIDES
        if (power := result.exponents.get(side)) is not None
    ]  # fmt: skip
    return Table.of("Exponent p of thrust against voltage, F ~ V^p at the same control signal [95 % interval]", rows)


def flagged(result: ThrusterFit) -> Table:
    """Points that contradict their neighbours, with weight and reason; the heaviest contradictions first."""
    points = result.points
    order = sorted(np.flatnonzero(points.flag != ""), key=lambda index: (points.weight[index], index))
    rows = [
        {
            "log": result.place(int(i)), "n": float(points.n[i]), "thrust [N]": float(points.force[i]),
            "weight": number(points.weight[i], 2), "why": str(points.flag[i]),
        }
        for i in order[:SHOWN]
    ]  # fmt: skip
    more = [f"and {len(order) - SHOWN} more, see thrusters.csv"] * (len(order) > SHOWN)
    title = f"{len(order)} of {len(points)} points have reduced weight: outliers from their neighbours"
    return Table.of(title, rows, more)


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
