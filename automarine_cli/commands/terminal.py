"""What a command prints: answers on standard output; progress, warnings and refusals on standard error."""

import os
import re
import sys
import textwrap
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import IO, Any, TextIO

import click

from automarine_cli.pipeline.parallel import Progress, silent

MAX_LISTED_RUNS = 8  # runs set aside that are listed one by one without -v
BAR_FROM_S = 1.0  # work shorter than this shows no bar
LINE_EVERY_S = 15.0  # between two lines on work that lasts, in a pipe
NARROWEST = 30
LABEL = re.compile(r"\S.*? {2,}(?=\S)")
TIED = "\N{NO-BREAK SPACE}"  # a number stays with its per cent


def width_of(stream: TextIO) -> int | None:
    """Columns of the terminal behind a stream; None for a pipe or a file, where lines are as long as they are."""
    if not _is_terminal(stream):
        return None
    try:
        columns = max(int(os.environ.get("COLUMNS", "0")), 0) or os.get_terminal_size(stream.fileno()).columns
    except (ValueError, OSError):
        columns = 0
    return max(NARROWEST, columns or 80)  # a serial console or a container says 0


def folded(sentence: str, width: int | None) -> str:
    """Sentences on as many lines as each needs, the later ones indented below where its text begins; unchanged for
    a pipe."""
    if width is None:
        return sentence
    lines, filled = sentence.split("\n"), list[str]()
    for line in lines:
        # where a line of several begins with a label, `label    text`, its text stays right of that
        label = LABEL.match(line) if len(lines) > 1 else None
        text = textwrap.TextWrapper(width, break_long_words=False, break_on_hyphens=False)
        text.subsequent_indent = " " * len(label[0]) if label else "  "
        tied = line.replace(" %", TIED + "%")
        filled.append(text.fill(tied).replace(TIED, " ") if len(line) > width else line)
    return "\n".join(filled)


def coloured(text: str, stream: TextIO, colour: str, **style: Any) -> str:
    """The text in a colour where the stream is a terminal that may show colours; else as it is."""
    return click.style(text, fg=colour, **style) if _may_colour(stream) else text


def marked(word: str, sentence: str, colour: str, **style: Any) -> str:
    """A sentence for standard error behind a coloured word."""
    return coloured(word, sys.stderr, colour, **style) + folded(f"{word} {sentence}", width_of(sys.stderr))[len(word) :]


def painted(table: str, stream: TextIO) -> str:
    """A table as text with its title bold and its rules dim, on a terminal that may show colours."""
    if not _may_colour(stream):
        return table
    lines = table.split("\n")
    titled = len(lines) > 1 and lines[1] == ""
    styled = [click.style(line, dim=True) if line and not line.strip("-") else line for line in lines]
    return "\n".join([click.style(lines[0], bold=True), *styled[1:]] if titled else styled)


class RefusedCommand(click.ClickException):
    """What is refused, in one sentence; `Error:` is red on a terminal."""

    def show(self, file: IO[Any] | None = None) -> None:
        click.echo(marked("Error:", self.format_message(), "red", bold=True), file=file, err=file is None)


class WrongUsage(click.UsageError):
    """A slip in the command line: what it is, how the command is used, an example, where the options are."""

    @classmethod
    def of(cls, error: click.UsageError) -> "WrongUsage":
        return error if isinstance(error, cls) else cls(error.format_message(), error.ctx)

    def show(self, file: IO[Any] | None = None) -> None:
        lines = [f"{coloured('Error:', sys.stderr, 'red', bold=True)} {self.format_message()}"]
        if self.ctx is not None:
            path = self.ctx.command_path
            lines.append(self.ctx.get_usage())
            lines += [f"Example: {line}" for line in examples(self.ctx.command) if line.startswith(path)][:1]
            lines.append(f"All options: {path} --help")
        click.echo("\n".join(lines), file=file, err=file is None)


def examples(command: click.Command) -> list[str]:
    tail = re.sub(r"\s*\\\n\s*", " ", (command.help or "").partition("Example:")[2])
    return [line for line in map(str.strip, tail.splitlines()) if line.startswith("automarine ")]


