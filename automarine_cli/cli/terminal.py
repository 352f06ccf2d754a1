"""What a terminal is told apart from a pipe by: its width, colours, and an error that stands out."""

import os
import re
import sys
import textwrap
from typing import IO, Any, TextIO

import click

NARROWEST = 30
LABEL = re.compile(r"\S.*? {2,}(?=\S)")
TIED = "\N{NO-BREAK SPACE}"  # a number stays with its per cent


def width_of(stream: TextIO) -> int | None:
    """Columns of the terminal behind a stream; None for a pipe or a file, where lines are as long as they are."""
    if not _is_terminal(stream):
        return None
    try:
        asked = int(os.environ.get("COLUMNS", "0"))
        return max(NARROWEST, asked if asked > 0 else os.get_terminal_size(stream.fileno()).columns)
    except (ValueError, OSError):
        return 80


def folded(sentence: str, width: int | None) -> str:
    """Sentences on as many lines as each needs, the later ones indented below where its text begins; unchanged for
    a pipe."""
    if width is None:
        return sentence
    lines = sentence.split("\n")
    return "\n".join(_filled(line, width, labelled=len(lines) > 1) for line in lines)


def _filled(line: str, width: int, *, labelled: bool) -> str:
    """One line; where it may begin with a label, `label    text`, its text stays right of that."""
    if len(line) <= width:
        return line
    label = LABEL.match(line) if labelled else None
    indent = " " * len(label[0]) if label else "  "
    tied = line.replace(" %", TIED + "%")
    filled = textwrap.fill(tied, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)
    return filled.replace(TIED, " ")


def coloured(text: str, stream: TextIO, colour: str, **style: Any) -> str:
    """The text in a colour where the stream is a terminal that may show colours; else as it is."""
    return click.style(text, fg=colour, **style) if _may_colour(stream) else text


def painted(table: str, stream: TextIO) -> str:
    """A table as text with its title bold and its rules dim, on a terminal that may show colours."""
    if not _may_colour(stream):
        return table
    lines = table.split("\n")
    titled = len(lines) > 1 and lines[1] == ""
    shown = [click.style(line, dim=True) if line and not line.strip("-") else line for line in lines]
    return "\n".join([click.style(lines[0], bold=True), *shown[1:]] if titled else shown)


class Refusal(click.ClickException):
    """What is refused, in one sentence; `Error:` is red on a terminal."""

    def show(self, file: IO[Any] | None = None) -> None:
        """Print the sentence on standard error, folded on a terminal."""
        said = folded(f"Error: {self.format_message()}", width_of(sys.stderr))
        head = coloured("Error:", sys.stderr, "red", bold=True)
        click.echo(f"{head}{said.removeprefix('Error:')}", file=file, err=file is None)


class WrongUsage(click.UsageError):
    """A slip in the command line: what it is, how the command is used, an example, where the options are."""

    @classmethod
    def of(cls, error: click.UsageError) -> "WrongUsage":
        """The same slip, to be told in our way."""
        return error if isinstance(error, cls) else cls(error.format_message(), error.ctx)

    def show(self, file: IO[Any] | None = None) -> None:
        """Print it on standard error."""
        lines = [f"{coloured('Error:', sys.stderr, 'red', bold=True)} {self.format_message()}"]
        if self.ctx is not None:
            path = self.ctx.command_path
            lines.append(self.ctx.get_usage())
            own = [line for line in examples(self.ctx.command) if line.startswith(path)]
            lines += [f"Example: {line}" for line in own[:1]]
            lines.append(f"All options: {path} --help")
        click.echo("\n".join(lines), file=file, err=file is None)


def examples(command: click.Command) -> list[str]:
    """The lines of a help text that may be copied."""
    tail = (command.help or "").partition("Example:")[2]
    lines = [line.strip() for line in tail.splitlines()]
    return [line for line in lines if line.startswith("automarine ")]


def versions(ctx: click.Context, param: click.Parameter, asked: bool) -> None:
    """Print the versions of automarine and of every library below it, none of which is imported for that."""
    if not asked or ctx.resilient_parsing:
        return
    from automarine_cli.pipeline.manifest import versions_here

    found = versions_here()
    click.echo(f"automarine, version {found.pop('automarine')}")
    click.echo(", ".join(f"{name} {version}" for name, version in found.items()))
    ctx.exit()


def _is_terminal(stream: TextIO) -> bool:
    try:
        return stream.isatty()
    except (ValueError, AttributeError):
        return False


def _may_colour(stream: TextIO) -> bool:
    """See no-color.org: any value of NO_COLOR but the empty one turns colours off."""
    return _is_terminal(stream) and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"
