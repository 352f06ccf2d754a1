"""Sections of `fit-thrusters`: coefficients, forms, voltages, flagged points; and the points as CSV."""

import numpy as np

from automarine_cli.estimate import Estimate, Given
from automarine_cli.report.sections import Content, Drawing, Sections, bullets, document, file_stems, numbers, sections
from automarine_cli.report.tables import MISSING, Table, escape, interval, number
from automarine_cli.thrusters.fit import MapFit
from automarine_cli.thrusters.map import SIDES
from automarine_cli.thrusters.result import Analysis, ThrusterFit

MAX_FLAGGED = 12  # flagged points on the terminal and in the report; thrusters.csv has all


@sections.register
def _(fit: ThrusterFit) -> Sections:
    lines, analysis, details = sentences(fit), fit.analysis, forms(fit)
    maps = tables(fit, details)
    page = document("# Thruster map", "![Thrust of one thruster](thrusters.png)", *maps, bullets(map(escape, lines)))
    files: dict[str, Content] = {
        "thrusters.json": fit.to_json(), "thrusters.csv": points_csv(fit), "thrusters.md": page
    }  # fmt: skip
    stems = file_stems([*fit.parts])
    files |= {f"thrusters_{stem}.json": part.to_json() for stem, part in zip(stems, fit.parts.values())}
    chosen = {} if _is_square(analysis) else analysis.estimates
    rows = [
        {"direction": side, "form": form, "parameter": name} | cells(value)
        for form, values in (
            (analysis.chosen.form.name, chosen), ("square", {("a", side): law for side, law in analysis.square.items()})
        )
        for (name, side), value in values.items()
    ]  # fmt: skip
    printed = [table for table in maps if table is not details]
    figures = {"thrusters": Drawing("parameters.thruster_figure", fit)}
    return Sections([*lines, *printed], files, figures, rows=rows, details=[details])


def cells(value: Estimate | Given) -> dict[str, object]:
    """Give a parameter as the cells of a row; without an interval where a bound holds it."""
    return numbers(value) if isinstance(value, Estimate) else {"value": value.value, "unit": value.unit}


def parameter_cell(value: Estimate | Given) -> Estimate | str:
    """Give a parameter as one cell: its estimate, or its value and why that has no interval."""
    if isinstance(value, Estimate):
        return value
    why = str(value.at_bound or "")
    return ", ".join(filter(None, (number(value.value), why))) if value.value is not None else why


def tables(result: ThrusterFit, details: Table) -> tuple[Table, ...]:
    """Make all tables that the result has something for, in the order of reading: the map that is used leads."""
    maps = [coefficients(result), details]
    return (
        *([thrusters(result)] if result.compared else []),
        *(maps if _is_square(result.analysis) else [parameters(result), *reversed(maps)]),
        *([voltages(result)] if result.voltages else []),
        *([flagged(result)] if np.any(result.points.flag != "") else []),
    )


def sentences(result: ThrusterFit) -> tuple[str, ...]:
    lines, samples = [_answer(result.analysis), result.analysis.because, result.tare.says], result.samples
    if samples["plateaus"]:
        left_out = f"; {samples['samples_left_out']} were left out" if samples["samples_left_out"] else ""
        lines.append(f"{samples['samples']} samples were reduced to {samples['plateaus']} plateaus{left_out}.")
    if result.logs.missing:
        lines.append(f"{result.logs.missing} rows without a control signal or a force were left out.")
    return (*lines, *result.notes)


def _answer(analysis: Analysis) -> str:
    """Say the map of one thruster: its equation with its numbers, and its error."""
    says, cells = analysis.chosen.form.equation, analysis.estimates.items()
    if _is_square(analysis):
        laws = (f"{number(law.value, 3)} n² {side}" for side, law in analysis.square.items())
        says = f"F = {', '.join(laws)} [N]"
    elif not analysis.chosen.form.interpolates:
        says = "; ".join([says, *(f"{side} {name} = {number(value.value, 3)}" for (name, side), value in cells)])
    return f"Thruster map: {says}; error {number(analysis.percent(analysis.chosen.error), 2)} % of full scale."


def thrusters(result: ThrusterFit) -> Table:
    """Lay out each thruster where a column names them: its square law, and whether it differs from the others."""
    rows, unit = [], next(iter(result.analysis.square.values())).unit
    for part in result.compared:
        row: dict[str, object] = {result.logs.by: part["thruster"], "points": part.get("points")}
        for side, _ in SIDES:
            percent = part.get(side, {}).get("differs_percent")
            row[f"a {side} [{unit}]"] = result.parts[part["thruster"]].analysis.square[side] if side in part else None
            row[f"{side} from the others"] = MISSING if percent is None else f"{percent:+.1f} %"
        rows.append(row | {"beyond chance": part.get("why") or ("differs" if part["differs"] else "alike")})
    return Table.of(f"Each thruster by itself (column {result.logs.by})", rows, [
        "Square laws [95 % interval] against the median of the others; a thruster differs where chance is below 5 % "
        "over all of them. The map below is of all together; each has its own file.",
    ])  # fmt: skip