def versions(ctx: click.Context, param: click.Parameter, requested: bool) -> None:
    """Print the versions of automarine and of every library below it, none of which is imported for that."""
    if not requested or ctx.resilient_parsing:
        return
    from automarine_cli.pipeline.results_folder import versions_here

    installed = versions_here()
    click.echo(f"automarine, version {installed.pop('automarine')}")
    click.echo(", ".join(f"{name} {version}" for name, version in installed.items()))
    ctx.exit()


def _is_terminal(stream: TextIO) -> bool:
    try:
        return stream.isatty()
    except (ValueError, AttributeError):
        return False


def _may_colour(stream: TextIO) -> bool:
    """See no-color.org: any value of NO_COLOR but the empty one turns colours off."""
    return _is_terminal(stream) and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"


def _count_verbosity(ctx: click.Context, param: click.Parameter, value: int) -> None:
    step = value if param.name == "verbose" else -value
    ctx.meta["automarine.verbosity"] = ctx.meta.get("automarine.verbosity", 0) + step


def verbosity(function: Callable[..., Any]) -> Callable[..., Any]:
    """-v and -q; kept in the context (see `verbosity_level`), not handed to the command."""
    quiet = click.option(
        "-q", "--quiet", count=True, expose_value=False, callback=_count_verbosity,
        help="Print the answer alone; -qq prints errors only.",
    )  # fmt: skip
    verbose = click.option(
        "-v", "--verbose", count=True, expose_value=False, callback=_count_verbosity,
        help="Print more details; -vv adds tracebacks.",
    )  # fmt: skip
    return quiet(verbose(function))


def verbosity_level() -> int:
    """-2 with -qq, -1 with -q, 0, 1 with -v, 2 with -vv."""
    ctx = click.get_current_context(silent=True)
    return 0 if ctx is None else ctx.meta.get("automarine.verbosity", 0)


class Bar:
    """A progress bar on standard error that comes only when work takes its time, and leaves no trace; a stage that
    begins in its middle goes on with something long, and comes at once."""

    def __init__(self) -> None:
        self._stage = ""
        self._since = 0.0
        self._drawn = 0.0

    def __call__(self, stage: str, done: int, total: int) -> None:
        if total == 0:
            self.clear()
            _sentence(stage)
            return
        now = time.monotonic()
        if stage != self._stage:
            self.clear()
            self._stage, self._since = stage, now - BAR_FROM_S if done > 0 else now
        if done >= total:
            self.clear()
        elif now - self._since >= BAR_FROM_S and now - self._drawn >= 0.1:
            width = min(30, max(5, (width_of(sys.stderr) or 80) - len(stage) - 20))
            filled = width * done // total
            bar = f"[{'#' * filled}{'.' * (width - filled)}]"
            click.echo(f"\r\x1b[K{stage} {bar} {done}/{total}", err=True, nl=False)
            self._drawn = now

    def clear(self) -> None:
        if self._drawn:
            click.echo("\r\x1b[K", err=True, nl=False)
            self._drawn = 0.0


class Lines:
    """Lines for a pipe: each finished stage; or how far work that lasts is, some time after the line before, and the
    end of each stage that lasted."""

    def __init__(self, stages: bool) -> None:
        self._stages, self._since, self._unfinished = stages, time.monotonic(), ""

    def __call__(self, stage: str, done: int, total: int) -> None:
        lasts = not self._stages and time.monotonic() - self._since >= LINE_EVERY_S
        if total == 0:
            _sentence(stage)
        elif done >= total and (self._stages or lasts or stage == self._unfinished):
            click.echo(f"{stage}: {total}", err=True)
        elif lasts:
            click.echo(f"{stage}: {done} of {total}", err=True)
            self._unfinished = stage
        if lasts and total:
            self._since = time.monotonic()


def terminal_progress() -> Progress:
    """A bar if standard error is a terminal; with -v a line for each finished stage; else how far long work is."""
    level = verbosity_level()
    if level < 0:
        return silent
    if level > 0 or not sys.stderr.isatty():
        return Lines(stages=level > 0)
    bar = Bar()
    ctx = click.get_current_context(silent=True)
    if ctx is not None:
        ctx.call_on_close(bar.clear)
    return bar


