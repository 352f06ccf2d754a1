"""`init`: a folder of logs is looked at and becomes a commented campaign file, with questions where it is not sure."""

import os
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from automarine_cli.errors import LogError
from automarine_cli.logs import ColumnMap, LogFile, find_logs, given_columns
from automarine_cli.logs.recognise import Recognised
from automarine_cli.pipeline.manifest import MANIFEST, manifest_of
from automarine_cli.pipeline.records import Document
from automarine_cli.pipeline.results_folder import refuse_existing, write_whole
from automarine_cli.report.tables import Table
from automarine_cli.results.records import runs_json
from automarine_cli.workflows.campaign_file import open_questions
from automarine_cli.workflows.campaign_look import Look, look_at
from automarine_cli.workflows.campaign_places import places_of
from automarine_cli.workflows.campaign_questions import Ask, answered
from automarine_cli.workflows.campaign_text import campaign_text
from automarine_cli.workflows.command import UNRECORDED, Command, Runner, reads
from automarine_cli.workflows.view import View

SCHEMA = "automarine/init/1"
NAME = "campaign.toml"
MAKE_LOGS = ("simulate", "slice")


@dataclass(frozen=True)
class Started:
    """The campaign file that was written, or would be, and what it still asks."""

    look: Look
    text: str
    questions: tuple[str, ...]

    def to_json(self) -> dict[str, object]:
        """What was seen: schema automarine/init/1."""
        return {
            "schema": SCHEMA,
            "logs": self.look.count,
            "placed": {kind: [file.name for file in files] for kind, files in self.look.placed.items()},
            **{
                motion: {kind: [file.name for file in files] for kind, files in kinds.items()}
                for motion, kinds in self.look.forces.items()
            },
            "columns": [
                {"column": one.source, "taken_for": one.key, "unit": one.unit, "seen": one.seen, "open": one.open}
                | ({"rule": one.rule} if one.more else {})
                for one in self.look.columns
            ],
            "questions": list(self.questions),
            "campaign": self.text,
            "runs": runs_json(sum(len(runs) for runs in self.look.runs.values()), self.look.set_aside),
        }

    def tables(self) -> tuple[Table | str, ...]:
        """How many logs of each kind, what the columns are taken for, and what is asked."""
        kinds = tuple((kind, str(len(files))) for kind, files in self.look.placed.items())
        for motion, placed in self.look.forces.items():
            kinds += tuple((f"{motion}: {kind}", str(len(files))) for kind, files in placed.items() if files)
        columns = tuple((one.source, _taken(one), one.seen, one.open or "sure") for one in self.look.columns)
        count = len(self.questions)
        asked = f"{count} question{'s' * (count != 1)} to answer: {', '.join(self.questions)}." if count else (
            "No open questions; check the file before running it."
        )  # fmt: skip
        return (
            Table("Logs", ("kind", "logs"), kinds),
            Table("Columns", ("column", "taken for", "values", "sure or asked"), columns),
            asked,
            *([f"Commands and bollard tests do not fit: {self.look.misfit}."] if self.look.misfit else ()),
        )


def _taken(one: Recognised) -> str:
    """`n less 1500`: what a column is taken for."""
    less, way = one.more.get("subtract"), one.more.get("sign_from")
    told = f" less {less:g}" if isinstance(less, int | float) else ""
    if way is not None:
        told += f", signed by {way if isinstance(way, str) else dict(way)['from']}"  # type: ignore[call-overload]
    return one.key + told


@dataclass(frozen=True)
class InitOptions:
    """The folder of logs, a column map for what is known, whether the file is written, and who answers questions (given
    a key and its comment; "" leaves it open)."""

    folder: Path = field(default=Path(), metadata=reads("file"))
    columns: Path | Document | ColumnMap | None = field(default=None, metadata=reads("file"))
    write: bool = True
    ask: Ask | None = field(default=None, metadata=UNRECORDED)


def _init(asked: InitOptions, runner: Runner) -> Started:
    """Look at the logs in `folder` and write a campaign file `out` (by default `campaign.toml` in the folder).

    Raises LogError where there are no logs, and OutputError for a file that is there already unless `overwrite`.
    """
    folder, write = asked.folder, asked.write
    target = folder / NAME if runner.out is None else runner.out
    if write:
        refuse_existing(target, overwrite=runner.overwrite)
    files = [file for file in find_logs([folder]) if not _is_result(file.path, folder)]
    if not files:
        raise LogError(f"{folder}: the only logs here are in folders of results; give a folder of logs")
    look = look_at(folder, files, given_columns(asked.columns), runner.jobs, runner.progress)
    entries = _entries(look.placed, look, files, target)
    forces = {motion: _entries(kinds, look, files, target) for motion, kinds in look.forces.items()}
    text = campaign_text(look, entries, forces)
    if asked.ask is not None:
        text = answered(text, asked.ask)
    if write:
        write_whole(target, text)
    return Started(look, text, tuple(open_questions(tomllib.loads(text))))


def _is_result(path: Path, folder: Path) -> bool:
    """Whether a table lies in a folder of results: of any command but those that make logs."""
    above = [one for one in path.parents if one == folder or folder in one.parents]
    found = (manifest_of(one) for one in above if (one / MANIFEST).is_file())
    return any(manifest is not None and manifest.command not in MAKE_LOGS for manifest in found)


def _entries(
    placed: Mapping[str, Sequence[LogFile]], look: Look, files: Sequence[LogFile], target: Path
) -> dict[str, list[str]]:
    """What stands under `[logs]`: folders, globs and files, relative to the campaign file."""
    home = target.parent.resolve()
    base = Path(os.path.relpath(look.folder.resolve(), home)).as_posix()
    inner = {file: file.path.resolve().relative_to(look.folder.resolve()).as_posix() for file in files}
    everywhere = list(inner.values())
    return {
        kind: list(_below(base, places_of([inner[file] for file in found], everywhere)))
        for kind, found in placed.items()
    }


def _below(base: str, places: Sequence[str]) -> Iterator[str]:
    yield from (place if base == "." else f"{base}/{place}" for place in places)


init = Command(
    "init", InitOptions, _init, {Started: View(Started.tables, lambda result: iter(result.questions))}
)  # fmt: skip
