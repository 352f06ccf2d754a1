"""All files of a yaw fit: tables, one row a run, figures."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from automarine_cli.dofs import Dof
from automarine_cli.fits.cautions import DRAG, INERTIA, Caution
from automarine_cli.fits.driven import Use
from automarine_cli.fits.half_turns import instant
from automarine_cli.fits.identify import YawFit, effect_estimates
from automarine_cli.fits.innovations import InnovationsFit, channel_noises, fit_sentences
from automarine_cli.fits.linear_mixed import GAIN, START_VELOCITY, SWITCHES
from automarine_cli.fits.mixed_model import SWITCH, MixedFit
from automarine_cli.fits.paper import DragFit, VelocityErrorFit, nested_test
from automarine_cli.fits.whole_runs import OutputErrorFit, Ways
from automarine_cli.report.figures import yaw as figures
from automarine_cli.report.figures.style import Draw
from automarine_cli.report.figures.yaw import driven_runs_figure
from automarine_cli.report.sections import Content, Sections, numbers, sections
from automarine_cli.report.tables import MISSING, Cell, Math, Table, interval, number
from automarine_cli.results.estimate import Estimate
from automarine_cli.runs.run import shared_readings

MODELS = ("1", "2", "3")
HEADER: tuple[Cell, ...] = ("Model", *MODELS)


def drag_table(
    seed: VelocityErrorFit | None, ml: Mapping[str, OutputErrorFit], unit: str, notes: tuple[str, ...], dof: Dof
) -> Table:
    """Table 1: drag of the three models and the sum of squares; intervals, tests and maximum likelihood
    below."""
    fits: Mapping[str, DragFit] = {} if seed is None else seed.drag
    own = dof.symbols
    quadratic, linear = Math(own.quadratic_print, own.quadratic_math), Math(own.linear, own.linear)

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
    ratio = Math(f"{own.inertia}/{own.quadratic_print}", f"{own.inertia}/{own.quadratic_math}", f" [{dof.units.base}]")
    inertia = Math(own.inertia, own.inertia)
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


def tables(fit: YawFit, short: bool = False) -> tuple[Table, Table]:
    """Tables 1 and 2 with what must be known of their parameters below them.

    `short`, for the terminal, leaves that to the warnings, and leaves out the means at each moment.
    """
    notes = (fit.seed_method.tail_because(fit.dof),) if fit.seed_method is not None else (f"{fit.why_no_seed_method}.",)
    drag, inertia = ((), ()) if short else caution_notes(fit.cautions)
    one = drag_table(fit.seed_method, fit.output_error, fit.moment_unit, (*notes, *drag), fit.dof)
    two = inertia_table(fit.seed_method, fit.output_error, fit.moment_unit, (*notes, *inertia), not short, fit.dof)
    return one, two


def sentences(fit: YawFit) -> tuple[str, ...]:
    """What a person should read beside the tables: choice, inertial turn angle, scatter, warnings."""
    preferred, turn = fit.preferred, fit.preferred.inertial_turn_angle
    dof, words, own = fit.dof, fit.dof.words, fit.dof.symbols
    lines = [fit.preference.because, *fit.told_of_known]
    if fit.use is not None:
        lines = [fit.use.sentence(dof), *lines]
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
    scattered = f"Thrust scatters from run to run by {100 * scatter.value:.1f} % {_ends(scatter, '.1f', 100.0)}"
    if isinstance(preferred.mixed, InnovationsFit):
        lines.append(f"{scattered}; {_noise(fit)}. {_disturbance(preferred, preferred.mixed)}")
    else:
        lines.append(
            f"{scattered}; {_noise(fit)}. {words.force.capitalize()}s switch {late.value:+.2f} sample intervals "
            f"{_ends(late, '+.2f')} from the middle between the first sample that shows them and the one before."
        )
    lines += fit_sentences(fit.channels, preferred.mixed, dof)
    if preferred.ways is not None:
        lines.append(_by_way(preferred.ways, dof))
    if fit.buoyancy is not None:
        lines.append(fit.buoyancy.says)
    lines += [f"Read: {note}." for note in shared_readings(fit.read)]
    warnings = fit.warnings if fit.use is None or fit.use.of_use else fit.warnings[1:]  # that line stands first
    return (*lines, *(f"Warning: {warning}" for warning in warnings))


def _ends(one: Estimate, form: str, times: float = 1.0) -> str:
    """The interval behind a number, or that it has none."""
    low, high = one.ci95
    return "(at its bound)" if one.at_bound else f"[{times * low:{form}}, {times * high:{form}}]"


def _disturbance(fit: OutputErrorFit, found: InnovationsFit) -> str:
    """What pushes the vehicle and is not logged, in a sentence."""
    model = fit.model
    dof, unit = model.dof, model.moment_unit
    size = model.inertia * found.value(f"{dof.name}.disturbance")
    time, thrust = (found.value(f"{dof.name}.{name}") for name in ("disturbance-time", "thrust-noise"))
    return (
        f"The runs are disturbed by a {dof.words.force} of {size:.3g} {unit} that lasts {time:.2g} s, and the thrust "
        f"is unsteady by {100 * thrust:.0f} % over a second."
    )


def _noise(fit: YawFit) -> str:
    """The noise of the sensor that the fit rests on first."""
    words, units, noise = fit.dof.words, fit.dof.units, fit.preferred.noise
    if noise is not None:
        bound = " (at its bound)" * channel_noises(fit.preferred.mixed, fit.dof)[fit.dof.position].at_bound
        return f"{words.position} noise {fit.dof.shown(noise):.2f}{units.mark}{bound}"
    return f"{words.rate} noise {fit.dof.shown(fit.preferred.mixed.noise):.3g}{units.mark}/s"


def _by_way(ways: Ways, dof: Dof) -> str:
    """Whether drag differs between the ways, in a sentence."""
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
    files: dict[str, Content] = {f"{fit.dof.name}_model.json": fit.to_json()}
    for name, table in zip(("table1", "table2"), tables(fit)):
        files |= {f"{name}.csv": table.to_csv(), f"{name}.md": table.to_markdown(), f"{name}.tex": table.to_latex()}
    files["runs.parquet"] = parquet(run_rows(fit))
    drawings = _drawings(fit)
    listed = (f"{fit.dof.name}_model.json", "table1 and table2 (.csv, .md, .tex)", "runs.parquet")
    printed: tuple[Table | str, ...] = (*tables(fit, short=True), *sentences(fit))
    return Sections(printed, files, drawings, (*listed, *(f"{name}.png" for name in drawings)), tuple(_numbers(fit)))


def _drawings(fit: YawFit) -> dict[str, Draw]:
    """What draws each figure, by the name of its file."""
    seed, data = fit.seed_method, fit.data
    if seed is None or data is None:
        use = fit.use
        if isinstance(use, Use):
            return {"whole_runs": partial(driven_runs_figure, fit, use)}
        return {"whole_runs": partial(figures.whole_runs_figure, fit)}
    return {
        fit.dof.steps_key: partial(figures.half_turns_figure, fit),
        "drag": partial(figures.drag_figure, fit, seed),
        "inertia": partial(figures.inertia_figure, fit, seed),
        "collapse": partial(figures.collapse_figure, fit, data),
    }


def _numbers(fit: YawFit) -> Iterator[dict[str, object]]:
    """One row a parameter of each model, by each method."""
    for model, likeliest in fit.output_error.items():
        estimates = dict(likeliest.estimates)
        for effect, group in effect_estimates(likeliest).items():
            estimates |= {f"{effect} {name}": estimate for name, estimate in group.items()}
        for name, estimate in estimates.items():
            yield {"model": model, "method": "maximum likelihood", "parameter": name} | numbers(estimate)
    if fit.seed_method is None:
        return
    for model, drag in fit.seed_method.drag.items():
        if model not in fit.output_error:  # with a constant moment: a test of symmetry, no model of its own
            continue
        estimates = dict(drag.estimates)
        if model in fit.seed_method.inertia:
            estimates[fit.dof.symbols.inertia] = fit.seed_method.inertia[model].overall
        for name, estimate in estimates.items():
            yield {"model": model, "method": "velocity error", "parameter": name} | numbers(estimate)


def run_rows(fit: YawFit) -> pa.Table:
    """One row a run: what was kept of it, why, and what both methods found in it."""
    return pa.Table.from_pylist(_rows(fit))


def _rows(fit: YawFit) -> list[dict[str, object]]:
    dof, words = fit.dof, fit.dof.words
    shown, shown_rate = dof.units.key, dof.units.rate_key
    mixed, measured = fit.preferred.mixed, list[dict[str, object]]()
    if isinstance(fit.use, Use):
        return _driven_rows(fit, fit.use)
    assert isinstance(mixed, MixedFit)
    read = mixed.reading(dof.position)
    if fit.seed_method is None or fit.data is None:
        for i, run in enumerate(fit.runs):
            off = dof.shown(run.position - read[i][: len(run)])
            measured.append(
                {
                    "run": run.name,
                    "file": run.source,
                    "samples": len(run),
                    "duration_s": float(run.time[-1] - run.time[0]),
                    f"start_{words.speed}_{shown_rate}": float(dof.shown(mixed.own(START_VELOCITY)[i, 0])),
                    "gain": float(np.exp(mixed.own(GAIN)[i, 0])),
                    f"rmse_{shown}": float(np.sqrt(np.mean(off**2))),
                }
            )
        return measured
    seed, data = fit.seed_method, fit.data
    for i, turn in enumerate(fit.turns):
        off = dof.shown((data.heading[i] - read[i])[data.seen[i]])
        row: dict[str, object] = {
            "run": turn.name,
            "file": turn.step.run.source,
            words.force: turn.moment,
            "time_from_s": float(turn.time[0]),
            "time_to_s": float(turn.time[-1]),
            "samples": len(turn.time),
            f"{words.gone_key}_{shown}": float(dof.shown(turn.turned)),
            "cut_by": turn.cut_by,
            "steady": turn.steady,
            f"start_{words.position}_{dof.units.log}": float(dof.logged(turn.start_position)),
            "switch_from_s": turn.switch_from,
            "switch_to_s": turn.switch_to,
            "tail_samples": int(seed.tails.used[i].sum()),
            f"steady_{words.speed}_{shown_rate}": float(dof.shown(seed.tails.rate[i])),
            f"steady_{words.speed}_stderr_{shown_rate}": float(dof.shown(np.sqrt(seed.variance[i]))),
            f"velocity_error_{shown}": float(dof.shown(seed.tails.error[i])),
        }
        row |= {
            f"{dof.symbols.inertia}_model_{number}": float(table.per_run[i]) for number, table in seed.inertia.items()
        }
        row |= {
            "gain": float(np.exp(mixed.own(GAIN)[i, 0])),
            "switch_shift_s": float(data.interval[i] * instant(mixed.value(SWITCH) + mixed.own(SWITCHES)[i, 0])),
            f"rmse_{shown}": float(np.sqrt(np.mean(off**2))),
        }
        measured.append(row)
    return measured


def _driven_rows(fit: YawFit, use: Use) -> list[dict[str, object]]:
    """One row a driven run: its gain, and what was predicted of it when it was left out of the fit."""
    dof, rows = fit.dof, list[dict[str, object]]()
    gains = np.exp(fit.preferred.mixed.own(GAIN)[:, 0])
    squares = {one.horizon: one.by_run(one.error, len(fit.runs)) for one in use.predictions}
    for i, run in enumerate(fit.runs):
        row: dict[str, object] = {
            "run": run.name,
            "file": run.source,
            "samples": len(run),
            "duration_s": float(run.time[-1] - run.time[0]),
            "gain": float(gains[i]),
        }
        for horizon, square in squares.items():
            row[f"rmse_{horizon:g}_s_ahead_{dof.units.key}"] = float(dof.shown(np.sqrt(square[i])))
        rows.append(row)
    return rows


def parquet(table: pa.Table) -> bytes:
    """The table as Parquet bytes, the same each time."""
    sink = pa.BufferOutputStream()
    pq.write_table(table, sink, compression="zstd")
    return bytes(sink.getvalue().to_pybytes())
