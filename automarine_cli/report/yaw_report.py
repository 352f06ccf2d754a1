"""What the fit of one motion shows and writes: tables, sentences, one row a run, figures."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from automarine_cli.dofs import Dof
from automarine_cli.estimate import Estimate
from automarine_cli.fits.driven import Use
from automarine_cli.fits.half_turns import instant
from automarine_cli.fits.identify import DRAG, INERTIA, YawFit, effect_estimates
from automarine_cli.fits.innovations import InnovationsFit, channel_noises, fit_sentences
from automarine_cli.fits.linear_mixed import GAIN, START_VELOCITY, SWITCHES
from automarine_cli.fits.mixed_model import SWITCH, MixedFit
from automarine_cli.fits.paper import DragFit, nested_test
from automarine_cli.fits.whole_runs import OutputErrorFit, Ways
from automarine_cli.report.figures import runs
from automarine_cli.report.figures import yaw as figures
from automarine_cli.report.figures.style import Draw
from automarine_cli.report.sections import Content, Sections, forms_of, numbers, sections
from automarine_cli.report.tables import MISSING, Cell, Math, Table, interval, number
from automarine_cli.runs.run import shared_readings

MODELS = ("1", "2", "3")
HEADER: tuple[Cell, ...] = ("Model", *MODELS)
LIKELIEST = ", maximum likelihood"


def drag_table(fit: YawFit, notes: Sequence[str]) -> Table:
    """Table 1: drag of the three models and the sum of squares; intervals, tests and maximum likelihood below."""
    dof, symbols, unit, ml = fit.dof, fit.dof.symbols, fit.moment_unit, fit.output_error
    fits: Mapping[str, DragFit] = {} if fit.seed_method is None else fit.seed_method.drag
    quadratic, linear = Math(symbols.quadratic_print, symbols.quadratic_math), Math(symbols.linear, symbols.linear)
    of = {quadratic: symbols.quadratic, linear: symbols.linear}
    rows = [
        *(_row(symbol, fits, partial(_value, key)) for symbol, key in of.items()),
        _row("SSE", fits, lambda drag: number(drag.sse)),
        *(_row(_with(symbol, ", 95 %"), fits, partial(_between, key)) for symbol, key in of.items()),
        _row("AICc", fits, lambda drag: number(drag.aicc)),
        _row("F test against 2, p", {m: drag for m, drag in fits.items() if m != "2" and "2" in fits},
             lambda drag: number(nested_test(drag, fits["2"])["p_value"], 2)),
        *(_row(_with(symbol, LIKELIEST), ml, partial(_between, key)) for symbol, key in of.items()),
        _row("log density of left-out runs", ml, lambda fit: number(float(fit.mixed.predictive.sum()), 6)),
    ]  # fmt: skip
    if dof.directional:
        ways = {m: model.ways for m, model in ml.items() if model.ways}
        for way in dof.words.ways:
            rows.append(_row(f"drag {way}{LIKELIEST}", {m: of.drag[way] for m, of in ways.items()}, interval))
        rows.append(_row("one drag both ways, p", ways, lambda ways: number(ways.p_value, 2)))
    if dof.has_constant:
        rows.append(_row("constant force, 95 %", fits, partial(_between, symbols.constant)))
        rows.append(_row(f"constant force{LIKELIEST}", ml, partial(_between, symbols.constant)))
    each = {model: effect_estimates(likeliest) for model, likeliest in ml.items()}
    names = {(effect, name): one.unit for groups in each.values() for effect, group in groups.items()
             for name, one in group.items() if one.stderr > 0}  # fmt: skip
    for (effect, name), shown in names.items():
        of_effect = {m: groups[effect][name] for m, groups in each.items() if effect in groups}
        rows.append(_row(f"{effect} {name} [{shown}]{LIKELIEST}", of_effect, interval))
    squared = f"({unit})²" if " " in unit else f"{unit}²"
    units = (
        f"{dof.words.force.capitalize()} [{unit}], {quadratic} [{dof.unit_of('quadratic', unit)}], "
        f"{linear} [{dof.unit_of('linear', unit)}], SSE [{squared}] of the plain least squares; brackets are 95 % "
        "intervals."
    )
    title = f"Table 1. Identified {dof.name} models: drag"
    return Table(title, HEADER, tuple(rows), (3, 7), (units, *_signs(dof), *notes)).without_empty_rows()


def _row(label: Cell, of_model: Mapping[str, Any], cell: Callable[[Any], str]) -> tuple[Cell, ...]:
    return (label, *(cell(of_model[model]) if model in of_model else MISSING for model in MODELS))


def _with(symbol: Math, after: str) -> Math:
    return replace(symbol, after=symbol.after + after)


def _value(name: str, fit: DragFit) -> str:
    return number(fit.estimates[name].value) if name in fit.estimates else MISSING


def _between(name: str, fit: DragFit | OutputErrorFit) -> str:
    return interval(fit.estimates.get(name))


def _signs(dof: Dof) -> tuple[str, ...]:
    if dof.wraps:
        return ()
    (first, second), own, force = dof.words.ways, dof.symbols, dof.words.force
    constant = (
        f"; the constant {force} is weight less buoyancy, positive {first}: that of a vehicle that floats {second} is "
        "negative"
    ) * dof.has_constant
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


def inertia_table(fit: YawFit, notes: Sequence[str], means: bool) -> Table:
    """Table 2: inertia of the three models; maximum likelihood, inertial turn angle and mean at each moment below."""
    dof, symbols, unit, ml = fit.dof, fit.dof.symbols, fit.moment_unit, fit.output_error
    tables = {} if fit.seed_method is None else fit.seed_method.inertia
    heavy = symbols.inertia
    inertia = Math(heavy, heavy)
    ratio = Math(f"{heavy}/{symbols.quadratic_print}", f"{heavy}/{symbols.quadratic_math}", f" [{dof.units.base}]")
    rows = [
        _row(inertia, tables, lambda table: number(table.overall.value)),
        _row(_with(inertia, ", 95 %"), tables, lambda table: interval(table.overall)),
        _row(_with(inertia, LIKELIEST), ml, partial(_between, symbols.inertia)),
        _row(_with(ratio, LIKELIEST), ml, lambda fit: interval(fit.inertial_turn_angle)),
    ]
    for way in dof.words.ways if dof.directional else ():
        far = {m: model.ways.distance.get(way) for m, model in ml.items() if model.ways}
        rows.append(_row(_with(ratio, f" {way}{LIKELIEST}"), far, interval))
    levels = sorted({level for table in tables.values() for level in table.per_moment}) if means else []
    rules = (1, len(rows)) if levels else (1,)
    for level in levels:
        rows.append(
            _row(f"mean at {level:+.4g} {unit}", {m: table.per_moment[level] for m, table in tables.items()}, number)
        )
    each = f"; means over the runs at each {dof.words.force} are by the velocity error" * bool(levels)
    unit_note = f"{symbols.inertia} [{dof.unit_of('inertia', unit)}]; brackets are 95 % intervals{each}."
    title = f"Table 2. Identified {dof.name} models: {dof.words.inertia}"
    return Table(title, HEADER, tuple(rows), rules, (unit_note, *notes)).without_empty_rows()


def tables(fit: YawFit, short: bool = False) -> tuple[Table, Table]:
    """Make tables 1 and 2 with what must be known of their parameters below; `short`, for the terminal, leaves that to
    the warnings, and leaves out the means at each moment."""
    notes = (fit.seed_method.tail_because(fit.dof),) if fit.seed_method is not None else (f"{fit.why_no_seed_method}.",)
    cautions = () if short else fit.cautions
    drag = (caution.sentence for caution in cautions if set(DRAG) & set(caution.parameters))
    inertia = (caution.sentence for caution in cautions if INERTIA in caution.parameters)
    return drag_table(fit, (*notes, *drag)), inertia_table(fit, (*notes, *inertia), not short)


def sentences(fit: YawFit) -> tuple[str, ...]:
    """Say what a person should read beside the tables: choice, inertial turn angle, scatter, warnings."""
    preferred, turn = fit.preferred, fit.preferred.inertial_turn_angle
    dof, words, own = fit.dof, fit.dof.words, fit.dof.symbols
    lines = [*([] if fit.use is None else [fit.use.sentence(dof)]), fit.preference.because, *fit.told_of_known]
    if turn is not None:
        low, high = turn.ci95
        lines.append(
            f"{words.inertial_length.capitalize()} {own.inertia}/{own.quadratic_print}: {turn.value:.4g} "
            f"{dof.units.base} [{low:.4g}, {high:.4g}], whatever the {words.force}'s unit."
        )
    elif (lasting := fit.time_constant) is not None:
        low, high = lasting.ci95
        lines.append(f"Time constant {own.inertia}/{own.linear}: {lasting.value:.3g} s [{low:.3g}, {high:.3g}].")
    scatter, late = preferred.gain_scatter, preferred.offset
    more = (
        f"{words.force.capitalize()}s switch {late.value:+.2f} sample intervals {_ends(late, '+.2f')} from the middle "
        "between the first sample that shows them and the one before."
    )
    if isinstance(preferred.mixed, InnovationsFit):
        more = _disturbance(preferred, preferred.mixed)
    scattered = f"Thrust scatters from run to run by {100 * scatter.value:.1f} % {_ends(scatter, '.1f', 100.0)}"
    lines.append(f"{scattered}; {_noise(fit)}. {more}")
    lines += fit_sentences(fit.channels, preferred.mixed, dof)
    if preferred.ways is not None:
        lines.append(_by_way(preferred.ways, dof))
    if fit.buoyancy is not None:
        lines.append(fit.buoyancy.says)
    lines += [f"Read: {note}." for note in shared_readings(fit.read)]
    warnings = fit.warnings if fit.use is None or fit.use.of_use else fit.warnings[1:]  # that line stands first
    return (*lines, *(f"Warning: {warning}" for warning in warnings))


def _ends(one: Estimate, form: str, times: float = 1.0) -> str:
    low, high = one.ci95
    return "(at its bound)" if one.at_bound else f"[{times * low:{form}}, {times * high:{form}}]"


def _disturbance(fit: OutputErrorFit, innovations: InnovationsFit) -> str:
    model, dof, names = fit.model, fit.model.dof, ("disturbance", "disturbance-time", "thrust-noise")
    size, time, thrust = (innovations.value(f"{dof.name}.{name}") for name in names)
    return (
        f"The runs are disturbed by a {dof.words.force} of {model.inertia * size:.3g} {model.moment_unit} that lasts "
        f"{time:.2g} s, and the thrust is unsteady by {100 * thrust:.0f} % over a second."
    )


def _noise(fit: YawFit) -> str:
    words, units, noise = fit.dof.words, fit.dof.units, fit.preferred.noise
    if noise is not None:
        bound = " (at its bound)" * channel_noises(fit.preferred.mixed, fit.dof)[fit.dof.position].at_bound
        return f"{words.position} noise {fit.dof.shown(noise):.2f}{units.mark}{bound}"
    return f"{words.rate} noise {fit.dof.shown(fit.preferred.mixed.noise):.3g}{units.mark}/s"


def _by_way(ways: Ways, dof: Dof) -> str:
    symbol = dof.symbols.quadratic_print if ways.role == "quadratic" else dof.symbols.linear
    told = " and ".join(f"{interval(one)} {way}" for way, one in ways.drag.items())
    unit = next(iter(ways.drag.values())).unit
    if ways.differ:
        far = " and ".join(f"{interval(one)} {one.unit} {way}" for way, one in ways.distance.items())
        said = f"Drag differs between the ways (p = {ways.p_value:.2g}): {symbol} is {told} {unit}"
        return f"{said}, the {dof.words.inertial_length} {far}." if far else f"{said}."
    return f"Drag does not differ between the ways beyond chance (p = {ways.p_value:.2g}): {symbol} {told} {unit}."


@sections.register
def _(fit: YawFit) -> Sections:
    model = f"{fit.dof.name}_model.json"
    files: dict[str, Content] = {model: fit.to_json()}
    for name, table in zip(("table1", "table2"), tables(fit)):
        files |= forms_of(name, table)
    sink = pa.BufferOutputStream()
    pq.write_table(pa.Table.from_pylist(run_rows(fit)), sink, compression="zstd")
    files["runs.parquet"] = sink.getvalue().to_pybytes()
    drawings = _drawings(fit)
    listed = (model, "table1 and table2 (.csv, .md, .tex)", "runs.parquet", *(f"{name}.png" for name in drawings))
    return Sections((*tables(fit, short=True), *sentences(fit)), files, drawings, listed, tuple(_numbers(fit)))


def _drawings(fit: YawFit) -> dict[str, Draw]:
    seed, data, use = fit.seed_method, fit.data, fit.use
    if seed is None or data is None:
        driven = partial(runs.driven_runs_figure, fit, use) if isinstance(use, Use) else None
        return {"whole_runs": driven or partial(runs.whole_runs_figure, fit)}
    return {
        fit.dof.steps_key: partial(figures.half_turns_figure, fit),
        "drag": partial(figures.drag_figure, fit, seed),
        "inertia": partial(figures.inertia_figure, fit, seed),
        "collapse": partial(figures.collapse_figure, fit, data),
    }


def _numbers(fit: YawFit) -> Iterator[dict[str, object]]:
    rows = list[tuple[str, str, Mapping[str, Estimate]]]()
    for model, likeliest in fit.output_error.items():
        effects = effect_estimates(likeliest).items()
        added = {f"{effect} {name}": estimate for effect, group in effects for name, estimate in group.items()}
        rows.append((model, "maximum likelihood", {**likeliest.estimates, **added}))
    seed = fit.seed_method
    for model, drag in () if seed is None else seed.drag.items():
        if seed and model in fit.output_error:  # with a constant moment: a test of symmetry, no model of its own
            table = seed.inertia.get(model)
            heavy = {} if table is None else {fit.dof.symbols.inertia: table.overall}
            rows.append((model, "velocity error", {**drag.estimates, **heavy}))
    for model, method, estimates in rows:
        for name, estimate in estimates.items():
            yield {"model": model, "method": method, "parameter": name} | numbers(estimate)


def run_rows(fit: YawFit) -> list[dict[str, object]]:
    """List what was kept of each run, why, and what both methods give of it."""
    dof, words, data, seed = fit.dof, fit.dof.words, fit.data, fit.seed_method
    key, rate_key, mixed, rows = dof.units.key, dof.units.rate_key, fit.preferred.mixed, list[dict[str, object]]()
    gains = np.exp(mixed.own(GAIN)[:, 0])
    if seed is None or data is None or isinstance(fit.use, Use):
        for i, run in enumerate(fit.runs):
            row: dict[str, object] = {"run": run.name, "file": run.source, "samples": len(run)}
            row["duration_s"] = float(run.time[-1] - run.time[0])
            if isinstance(fit.use, Use):  # what was predicted of it when it was left out of the fit
                row["gain"] = float(gains[i])
                for ahead in fit.use.predictions:
                    square = ahead.by_run(ahead.error, len(fit.runs))[i]
                    row[f"rmse_{ahead.horizon:g}_s_ahead_{key}"] = float(dof.shown(np.sqrt(square)))
            else:
                assert isinstance(mixed, MixedFit)
                off = dof.shown(run.position - mixed.reading(dof.position)[i][: len(run)])
                row[f"start_{words.speed}_{rate_key}"] = float(dof.shown(mixed.own(START_VELOCITY)[i, 0]))
                row |= {"gain": float(gains[i]), f"rmse_{key}": float(np.sqrt(np.mean(off**2)))}
            rows.append(row)
        return rows
    assert isinstance(mixed, MixedFit)
    read = mixed.reading(dof.position)
    for i, turn in enumerate(fit.turns):
        off = dof.shown((data.heading[i] - read[i])[data.seen[i]])
        rows.append({
            "run": turn.name, "file": turn.step.run.source, words.force: turn.moment,
            "time_from_s": float(turn.time[0]), "time_to_s": float(turn.time[-1]), "samples": len(turn.time),
            f"{words.gone_key}_{key}": float(dof.shown(turn.turned)), "cut_by": turn.cut_by, "steady": turn.steady,
            f"start_{words.position}_{dof.units.log}": float(dof.logged(turn.start_position)),
            "switch_from_s": turn.switch_from, "switch_to_s": turn.switch_to,
            "tail_samples": int(seed.tails.used[i].sum()),
            f"steady_{words.speed}_{rate_key}": float(dof.shown(seed.tails.rate[i])),
            f"steady_{words.speed}_stderr_{rate_key}": float(dof.shown(np.sqrt(seed.variance[i]))),
            f"velocity_error_{key}": float(dof.shown(seed.tails.error[i])),
            **{f"{dof.symbols.inertia}_model_{n}": float(table.per_run[i]) for n, table in seed.inertia.items()},
            "gain": float(gains[i]),
            "switch_shift_s": float(data.interval[i] * instant(mixed.value(SWITCH) + mixed.own(SWITCHES)[i, 0])),
            f"rmse_{key}": float(np.sqrt(np.mean(off**2))),
        })  # fmt: skip
    return rows
