"""The result of `slice`: one line a run, and what became none."""

from dataclasses import asdict, dataclass
from typing import Any

from automarine_cli.pipeline.records import Shown
from automarine_cli.pipeline.results_folder import file_stems
from automarine_cli.report.sections import Content, Sections, sections
from automarine_cli.report.tables import Table, number
from automarine_cli.runs.run import SetAside, runs_json

FOLDER, MOVING = "runs", "moving"
MAX_LISTED = 20  # intervals between the runs that a table lists


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

    def comment(self, by: str) -> str:
        rows, seconds = f"rows {self.rows[0]} to {self.rows[1]}", f"{_seconds(self.from_s)} to {_seconds(self.to_s)} s"
        return f"{self.source}, {rows}, {seconds}, cut by {by}: {self.state}"


@dataclass(frozen=True)
class Between:
    """An interval of a log that became no run, and why."""

    source: str
    from_s: float
    to_s: float
    why: str


@dataclass(frozen=True)
class SlicedLog:
    """One log that was cut: its runs and the content of their files, what is between them, notes of the reading."""

    file: str
    cuts: tuple[Cut, ...]
    contents: tuple[bytes, ...]
    between: tuple[Between, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True, repr=False)
class Slices(Shown):
    """What `slice` made of the logs, in their order."""

    by: str
    form: str
    sources: tuple[SlicedLog, ...]
    set_aside: tuple[SetAside, ...]

    @property
    def cuts(self) -> tuple[Cut, ...]:
        return tuple(cut for source in self.sources for cut in source.cuts)

    @property
    def files(self) -> tuple[str, ...]:
        """The file of each run in the folder of results."""
        stems = file_stems([cut.run for cut in self.cuts])
        return tuple(f"{MOVING if cut.moving else FOLDER}/{stem}.{self.form}" for cut, stem in zip(self.cuts, stems))

    def to_json(self) -> dict[str, Any]:
        """Return the content of slices.json (schema automarine/slices/1)."""
        return {
            "schema": "automarine/slices/1",
            "by": self.by,
            "slices": [{"file": file, **asdict(cut)} for file, cut in zip(self.files, self.cuts)],
            "left_out": [asdict(gap) for source in self.sources for gap in source.between],
            "sources": [{"file": source.file, "notes": list(source.notes)} for source in self.sources],
            "runs": runs_json(len(self.cuts), self.set_aside),
        }


@sections.register
def _(result: Slices) -> Sections:
    table, content = _table(result), result.to_json()
    files: dict[str, Content] = dict(zip(result.files, (log for source in result.sources for log in source.contents)))
    files |= {"slices.json": content, "slices.md": table.to_markdown()}
    folders = dict.fromkeys(file.partition("/")[0] + "/" for file in result.files)
    return Sections([table], files, listed=("slices.json", "slices.md", *folders), rows=content["slices"])


def _table(result: Slices) -> Table:
    rows = [
        {"run": cut.run, result.by: cut.state, "log": cut.source, "rows": f"{cut.rows[0]} to {cut.rows[1]}",
         "from s": _seconds(cut.from_s), "to s": _seconds(cut.to_s), "lasts s": number(cut.to_s - cut.from_s, 3)}
        for cut in result.cuts
    ]  # fmt: skip
    moving, gaps = sum(cut.moving for cut in result.cuts), [gap for source in result.sources for gap in source.between]
    notes = [f"{moving} of {len(rows)} begin while another command moves the vehicle: in the folder {MOVING}"]
    notes = notes * bool(moving) + [f"{source.file}: {note}" for source in result.sources for note in source.notes]
    notes += [f"{gap.source}, {_seconds(gap.from_s)} to {_seconds(gap.to_s)} s: {gap.why}" for gap in gaps[:MAX_LISTED]]
    notes += [f"and {len(gaps) - MAX_LISTED} more"] * (len(gaps) > MAX_LISTED)
    return Table.of("Runs", rows, notes)


def _seconds(value: float) -> str:
    return f"{value:.3f}".rstrip("0").rstrip(".")
