"""The options and arguments that commands share, as named decorators."""

import math
from collections.abc import Callable, Iterable
from importlib import import_module
from operator import attrgetter
from pathlib import Path
from typing import Any

import click

from automarine_cli.commands.command import GENERAL, HOLD_OUT, INPUT, OUTPUT, Function, argument, option
from automarine_cli.commands.terminal import verbosity as verbosity

FILE = click.Path(exists=True, dir_okay=False, path_type=Path)


class Finite(click.FloatRange):
    """A finite number within bounds."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number; give one", param, ctx)
        return number


POSITIVE = Finite(min=0, min_open=True)


class Checked(click.ParamType):
    """A value that a function of another room, MODULE:FUNCTION, checks with `more`; imported when a value is given."""

    def __init__(self, place: str, *more: Any, type: click.ParamType = click.STRING) -> None:
        self.place, self.more, self.type, self.name = place, more, type, type.name

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        converted = self.type.convert(value, param, ctx)
        if converted != ():  # no effects ask none of the library
            module, _, function = self.place.partition(":")
            attrgetter(function)(import_module(f"automarine_cli.{module}"))(converted, *self.more)
        return converted


class Names(click.ParamType):
    name = "names"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[str, ...]:
        parts = value.split(",") if isinstance(value, str) else value
        return tuple(part.strip() for part in parts if part.strip())


class Figures(Names):
    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[str, ...]:
        from automarine_cli.report.sections import refuse_unknown

        kinds = () if value == "none" else super().convert(value, param, ctx)
        refuse_unknown(kinds)
        return kinds


class OneOf(click.ParamType):
    """One of the names that a registry holds, looked up when one is given: asking for help loads no room."""

    name = "name"

    def __init__(self, names: Callable[[], Iterable[str]]) -> None:
        self.names = names

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        return click.Choice(tuple(self.names())).convert(value, param, ctx)

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[Any]:
        return click.Choice(tuple(self.names())).shell_complete(ctx, param, incomplete)


logs = argument(
    "logs", nargs=-1, required=True, type=click.Path(readable=False), metavar="LOG...", reads="logs", role="log"
)
hold_out = option(
    "--hold-out", multiple=True, type=click.Path(readable=False), metavar="LOG", reads="logs", role=HOLD_OUT,
    help="A log to hold out from the fit, to test the model on; may be repeated.  [default: a quarter of the runs]",
)  # fmt: skip
columns = option(
    "--columns", type=FILE, metavar="FILE.toml", reads="file", help="Map the logs' column names, units and signs."
)
model = option(
    "--model", type=FILE, required=True, metavar="FILE", reads="file",
    help="The model file of a fit, such as yaw_model.json.",
)  # fmt: skip
thrusters = option(
    "--thrusters", type=FILE, metavar="FILE", reads="file",
    help="A thrusters.json: the map between thruster commands and moment or force.",
)  # fmt: skip
arm = option(
    "--arm", type=POSITIVE, metavar="METRES", group=INPUT, help="Lever arm of the two thrusters of --thrusters."
)
CHANNELS_HELP = "Sensors to use: auto (those that agree with the position), position, all, or names with commas."
channels = option(
    "--channels", default="auto", show_default=True, metavar="WHICH", seldom=True, group=INPUT, help=CHANNELS_HELP
)
known_parameters = option(
    "--known", multiple=True, type=Checked("fits.known:parse_known"), metavar="NAME=VALUE[±STDERR]", seldom=True,
    help="Known parameter, in the unit of the fit: I_r=915 (exactly) or I_r=915±50. Several with commas, or repeated.",
)  # fmt: skip
inputs = option(
    "--inputs", multiple=True, type=click.Path(exists=True, path_type=Path), metavar="DIR", group=INPUT,
    help="Look for the recorded inputs in this folder and below; may be repeated.",
)  # fmt: skip
strict = option("--strict", is_flag=True, group=INPUT, help="Stop at the first unusable run, instead of skipping it.")
seed = option(
    "--seed", type=click.IntRange(min=0), default=0, show_default=True, metavar="N", group=GENERAL, help="Random seed."
)
out = option(
    "-o", "--out", type=click.Path(path_type=Path), metavar="DIR", group=OUTPUT,
    help="Write the results into this folder.",
)  # fmt: skip
overwrite = option("--overwrite", is_flag=True, group=OUTPUT, help="Replace existing results.")
figures = option(
    "--figures", "figure_formats", type=Figures(), default="png", show_default=True, metavar="KINDS", group=OUTPUT,
    help="Kinds of figures, with commas: png, svg, pdf, slides (16:9, 18-point text); or none.",
)  # fmt: skip
jobs = option(
    "--jobs", type=click.IntRange(min=1), default=1, show_default=True, metavar="N", group=GENERAL,
    help="Parallel processes (results do not change).",
)  # fmt: skip
cluster = option(
    "--cluster", metavar="ADDRESS", group=GENERAL,
    help="A Dask scheduler, such as tcp://host:8786, that distributes the work (results do not change).",
)  # fmt: skip
as_json = option("--json", "as_json", is_flag=True, group=OUTPUT, help="Print the result as JSON and nothing else.")


def ending(*options: Callable[[Function], Function], draws: bool = True) -> Callable[[Function], Function]:
    """Where results go and how they are told, with `options` between."""
    if draws:
        options = (figures, *options)
    return together(out, overwrite, *options, as_json, verbosity)


def together(*decorators: Callable[[Function], Function]) -> Callable[[Function], Function]:
    """Several decorators as one, the first on top."""

    def decorated(function: Function) -> Function:
        for decorator in reversed(decorators):
            function = decorator(function)
        return function

    return decorated
