"""`report`: what the steps of a campaign left, as one page and as Markdown."""

import re
from dataclasses import dataclass
from pathlib import Path

from automarine_cli.errors import OutputError
from automarine_cli.pipeline.results_folder import write_whole
from automarine_cli.report.campaign_page import document, usual_title
from automarine_cli.report.campaign_steps import Steps, read_steps
from automarine_cli.report.html.page import page
from automarine_cli.results.judged import RunFile
from automarine_cli.results.kinds import RUN
from automarine_cli.workflows.campaign_steps import FOLDERS
from automarine_cli.workflows.command import commands

SCHEMA = "automarine/report/1"
FILES = ("report.html", "report.md")


@dataclass(frozen=True)
class Report:
    """The report's files in memory, and the steps that it tells of."""

    files: dict[str, str]
    steps: Steps

    def to_json(self) -> dict[str, object]:
        """What is in it: schema automarine/report/1."""
        steps, missing = list(self.steps.found), self.steps.missing
        return {"schema": SCHEMA, "files": list(self.files), "steps": steps, "missing": missing}


def report_files(folder: Path, *, title: str | None = None, ran: RunFile | None = None) -> dict[str, str]:
    """`report.html` and `report.md` of a campaign's folder, from its step folders and what `run` says of them; without
    a `title` it is that of what was identified.

    Steps without results are left out, and the report says so. Raises OutputError if there is none at all.
    """
    return _made(folder, title, ran).files


def report(folder: Path, *, title: str | None = None, overwrite: bool = False) -> Report:
    """Write the report of a campaign's folder beside its step folders. Raises OutputError, also for reports that
    are there already unless `overwrite`."""
    there = [name for name in FILES if (folder / name).exists()]
    if there and not overwrite:
        raise OutputError(f"{folder} already holds {there[0]}; give --overwrite to replace it")
    record = folder / RUN.file
    made = _made(folder, title, RUN.read(record, refuse=OutputError) if record.is_file() else None)
    for name, text in made.files.items():
        write_whole(folder / name, text)
    return made


def _made(folder: Path, title: str | None, ran: RunFile | None) -> Report:
    steps = read_steps(folder, FOLDERS)
    title = title or usual_title(steps)
    text = document(steps, title, ran.cautions if ran else (), _also(folder), ran.steps if ran else ())
    return Report({"report.html": page(text, folder, title), "report.md": text}, steps)


def _also(folder: Path) -> dict[str, str]:
    """What commands without a section of their own left in the folder, by heading."""
    found = {}
    for name, command in commands().items():
        place = folder / name / command.section
        if command.section and place.is_file():
            text = place.read_text(encoding="utf-8", errors="replace")
            text = re.sub(r"^(!\[.*\])\((\w+\.\w+)\)$", rf"\1({name}/\2)", text, flags=re.MULTILINE)
            found[name.replace("-", " ").capitalize()] = re.sub(
                r"^## ", "### ", re.sub(r"\A# .*\n", "", text), flags=re.MULTILINE
            )
    return found
