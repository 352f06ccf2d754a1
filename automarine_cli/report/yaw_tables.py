"""Tables 1 and 2 of a yaw fit: the paper's layout above the rule, our own rows below it."""

from collections.abc import Callable, Mapping, Sequence

from automarine_cli.axes import YAW, Axis
from automarine_cli.fits.drag import DragFit, nested_test
from automarine_cli.fits.estimate import Estimate
from automarine_cli.fits.output_error import OutputErrorFit
from automarine_cli.fits.velocity_error import VelocityErrorFit
from automarine_cli.fits.yaw_cautions import DRAG, INERTIA, Caution
from automarine_cli.report.tables import MISSING, Cell, Math, Table, interval, number

MODELS = ("1", "2", "3")
HEADER: tuple[Cell, ...] = ("Model", *MODELS)
K_RR = Math("k_r|r|", "k_{r|r|}")
K_R = Math("k_r", "k_r")
I_R = Math("I_r", "I_r")


def drag_table(
    seed: VelocityErrorFit | None,
    ml: Mapping[str, OutputErrorFit],
    unit: str,
    notes: tuple[str, ...],
    axis: Axis = YAW,
) -> Table:
    """Table 1: drag of the three models and the sum of squares; intervals, tests and maximum likelihood
    below."""
    fits: Mapping[str, DragFit] = {} if seed is None else seed.drag

    def of(name: str, form: Callable[[Estimate], str]) -> list[str]:
        return [
            form(fits[m].estimates[name]) if m in fits and name in fits[m].estimates else MISSING
            for m in MODELS
        ]

    rows: list[tuple[Cell, ...]] = [
        (K_RR, *of("k_rr", lambda e: number(e.value))),
        (K_R, *of("k_r", lambda e: number(e.value))),
        ("SSE", *(number(fits[m].sse) if m in fits else MISSING for m in MODELS)),
        ("k_r|r|, 95 %", *of("k_rr", interval)),
        ("k_r, 95 %", *of("k_r", interval)),
        ("AICc", *(number(fits[m].aicc) if m in fits else MISSING for m in MODELS)),
        ("F test against 2, p", *(_f_test(fits, m) for m in MODELS)),
        ("k_r|r|, maximum likelihood", *(_ml(ml, m, "k_rr") for m in MODELS)),
        ("k_r, maximum likelihood", *(_ml(ml, m, "k_r") for m in MODELS)),
        (
            "log density of left-out runs",
            *(number(float(ml[m].mixed.predictive.sum()), 6) if m in ml else MISSING for m in MODELS),
        ),
    ]
    rows += _force_rows(fits, ml, axis)
    squared = f"({unit})²" if " " in unit else f"{unit}²"
    unit_note = (
        f"Moment [{unit}], k_r|r| [{axis.unit_of('k_rr', unit)}], k_r [{axis.unit_of('k_r', unit)}], SSE [{squared}] "
        "of the plain least squares; brackets are 95 % intervals."
    )
    notes = (unit_note, *_signs(axis), *notes)
    return Table("Table 1. Identified yaw models: drag", HEADER, tuple(rows), (3, 7), notes).said(axis)


def _force_rows(
    fits: Mapping[str, DragFit], ml: Mapping[str, OutputErrorFit], axis: Axis
) -> list[tuple[Cell, ...]]:
    """What only translations have: the drag of each way, and the constant force."""
    rows: list[tuple[Cell, ...]] = []
    if axis.sided:
        asked = {m: ml[m].ways for m in MODELS if m in ml}
        for way in axis.ways:
            cells = (interval(ways.drag[way]) if (ways := asked.get(m)) else MISSING for m in MODELS)
            rows.append((f"drag {way}, maximum likelihood", *cells))
        tests = (number(ways.p_value, 2) if (ways := asked.get(m)) else MISSING for m in MODELS)
        rows.append(("one drag both ways, p", *tests))
    if axis.constant:
        least = [fits[m].estimates.get("b") if m in fits else None for m in MODELS]
        rows.append(("constant force, 95 %", *(interval(e) if e is not None else MISSING for e in least)))
        rows.append(("constant force, maximum likelihood", *(_ml(ml, m, "b") for m in MODELS)))
    return rows


