"""`slice`: one long log is cut into runs, each a log of its own that names its source and interval."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import click

from automarine_cli.commands import options
from automarine_cli.commands.command import OUTPUT, command, option
from automarine_cli.errors import LogError, RunError
from automarine_cli.text import printable

if TYPE_CHECKING:
    from automarine_cli.logs import ColumnMap, LogFile
    from automarine_cli.pipeline.parallel import Progress
    from automarine_cli.report.log_tables import SlicedLog, Slices
    from automarine_cli.runs.run import ExcludedRun
    from automarine_cli.runs.slices import By


@command("slice", report="log_tables", then="automarine check {out}")
@options.logs
@option(
    "--by", type=click.Choice(["mode", "arm", "moment"]), required=True,
    help="Cut where a flight mode, an arming state, or a constant command begins and ends.",
)  # fmt: skip
@options.columns
@option("--keep", multiple=True, metavar="MODE", help="Keep only this flight mode; may be repeated.")
@option(
    "--lead", type=click.FloatRange(min=0), default=2.0, show_default=True, metavar="SECONDS",
    help="Rest to keep before a constant command.",
)  # fmt: skip
@option(
    "--shortest", type=click.FloatRange(min=0), default=1.0, show_default=True, metavar="SECONDS",
    help="Shortest run to keep.",
)  # fmt: skip
@option(
    "--format", "form", type=click.Choice(["csv", "csv.gz", "parquet"]), default="csv", show_default=True,
    group=OUTPUT, help="File format of the runs.",
)  # fmt: skip
@options.ending(options.strict, options.jobs, draws=False)
def slice_log(
    logs: Sequence[Any], by: "By", columns: Any, keep: tuple[str, ...], lead: float, shortest: float, form: str,
    strict: bool, jobs: int, progress: "Progress",
) -> "Slices":  # fmt: skip
    """Cut one long log into runs, each a log that names its source and interval.

    Cut a log of a whole day by the flight mode, by arming, or where a constant command begins and ends. Then check,
    fit and validate with DIR/runs. Commands that follow another without a rest are in DIR/moving, for validate,
    diagnose and fit-yaw --fit-to whole-runs. Most logs of vehicles contain mode and arming; tables need columns mode
    and armed.

    \b
    Example:
      automarine slice sample_runs/validation/there_and_back.csv \\
        --by moment -o out/slices
    """
    from functools import partial

    from automarine_cli.pipeline.parallel import ordered_map
    from automarine_cli.report.log_tables import SlicedLog, Slices
    from automarine_cli.runs.load import require_usable
    from automarine_cli.runs.run import ExcludedRun

    if keep and by != "mode":
        raise click.UsageError("--keep MODE goes with --by mode.")
    cut = partial(_cut, columns=columns, by=by, keep=keep, lead=lead, shortest=shortest, form=form)
    results = ordered_map(cut, logs, jobs, progress=progress, stage="cutting logs")
    set_aside = tuple(result for result in results if isinstance(result, ExcludedRun))
    sources = tuple(result for result in results if isinstance(result, SlicedLog))
    require_usable(sources, set_aside, len(logs), strict)
    if not any(source.cuts for source in sources):
        why = list(dict.fromkeys(gap["why"] for source in sources for gap in source.between))
        raise RunError(
            f"{sources[0].file}: no run in it, cut by {by}: {'; '.join(why[:5]) or 'no rows'}. "
            "Cut by something else, or take runs that are shorter"
        )
    return Slices(by, form, sources, set_aside)


def _cut(
    file: "LogFile", columns: "ColumnMap", by: "By", keep: tuple[str, ...], lead: float, shortest: float, form: str
) -> "SlicedLog | ExcludedRun":
    from automarine_cli.logs import read_log
    from automarine_cli.logs.find import stem_of
    from automarine_cli.logs.table import columns_of
    from automarine_cli.report.log_tables import SlicedLog, interval_of
    from automarine_cli.runs.load import unreadable
    from automarine_cli.runs.slices import find_slices
    from automarine_cli.simulation.campaign import file_bytes

    try:
        table = read_log(file, columns, dof=None)
        slices = find_slices(table, by, keep, lead, shortest)
    except LogError as error:
        return unreadable(file, error)
    time, stem = table.columns["time"], stem_of(file.name.rpartition("/")[2])
    cuts, between, contents = list[dict[str, Any]](), list[dict[str, Any]](), list[bytes]()
    digits = len(str(sum(not part.why for part in slices)))
    for part in slices:
        ends = {"from_s": float(time[part.first]), "to_s": float(time[part.stop - 1])}
        if part.why:
            between.append({"source": file.name, **ends, "why": part.why})
            continue
        run = None if table.run is None else str(table.run[part.first])
        name = "_".join(word for word in (stem, run, f"{len(cuts) + 1:0{digits}d}", part.state) if word)
        rows = [int(table.rows[part.first]), int(table.rows[part.stop - 1])]  # the last included
        cuts.append({
            "run": printable(name), "state": part.state, "source": file.name, "source_run": run, "rows": rows,
            "samples": part.stop - part.first, "moving": part.moving, **ends,
        })  # fmt: skip
        comment = f"{file.name}, rows {rows[0]} to {rows[1]}, {interval_of(cuts[-1])}, cut by {by}: {part.state}"
        contents.append(file_bytes(columns_of(table, part.first, part.stop), form, comment))
    return SlicedLog(file.name, tuple(cuts), tuple(contents), tuple(between), table.notes)
