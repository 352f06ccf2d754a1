"""The command group: commands loaded on demand, and every refusal turned into one line and an exit status.

A module in this folder is a command: `fit_yaw.py` is `automarine fit-yaw` and defines one click command.
Nothing in this folder imports numpy at module level; a command's body imports its workflow.
"""

import contextlib
import difflib
import errno
import os
import re
import sys
from importlib import import_module
from pathlib import Path

import click

from automarine_cli.cli.options import verbosity
from automarine_cli.cli.terminal import Refusal, WrongUsage, versions
from automarine_cli.errors import AutomarineError

SHORT_HELP = re.compile(r'^@click\.command\(\s*"[\w-]+",\s*short_help="([^"\n]+)"', re.MULTILINE)
NOT_COMMANDS = ("__init__", "options", "echo", "terminal")


def _modules() -> dict[str, Path]:
    """Name and file of every module that is a command."""
    folders = (Path(place) for place in __path__)
    files = (file for folder in folders for file in folder.glob("*.py"))
    return {file.stem: file for file in files if file.stem not in NOT_COMMANDS}


class CommandFolder(click.Group):
    """Finds its commands as modules of this folder and maps what they raise to the terminal."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of the modules in this folder, dashed, in name order."""
        found = {name.replace("_", "-") for name in _modules()}
        return sorted(found.union(super().list_commands(ctx)))

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The one click command defined in the module of that name."""
        if cmd_name in self.commands or cmd_name not in self.list_commands(ctx):
            return super().get_command(ctx, cmd_name)
        module = import_module(f"{__name__}.{cmd_name.replace('-', '_')}")
        return next(value for value in vars(module).values() if isinstance(value, click.Command))

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The list of commands; what each does is read off its file, for loading them all would take longer."""
        rows = [(name, self._short_help(ctx, name)) for name in self.list_commands(ctx)]
        with formatter.section("Commands"):
            formatter.write_dl(rows)

    def _short_help(self, ctx: click.Context, name: str) -> str:
        file = _modules().get(name.replace("-", "_"))
        written = file and SHORT_HELP.search(file.read_text(encoding="utf-8"))
        if written:
            return written[1]
        command = self.get_command(ctx, name)
        return "" if command is None else command.get_short_help_str(60)

    def invoke(self, ctx: click.Context) -> object:
        """Run the command; 1 for what is refused, 130 for an interrupt, never a traceback without -vv."""
        try:
            return super().invoke(ctx)
        except click.UsageError as slip:
            raise WrongUsage.of(slip) from slip
        except (click.ClickException, click.exceptions.Exit):
            raise
        except (KeyboardInterrupt, click.Abort):
            click.echo("Interrupted; nothing was left half written.", err=True)
            ctx.exit(130)
        except Exception as problem:
            raise self._refusal(ctx, problem) from problem

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """The options of the group itself."""
        try:
            return super().parse_args(ctx, args)
        except click.exceptions.NoArgsIsHelpError:
            raise
        except click.UsageError as slip:
            raise WrongUsage.of(slip) from slip

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The command that is named; for a name that is none, the nearest one is offered."""
        near = difflib.get_close_matches(args[0], names := self.list_commands(ctx), 1)
        if args[0] not in names and not args[0].startswith("-"):
            meant = f"did you mean {near[0]!r}?" if near else f"there are {', '.join(names)}"
            ctx.fail(f"No such command {args[0]!r}; {meant}")
        return super().resolve_command(ctx, args)

    def _refusal(self, ctx: click.Context, problem: Exception) -> click.ClickException:
        """One sentence for what a command raised."""
        if isinstance(problem, AutomarineError):
            return Refusal(str(problem))
        if isinstance(problem, OSError) and problem.errno == errno.EPIPE:
            _forget_stdout()
            ctx.exit(141)  # as if the closed pipe had ended us, which is what shells expect
        if isinstance(problem, MemoryError):
            return Refusal("not enough memory; give fewer logs at a time, or --jobs 1")
        _show_traceback(ctx)
        if isinstance(problem, OSError):
            return Refusal(f"{problem}; check the path, its permissions and the free disk space")
        what = f"{type(problem).__name__}: {problem}".replace("\n", " ")
        return Refusal(f"{what}; this is a bug in automarine, please report it (-vv shows where)")


def _show_traceback(ctx: click.Context) -> None:
    if ctx.meta.get("automarine.verbosity", 0) >= 2:
        import traceback

        click.echo(traceback.format_exc(), err=True, nl=False)


def _forget_stdout() -> None:
    """The reader has gone: whatever is still to be printed goes nowhere, silently."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@click.group(cls=CommandFolder, context_settings={"help_option_names": ["-h", "--help"]})
@verbosity
@click.option(
    "--version", is_flag=True, is_eager=True, expose_value=False, callback=versions,
    help="Show the versions of automarine and its libraries, and exit.",
)  # fmt: skip
def automarine() -> None:
    """From pool logs of an ROV or AUV to its thruster map and yaw model, and to why they disagree.

    With logs of your own begin with `automarine init`, which writes a file for `automarine run`; to look around, with
    the example below. The help of every command ends with an example.

    A LOG is a file (.csv, .csv.gz, .parquet or a vehicle's own), a directory (searched recursively) or a quoted glob.

    \b
    Example:
      automarine check sample_runs/steps
    """


def main() -> None:
    """The command line, from the arguments to the exit status."""
    for library in ("OPENBLAS", "OMP", "MKL"):  # our matrices are small: threads cost more than they bring, and
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")  # sums in another order would be other bytes
    # what an interrupt leaves behind is cleared away by a process of Python's own, without a word
    os.environ.setdefault("PYTHONWARNINGS", "ignore:resource_tracker:UserWarning")
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(AttributeError, ValueError):
            stream.reconfigure(encoding="utf-8", errors="backslashreplace")  # type: ignore[union-attr]
    try:
        automarine(prog_name="automarine")
    finally:
        try:
            if sys.stdout is not None:
                sys.stdout.flush()
        except OSError:
            _forget_stdout()
