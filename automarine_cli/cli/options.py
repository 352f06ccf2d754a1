"""The options and arguments that commands share, as named decorators; how they end is in `echo`."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from automarine_cli.cli.echo import echo_result, echo_set_aside, terminal_progress, verbosity_level

__all__ = [
    "FILE",
    "arm_option",
    "channels_option",
    "cluster_option",
    "columns_option",
    "echo_result",
    "echo_set_aside",
    "fit_options",
    "fit_to_option",
    "inputs_option",
    "jobs_option",
    "json_option",
    "logs_argument",
    "model_option",
    "names_in",
    "out_option",
    "overwrite_option",
    "seed_option",
    "strict_option",
    "tail_option",
    "terminal_progress",
    "thrusters_option",
    "verbosity",
    "verbosity_level",
    "with_option",
]

Function = TypeVar("Function", bound=Callable[..., Any])

FILE = click.Path(exists=True, dir_okay=False, path_type=Path)


def _count_verbosity(ctx: click.Context, param: click.Parameter, value: int) -> None:
    step = value if param.name == "verbose" else -value
    ctx.meta["automarine.verbosity"] = ctx.meta.get("automarine.verbosity", 0) + step


def _finite(ctx: click.Context, param: click.Parameter, value: float | None) -> float | None:
    if value is not None and not math.isfinite(value):
        raise click.BadParameter(f"{value} is no finite number; give one")
    return value


def verbosity(function: Function) -> Function:
    """-v and -q; kept in the context (see `verbosity_level`), not handed to the command."""
    quiet = click.option(
        "-q",
        "--quiet",
        count=True,
        expose_value=False,
        callback=_count_verbosity,
        help="Say only what went wrong.",
    )
    verbose = click.option(
        "-v", "--verbose", count=True, expose_value=False, callback=_count_verbosity,
        help="Say more; twice shows where a defect is.",
    )  # fmt: skip
    return quiet(verbose(function))


logs_argument = click.argument(
    "logs", nargs=-1, required=True, type=click.Path(readable=False), metavar="LOG..."
)
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
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    metavar="N",
    help="Seed of everything random.",
)
"""`seed`: int."""

inputs_option = click.option(
    "--inputs", multiple=True, type=click.Path(exists=True, path_type=Path), metavar="FOLDER",
    help="Look for the recorded inputs in this folder and below; may be given again.",
)  # fmt: skip
"""`inputs`: Paths."""

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

fit_to_option = click.option(
    "--fit-to", type=click.Choice(("auto", "half-turns", "whole-runs")), default="auto", show_default=True,
    help="What of the runs is fitted; auto takes half-turns where enough runs have them.",
)  # fmt: skip
"""`fit_to`: one of three words."""


def tail_option(unit: str) -> Callable[[Function], Function]:
    """`tail`: a number in the `unit` that is shown, or None."""
    return click.option(
        "--tail", type=float, callback=_finite, metavar=unit,
        help="Where the tails of the paper's method start; without it where drag and inertia are expected to be off "
        "least.",
    )  # fmt: skip


json_option = click.option(
    "--json", "as_json", is_flag=True, help="Print the result as JSON and nothing else."
)
"""`as_json`: bool."""

strict_option = click.option(
    "--strict", is_flag=True, help="Refuse an unusable run instead of setting it aside."
)
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


with_option = click.option(
    "--with", "with_effects", default="", metavar="EFFECTS",
    help="Effects that the models have beside drag, such as dead-band,input-delay. Fits whole runs, as driven ones.",
)  # fmt: skip
"""`with_effects`: text of names with commas."""


def names_in(text: str) -> tuple[str, ...]:
    """Names with commas between, as an option holds them."""
    return tuple(name.strip() for name in text.split(",") if name.strip())


def fit_options(function: Function) -> Function:
    """What the fits of translations share; their `--fit-to` speaks of steps."""
    steps = click.option(
        "--fit-to", type=click.Choice(("auto", "steps", "whole-runs")), default="auto", show_default=True,
        help="What of the runs is fitted; auto takes steps where there are enough.",
    )  # fmt: skip
    every = (
        logs_argument, columns_option, thrusters_option, steps, tail_option("METRES"), channels_option, with_option,
        out_option, overwrite_option, strict_option, jobs_option, json_option, verbosity,
    )  # fmt: skip
    for one in reversed(every):
        function = one(function)
    return function
