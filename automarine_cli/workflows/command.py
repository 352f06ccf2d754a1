"""What a command is, and the one way from its options to a folder of results.

A module of this folder that defines a `Command` has made a command of it: `commands()` finds it there, and so do
the steps of a campaign and Python. The options are a frozen dataclass, of which the fields say what is
read and what a manifest records; `Runner.results` does the rest alike for all.
"""

import inspect
import pkgutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, fields, replace
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar, Generic, Literal, TypeVar

from automarine_cli.comparison.result_files import Contents
from automarine_cli.effects import own_files
from automarine_cli.errors import AutomarineError, SettingError
from automarine_cli.logs import ColumnMap, Logs, column_rules, find_logs, given_columns, whole_logs, with_joined
from automarine_cli.pipeline.manifest import Input, given_as
from automarine_cli.pipeline.progress import Progress, silent
from automarine_cli.pipeline.records import Document, Record
from automarine_cli.pipeline.results_folder import ResultFolder, result_folder
from automarine_cli.report.tables import Table
from automarine_cli.results.kinds import ResultKind
from automarine_cli.results.records import ResultRecord
from automarine_cli.results.shown import Shown
from automarine_cli.runs.load import has_bytes
from automarine_cli.workflows.view import View

Options = TypeVar("Options", bound=Record)
Result = TypeVar("Result")

Kept = TypeVar("Kept", bound=ResultRecord)

HOLD_OUT = "hold_out"


@dataclass(frozen=True)
class Read:
    """What an option reads: logs, files, folders of results, or one file; its role among the inputs of a manifest."""

    kind: Literal["logs", "files", "folders", "file"]
    role: str = ""


def reads(
    kind: Literal["logs", "files", "folders", "file"], role: str = "", *, recorded: bool = True
) -> Mapping[str, object]:
    """Metadata of a field that is read: of many files the manifest's inputs tell, of one its options do too if
    `recorded`."""
    return {"read": Read(kind, role), "unrecorded": not recorded}


UNRECORDED: Mapping[str, object] = {"unrecorded": True}
"""Metadata of a field that no manifest tells: no result depends on it."""
SELDOM: Mapping[str, object] = {"seldom": True}
"""Metadata of a field that a manifest records only where it is not the default."""


@dataclass(frozen=True)
class ReadBack(Generic[Kept]):
    """How a command's result file is read back: its kind, what `run` says of it in a few words, and what `compare`
    takes of it: parameters and facts, of the models that it is asked for."""

    kind: ResultKind[Kept]
    says: Callable[[Kept], str] = lambda file: ""
    contents: Callable[[Kept, Sequence[str]], Contents] | None = None

    def outcome(self, folder: Path) -> str:
        """What `run` says of the result in a folder; empty where its file cannot be read."""
        try:
            return self.says(self.kind.read(folder / self.kind.file))
        except AutomarineError:
            return ""


@dataclass(frozen=True)
class Runner:
    """How a command is carried out: where its results go, on how many processes, and who is told how far it is."""

    command: str
    out: Path | None = None
    overwrite: bool = False
    jobs: int = 1
    cluster: str | None = None
    progress: Progress = silent

    def results(
        self,
        asked: Record,
        work: Callable[[], Result],
        write: Callable[[ResultFolder, Result], object],
        also: Sequence[Input] = (),
    ) -> Result:
        """What `work` makes, written by `write` into the folder of results if there is to be one, with a manifest of
        the options `asked`, what they read, and what was read `also`. Raises OutputError."""
        if self.out is None:
            return work()
        with result_folder(
            self.out, command=self.command, options=recorded(asked), inputs=[*inputs_of(asked), *also],
            seed=seed_of(asked), overwrite=self.overwrite,
        ) as folder:  # fmt: skip
            result = work()
            write(folder, result)
        return result


