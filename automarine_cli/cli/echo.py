"""What a command says: progress and runs set aside on standard error, tables or JSON on standard output."""

import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import click

from automarine_cli.cli.terminal import coloured, folded, painted, width_of
from automarine_cli.pipeline.progress import Progress, silent

if TYPE_CHECKING:
    from automarine_cli.workflows.run import News

SHOWN = 8  # runs set aside that are listed one by one without -v
PATIENCE_S = 1.0  # work shorter than this shows no bar


class Result(Protocol):
    """What every workflow returns: a frozen dataclass with the result file's content."""

    def to_json(self) -> dict[str, Any]:
        """The result file's content."""
        ...


class Printable(Protocol):
    """What goes onto the terminal: a `report.tables.Table`."""

    def to_text(self, width: int | None = None) -> str:
        """Lines for a terminal of that width (None: as wide as they are)."""
        ...


def verbosity_level() -> int:
    """-1 with -q, 0, 1 with -v, 2 with -vv."""
    ctx = click.get_current_context(silent=True)
    return 0 if ctx is None else ctx.meta.get("automarine.verbosity", 0)


class Bar:
    """A progress bar on standard error that comes only when work takes its time, and leaves no trace."""

    def __init__(self) -> None:
        self.whole = ""  # how far everything is, in front of how far the stage is
        self._stage = ""
        self._since = 0.0
        self._drawn = 0.0

    def __call__(self, stage: str, done: int, total: int) -> None:
        if total == 0:
            self.clear()
            _sentence(stage, done, total)
            return
        now = time.monotonic()
        if stage != self._stage:
            self.clear_stage()
            self._stage, self._since = stage, now
        if done >= total:
            self.clear_stage()
        elif now - self._since >= PATIENCE_S and now - self._drawn >= 0.1:
            said = f"{self.whole}{stage}"
            width = min(30, max(5, (width_of(sys.stderr) or 80) - len(said) - 20))
            click.echo(f"\r\x1b[K{said} {strip(done, total, width)} {done}/{total}", err=True, nl=False)
            self._drawn = now

    def show(self, whole: str) -> None:
        """Say at once how far everything is; it stays until something else is drawn or all is cleared."""
        self.clear()
        self.whole = whole
        click.echo(f"\r\x1b[K{whole}", err=True, nl=False)
        self._drawn = time.monotonic()

    def clear_stage(self) -> None:
        """Take the stage away; how far everything is comes back."""
        self.clear()
        if self.whole:
            self.show(self.whole)

    def clear(self) -> None:
        """Take the bar away."""
        if self._drawn:
            click.echo("\r\x1b[K", err=True, nl=False)
            self._drawn = 0.0


def strip(done: int, total: int, width: int) -> str:
    """`[####......]`, `width` characters between the brackets."""
    filled = width * done // max(total, 1)
    return f"[{'#' * filled}{'.' * (width - filled)}]"


class CampaignTeller:
    """Tells on standard error how a campaign goes: a bar for the whole and the step on a terminal, in a pipe a line for
    each step with its time."""

    def __init__(self) -> None:
        self.progress = terminal_progress()
        self._since = time.monotonic()

    def tell(self, news: "News") -> None:
        """A step starts or is over."""
        bar = self.progress if isinstance(self.progress, Bar) else None
        if bar is not None:
            bar.clear()
            bar.whole = ""
        over = news.did in ("made", "refused")
        if verbosity_level() > 0 or (bar is not None and over):
            why = f" ({news.why})" if news.why else ""
            click.echo(f"{news.number}/{news.total} {news.step}: {news.did}{why}", err=True)
        elif verbosity_level() == 0 and news.did != "starts":
            took = f", {time.monotonic() - self._since:.0f} s" if over else ""
            click.echo(f"{news.number}/{news.total} {news.step}: {news.did}{took}", err=True)
        self._since = time.monotonic()
        if bar is not None and news.did == "starts":
            bar.show(f"{strip(news.number - 1, news.total, 12)} {news.number}/{news.total} {news.step} ")


def terminal_progress(quiet: bool | None = None) -> Progress:
    """A bar if standard error is a terminal; with -v a line for each finished stage; else what will take minutes."""
    level = verbosity_level()
    if quiet or (quiet is None and level < 0):
        return silent
    if level > 0:
        return _stage_lines
    if not sys.stderr.isatty():
        return _sentence
    bar = Bar()
    ctx = click.get_current_context(silent=True)
    if ctx is not None:
        ctx.call_on_close(bar.clear)
    return bar


