"""Tables 1 and 2 of a yaw fit: the paper's layout above the rule, our own rows below it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from automarine_cli.dofs import Dof
from automarine_cli.fits.cautions import DRAG, INERTIA, Caution
from automarine_cli.fits.identify import effect_estimates
from automarine_cli.fits.paper import DragFit, VelocityErrorFit, nested_test
from automarine_cli.fits.whole_runs import OutputErrorFit
from automarine_cli.report.tables import MISSING, Cell, Math, Table, interval, number
from automarine_cli.results.estimate import Estimate

MODELS = ("1", "2", "3")
HEADER: tuple[Cell, ...] = ("Model", *MODELS)


def drag_table(
    seed: VelocityErrorFit | None, ml: Mapping[str, OutputErrorFit], unit: str, notes: tuple[str, ...], dof: Dof
) -> Table:
    """Table 1: drag of the three models and the sum of squares; intervals, tests and maximum likelihood
    below."""
    fits: Mapping[str, DragFit] = {} if seed is None else seed.drag
    own = dof.symbols
    quadratic, linear = Math(own.quadratic_print, own.quadratic_math), Math(own.linear, own.linear_math)

    def of(name: str, form: Callable[[Estimate], str]) -> list[str]:
        return [form(fits[m].estimates[name]) if m in fits and name in fits[m].estimates else MISSING for m in MODELS]

    own = dof.symbols
    rows: list[tuple[Cell, ...]] = [
        (quadratic, *of(own.quadratic, lambda e: number(e.value))),
        (linear, *of(own.linear, lambda e: number(e.value))),
        ("SSE", *(number(fits[m].sse) if m in fits else MISSING for m in MODELS)),
        (replace(quadratic, after=", 95 %"), *of(own.quadratic, interval)),
        (replace(linear, after=", 95 %"), *of(own.linear, interval)),
        ("AICc", *(number(fits[m].aicc) if m in fits else MISSING for m in MODELS)),
        ("F test against 2, p", *(_f_test(fits, m) for m in MODELS)),
        (replace(quadratic, after=", maximum likelihood"), *(_ml(ml, m, own.quadratic) for m in MODELS)),
        (replace(linear, after=", maximum likelihood"), *(_ml(ml, m, own.linear) for m in MODELS)),
        (
            "log density of left-out runs",
            *(number(float(ml[m].mixed.predictive.sum()), 6) if m in ml else MISSING for m in MODELS),
        ),
    ]
    rows += [*_force_rows(fits, ml, dof), *_effect_rows(ml)]
    squared = f"({unit})²" if " " in unit else f"{unit}²"
    unit_note = (
        f"{dof.words.force.capitalize()} [{unit}], {quadratic} [{dof.unit_of('quadratic', unit)}], "
        f"{linear} [{dof.unit_of('linear', unit)}], SSE [{squared}] of the plain least squares; brackets are 95 % "
        "intervals."
    )
    notes = (unit_note, *_signs(dof), *notes)
    return Table(f"Table 1. Identified {dof.name} models: drag", HEADER, tuple(rows), (3, 7), notes)


def _effect_rows(ml: Mapping[str, OutputErrorFit]) -> list[tuple[Cell, ...]]:
    """The effects that were fitted beside drag."""
    each = {number: effect_estimates(fit) for number, fit in ml.items()}
    names = {(e, name): one.unit for own in each.values() for e, group in own.items() for name, one in group.items()
             if one.stderr > 0}  # fmt: skip
    return [
        (
            f"{effect} {name} [{unit}], maximum likelihood",
            *(interval(each[m][effect][name]) if effect in each.get(m, {}) else MISSING for m in MODELS),
        )
        for (effect, name), unit in names.items()
    ]


def _force_rows(fits: Mapping[str, DragFit], ml: Mapping[str, OutputErrorFit], dof: Dof) -> list[tuple[Cell, ...]]:
    """What only translations have: the drag of each way, and the constant force."""
    rows: list[tuple[Cell, ...]] = []
    if dof.directional:
        asked = {m: ml[m].ways for m in MODELS if m in ml}
        for way in dof.words.ways:
            cells = (interval(ways.drag[way]) if (ways := asked.get(m)) else MISSING for m in MODELS)
            rows.append((f"drag {way}, maximum likelihood", *cells))
        tests = (number(ways.p_value, 2) if (ways := asked.get(m)) else MISSING for m in MODELS)
        rows.append(("one drag both ways, p", *tests))
    if dof.has_constant:
        constant = dof.symbols.constant
        least = [fits[m].estimates.get(constant) if m in fits else None for m in MODELS]
        rows.append(("constant force, 95 %", *(interval(e) if e is not None else MISSING for e in least)))
        rows.append(("constant force, maximum likelihood", *(_ml(ml, m, constant) for m in MODELS)))
    return rows


def _signs(dof: Dof) -> tuple[str, ...]:
    """What the signs of a translation's symbols are."""
    if dof.wraps:
        return ()
    (first, second), own, force = dof.words.ways, dof.symbols, dof.words.force
    constant = (
        f"; the constant {force} is weight less buoyancy, positive {first}: that of a vehicle that floats {second} is "
        "negative"
        if dof.has_constant
        else ""
    )
    v, quadratic = own.velocity, own.quadratic_print
    signs = (
        f"{first.capitalize()} is positive. {own.linear} and {quadratic} are positive where drag brakes, as in "
        f"{force} = {own.inertia} d{v}/dt + {own.linear} {v} + {quadratic} |{v}| {v}; Fossen's derivatives of these "
        f"names are their negatives. {own.inertia} is {dof.words.full_inertia}{constant}."
    )
    if not dof.directional:
        return (signs,)
    return (
        signs,
        f"The drag of one way is {own.linear} in model 1, else {quadratic}. Where {first} and {second} do not differ "
        "(p above 0.05) they are fitted as one; where they do, the value above is their mean.",
    )


