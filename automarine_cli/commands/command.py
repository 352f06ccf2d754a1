"""What a command is: a function whose decorators are its options.

They are declared once: click parses them for the terminal, Python and campaign files give them by name, a manifest
records them. A result is shown and saved by its sections, in the module of `report` that the command names.
"""

import inspect
import re
import shlex
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, Literal

import click
from click.core import augment_usage_errors

from automarine_cli.commands import python_name, short_help
from automarine_cli.commands.terminal import echo_result, terminal_progress, verbosity_level
from automarine_cli.errors import SettingError
from automarine_cli.pipeline.parallel import Progress, silent
from automarine_cli.text import printable

EXECUTION = ("out", "overwrite", "figure_formats", "jobs", "cluster", "as_json")
"""Options that change no result."""
IN_PROCESS = ("overwrite", "jobs", "cluster", "progress")
HOLD_OUT = "hold_out"
INPUT, OUTPUT, GENERAL = "Input", "Output", "General"
"""Groups of options in a help, between the first two those of the command itself."""
PNG = ("png",)
READS = {
    "": "A new folder.",
    "logs": "Logs, as places or as tables.",
    "file": "A file, or its result.",
    "folders": "Folders of results.",
}
"""What arguments without a help are."""
SHOWN = "Printed, it is what the terminal shows; `to_frame()` is a pandas table, `plot(figure)` a matplotlib figure."

Function = Callable[..., Any]


class Setting:
    """What a manifest and Python need to know of an option or argument. `reads` says what it names: logs, one file (or
    the result that would be it), files, of which the manifest lists the inputs under `role`, or folders, of which the
    command's `folder_inputs` does. Only what is `recorded` stands among its options; `seldom` where it is not the
    default. The help lists it in its `group`: what it reads, or the command."""

    def __init__(
        self, *args: Any, reads: Literal["", "logs", "file", "files", "folders"] = "", role: str = "",
        recorded: bool = True, seldom: bool = False, group: str = "", **kwargs: Any,
    ) -> None:  # fmt: skip
        self.reads, self.role, self.recorded, self.seldom = reads, role, recorded, seldom
        self.group = group or (INPUT if reads else "")
        super().__init__(*args, **kwargs)


class _Option(Setting, click.Option):
    pass


class _Argument(Setting, click.Argument):
    pass


option: Callable[..., Callable[[Function], Function]] = partial(click.option, cls=_Option)
argument: Callable[..., Callable[[Function], Function]] = partial(click.argument, cls=_Argument)
"""Declare options and arguments as click does; see `Setting` for what they may have beyond that."""


