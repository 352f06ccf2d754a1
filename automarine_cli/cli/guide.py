"""`automarine guide`: a topic or none in, the list of pages or one of them out."""

import sys
import textwrap

import click
from click.shell_completion import CompletionItem

from automarine_cli.cli import options
from automarine_cli.commands.terminal import coloured, echo_result, verbosity_level, width_of

IN_A_PIPE = 100  # columns of a page that no terminal shows
WIDEST = 110  # columns, beyond which lines are tiring to read


def topics(ctx: click.Context, param: click.Parameter, begun: str) -> list[CompletionItem]:
    """The topics that begin so, for the shell."""
    from automarine_cli import guide as pages

    return [CompletionItem(name) for name in (*pages.commands(), *pages.pages()) if name.startswith(begun)]


@click.command("guide", short_help="List the pages of the guide, or show one.")
@click.argument("topic", required=False, metavar="[TOPIC]", shell_complete=topics)
@options.json_option
@options.verbosity
@click.pass_context
def guide(ctx: click.Context, topic: str | None, as_json: bool) -> object:
    """The guide: a page for each command, and pages about logs, results, the method and how well it works.

    Without TOPIC the pages are listed, each with what it is about. A terminal shows a page in its pager (the variable
    PAGER names another one); in a pipe it is plain text.

    \b
    Example:
      automarine guide logs
    """
    from automarine_cli import guide as pages
    from automarine_cli.guide.text import to_text
    from automarine_cli.report.tables import Table

    group = ctx.find_root().command
    assert isinstance(group, click.Group)
    if topic is None:
        known = ((name, group.get_command(ctx, name)) for name in pages.commands())
        result = pages.Contents(
            tuple(pages.Topic(name, command.get_short_help_str(100)) for name, command in known if command),
            tuple(pages.Topic(name, pages.title(name)) for name in pages.pages()),
        )
        tables = [
            Table(title, ("topic", "what it is about"), tuple((one.name, one.about) for one in some))
            for title, some in (("Commands", result.commands), ("More pages", result.pages))
        ]
        said = "automarine guide TOPIC shows a page."
        echo_result(result, as_json=as_json, tables=(*tables, said), keep_hint=None)
        return result
    shown = pages.page(topic)
    command = group.get_command(ctx, topic) if topic in pages.commands() else None
    width = min(width_of(sys.stdout) or IN_A_PIPE, WIDEST)
    if command is not None:
        shown = pages.with_options(shown, _options(ctx, command, width))
    if as_json or verbosity_level() < 0:
        echo_result(shown, as_json=as_json, keep_hint=None)
        return shown
    text = to_text(shown.markdown, width, lambda line: coloured(line, sys.stdout, "cyan", bold=True))
    if width_of(sys.stdout) is None:
        click.echo(text, nl=False)
    else:
        click.echo_via_pager(text)
    return shown


def _options(ctx: click.Context, command: click.Command, width: int) -> str:
    """The list of a command's options, as its --help has it."""
    formatter = click.HelpFormatter(width=width)
    own = click.Context(command, parent=ctx.find_root(), info_name=command.name)
    command.format_options(own, formatter)
    return textwrap.dedent(formatter.getvalue().partition("\n")[2])
