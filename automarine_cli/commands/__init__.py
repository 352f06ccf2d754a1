"""The command line: its commands in groups, loaded when one is asked for, and every refusal as one line.

A command is a file of this folder and a line of `COMMANDS`. Nothing here imports numpy at module level: the body of a
command imports what it needs.
"""

import contextlib
import errno
import os
import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

import click

from automarine_cli.commands.terminal import RefusedCommand, WrongUsage, verbosity, versions
from automarine_cli.errors import AutomarineError

if TYPE_CHECKING:
    from automarine_cli.commands.command import Command

COMMANDS = {
    "Start here": {
        "init": "Look at a folder of logs and write a campaign file.",
        "run": "Run every step of a campaign and report.",
        "report": "Write one report of a campaign's results.",
        "guide": "List the pages of the guide, or show one.",
        "samples": "Copy the sample logs, for the examples.",
    },
    "Logs": {"check": "Inspect logs and list their problems.", "slice": "Cut one long log into runs."},
    "Identify": {
        "fit-thrusters": "Fit a thruster map to bollard tests.",
        "fit-yaw": "Identify drag, inertia and a yaw model.",
        "fit-surge": "Identify drag, mass and a surge model.",
        "fit-sway": "Identify drag, mass and a sway model.",
        "fit-heave": "Identify drag, mass and a heave model.",
        "fit-roll": "Identify period, damping and stability in roll.",
        "fit-pitch": "Identify period, damping and stability in pitch.",
        "fit-planar": "Identify surge, sway and yaw together.",
    },
    "Judge": {
        "validate": "Simulate each log with each model, and compare.",
        "diagnose": "Find and name the effect that a model lacks.",
        "effects": "List the library of effects, or show one.",
        "compare": "Compare results and test their differences.",
    },
    "Use": {
        "predict": "Predict where commands take the vehicle.",
        "plan": "Plan the next campaign.",
        "tune": "Tune a heading controller with a safety margin.",
        "export": "Write a model for a simulator, a controller or a paper.",
        "simulate": "Make a pool campaign with known truth.",
    },
    "On the vehicle": {
        "serve": "On the vehicle: play campaigns, hand out logs.",
        "collect": "On the surface: send a campaign, fetch logs.",
    },
    "Upkeep": {"verify": "Check that results are unchanged."},
}
"""Names and short helps by group, in the order of the help."""
MODULES = {f"fit-{motion}": "fit_motion" for motion in ("yaw", "surge", "sway", "heave", "roll", "pitch", "planar")}
"""Modules that do not have the command's name."""
IN_PYTHON = {"run": "run_campaign", "slice": "slice_log"}
"""Names of commands in Python, where they have others there."""


def short_help(name: str) -> str:
    return next(group[name] for group in COMMANDS.values() if name in group)


def names() -> list[str]:
    return [name for group in COMMANDS.values() for name in group]


def load(name: str) -> "Command":
    from automarine_cli.commands.command import Command

    module = import_module(f"{__name__}.{MODULES.get(name, name.replace('-', '_'))}")
    return next(value for value in vars(module).values() if isinstance(value, Command) and value.name == name)


def python_name(name: str) -> str:
    return IN_PYTHON.get(name, name.replace("-", "_"))


def in_python() -> dict[str, str]:
    """Names of the commands by what they are called in Python."""
    return {python_name(name): name for name in names()}


class CommandGroup(click.Group):
    """Loads the commands of this folder and maps what they raise to the terminal."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return [*names(), *self.commands]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        return self.commands.get(cmd_name) or (load(cmd_name) if cmd_name in names() else None)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        for group, commands in COMMANDS.items():
            with formatter.section(group):
                formatter.write_dl(list(commands.items()))

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
        try:
            return super().parse_args(ctx, args)
        except click.exceptions.NoArgsIsHelpError:
            raise
        except click.UsageError as slip:
            raise WrongUsage.of(slip) from slip

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        names = self.list_commands(ctx)
        if args[0] not in names and not args[0].startswith("-"):
            import difflib

            matches = difflib.get_close_matches(args[0], names, 1)
            meant = f"did you mean {matches[0]!r}?" if matches else f"there are {', '.join(names)}"
            ctx.fail(f"No such command {args[0]!r}; {meant}")
        return super().resolve_command(ctx, args)

    def _refusal(self, ctx: click.Context, problem: Exception) -> click.ClickException:
        if isinstance(problem, AutomarineError):
            return RefusedCommand(str(problem))
        if isinstance(problem, OSError) and problem.errno == errno.EPIPE:
            _forget_stdout()
            ctx.exit(141)  # as if the closed pipe had ended us, which is what shells expect
        if isinstance(problem, MemoryError):
            return RefusedCommand("not enough memory; give fewer logs at a time, or --jobs 1")
        if ctx.meta.get("automarine.verbosity", 0) >= 2:
            import traceback

            click.echo(traceback.format_exc(), err=True, nl=False)
        if isinstance(problem, OSError):
            return RefusedCommand(f"{problem}; check the path, its permissions and the free disk space")
        error = f"{type(problem).__name__}: {problem}".replace("\n", " ")
        return RefusedCommand(f"{error}; this is a bug in automarine, please report it (-vv shows where)")


def _forget_stdout() -> None:
    """The reader has gone: whatever is still to be printed goes nowhere, silently."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@click.group(
    cls=CommandGroup, context_settings={"help_option_names": ["-h", "--help"]},
    epilog="Learn more: automarine COMMAND --help, automarine guide",
)  # fmt: skip
@verbosity
@click.option(
    "--version", is_flag=True, is_eager=True, expose_value=False, callback=versions,
    help="Show the versions of automarine and its libraries, and exit.",
)  # fmt: skip
def automarine() -> None:
    """Identify the dynamics of an ROV, AUV or boat from its logs, and find out what the model misses.

    With logs of your own begin with `automarine init`, which writes a file for `automarine run`. To look around, begin
    with the example below. The help of every command has one above its options.

    A LOG is a file (.csv, .csv.gz, .parquet or a vehicle's own), a directory (searched recursively) or a quoted glob.

    \b
    Example:
      automarine samples
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
