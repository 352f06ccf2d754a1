"""The options and arguments that commands share, as named decorators, and how a command is performed with them."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click
from click.shell_completion import CompletionItem

from automarine_cli.commands.terminal import Result as Printed
from automarine_cli.commands.terminal import echo_result, terminal_progress, verbosity_level

if TYPE_CHECKING:
    from automarine_cli.workflows.command import Command

Function = TypeVar("Function", bound=Callable[..., Any])
Result = TypeVar("Result", bound=Printed)

FILE = click.Path(exists=True, dir_okay=False, path_type=Path)


class OneOf(click.ParamType):
    """One of the names that a registry holds, looked up when one is given: asking for help loads no room."""

    name = "name"

    def __init__(self, names: Callable[[], Iterable[str]]) -> None:
        self.names = names

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """The name. Raises BadParameter for another, with all of them."""
        return click.Choice(tuple(self.names())).convert(value, param, ctx)

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """The names that begin so."""
        return click.Choice(tuple(self.names())).shell_complete(ctx, param, incomplete)


def _count_verbosity(ctx: click.Context, param: click.Parameter, value: int) -> None:
    step = value if param.name == "verbose" else -value
    ctx.meta["automarine.verbosity"] = ctx.meta.get("automarine.verbosity", 0) + step


def _finite(ctx: click.Context, param: click.Parameter, value: float | None) -> float | None:
    if value is not None and not math.isfinite(value):
        raise click.BadParameter(f"{value} is not a finite number; give one")
    return value


def verbosity(function: Function) -> Function:
    """-v and -q; kept in the context (see `verbosity_level`), not handed to the command."""
    quiet = click.option(
        "-q", "--quiet", count=True, expose_value=False, callback=_count_verbosity, help="Print errors only."
    )
    verbose = click.option(
        "-v", "--verbose", count=True, expose_value=False, callback=_count_verbosity,
        help="Print more details; -vv adds tracebacks.",
    )  # fmt: skip
    return quiet(verbose(function))


logs_argument = click.argument("logs", nargs=-1, required=True, type=click.Path(readable=False), metavar="LOG...")
"""`logs`: strings as given; `logs.find_logs` makes files of them."""

columns_option = click.option(
    "--columns", type=FILE, metavar="FILE.toml", help="Map the logs' column names, units and signs."
)
"""`columns`: Path or None."""

out_option = click.option(
    "-o", "--out", type=click.Path(path_type=Path), metavar="DIR", help="Write the results into this folder."
)
"""`out`: Path or None."""

overwrite_option = click.option("--overwrite", is_flag=True, help="Replace results that are there already.")
"""`overwrite`: bool."""

seed_option = click.option(
    "--seed", type=click.IntRange(min=0), default=0, show_default=True, metavar="N", help="Random seed."
)
"""`seed`: int."""

jobs_option = click.option(
    "--jobs", type=click.IntRange(min=1), default=1, show_default=True, metavar="N",
    help="Parallel processes (results do not change).",
)  # fmt: skip
"""`jobs`: int."""

cluster_option = click.option(
    "--cluster", metavar="ADDRESS",
    help="A Dask scheduler, such as tcp://host:8786, whose workers do the work (results do not change).",
)  # fmt: skip
"""`cluster`: address or None."""

json_option = click.option("--json", "as_json", is_flag=True, help="Print the result as JSON and nothing else.")
"""`as_json`: bool."""

strict_option = click.option("--strict", is_flag=True, help="Refuse an unusable run instead of setting it aside.")
"""`strict`: bool."""

model_option = click.option(
    "--model",
    type=FILE,
    required=True,
    metavar="FILE",
    help="A yaw_model.json (or surge, sway, heave) of a fit (for diagnose also a thrusters.json).",
)
"""`model`: Path."""

thrusters_option = click.option(
    "--thrusters",
    type=FILE,
    metavar="FILE",
    help="A thrusters.json: makes the moment of n_port and n_stbd, or the force of these or n_vert.",
)
"""`thrusters`: Path or None."""

arm_option = click.option(
    "--arm", type=click.FloatRange(min=0, min_open=True), callback=_finite, metavar="METRES",
    help="Lever arm of the two thrusters, with --thrusters.",
)  # fmt: skip
"""`arm`: metres or None."""


channels_option = click.option(
    "--channels", default="auto", show_default=True, metavar="WHICH",
    help="Sensors that count: auto (those that agree with the position), position, all, or names with commas.",
)  # fmt: skip
"""`channels`: text, understood by `runs.channels.wanted_channels`."""


def _names(ctx: click.Context, param: click.Parameter, value: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in value.split(",") if name.strip())


with_option = click.option(
    "--with", "with_effects", default="", callback=_names, metavar="EFFECTS",
    help="Effects that the models have beside drag, such as dead-band,input-delay. Fits whole runs, as driven ones.",
)  # fmt: skip
"""`with_effects`: names."""


known_option = click.option(
    "--known", multiple=True, metavar="NAME=VALUE[±STDERR]",
    help="What is known of a parameter beforehand, in the unit of the fit: I_r=915 (exactly) or I_r=915±50; several "
    "with commas, or repeated.",
)  # fmt: skip
"""`known`: texts, understood by `fits.known.Known`."""


def ending(*also: str) -> Callable[[Function], Function]:
    """Where results go and how they are told, with those of strict, seed, jobs and cluster that are named."""
    known = {"strict": strict_option, "seed": seed_option, "jobs": jobs_option, "cluster": cluster_option}
    return _all(out_option, overwrite_option, *(known[name] for name in also), json_option, verbosity)


def fit_options(steps: str, unit: str, *own: Callable[..., Any]) -> Callable[[Function], Function]:
    """What the fits of single motions share: what their `steps` are called, and the `unit` of tails; `own` options are
    told after the columns, those of thrusters among them where some push that way."""
    where = " enough runs have them" if steps == "half-turns" else " there are enough"
    fit_to = click.option(
        "--fit-to", type=click.Choice(("auto", steps, "whole-runs")), default="auto", show_default=True,
        help=f"Part of the runs to fit; auto takes {steps} where{where}.",
    )  # fmt: skip
    tail = click.option(
        "--tail", type=float, callback=_finite, metavar=unit,
        help="Start of the steady tails of the paper's method; by default where the expected error of drag and inertia "
        "is smallest.",
    )  # fmt: skip
    every = (columns_option, *own, fit_to, tail, channels_option, with_option, known_option)
    return _all(logs_argument, *every, ending("strict", "jobs"))


def _all(*decorators: Callable[..., Any]) -> Callable[[Function], Function]:
    """The decorators as one, the first on top."""

    def decorated(function: Function) -> Function:
        for one in reversed(decorators):
            function = one(function)
        return function

    return decorated


def perform_one(command: "Command[Any, Result]", given: Mapping[str, Any], written: str = "") -> Result:
    """The same of a command that writes one file, or none; `written` says where it is."""
    settings = {key: value for key, value in given.items() if key != "as_json"}
    result = command(**{"progress": terminal_progress(), **settings})
    echo_result(result, as_json=given["as_json"], tables=command.says(result), keep_hint=None)
    if written and not given["as_json"] and verbosity_level() >= 0:
        click.echo(written)
    return result


def perform(
    command: "Command[Any, Result]", given: dict[str, Any], warnings: Callable[[Result], Sequence[str]] | None = None
) -> Result:
    """Carry a command out as `given` on the command line, say what it found and where it is; hand that back.

    `warnings` are those of the result, where they are not in the manifest that was written."""
    as_json, out = given.pop("as_json"), given.get("out")
    result = command(**{"progress": terminal_progress(), **given})
    echo_result(
        result, as_json=as_json, out=out, tables=command.says(result), files=command.files(result),
        warnings=None if warnings is None else warnings(result),
    )  # fmt: skip
    return result
