"""`guide`: the list of the pages of the guide, or one of them."""

import sys
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import CompletionItem

from automarine_cli.commands import options
from automarine_cli.commands.command import argument, command, option
from automarine_cli.commands.terminal import coloured, echo_result, verbosity_level, width_of

if TYPE_CHECKING:
    from automarine_cli.guide import Contents, Page, Places

PIPE_WIDTH = 100  # columns of a page that no terminal shows
MAX_WIDTH = 110  # columns, beyond which lines are tiring to read
MAX_PLACES = 12  # pages that a search shows


def topics(ctx: click.Context, param: click.Parameter, begun: str) -> list[CompletionItem]:
    from automarine_cli import guide as pages

    return [CompletionItem(name) for name in (*pages.commands(), *pages.pages()) if name.startswith(begun)]


@command("guide", saves=False)
@argument("topic", required=False, metavar="[TOPIC]", shell_complete=topics)
@option("--find", "words", metavar="WORDS", help="Search all pages for these words, or what the guide calls them.")
@options.together(options.as_json, options.verbosity)
def guide(topic: str | None, words: str | None) -> "Contents | Page | Places":
    """Show the guide: a page for each command, and pages about logs, results, the method and how well it works.

    Without TOPIC it lists the pages. A terminal shows a page in its pager, which the variable PAGER selects. In a
    pipe a page is plain text.

    \b
    Example:
      automarine guide logs
      automarine guide --find torque
    """
    from automarine_cli import guide as pages
    from automarine_cli.commands import load, short_help

    if words is not None:
        if topic is not None:
            raise click.UsageError("Give TOPIC or --find, not both; several words to find stand in quotes.")
        return pages.find(words)
    if topic is None:
        return pages.Contents(
            tuple((name, short_help(name)) for name in pages.commands()),
            tuple((name, pages.title(name)) for name in pages.pages()),
        )
    page = pages.page(topic)
    if topic not in pages.commands():
        return page
    formatter, described = click.HelpFormatter(width=_width()), load(topic)
    described.format_options(click.Context(described, help_option_names=["-h", "--help"]), formatter)
    return pages.with_options(page, formatter.getvalue().strip("\n"))


def _width() -> int:
    return min(width_of(sys.stdout) or PIPE_WIDTH, MAX_WIDTH)


def _show(ctx: click.Context, result: Any) -> None:
    from automarine_cli.commands import COMMANDS
    from automarine_cli.guide import Page, Places, groups
    from automarine_cli.guide.text import to_text
    from automarine_cli.report.tables import Table

    if ctx.params["as_json"] or verbosity_level() < 0:
        return
    if isinstance(result, Places):
        rows = [vars(place) for place in result.places[:MAX_PLACES]]
        count = f"Pages with {' or '.join(result.words)}: {len(result.places)}"
        table = Table.of(count if len(rows) == len(result.places) else f"{count}; the first {MAX_PLACES}", rows)
        echo_result(result, as_json=False, tables=(table, "automarine guide TOPIC shows a page."), saves=False)
        return
    if not isinstance(result, Page):
        about = dict((*result.commands, *result.pages))
        topics = groups() | {f"Commands: {title}": list(group) for title, group in COMMANDS.items()}
        tables = [
            Table(title, ("topic", "what it is about"), tuple((topic, about[topic]) for topic in group))
            for title, group in topics.items()
        ]
        echo_result(result, as_json=False, tables=(*tables, "automarine guide TOPIC shows a page."), saves=False)
        return
    text = to_text(result.markdown, _width(), lambda line: coloured(line, sys.stdout, "cyan", bold=True))
    if width_of(sys.stdout) is None:
        click.echo(text, nl=False)
    else:
        click.echo_via_pager(text)


guide.finish = _show