def _signs(axis: Axis) -> tuple[str, ...]:
    """What the signs of a translation's symbols are."""
    if axis.wraps:
        return ()
    (first, second), v = axis.ways, "w" if axis.constant else "u"
    constant = (
        "; the constant force is weight less buoyancy, positive down: that of a vehicle that floats up is negative"
        if axis.constant
        else ""
    )
    return (
        f"{first.capitalize()} is positive. k_r and k_r|r| are positive where drag brakes, as in force = I_r d{v}/dt + "
        f"k_r {v} + k_r|r| |{v}| {v}; Fossen's derivatives of these names are their negatives. I_r is mass with added "
        f"mass{constant}.",
        f"The drag of one way is k_r in model 1, else k_r|r|. Where {first} and {second} do not differ (p above 0.05) "
        "they are fitted as one; where they do, the value above is their mean.",
    )


def inertia_table(
    seed: VelocityErrorFit | None,
    ml: Mapping[str, OutputErrorFit],
    unit: str,
    notes: tuple[str, ...],
    means: bool = True,
    axis: Axis = YAW,
) -> Table:
    """Table 2: inertia of the three models; maximum likelihood, inertial turn angle and the mean at each
    moment below."""
    tables = {} if seed is None else seed.inertia
    rows: list[tuple[Cell, ...]] = [
        (I_R, *(number(tables[m].overall.value) if m in tables else MISSING for m in MODELS)),
        ("I_r, 95 %", *(interval(tables[m].overall) if m in tables else MISSING for m in MODELS)),
        ("I_r, maximum likelihood", *(_ml(ml, m, "I_r") for m in MODELS)),
        (
            "I_r/k_r|r| [rad], maximum likelihood",
            *(interval(ml[m].inertial_turn_angle) if m in ml else MISSING for m in MODELS),
        ),
    ]
    asked = {m: ml[m].ways for m in MODELS if m in ml} if axis.sided else {}
    for way in axis.ways if axis.sided else ():
        far = (ways.distance.get(way) if (ways := asked.get(m)) else None for m in MODELS)
        cells = (MISSING if one is None else interval(one) for one in far)
        rows.append((f"I_r/k_r|r| [rad] {way}, maximum likelihood", *cells))
    levels = sorted({level for table in tables.values() for level in table.per_moment}) if means else []
    for level in levels:
        row = (number(tables[m].per_moment[level]) if m in tables else MISSING for m in MODELS)
        rows.append((f"mean at {level:+.4g} {unit}", *row))
    rules = (1, len(rows) - len(levels)) if levels else (1,)
    unit_note = f"I_r [{axis.unit_of('I_r', unit)}]; brackets are 95 % intervals"
    unit_note += "; means over the runs at each moment are by the velocity error." if levels else "."
    notes = (unit_note, *notes)
    return Table("Table 2. Identified yaw models: inertia", HEADER, tuple(rows), rules, notes).said(axis)


def caution_notes(cautions: Sequence[Caution]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Notes below Table 1, on drag, and below Table 2, on inertia."""
    return (
        tuple(one.sentence for one in cautions if set(DRAG) & set(one.parameters)),
        tuple(one.sentence for one in cautions if INERTIA in one.parameters),
    )


def _ml(ml: Mapping[str, OutputErrorFit], model: str, name: str) -> str:
    fit = ml.get(model)
    return interval(fit.estimates[name]) if fit is not None and name in fit.estimates else MISSING


def _f_test(fits: Mapping[str, DragFit], model: str) -> str:
    if model == "2" or model not in fits or "2" not in fits:
        return MISSING
    return number(nested_test(fits[model], fits["2"]).p_value, 2)
