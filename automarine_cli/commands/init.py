"""`init`: a folder of logs is looked at and becomes a commented campaign file, with questions where it is not sure."""

import shlex
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from automarine_cli.commands import options
from automarine_cli.commands.command import OUTPUT, argument, command, option
from automarine_cli.commands.terminal import folded, verbosity_level, width_of
from automarine_cli.errors import LogError

if TYPE_CHECKING:
    from automarine_cli.pipeline.parallel import Progress
    from automarine_cli.report.campaign_file import NewCampaign

CAMPAIGN_FILE = "campaign.toml"
MAKE_LOGS = ("simulate", "slice")


@command("init", report="campaign_file", saves=False)
@argument("folder", metavar="[DIR]", default=".", type=click.Path(exists=True, file_okay=False, path_type=Path))
@option(
    "-o", "--out", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", group=OUTPUT,
    help="The campaign file to write.  [default: DIR/campaign.toml]",
)  # fmt: skip
@options.columns
@options.overwrite
@options.figures
@options.jobs
@options.as_json
@options.verbosity
def init(
    folder: Path, columns: Any, out: Path | None, overwrite: bool, figure_formats: tuple[str, ...], jobs: int,
    progress: "Progress",
) -> "NewCampaign":  # fmt: skip
    """Look at the logs in DIR (by default here) and write a commented campaign.toml for `automarine run`.

    It lists bollard tests, step runs, manoeuvres and validation runs, and what it reads each column as, with unit
    and range. If name and range leave a question, it asks on a terminal. In a pipe, or if you only press Enter, the
    value in the file is "?". Replace it by the answer before `automarine run`. What --columns says is not asked.
    Each run is drawn, in a folder next to the file.

    \b
    Example:
      automarine init sample_runs -o out/campaign.toml
    """
    from automarine_cli.logs import find_logs
    from automarine_cli.pipeline.results_folder import Input, refuse_existing, result_folder, write_whole
    from automarine_cli.report.campaign_file import new_campaign
    from automarine_cli.report.log_tables import run_pages
    from automarine_cli.report.sections import save_figures
    from automarine_cli.runs.load import has_bytes, require_usable
    from automarine_cli.runs.look import survey

    place = folder / CAMPAIGN_FILE if out is None else out
    refuse_existing(place, overwrite=overwrite)
    files = [file for file in find_logs([folder]) if not _is_result(file.path, folder)]
    if not files:
        raise LogError(f"{folder}: the only logs here are in folders of results; give a folder of logs")
    look = survey(folder, files, columns, jobs, progress)
    result = new_campaign(look, files, place, _ask if _is_on_a_terminal() else None)
    if not result.questions:  # something serves now, or nothing ever will
        placed = [of_kind for kinds in (look.placed, *look.forces.values()) for of_kind in kinds.values() if of_kind]
        require_usable(placed, look.not_used, len(files), strict=False)
    pages = run_pages([run for of_file in look.runs.values() for run in of_file]) if figure_formats else {}
    if not pages:
        write_whole(place, result.text)
        return result
    logs = [Input(file.name, file.source) for file in files if has_bytes(file)]
    made_of: dict[str, Any] = {"command": "init", "options": {}, "inputs": logs, "seed": None}
    with result_folder(result.pictures, **made_of, overwrite=overwrite) as pictures:
        save_figures(pictures, pages, figure_formats)
        write_whole(place, result.text)
    return replace(result, pages=tuple(pages))


def _is_result(path: Path, folder: Path) -> bool:
    """Whether a table lies in a folder of results: of any command but those that make logs."""
    from automarine_cli.pipeline.results_folder import MANIFEST, manifest_of

    above = [place for place in path.parents if place == folder or folder in place.parents]
    manifests = (manifest_of(place) for place in above if (place / MANIFEST).is_file())
    return any(manifest is not None and manifest.command not in MAKE_LOGS for manifest in manifests)


def _is_on_a_terminal() -> bool:
    ctx = click.get_current_context(silent=True)
    quiet = ctx is None or ctx.params.get("as_json") or verbosity_level() < 0
    return not quiet and sys.stdin.isatty() and sys.stdout.isatty()


def _ask(key: str, comment: str) -> str:
    click.echo(folded(comment, width_of(sys.stdout)))
    answer: str = click.prompt(f"{key} (Enter: later)", default="", show_default=False)
    click.echo()
    return answer


def _then(result: "NewCampaign") -> str:
    place = shlex.quote(str(result.place))
    first = f"write the answers in {place}, then " if result.questions else ""
    return f"{first}automarine run {place} -o results"


init.then = _then