def _sentence(text: str) -> None:
    click.echo(f"{text[0].upper()}{text[1:]}.", err=True)


def echo_set_aside(runs: Sequence[Mapping[str, str]]) -> None:
    """Count and name on standard error the runs left out, as a result file has them. A reason that many runs share is
    said once; with -v every run has its line."""
    if not runs or verbosity_level() < 0:
        return
    click.echo(coloured(f"Set aside: {len(runs)} run{'s' if len(runs) > 1 else ''}", sys.stderr, "yellow"), err=True)
    alike: dict[object, list[Mapping[str, str]]] = {}
    for i, run in enumerate(runs):
        alike.setdefault(i if verbosity_level() > 0 else run["why"], []).append(run)
    groups = list(alike.values())[: None if verbosity_level() > 0 else MAX_LISTED_RUNS]
    width = width_of(sys.stderr)
    for first, *more in groups:
        name = first["file"] if first["run"] in ("", first["file"]) else f"{first['file']}, run {first['run']}"
        name += f", and {len(more)} more" if more else ""
        line = folded(f"{name}: {first['why']}", width and width - 2)
        click.echo("  " + line.replace("\n", "\n  "), err=True)
    unlisted = len(runs) - sum(map(len, groups))
    if unlisted:
        click.echo(f"  and {unlisted} more (-v lists all)", err=True)
    elif len(groups) < len(runs):
        click.echo("  (-v lists all)", err=True)


def echo_warnings(warnings: Iterable[str]) -> None:
    """A line on standard error for each thing that could not be made, also with -q."""
    for warning in warnings:
        click.echo(marked("Warning:", warning, "yellow"), err=True)


def echo_result(
    result: Any, *, as_json: bool, out: Path | None = None, answer: str = "", tables: Sequence[Any] = (),
    files: Sequence[str] = (), saves: bool = True, then: str = "",
) -> None:  # fmt: skip
    """The shared tail of all commands. Runs set aside and the warnings in the manifest in `out` go to standard error.
    With `as_json` the result file's content is all there is on standard output; otherwise the `answer`, which is all
    with -q, `tables` (or sentences), where `files` are, or how to keep them, where a command `saves` them, and what to
    do `then`."""
    from automarine_cli.pipeline.results_folder import manifest_of

    content = result.to_json()
    echo_set_aside(content.get("runs", {}).get("set_aside", ()))
    manifest = None if out is None else manifest_of(out)
    echo_warnings(manifest.warnings if manifest else ())
    if as_json:
        from automarine_cli.pipeline.records import json_text

        click.echo(json_text(content), nl=False)
        return
    width = width_of(sys.stdout)
    if verbosity_level() < 0:
        if answer and verbosity_level() == -1:
            click.echo(folded(answer, width))
        return
    tables = [*filter(None, [answer]), *tables]
    for i, table in enumerate(tables):
        if isinstance(table, str):
            click.echo(folded(table, width))
        else:
            click.echo(painted(table.to_text(width, full=verbosity_level() > 0).rstrip("\n"), sys.stdout))
        last = i + 1 == len(tables) and out is None and not saves and not then
        if not last and not (isinstance(table, str) and i + 1 < len(tables) and isinstance(tables[i + 1], str)):
            click.echo()  # sentences stand together, everything else apart
    if out is not None:
        # a name with a blank tells of several files
        is_folder = out.is_dir()
        there = [n for n in files if not is_folder or " " in n or any(out.glob(n.replace("RUN", "*").rstrip("/")))]
        listed = f": {', '.join(there)}" if there else ""
        click.echo(folded(f"Results are in {out}{listed}", width))
    elif saves:
        click.echo("No files were written; use -o DIR to save the results.")
    if then:
        click.echo(f"Next: {then}")  # not folded: it is copied


def end_with(ctx: click.Context, refusals: list[str]) -> None:
    """Status 1, and each refusal in a line of its own, if there are any."""
    for refusal in refusals:
        click.echo(f"Error: {refusal}", err=True)
    if refusals:
        click.echo("Correct that and run the same command again: finished steps are reused.", err=True)
        ctx.exit(1)
