"""What `help()` and the site say of a function of the package: what it does, its settings, and what it returns."""

import inspect
import re
from importlib import import_module

import click

from automarine_cli.commands.command import Command

READS = {
    "": "A new folder.",
    "logs": "Logs, as places or as tables.",
    "file": "A file, or its result.",
    "folders": "Folders of results.",
}
"""What arguments without a help are."""
SHOWN = "Printed, it is what the terminal shows; `to_frame()` is a pandas table, `plot(figure)` a matplotlib figure."


def result_classes(command: Command) -> list[type]:
    """The classes of a command's result, as its function's annotation names them."""
    names = str(inspect.signature(command).return_annotation).split(" | ")
    rooms = [import_module(f"automarine_cli.{name}") for name in (f"report.{command.report}", "exports.export")]
    return [next(vars(room)[name] for room in rooms if name in vars(room)) for name in names]


def python_help(command: Command) -> str:
    """The help of a function in plain text with Markdown's marks; options have the names of settings."""
    flags = {flag: f"`{param.name}`" for param in command.params for flag in param.opts if flag.startswith("--")}
    about = str(command.help).partition("\b")[0].strip()
    settings = [f"- **{param.name}**: {_meaning(param)}" for param in command.own]
    text = "\n".join([about, "", "Settings:", "", *settings])
    text = re.sub(r"--[a-z][a-z-]*", lambda flag: flags.get(flag[0], flag[0]), text)
    return "\n\n".join([text, "Returns:", *map(_result, result_classes(command))])


def _meaning(param: click.Parameter) -> str:
    return str(getattr(param, "help", "") or READS[getattr(param, "reads", "")])


def _result(result: type) -> str:
    first, *remaining = (" ".join(part.split()) for part in (inspect.getdoc(result) or "").split("\n\n"))
    documented = [SHOWN] if hasattr(result, "plot") else []
    return "\n\n".join([f"`{result.__name__}`. {first}", *remaining, *documented])