def coefficients(result: ThrusterFit) -> Table:
    """Lay out equation 2 for one thruster, and for all that pulled together (equation 3), with 95 % intervals."""
    analysis, count, rows = result.analysis, result.thrusters_per_test, []
    for side, sign in SIDES:
        law = analysis.square.get(side)
        row = {"direction": side, "a, one thruster": law}
        if count > 1:
            row[f"a, {count} thrusters together"] = law and law.scaled(count, law.unit)
        rows.append(row | {
            "unit": law.unit if law else analysis.without.get(side, ""),
            "points": np.count_nonzero(analysis.points.n * sign > 0), "levels": analysis.levels(side),
        })  # fmt: skip
    return Table.of("Square law F = a |n| n, least squares [95 % interval]", rows, [_errors(analysis, analysis.law)])


def forms(result: ThrusterFit) -> Table:
    """Lay out all forms on the same points; errors in percent of full scale; a star marks the chosen one."""
    analysis = result.analysis
    return Table.of("Forms side by side, cross-validated over levels (parameters in each direction; * chosen)", [
        {
            "form": f"{score.form.name} *" if score.form.name == analysis.chosen.form.name else score.form.name,
            "parameters": score.parameters, "cv rmse [N]": number(score.cv_rmse, 3),
            "cv [% of full scale]": number(analysis.percent(score.cv_rmse), 3), "rmse [N]": number(score.rmse, 3),
            "rmse [% of full scale]": number(analysis.percent(score.rmse), 3),
            "within reach of best": "yes" if score.form.name in analysis.reach else "no",
            "at bound": "; ".join(f"{name} {', '.join(at)}" for name, at in score.at_bound.items() if at),
        }
        for score in analysis.fits
    ])  # fmt: skip


def parameters(result: ThrusterFit) -> Table:
    analysis, chosen = result.analysis, result.analysis.chosen
    rows = []
    for side, _ in SIDES:
        names = [name for name, of in analysis.estimates if of == side]
        for name in names[:: max(len(names) // MAX_FLAGGED, 1)]:
            value = analysis.estimates[name, side]
            row = {"direction": side, "parameter": name, "value [95 % interval]": parameter_cell(value)}
            rows.append(row | {"unit": value.unit})
    notes = [_errors(analysis, chosen)]
    if len(rows) < len(analysis.estimates):
        notes.append(f"{len(rows)} of {len(analysis.estimates)} levels; thrusters.json has all.")
    return Table.of(f"Chosen form {chosen.form.name}: {chosen.form.equation}", rows, notes)


def _is_square(analysis: Analysis) -> bool:
    return analysis.chosen.form.name == "square"


def _errors(analysis: Analysis, score: MapFit) -> str:
    cross = "" if score.cv_rmse is None else f", {number(analysis.percent(score.cv_rmse), 3)} % cross-validated"
    text = (
        f"R² {analysis.r2(score):.4f}, rmse {number(score.rmse, 3)} N = {number(analysis.percent(score.rmse), 3)} % of "
        f"full scale ({number(analysis.full_scale)} N){cross}."
    )
    if not (less := int(np.count_nonzero(analysis.points.flag != ""))):
        return text
    every = number(analysis.over_all(score), 3)
    return f"{text} Over all points alike the rmse is {every} N: {less} of {len(analysis.points)} weigh less above."


def voltages(result: ThrusterFit) -> Table:
    unit = next(iter(result.analysis.square.values())).unit
    powers = [f"{side} {interval(power)}" for side, power in result.exponents.items()]
    return Table.of("A map for each voltage (errors in percent of that voltage's full scale)", [
        {
            "voltage [V]": volts, **{f"a {side} [{unit}]": analysis.square.get(side) for side, _ in SIDES},
            "square law [%]": number(analysis.percent(analysis.law.rmse), 3),
            "chosen form": analysis.chosen.form.name,
            "chosen form [%]": number(analysis.percent(analysis.chosen.error), 3),
            "full scale [N]": analysis.full_scale,
        }
        for volts, analysis in result.voltages
    ], [f"At one control signal thrust grows with voltage to the power {', '.join(powers) or MISSING}."])  # fmt: skip


def flagged(result: ThrusterFit) -> Table:
    """Lay out points that contradict their neighbours, with weight and reason; the heaviest contradictions first."""
    points = result.points
    order = sorted(np.flatnonzero(points.flag != ""), key=lambda index: (points.weight[index], index))
    rows = [
        {
            "log": result.place(int(i)), "n": float(points.n[i]), "thrust [N]": float(points.force[i]),
            "weight": number(points.weight[i], 2), "why": str(points.flag[i]),
        }
        for i in order[:MAX_FLAGGED]
    ]  # fmt: skip
    return Table.of(f"{len(order)} of {len(points)} points have reduced weight: outliers from their neighbours", rows)


def points_csv(result: ThrusterFit) -> str:
    """Write every point of one thruster with both laws at it: ten digits, nothing for a missing value."""
    import pandas as pd

    points, analysis = result.points, result.analysis
    fitted = analysis.chosen.along(points.n)
    columns = {
        "n": points.n, "force_N": points.force, "spread_N": points.spread, "count": points.count,
        "stderr_N": points.stderr, "voltage_V": points.voltage, "fitted_N": fitted,
        "square_law_N": analysis.law.along(points.n), "residual_N": points.force - fitted,
        "weight": points.weight,
    }  # fmt: skip
    records = [result.logs.records[int(index)] for index in points.record]
    places = {"file": [record.source for record in records], "run": [record.run for record in records]}
    frame = pd.DataFrame(places | {name: x + 0.0 for name, x in columns.items()} | {"flag": points.flag})
    return frame.replace(np.inf, np.nan).to_csv(index=False, float_format="%.10g", lineterminator="\n")
