"""All files of a yaw fit, in memory: tables, figures, one row a run."""

from collections.abc import Iterator, Sequence

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from automarine_cli.axes import Axis
from automarine_cli.fits.step_response import instant
from automarine_cli.fits.ways import Ways
from automarine_cli.fits.yaw_fit import YawFit
from automarine_cli.report import yaw_tables
from automarine_cli.report.figures import yaw as figures
from automarine_cli.report.figures.style import figure_files
from automarine_cli.report.tables import Table, interval


def tables(fit: YawFit, short: bool = False) -> tuple[Table, Table]:
    """Tables 1 and 2 with what must be known of their parameters below them.

    `short`, for the terminal, leaves that to the warnings, and leaves out the means at each moment.
    """
    notes = (
        (fit.seed_method.tail_because(fit.axis),)
        if fit.seed_method is not None
        else (f"{fit.why_no_seed_method}.",)
    )
    drag, inertia = ((), ()) if short else yaw_tables.caution_notes(fit.cautions)
    one = yaw_tables.drag_table(fit.seed_method, fit.output_error, fit.moment_unit, (*notes, *drag), fit.axis)
    two = yaw_tables.inertia_table(
        fit.seed_method, fit.output_error, fit.moment_unit, (*notes, *inertia), not short, fit.axis
    )
    return one, two


def sentences(fit: YawFit) -> tuple[str, ...]:
    """What a person should read beside the tables: choice, inertial turn angle, scatter, warnings."""
    preferred, turn = fit.preferred, fit.inertial_turn_angle
    lines = [fit.preference.because]
    if turn is not None:
        low, high = turn.ci95
        lines.append(
            f"Inertial turn angle I_r/k_r|r|: {turn.value:.4g} rad [{low:.4g}, {high:.4g}], whatever the "
            "moment's unit."
        )
    low, high = preferred.gain_scatter.ci95
    lines.append(
        f"Thrust scatters from run to run by {100 * preferred.gain_scatter.value:.1f} % [{100 * low:.1f}, "
        f"{100 * high:.1f}]; "
        f"heading noise {fit.axis.shown(preferred.noise):.2f}°. Moments switch {preferred.offset.value:+.2f} sample "
        f"intervals [{preferred.offset.ci95[0]:+.2f}, {preferred.offset.ci95[1]:+.2f}] from the middle between "
        "the first sample that shows them and the one before."
    )
    lines = [fit.axis.say(line) for line in lines]
    if preferred.ways is not None:
        lines.append(_by_way(preferred.ways, fit.axis))
    if fit.buoyancy is not None:
        lines.append(fit.buoyancy.says)
    return (*lines, *(f"Warning: {warning}" for warning in fit.warnings))


def _by_way(ways: Ways, axis: Axis) -> str:
    """Whether drag differs between the ways, in a sentence."""
    symbol = axis.say("k_r|r|" if ways.parameter == "k_rr" else "k_r")
    told = " and ".join(f"{interval(one)} {way}" for way, one in ways.drag.items())
    unit = next(iter(ways.drag.values())).unit
    if ways.differ:
        far = " and ".join(f"{interval(one)} m {way}" for way, one in ways.distance.items())
        said = f"Drag differs between the ways (p = {ways.p_value:.2g}): {symbol} is {told} {unit}"
        return f"{said}, the inertial distance {far}." if far else f"{said}."
    return f"Drag does not differ between the ways beyond chance (p = {ways.p_value:.2g}): {symbol} {told} {unit}."


def files(fit: YawFit, formats: Sequence[str] = ("png",)) -> Iterator[tuple[str, str | bytes]]:
    """Name and content of every file but the model's JSON; each figure in each of the formats."""
    for name, table in zip(("table1", "table2"), tables(fit)):
        yield f"{name}.csv", table.to_csv()
        yield f"{name}.md", table.to_markdown()
        yield f"{name}.tex", table.to_latex()
    yield "runs.parquet", parquet(run_rows(fit))
    if fit.seed_method is not None and fit.data is not None:
        yield from figure_files(
            "half_turns" if fit.axis.wraps else "steps", figures.half_turns_figure(fit), formats
        )
        yield from figure_files("drag", figures.drag_figure(fit, fit.seed_method), formats)
        yield from figure_files("inertia", figures.inertia_figure(fit, fit.seed_method), formats)
        yield from figure_files("collapse", figures.collapse_figure(fit, fit.data), formats)
    else:
        yield from figure_files("whole_runs", figures.whole_runs_figure(fit), formats)


def run_rows(fit: YawFit) -> pa.Table:
    """One row a run: what was kept of it, why, and what both methods found in it."""
    return pa.Table.from_pylist([fit.axis.named(row) for row in _rows(fit)])


def _rows(fit: YawFit) -> list[dict[str, object]]:
    axis = fit.axis
    mixed, measured = fit.preferred.mixed, list[dict[str, object]]()
    effects = mixed.run_effects
    if fit.seed_method is None or fit.data is None:
        for i, run in enumerate(fit.runs):
            off = axis.shown(run.heading - mixed.fitted[i][: len(run)])
            measured.append(
                {
                    "run": run.name,
                    "file": run.source,
                    "samples": len(run),
                    "duration_s": float(run.time[-1] - run.time[0]),
                    "start_rate_deg_s": float(axis.shown(effects[i, 1])),
                    "gain": float(np.exp(effects[i, 2])),
                    "rmse_deg": float(np.sqrt(np.mean(off**2))),
                }
            )
        return measured
    seed, data = fit.seed_method, fit.data
    for i, turn in enumerate(fit.turns):
        off = axis.shown((data.heading - mixed.fitted)[i][data.seen[i]])
        row: dict[str, object] = {
            "run": turn.name,
            "file": turn.step.run.source,
            "moment": turn.moment,
            "time_from_s": float(turn.time[0]),
            "time_to_s": float(turn.time[-1]),
            "samples": len(turn.time),
            "turned_deg": float(axis.shown(turn.turned)),
            "cut_by": turn.cut_by,
            "steady": turn.steady,
            "start_heading_deg": float(axis.shown(turn.start_heading)),
            "switch_from_s": turn.switch_from,
            "switch_to_s": turn.switch_to,
            "tail_samples": int(seed.tails.used[i].sum()),
            "steady_rate_deg_s": float(axis.shown(seed.tails.rate[i])),
            "steady_rate_stderr_deg_s": float(axis.shown(np.sqrt(seed.variance[i]))),
            "velocity_error_deg": float(axis.shown(seed.tails.error[i])),
        }
        row |= {
            f"{axis.key('I_r')}_model_{number}": float(table.per_run[i])
            for number, table in seed.inertia.items()
        }
        row |= {
            "gain": float(np.exp(effects[i, 1])),
            "switch_shift_s": float(data.interval[i] * instant(mixed.theta[-1] + effects[i, 2])),
            "rmse_deg": float(np.sqrt(np.mean(off**2))),
        }
        measured.append(row)
    return measured


def parquet(table: pa.Table) -> bytes:
    """The table as Parquet bytes, the same each time."""
    sink = pa.BufferOutputStream()
    pq.write_table(table, sink, compression="zstd")
    return bytes(sink.getvalue().to_pybytes())