@dataclass(frozen=True)
class Command(Generic[Options, Result]):
    """A command: what it takes, what carries it out, the files it leaves, and how its results are shown.

    `kept` says how its result file is read back, `section` which of its files the report of a campaign shows
    where it lies in a folder of the command's name. `instead` names, for the settings at hand, another command of the
    same name, such as that for another kind of model, which is not `listed` itself; `python` is its name there, where
    it has another. A command is called as
    a function, with the first of its options or with all by name.
    """

    name: str
    options: type[Options]
    run: Callable[[Options, Runner], Result]
    views: Mapping[type, View[Any]]
    files: Callable[[Any], Sequence[str]] = lambda result: ()
    kept: ReadBack[Any] | None = None
    section: str = ""
    instead: "Callable[[Mapping[str, object]], Command[Any, Any] | None]" = lambda settings: None
    python: str = ""
    listed: bool = True
    __name__: ClassVar[str]

    def __post_init__(self) -> None:
        Shown.views.update(self.views)
        called = self.python or self.name.replace("-", "_")
        own = [inspect.Parameter(one.name, inspect.Parameter.KEYWORD_ONLY, default=_default(one))
               for one in fields(self.options)]  # fmt: skip
        how = [one for one in inspect.signature(Runner).parameters.values() if one.name != "command"]
        given = [one.replace(kind=inspect.Parameter.KEYWORD_ONLY) for one in how]
        first = own[0].replace(kind=inspect.Parameter.POSITIONAL_OR_KEYWORD)
        signature = inspect.Signature([first, *own[1:], *given])
        for key, value in (("__name__", called), ("__doc__", self.run.__doc__), ("__signature__", signature)):
            object.__setattr__(self, key, value)

    def __call__(
        self,
        *given: object,
        out: str | Path | None = None,
        overwrite: bool = False,
        jobs: int = 1,
        cluster: str | None = None,
        progress: Progress = silent,
        **settings: object,
    ) -> Result:
        """Carry it out: places may be texts, one log stands for a list, a result for the file that it would be."""
        first = fields(self.options)[0].name
        if len(given) > 1:
            raise TypeError(f"{len(given)} arguments without a name; give {first} alone so, as a list if they are many")
        settings = dict(zip((first,), given)) | settings
        if isinstance(piped := settings.get("columns"), Path) and piped.is_fifo():  # which can be read but once
            settings["columns"] = Document("columns.toml", piped.read_bytes())
        chosen = self.chosen(settings)
        place = Path(out) if isinstance(out, str) else out
        return chosen.run(chosen.asked(settings), Runner(self.name, place, overwrite, jobs, cluster, progress))

    def chosen(self, settings: Mapping[str, object]) -> "Command[Any, Result]":
        """This command or, for these settings, another of its name."""
        files = {
            one.name: _file(settings[one.name], one.name)
            for one in fields(self.options)
            if one.name in settings and "read" in one.metadata and one.metadata["read"].kind == "file"
        }
        return self.instead({**settings, **files}) or self

    def asked(self, settings: Mapping[str, object]) -> Options:
        """The options record of these settings. Raises TypeError for one that there is not, LogError for no logs."""
        plain = dict(settings)
        logs: dict[str, Logs] = {}
        known = {one.name for one in fields(self.options)}
        if unknown := [name for name in plain if name not in known]:
            raise TypeError(f"{self.__name__} has no setting {unknown[0]!r}; it has {', '.join(sorted(known))}")
        for one in fields(self.options):
            if one.name in plain and "read" in one.metadata:
                plain[one.name] = found = _plain(plain[one.name], one)
                if one.metadata["read"].kind == "logs" and (found or one.default is MISSING):
                    logs[one.name] = found
            elif isinstance(plain.get(one.name), str) and isinstance(one.default, tuple):
                plain[one.name] = (plain[one.name],)
        record: Any = self.options(**plain)  # says what is wrong with it before logs are looked for
        names = given_columns(getattr(record, "columns", None))
        found_logs = {name: whole_logs(find_logs(places), names) for name, places in logs.items()}
        return replace(record, **found_logs) if found_logs else record

    def says(self, result: Result) -> Sequence[Table | str]:
        """What the terminal shows of a result."""
        view = next(view for kind, view in self.views.items() if isinstance(result, kind))
        return view.says(result)


def commands() -> dict[str, Command[Any, Any]]:
    """Every command by its name: what the modules of this folder define, alone or in a dictionary."""
    from automarine_cli import workflows

    named: dict[str, Command[Any, Any]] = {}
    for module in pkgutil.iter_modules(workflows.__path__):
        found = vars(import_module(f"{workflows.__name__}.{module.name}")).values()
        each = (one for value in found for one in (value.values() if isinstance(value, dict) else (value,)))
        named |= {one.name: one for one in each if isinstance(one, Command) and one.listed}
    return named


def recorded(asked: Record) -> dict[str, object]:
    """The options as a manifest records them, in order: what is read of many files is told by its inputs."""
    found: dict[str, object] = {}
    for one in fields(asked):
        value, read = getattr(asked, one.name), one.metadata.get("read")
        left = one.metadata.get("unrecorded") or (one.metadata.get("seldom") and value == one.default)
        if one.name == "seed" or left:
            continue
        if read is None or read.kind == "file":
            found[one.name] = list(value) if isinstance(value, tuple) else value
        elif read.role == HOLD_OUT:
            found[one.name] = [file.name for file in value]
    return found


def inputs_of(asked: Record) -> list[Input]:
    """Every file that the options name, as a manifest lists them."""
    found: list[Input] = []
    for one in fields(asked):
        value, read = getattr(asked, one.name), one.metadata.get("read")
        if read is not None and read.kind == "logs":
            files = with_joined(value, given_columns(getattr(asked, "columns", None)))
            found += [Input(file.name, file.source, read.role) for file in files if has_bytes(file)]
        elif read is not None:
            found += given_as(**{one.name: value})
        if one.name == "columns":
            found += given_as(dbc=given_columns(value).database)
    found.sort(key=lambda one: one.role not in ("log", HOLD_OUT))
    own = own_files() if getattr(asked, "by_effects", False) else ()
    return [*found, *(Input(path.name, path, "own_effect") for path in own)]


def seed_of(asked: Record) -> int | None:
    """The seed of everything random, of commands that draw something."""
    drawn = (one for one in fields(asked) if one.name == "seed" and not one.metadata.get("unrecorded"))
    return next((getattr(asked, one.name) for one in drawn), None)


def _plain(value: object, one: "Field[Any]") -> Any:
    """What is read as the options record holds it: texts become places, one place a list."""
    kind = one.metadata["read"].kind
    if kind == "file":
        return _file(value, one.name)
    if kind == "logs":
        from automarine_cli.logs.frames import as_logs

        return as_logs(value, one.name)
    many = [value] if isinstance(value, str | Path) else value
    assert isinstance(many, Sequence)
    return tuple(Path(each) for each in many)


def _file(value: object, name: str) -> object:
    """A place, or the file that a result stands for; what we made ourselves is left as it is."""
    if isinstance(value, Shown):
        return value.document(name)
    if isinstance(value, str):
        return Path(value)
    if name == "columns" and isinstance(value, Mapping):
        return ColumnMap(columns=column_rules(value, name), source=name)
    ours = type(value).__module__.startswith(f"{__name__.partition('.')[0]}.")
    if value is None or isinstance(value, Path) or ours:
        return value
    raise SettingError(f"{name}: found {type(value).__name__}, expected a file or a result")


def _default(one: "Field[Any]") -> object:
    return inspect.Parameter.empty if one.default is MISSING else one.default