def inertia_table(
    seed: VelocityErrorFit | None,
    ml: Mapping[str, OutputErrorFit],
    unit: str,
    notes: tuple[str, ...],
    means: bool,
    dof: Dof,
) -> Table:
    """Table 2: inertia of the three models; maximum likelihood, inertial turn angle and the mean at each
    moment below."""
    tables = {} if seed is None else seed.inertia
    own = dof.symbols
    ratio = Math(
        f"{own.inertia}/{own.quadratic_print}", f"{own.inertia_math}/{own.quadratic_math}", f" [{dof.units.base}]"
    )
    inertia = Math(own.inertia, own.inertia_math)
    rows: list[tuple[Cell, ...]] = [
        (inertia, *(number(tables[m].overall.value) if m in tables else MISSING for m in MODELS)),
        (replace(inertia, after=", 95 %"), *(interval(tables[m].overall) if m in tables else MISSING for m in MODELS)),
        (replace(inertia, after=", maximum likelihood"), *(_ml(ml, m, own.inertia) for m in MODELS)),
        (
            replace(ratio, after=f"{ratio.after}, maximum likelihood"),
            *(interval(ml[m].inertial_turn_angle) if m in ml else MISSING for m in MODELS),
        ),
    ]
    asked = {m: ml[m].ways for m in MODELS if m in ml} if dof.directional else {}
    for way in dof.words.ways if dof.directional else ():
        far = (ways.distance.get(way) if (ways := asked.get(m)) else None for m in MODELS)
        cells = (MISSING if one is None else interval(one) for one in far)
        rows.append((replace(ratio, after=f"{ratio.after} {way}, maximum likelihood"), *cells))
    levels = sorted({level for table in tables.values() for level in table.per_moment}) if means else []
    for level in levels:
        row = (number(tables[m].per_moment[level]) if m in tables else MISSING for m in MODELS)
        rows.append((f"mean at {level:+.4g} {unit}", *row))
    rules = (1, len(rows) - len(levels)) if levels else (1,)
    unit_note = f"{own.inertia} [{dof.unit_of('inertia', unit)}]; brackets are 95 % intervals"
    each = f"means over the runs at each {dof.words.force} are by the velocity error"
    notes = (f"{unit_note}; {each}." if levels else f"{unit_note}.", *notes)
    title = f"Table 2. Identified {dof.name} models: {dof.words.inertia}"
    return Table(title, HEADER, tuple(rows), rules, notes)


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