class Command(click.Command):
    """A command of the terminal that Python calls as a function: the first of its settings alone, others by name. Its
    function gets the settings, and `jobs`, `cluster`, `progress` or `each` where it has parameters of these names;
    `each` is a map on the processes asked for. `report` names the module that shows the result (none: `finish` does
    it). A command that `saves` writes a folder of results with a manifest. `complete` fills in settings that follow
    from others and refuses what contradicts, before logs are looked for; `finish` ends the command on the terminal.
    `then` is what to do next: with {names} of parameters, and not said of a folder {out} where there is none."""

    def __init__(
        self, name: str, function: Function, report: str, then: str, *, saves: bool, by_effects: bool,
        **more: Any,
    ) -> None:  # fmt: skip
        super().__init__(name, help=inspect.getdoc(function), epilog=f"Learn more: automarine guide {name}", **more)
        self.function, self.report = function, report
        self.saves, self.by_effects = saves, by_effects
        self.draws = saves and any(param.name == "figure_formats" for param in self.params)
        self.takes = set(inspect.signature(function).parameters)
        settings = [param for param in self.params if isinstance(param, Setting) and param.name not in EXECUTION]
        self.own = sorted(settings, key=lambda param: not isinstance(param, click.Argument))
        self.names = {str(param.name) for param in self.own}
        self.files = {str(param.name) for param in self.own if param.reads == "file"}
        self.finish: Callable[[click.Context, Any], object] = lambda ctx, result: None
        self.then: Callable[[Any], str] = lambda result: then
        self.folder_inputs: Callable[[Any], list[Any]] = lambda folders: []
        self.complete: Callable[[dict[str, Any]], dict[str, Any]] = lambda settings: settings
        self.__name__ = python_name(name)
        self.__doc__ = function.__doc__

    @property
    def __signature__(self) -> inspect.Signature:
        """Its settings as Python takes them, with types and defaults, then where results go."""
        ctx, by_name = click.Context(self), {param.name for param in self.params}
        settings = [
            inspect.Parameter(
                str(param.name), inspect.Parameter.KEYWORD_ONLY if i else inspect.Parameter.POSITIONAL_OR_KEYWORD,
                default=inspect.Parameter.empty if param.required else _default(ctx, param),
                annotation=_type(ctx, param),
            ) for i, param in enumerate(self.own)
        ]  # fmt: skip
        places: dict[str, tuple[Any, object]] = {
            "out": (str | Path | None, None), "overwrite": (bool, False), "figure_formats": (Sequence[str], PNG),
            "jobs": (int, 1), "cluster": (str | None, None),
        }  # fmt: skip
        settings += [
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)
            for name, (annotation, default) in places.items() if name in by_name
        ]  # fmt: skip
        function = getattr(self.function, "func", self.function)  # of several commands one function, in part
        return inspect.Signature(settings, return_annotation=function.__annotations__.get("return", Any))

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse as click does; of an option called by another name of its own the message tells the right one."""
        try:
            return super().parse_args(ctx, args)
        except click.NoSuchOption as problem:
            name = problem.option_name.lstrip("-").replace("-", "_")
            if (param := next((param for param in self.params if param.name == name), None)) is None:
                raise
            by = f"write {param.metavar} alone" if isinstance(param, click.Argument) else f"write {param.opts[0]}"
            raise click.UsageError(f"No such option '{problem.option_name}'; {by}", ctx) from None

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the options in groups; click's own, which have none, are general."""
        noun = str(self.name).partition("-")[0].capitalize()
        groups: dict[str, list[tuple[str, str]]] = {INPUT: [], noun: [], OUTPUT: [], GENERAL: []}
        for param in self.get_params(ctx):
            if isinstance(param, click.Option) and (record := param.get_help_record(ctx)):
                groups[getattr(param, "group", GENERAL) or noun].append(record)
        for group, records in groups.items():
            if records:
                with formatter.section(group):
                    formatter.write_dl(records)

    def __call__(
        self, *first: object, out: str | Path | None = None, figure_formats: Sequence[str] = PNG, **settings: Any
    ) -> Any:
        """Carry it out from Python: places may be texts, a single log or a table stands for a list of logs, a result
        for the file that it would be."""
        from automarine_cli.report.sections import refuse_unknown

        refuse_unknown(figure_formats)
        if len(first) > 1:
            raise TypeError(f"{len(first)} arguments without a name; give {self.own[0].name} alone so, a list if many")
        settings = {str(self.own[0].name): value for value in first} | settings
        execution: dict[str, Any] = {key: settings.pop(key) for key in IN_PROCESS if key in settings}
        place = None if out is None else Path(out)
        try:
            return self.run(self.settings(settings), out=place, figure_formats=figure_formats, **execution)
        except click.UsageError as problem:
            raise SettingError(problem.format_message()) from problem

    def settings(self, values_by_name: Mapping[str, object]) -> dict[str, Any]:
        """Complete and convert the settings given. Raises TypeError for one that there is not, SettingError for a wrong
        value, LogError for no logs."""
        unknown = [name for name in values_by_name if name not in self.names]
        if unknown:
            raise TypeError(f"{self.__name__} has no setting {unknown[0]!r}; it has {', '.join(sorted(self.names))}")
        ctx = click.Context(self)
        values: dict[str, Any] = {}
        for param in self.own:
            name = str(param.name)
            if name in values_by_name:
                values[name] = _converted(ctx, param, values_by_name[name])
            elif param.required:
                raise TypeError(f"{self.__name__} needs {name}; give it")
            else:
                values[name] = _default(ctx, param)
        values = self.complete(values)
        logs = [str(param.name) for param in self.own if param.reads == "logs"]
        if logs:
            from automarine_cli.logs import find_logs, given_columns, whole_logs

            columns = given_columns(values.get("columns"))
            for name in logs:
                if values[name] or name == "logs":
                    values[name] = whole_logs(find_logs(values[name]), columns)
        return values

    def convert(self, name: str, value: object) -> Any:
        return _converted(click.Context(self), next(param for param in self.own if param.name == name), value)

    def run(
        self, settings: Mapping[str, Any], *, out: Path | None = None, overwrite: bool = False, jobs: int = 1,
        cluster: str | None = None, progress: Progress = silent, figure_formats: Sequence[str] = PNG,
    ) -> Any:  # fmt: skip
        """Make the result of complete settings; save it in the folder `out`, if one is given. Raises OutputError."""
        from automarine_cli.pipeline.parallel import lasting_map

        with ExitStack() as stack:
            folder = None
            if out is not None and self.saves:
                from automarine_cli.pipeline.results_folder import result_folder

                manifest = self.manifest(settings, figure_formats)
                folder = stack.enter_context(result_folder(out, **manifest, overwrite=overwrite))
            map_fn = None
            if "map_fn" in self.takes:
                map_fn = stack.enter_context(lasting_map(jobs, cluster=cluster, progress=progress))
            execution: dict[str, Any] = {
                "jobs": jobs, "cluster": cluster, "progress": progress, "map_fn": map_fn, "out": out,
                "overwrite": overwrite, "figure_formats": figure_formats,
            }  # fmt: skip
            taken_up = {key: value for key, value in execution.items() if key in self.takes}
            if "columns" in settings:
                from automarine_cli.logs import given_columns

                taken_up["columns"] = given_columns(settings["columns"])
            result = self.function(**{**settings, **taken_up})
            if self.report:
                import_module(f"automarine_cli.report.{self.report}")
            if folder is not None:
                from automarine_cli.report.sections import sections

                if map_fn is None:
                    map_fn = stack.enter_context(lasting_map(jobs, progress=progress))
                sections(result).save(folder, figure_formats, map_fn)
        return result

    def manifest(self, settings: Mapping[str, Any], figure_formats: Sequence[str] = PNG) -> dict[str, Any]:
        """Give what a manifest records of complete settings."""
        return {
            "command": str(self.name), "options": self.recorded(settings, figure_formats),
            "inputs": self.inputs(settings), "seed": settings.get("seed"),
        }  # fmt: skip

    def recorded(self, settings: Mapping[str, Any], figure_formats: Sequence[str] = PNG) -> dict[str, object]:
        """Select the options that a manifest records; of many files its inputs tell."""
        options: dict[str, object] = {}
        ctx = click.Context(self)
        for param in self.own:
            name = str(param.name)
            value = settings[name]
            default = param.seldom and value == _default(ctx, param)
            if name == "seed" or not param.recorded or default:
                continue
            if param.reads in ("", "file"):
                options[name] = list(value) if isinstance(value, tuple) else value
            elif param.role == HOLD_OUT:
                options[name] = [file.name for file in value]
        return options | ({"figure_formats": list(figure_formats)} if self.draws else {})

    def inputs(self, settings: Mapping[str, Any]) -> list[Any]:
        """List every file that the settings name, as a manifest does."""
        from automarine_cli.effects import own_files
        from automarine_cli.logs import given_columns, with_joined
        from automarine_cli.pipeline.results_folder import Input
        from automarine_cli.runs.load import has_bytes

        files: list[Input] = []
        for param in self.own:
            value, name = settings[str(param.name)], str(param.name)
            if param.reads == "logs":
                logs = with_joined(value, given_columns(settings.get("columns")))
                files += [Input(file.name, file.source, param.role) for file in logs if has_bytes(file)]
            elif param.reads == "file":
                files += given_as(**{name: value})
            elif param.reads == "files":
                files += [Input(path.name, path, param.role) for path in value]
            elif param.reads == "folders":
                files += self.folder_inputs(value)
            if name == "columns":
                files += given_as(dbc=given_columns(value).database)
        files.sort(key=lambda file: file.role not in ("log", HOLD_OUT))
        effect_files = own_files() if self.by_effects else ()
        return [*files, *(Input(path.name, path, "own_effect") for path in effect_files)]

    def invoke(self, ctx: click.Context) -> Any:
        values = {param.name: ctx.params[param.name] for param in self.own}
        execution = {key: ctx.params[key] for key in EXECUTION if key in ctx.params}
        as_json = execution.pop("as_json", False)
        kinds = execution.get("figure_formats", ())
        with augment_usage_errors(ctx):
            result = self.run(self.settings(values), **execution, progress=terminal_progress())
        then, out = self.then(result), getattr(result, "out", None) or ctx.params.get("out")
        then = "" if out is None and "{out}" in then else then
        for name, value in {**ctx.params, "out": out}.items():
            then = then.replace(f"{{{name}}}", shlex.quote(printable(str(value))))
        answer, tables, files = "", list[Any](), list[str]()
        if self.report:
            from automarine_cli.report.sections import figure_file, sections

            page = sections(result)
            kind = next(iter(kinds), "png")
            answer = page.answer
            files = [figure_file(name[:-4], kind) if name.endswith(".png") else name for name in page.listed]
            tables = [*page.printed, *(page.details if verbosity_level() > 0 else ())]
        echo_result(
            result, as_json=as_json, out=out, answer=answer, tables=tables, files=files, saves=self.saves, then=then
        )
        self.finish(ctx, result)
        return result


