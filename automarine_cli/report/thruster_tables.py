"""Tables of `fit-thrusters`: coefficients, forms, voltages, flagged points; and the points as CSV."""

import csv
import io

import numpy as np

from automarine_cli.fits.estimate import Estimate
from automarine_cli.report.tables import MISSING, Table, interval, number
from automarine_cli.thrusters.fit import SIDES
from automarine_cli.thrusters.result import ThrusterFit, scaled

SHOWN = 12  # flagged points on the terminal and in the report; thrusters.csv has all


def tables(result: ThrusterFit) -> tuple[Table, ...]:
    """All tables that the result has something for, in the order of reading."""
    found = [coefficients(result), forms(result), parameters(result)]
    if result.voltages:
        found.append(voltages(result))
    if any(result.exponents.values()):
        found.append(exponents(result))
    if np.any(result.points.flag != ""):
        found.append(flagged(result))
    return tuple(found)


def sentences(result: ThrusterFit) -> tuple[str, ...]:
    """The choice, the tare, what was left out, and notes."""
    dropped = result.reduction.dropped
    parts = [f"{count} {name.replace('_', ' ')}" for name, count in dropped.items() if count]
    said = [result.analysis.selection.because, result.tare.says]
    if result.reduction.plateaus:
        left = f"; left out: {', '.join(parts)}" if parts else ""
        said.append(
            f"{result.reduction.samples} samples were reduced to {result.reduction.plateaus} plateaus{left}."
        )
    if result.logs.missing:
        said.append(f"{result.logs.missing} rows without a control signal or a force were left out.")
    return (*said, *result.notes)


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
    law = analysis.law
    cross = "" if law.cv_rmse is None else f", {number(analysis.percent(law.cv_rmse), 3)} % cross-validated"
    note = (
        f"R² {analysis.r2:.4f}, rmse {number(law.rmse, 3)} N = {number(analysis.percent(law.rmse), 3)} % of "
        f"full scale ({number(analysis.full_scale)} N){cross}."
    )
    return Table(
        "Square law F = a |n| n, least squares [95 % interval]",
        ("direction", *header[: min(count, 2)], "unit", "points", "levels"),
        tuple(rows),
        notes=(note,),
    )


def forms(result: ThrusterFit) -> Table:
    """All forms on the same points; errors in percent of full scale; a star marks the chosen one."""
    analysis = result.analysis
    rows = []
    for score in analysis.selection.scores:
        chosen = score.form.name == analysis.selection.chosen.form.name
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
        "form",
        "parameters",
        "cv rmse [N]",
        "cv [% of full scale]",
        "rmse [N]",
        "rmse [% of full scale]",
        "within 1 s.e. of best",
        "at bound",
    )
    return Table(
        "Forms side by side, cross-validated over levels (parameters in each direction; * chosen)",
        header,
        tuple(rows),
    )


def parameters(result: ThrusterFit) -> Table:
    """The chosen form's parameters in each direction."""
    chosen = result.analysis.selection.chosen
    rows = []
    for name, _ in SIDES:
        for key in chosen.form.free:
            entry = result.analysis.parameters.get(name, {}).get(key)
            if isinstance(entry, dict):
                known = entry["stderr"] is not None
                at_bound = [
                    text for text in (number(entry["value"]), entry.get("at_bound")) if text != MISSING
                ]
                text = interval(Estimate.from_json(entry)) if known else ", ".join(map(str, at_bound))
                rows.append((name, key, text, str(entry["unit"])))
    return Table(
        f"Chosen form {chosen.form.name}: {chosen.form.equation}",
        ("direction", "parameter", "value [95 % interval]", "unit"),
        tuple(rows),
    )


def voltages(result: ThrusterFit) -> Table:
    """One row a voltage: the square law's coefficients and error, the chosen form and its error."""
    rows = []
    for volts, analysis in result.voltages:
        chosen = analysis.selection.chosen
        rows.append(
            (
                number(volts),
                *(interval(analysis.square.get(name)) for name, _ in SIDES),
                number(analysis.percent(analysis.law.rmse), 3),
                chosen.form.name,
                number(analysis.percent(chosen.rmse), 3),
                number(analysis.full_scale),
            )
        )
    unit = next(iter(result.analysis.square.values())).unit
    header = (
        "voltage [V]",
        f"a forward [{unit}]",
        f"a backward [{unit}]",
        "square law [%]",
        "chosen form",
        "chosen form [%]",
        "full scale [N]",
    )
    return Table(
        "A map for each voltage (errors in percent of that voltage's full scale)", header, tuple(rows)
    )


def exponents(result: ThrusterFit) -> Table:
    """Thrust against voltage as a power law, at a fixed control signal and through a."""
    rows = []
    for name, _ in SIDES:
        found = result.exponents.get(name)
        if found is None:
            continue
        pairs = ", ".join(f"{p:.2f} ({low:.4g}–{high:.4g} V)" for low, high, p in found.between) or MISSING
        rows.append(
            (
                name,
                interval(found.exponent),
                pairs,
                interval(found.coefficient),
                f"{found.drift_percent:+.1f} %",
            )
        )
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
            result.place(int(index)),
            number(float(points.n[index])),
            number(float(points.force[index])),
            number(float(points.weight[index]), 2),
            str(points.flag[index]),
        )
        for index in order[:SHOWN]
    )
    more = (f"and {len(order) - SHOWN} more, see thrusters.csv",) if len(order) > SHOWN else ()
    title = f"{len(order)} of {len(points)} points weigh less: they contradict their neighbours"
    return Table(
        title,
        ("log", "n", "thrust [N]", "weight", "why"),
        rows,
        notes=more,
    )


def points_csv(result: ThrusterFit) -> str:
    """Every point of one thruster with the chosen form and the square law at it; missing values are empty."""
    points, analysis = result.points, result.analysis
    fitted, square = analysis.fitted(points.n), analysis.fitted(points.n, square=True)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(
        (
            "file",
            "run",
            "n",
            "force_N",
            "spread_N",
            "count",
            "stderr_N",
            "voltage_V",
            "fitted_N",
            "square_law_N",
            "residual_N",
            "weight",
            "flag",
        )
    )
    for i in range(len(points)):
        record = result.logs.records[int(points.record[i])]
        values = (points.voltage[i], fitted[i], square[i], points.force[i] - fitted[i], points.weight[i])
        writer.writerow(
            (
                record.source,
                record.run,
                _cell(points.n[i]),
                _cell(points.force[i]),
                _cell(points.spread[i]),
                int(points.count[i]),
                _cell(points.stderr[i]),
                *map(_cell, values),
                str(points.flag[i]),
            )
        )
    return text.getvalue()


def markdown(result: ThrusterFit) -> str:
    """thrusters.md: tables, then what was done to the data."""
    blocks = [
        "# Thruster map",
        *(table.to_markdown().rstrip("\n") for table in tables(result)),
        *(f"- {sentence}" for sentence in sentences(result)),
    ]
    return "\n\n".join(blocks) + "\n"


def _cell(value: float) -> str:
    """Ten significant digits, nothing for a missing value, no negative zero."""
    return "" if not np.isfinite(value) else f"{value + 0.0:.10g}"
