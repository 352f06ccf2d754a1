"""`slice`: one long log is cut into runs, each a log of its own that names its source and interval."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from itertools import islice
from typing import Any, Literal

from automarine_cli.errors import LogError, RunError
from automarine_cli.logs import ColumnMap, LogFile, LogTable, find_logs, given_columns, read_log
from automarine_cli.logs.formats import stem_of
from automarine_cli.logs.table import columns_of, csv_text
from automarine_cli.pipeline.parallel import ordered_map
from automarine_cli.pipeline.progress import Progress
from automarine_cli.pipeline.results_folder import ResultFolder, file_stems
from automarine_cli.pipeline.words import printable
from automarine_cli.report.tables import Table, number
from automarine_cli.results.records import runs_json
from automarine_cli.results.shown import Shown
from automarine_cli.runs.load import none_left, refused_by_strict, unreadable
from automarine_cli.runs.run import SetAside
from automarine_cli.runs.slices import By, find_slices
from automarine_cli.simulation.log_files import gzip_bytes, parquet_bytes
from automarine_cli.workflows.command import Command, Runner
from automarine_cli.workflows.shared import Columns, OfLogs, counted
from automarine_cli.workflows.view import Row, View

SCHEMA = "automarine/slices/1"
FOLDER, MOVING = "runs", "moving"
MOST_TOLD = 20  # intervals between the runs that a table lists
Form = Literal["csv", "csv.gz", "parquet"]


@dataclass(frozen=True)
class Cut:
    """One run: its name and state, the log it comes from, its rows there (the last included) and its interval.

    `moving`: another command acted right before, so that the vehicle was in motion when this one began.
    """

    run: str
    state: str
    source: str
    source_run: str | None
    rows: tuple[int, int]
    samples: int
    moving: bool
    from_s: float
    to_s: float


@dataclass(frozen=True)
class Between:
    """An interval of a log that became no run, and why."""

    source: str
    from_s: float
    to_s: float
    why: str


@dataclass(frozen=True)
class Source:
    """One log that was cut: its runs and what they hold, what is between them, and notes of the reading."""

    file: str
    cuts: tuple[Cut, ...]
    contents: tuple[bytes, ...]
    between: tuple[Between, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True, repr=False)
class Slices(Shown):
    """What `slice` made of the logs, in their order."""

    by: str
    form: Form
    sources: tuple[Source, ...]
    set_aside: tuple[SetAside, ...]

    @property
    def cuts(self) -> tuple[Cut, ...]:
        """All runs, in the order of the logs and of time."""
        return tuple(cut for source in self.sources for cut in source.cuts)

    @property
    def written(self) -> tuple[str, ...]:
        """Files and folders of the result."""
        folders = dict.fromkeys(file.partition("/")[0] + "/" for file in self.files)
        return ("slices.json", "slices.md", *folders)

    @property
    def files(self) -> tuple[str, ...]:
        """The file of each run in the folder of results."""
        stems = file_stems([cut.run for cut in self.cuts])
        folders = (MOVING if cut.moving else FOLDER for cut in self.cuts)
        return tuple(f"{folder}/{stem}.{self.form}" for folder, stem in zip(folders, stems))

    def to_json(self) -> dict[str, Any]:
        """The result: schema automarine/slices/1."""
        return {
            "schema": SCHEMA,
            "by": self.by,
            "slices": [{"file": file, **asdict(cut)} for file, cut in zip(self.files, self.cuts)],
            "left_out": [asdict(one) for source in self.sources for one in source.between],
            "sources": [{"file": source.file, "notes": list(source.notes)} for source in self.sources],
            "runs": runs_json(len(self.cuts), self.set_aside),
        }

    def tables(self) -> tuple[Table, ...]:
        """One line a run, and what became none."""
        rows = tuple(
            (cut.run, cut.state, cut.source, f"{cut.rows[0]} to {cut.rows[1]}", _seconds(cut.from_s),
             _seconds(cut.to_s), number(cut.to_s - cut.from_s, 3))
            for cut in self.cuts
        )  # fmt: skip
        moving = sum(cut.moving for cut in self.cuts)
        lost = [one for source in self.sources for one in source.between]
        notes = [f"{source.file}: {note}" for source in self.sources for note in source.notes]
        told = (f"{one.source}, {_seconds(one.from_s)} to {_seconds(one.to_s)} s: {one.why}" for one in lost)
        notes += [*islice(told, MOST_TOLD), *[f"and {len(lost) - MOST_TOLD} more"] * (len(lost) > MOST_TOLD)]
        if moving:
            notes.insert(
                0, f"{moving} of {len(rows)} begin while another command moves the vehicle: in the folder {MOVING}"
            )
        header = ("run", self.by, "log", "rows", "from s", "to s", "lasts s")
        return (Table("Runs", header, rows, notes=tuple(notes)),)


@dataclass(frozen=True, kw_only=True)
class _By:
    """What logs are cut by: mode, arm or moment."""

    by: By


@dataclass(frozen=True, kw_only=True)
class SliceOptions(Columns, _By, OfLogs):
    """`keep`, `lead` and `shortest` as in `find_slices`, and the format of the logs that are written."""

    keep: tuple[str, ...] = ()
    lead: float = 2.0
    shortest: float = 1.0
    form: Form = "csv"
    strict: bool = False


def _slice(asked: SliceOptions, runner: Runner) -> Slices:
    """Cut each log into runs where the mode, the arming state or a constant command (`by`) begins and ends.

    Raises LogError for a log that does not tell what it is to be cut by, RunError where nothing is left, OutputError.
    """
    cut = partial(
        _cut, columns=given_columns(asked.columns), by=asked.by, keep=asked.keep, lead=asked.lead,
        shortest=asked.shortest, form=asked.form,
    )  # fmt: skip
    files = find_logs(asked.logs)
    return runner.results(
        asked, lambda: _sliced(files, cut, asked.by, asked.form, asked.strict, runner.jobs, runner.progress), _write
    )


def _write(folder: ResultFolder, result: Slices) -> None:
    for file, content in zip(result.files, (one for source in result.sources for one in source.contents)):
        folder.write(file, content)
    folder.write_json("slices.json", result.to_json())
    folder.write("slices.md", "\n".join(table.to_markdown() for table in result.tables()))


def _sliced(
    files: Sequence[LogFile], cut: Any, by: By, form: Form, strict: bool, jobs: int, progress: Progress
) -> Slices:
    found = ordered_map(cut, files, jobs, progress=progress, stage="cutting logs")
    aside = [one for one in found if isinstance(one, SetAside)]
    if strict and aside:
        raise refused_by_strict(aside[0])
    sources = tuple(one for one in found if isinstance(one, Source))
    if not sources:
        raise none_left(len(files), aside)
    if not any(source.cuts for source in sources):
        why = list(dict.fromkeys(one.why for source in sources for one in source.between))
        raise RunError(
            f"{sources[0].file}: no run in it, cut by {by}: {'; '.join(why[:5]) or 'no rows'}. "
            "Cut by something else, or take runs that are shorter"
        )
    return Slices(by, form, sources, tuple(aside))


def _cut(
    file: LogFile, columns: ColumnMap, by: By, keep: tuple[str, ...], lead: float, shortest: float, form: Form
) -> Source | SetAside:
    """The runs of one log as files, or why it was set aside."""
    try:
        table = read_log(file, columns, dof=None)
        found, passed = find_slices(table, by, keep, lead, shortest)
    except LogError as error:
        if file.named:
            raise
        return unreadable(file, error)
    time, digits = table.columns["time"], len(str(len(found)))
    cuts, contents = [], []
    for number_, one in enumerate(found, 1):
        run = None if table.run_code is None else table.run_names[table.run_code[one.first]]
        stem = stem_of(file.name.rpartition("/")[2])
        name = "_".join(part for part in (stem, run, f"{number_:0{digits}d}", one.state) if part)
        rows = int(table.rows[one.first]), int(table.rows[one.stop - 1])
        ends = float(time[one.first]), float(time[one.stop - 1])
        cut = Cut(printable(name), one.state, file.name, run, rows, one.stop - one.first, one.moving, *ends)
        cuts.append(cut)
        contents.append(_content(table, one.first, one.stop, form, _comment(cut, by)))
    between = tuple(Between(file.name, float(time[one.first]), float(time[one.stop - 1]), one.why) for one in passed)
    return Source(file.name, tuple(cuts), tuple(contents), between, table.notes)


def _comment(cut: Cut, by: By) -> str:
    rows = f"rows {cut.rows[0]} to {cut.rows[1]}"
    return f"{cut.source}, {rows}, {_seconds(cut.from_s)} to {_seconds(cut.to_s)} s, cut by {by}: {cut.state}"


def _content(table: LogTable, first: int, stop: int, form: Form, comment: str) -> bytes:
    columns = columns_of(table, first, stop)
    if form == "parquet":
        return parquet_bytes(columns, comment)
    text = csv_text(columns, comment).encode()
    return text if form == "csv" else gzip_bytes(text)


def _seconds(value: float) -> str:
    """A stamp to the millisecond, without needless zeros."""
    return f"{value:.3f}".rstrip("0").rstrip(".")


def _lines(result: Slices) -> Iterator[str]:
    cuts = counted(len(result.cuts), "run")
    yield f"{counted(len(result.sources), 'log')} cut by {result.by} into {cuts}; {len(result.set_aside)} set aside"


def _rows(result: Slices) -> Iterator[Row]:
    yield from result.to_json()["slices"]


slice_log = Command(
    "slice", SliceOptions, _slice, {Slices: View(Slices.tables, _lines, _rows)},
    files=lambda result: result.written, python="slice_log",
)  # fmt: skip