def command(
    name: str, *, report: str = "", then: str = "", saves: bool = True, by_effects: bool = False
) -> Callable[[Function], Command]:
    """Make a command of a function, whose decorators below this one are its options; see `Command`. `by_effects`:
    effects of one's own are among its inputs."""

    def decorated(function: Function) -> Command:
        params = list(reversed(getattr(function, "__click_params__", [])))
        return Command(
            name, function, report, then, saves=saves, by_effects=by_effects, params=params,
            short_help=short_help(name),
        )  # fmt: skip

    return decorated


def given_as(**options: object) -> list[Any]:
    """Return those of the options that are files, each with the option's name as its role."""
    from automarine_cli.pipeline.records import Document, Source
    from automarine_cli.pipeline.results_folder import Input

    files = {role: path for role, path in options.items() if isinstance(path, Source)}
    lasting = {role: path for role, path in files.items() if not (isinstance(path, Document) and path.built_in)}
    return [Input(printable(path.name), path, role) for role, path in lasting.items()]


def _default(ctx: click.Context, param: Any) -> Any:
    value = param.get_default(ctx)
    if isinstance(value, str | int | float | tuple):
        return param.type_cast_value(ctx, value)
    return () if param.multiple or param.nargs == -1 else None


def _type(ctx: click.Context, param: Any) -> Any:
    """What a setting may be in Python, for the signature."""
    if param.reads == "logs":
        return str | Path | Sequence[Any]
    default, kinds = _default(ctx, param), {"integer": int, "float": float, "boolean": bool}
    kind: Any = next((kinds[word] for word in kinds if param.type.name.startswith(word)), str)
    if isinstance(param.type, click.Choice):
        kind = Literal[tuple(param.type.choices)]
    elif isinstance(param.type, click.Path):
        kind = str | Path
    elif isinstance(default, tuple) and default:
        kind = type(default[0])
    if isinstance(default, tuple) or param.reads in ("files", "folders"):
        return Sequence[kind]
    return kind if param.required or default is not None else kind | None