def _sentence(stage: str, done: int, total: int) -> None:
    if total == 0:
        click.echo(f"{stage[0].upper()}{stage[1:]}.", err=True)


def _stage_lines(stage: str, done: int, total: int) -> None:
    _sentence(stage, done, total)
    if done >= total > 0:
        click.echo(f"{stage}: {total}", err=True)


def echo_set_aside(runs: Sequence[Mapping[str, str]]) -> None:
    """Count and name on standard error the runs left out, as a result file has them.

    A reason that many runs share is said once; with -v every run has its line.
    """
    if not runs or verbosity_level() < 0:
        return
    head = f"Set aside: {len(runs)} run{'s' if len(runs) > 1 else ''}"
    click.echo(coloured(head, sys.stderr, "yellow"), err=True)
    alike: dict[object, list[Mapping[str, str]]] = {}
    for i, run in enumerate(runs):
        alike.setdefault(i if verbosity_level() > 0 else run["why"], []).append(run)
    shown = list(alike.values()) if verbosity_level() > 0 else list(alike.values())[:SHOWN]
    width = width_of(sys.stderr)
    for first, *others in shown:
        name = first["file"] if first["run"] in ("", first["file"]) else f"{first['file']}, run {first['run']}"
        name += f", and {len(others)} more" if others else ""
        line = folded(f"{name}: {first['why']}", width and width - 2)
        click.echo("  " + line.replace("\n", "\n  "), err=True)
    left = len(runs) - sum(map(len, shown))
    if left:
        click.echo(f"  and {left} more (-v lists all)", err=True)
    elif len(shown) < len(runs):
        click.echo("  (-v lists all)", err=True)


def echo_warnings(warnings: Iterable[str]) -> None:
    """A line on standard error for each thing that could not be made, also with -q."""
    for warning in warnings:
        said = folded(f"Warning: {warning}", width_of(sys.stderr))
        head = coloured("Warning:", sys.stderr, "yellow")
        click.echo(f"{head}{said.removeprefix('Warning:')}", err=True)


def echo_result(
    result: Result,
    *,
    as_json: bool,
    out: Path | None = None,
    tables: Sequence[Printable | str] = (),
    files: Sequence[str] = (),
    keep_hint: str | None = "-o DIR",
    warnings: Sequence[str] | None = None,
) -> None:
    """The shared tail of all commands.

    Runs set aside go to standard error, and `warnings` (None: those in the manifest in `out`). With `as_json` the
    result file's content is all there is on standard output; otherwise `tables` (or sentences), then where `files`
    are, or how to keep them (`keep_hint`; None where a command has nothing to write).
    """
    content = result.to_json()
    echo_set_aside(content.get("runs", {}).get("set_aside", ()))
    echo_warnings(_warnings_in(out) if warnings is None else warnings)
    if as_json:
        from automarine_cli.pipeline.records import json_text

        click.echo(json_text(content), nl=False)
        return
    if verbosity_level() < 0:
        return
    width = width_of(sys.stdout)
    for i, table in enumerate(tables):
        if isinstance(table, str):
            click.echo(folded(table, width))
        else:
            click.echo(painted(table.to_text(width).rstrip("\n"), sys.stdout))
        last = i + 1 == len(tables) and out is None and keep_hint is None
        if not last and not (isinstance(table, str) and i + 1 < len(tables) and isinstance(tables[i + 1], str)):
            click.echo()  # sentences stand together, everything else apart
    if out is not None:
        # a name with a blank tells of several files
        told = out.is_dir()
        there = [n for n in files if not told or " " in n or any(out.glob(n.replace("RUN", "*").rstrip("/")))]
        listed = f": {', '.join(there)}" if there else ""
        click.echo(folded(f"Results are in {out}{listed}", width))
    elif keep_hint is not None:
        click.echo(f"No files were written; use {keep_hint} to save the results.")


def _warnings_in(out: Path | None) -> Sequence[str]:
    """What the manifest of a folder of results warns of."""
    from automarine_cli.pipeline.manifest import manifest_of

    manifest = None if out is None else manifest_of(out)
    return () if manifest is None else manifest.warnings


def end_with(ctx: click.Context, refusals: list[str]) -> None:
    """Status 1, and each refusal in a line of its own, if there are any."""
    for refusal in refusals:
        click.echo(f"Error: {refusal}", err=True)
    if refusals:
        click.echo("Correct that and run the same command again: finished steps are reused.", err=True)
        ctx.exit(1)
