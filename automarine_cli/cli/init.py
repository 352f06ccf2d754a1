"""`automarine init`: a folder in, one workflow call, a campaign file and its questions out."""

import sys
from pathlib import Path
from typing import Any

import click

from automarine_cli.cli import options
from automarine_cli.commands.terminal import folded, verbosity_level, width_of


@click.command("init", short_help="Look at a folder of logs and write a campaign file.")
@click.argument("folder", metavar="[DIR]", default=".", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option(
    "-o", "--out", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE",
    help="The campaign file to write.  [default: DIR/campaign.toml]",
)  # fmt: skip
@options.columns_option
@options.overwrite_option
@options.jobs_option
@options.json_option
@options.verbosity
def init(**given: Any) -> object:
    """Look at the logs in DIR (by default here) and write a commented campaign.toml for `automarine run`.

    It says which logs are thruster tests, step runs, manoeuvres and validation runs, and which column holds what,
    in which unit, with the range that was seen. Where name and range do not settle it, it asks: on a terminal at
    once; in a pipe, or where you only press Enter, the value in the file is "?", and `automarine run` takes the file
    when you have written the answer in its place. What --columns says is not asked.

    \b
    Example:
      automarine init sample_runs -o out/campaign.toml
    """
    from automarine_cli.workflows.init import NAME
    from automarine_cli.workflows.init import init as command

    asking = sys.stdin.isatty() and sys.stdout.isatty() and not given["as_json"] and verbosity_level() >= 0
    result = options.perform_one(command, {**given, "ask": _ask if asking else None})
    if not given["as_json"] and verbosity_level() >= 0:
        place = given["folder"] / NAME if given["out"] is None else given["out"]
        first = "Answer the questions in it, then: " if result.questions else "Next: "
        said = f"Written: {place}. {first}automarine run {place} -o results"
        click.echo(folded(said, width_of(sys.stdout)))
    return result


def _ask(key: str, comment: str) -> str:
    """The answer to one question, "" to leave it open."""
    click.echo(folded(comment, width_of(sys.stdout)))
    answer: str = click.prompt(f"{key} (Enter: later)", default="", show_default=False)
    click.echo()
    return answer