def _converted(ctx: click.Context, param: Any, value: object) -> Any:
    """A setting as the function takes it. Raises SettingError for a value of the wrong kind."""
    name = str(param.name)
    if param.reads == "logs":
        from automarine_cli.logs.find import as_logs

        return as_logs(value, name)
    if param.reads == "file":
        if param.nargs == 1:
            return _document(value, name)
        parts: Sequence[object] = value if isinstance(value, tuple | list) else () if value is None else (value,)
        return tuple(_document(part, name) for part in parts)
    if param.reads in ("files", "folders"):
        many = [value] if isinstance(value, str | Path) else value
        return tuple(Path(place) for place in many)  # type: ignore[attr-defined]
    if isinstance(value, str) and (param.multiple or param.nargs == -1):
        value = (value,)
    plain = value if isinstance(value, tuple | list) else (value,)
    if not all(isinstance(part, str | int | float) for part in plain):
        return value
    try:
        return param.type_cast_value(ctx, value)
    except (click.BadParameter, TypeError) as problem:
        why = problem.message if isinstance(problem, click.BadParameter) else f"expected a {param.type.name}"
        raise SettingError(f"{name} is {value!r}; {why}") from None


def _document(value: object, name: str) -> Any:
    """A place, or the file that a result stands for; what we made ourselves is left as it is."""
    from automarine_cli.pipeline.records import Document, Shown

    if isinstance(value, Shown):
        return value.document(name)
    if isinstance(value, str):
        return Path(value)
    if name == "columns" and isinstance(value, Path) and value.is_fifo():  # which can be read but once
        return Document("columns.toml", value.read_bytes())
    if name == "columns" and isinstance(value, Mapping):
        from automarine_cli.logs import ColumnMap, column_rules

        return ColumnMap(columns=column_rules(value, name), source=name)
    is_result = type(value).__module__.startswith("automarine_cli.")
    if value is None or isinstance(value, Path) or is_result:
        return value
    raise SettingError(f"{name}: found {type(value).__name__}, expected a file or a result")


def result_classes(command: Command) -> list[type]:
    """List the classes of a command's result, as its function's annotation names them."""
    names = str(inspect.signature(command).return_annotation).split(" | ")
    rooms = [import_module(f"automarine_cli.{name}") for name in (f"report.{command.report}", "exports.export")]
    return [next(vars(room)[name] for room in rooms if name in vars(room)) for name in names]


def python_help(command: Command) -> str:
    """Write what `help()` and the site say of a function: what it does, its settings by name, what it returns."""
    flags = {flag: f"`{param.name}`" for param in command.params for flag in param.opts if flag.startswith("--")}
    about = str(command.help).partition("\b")[0].strip()
    settings = [
        f"- **{param.name}**: {getattr(param, 'help', '') or READS[getattr(param, 'reads', '')]}"
        for param in command.own
    ]
    text = "\n".join([about, "", "Settings:", "", *settings])
    text = re.sub(r"--[a-z][a-z-]*", lambda flag: flags.get(flag[0], flag[0]), text)
    return "\n\n".join([text, "Returns:", *map(_result, result_classes(command))])


def _result(result: type) -> str:
    first, *remaining = (" ".join(part.split()) for part in (inspect.getdoc(result) or "").split("\n\n"))
    documented = [SHOWN] if hasattr(result, "plot") else []
    return "\n\n".join([f"`{result.__name__}`. {first}", *remaining, *documented])
