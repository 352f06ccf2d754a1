"""Plain data (JSON, TOML) to and from typed records, by their type hints; what does not fit is refused by file and key.

A record is any frozen dataclass whose fields are `bool`, `int`, `float`, `str`, `Literal[...]`, `object`, `X | None`,
`tuple[X, ...]`, `tuple[X, Y]`, `Mapping[str, X]` or another such dataclass. A field called `from_` is the key `from`. A
record with a class method `of_number` takes a plain number too. A record checks its own values in `__post_init__` and
raises SettingError with the bare reason; the place in the file is put in front of it here.
"""

import contextlib
import dataclasses
import difflib
import functools
import io
import json
import math
import re
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, ClassVar, Generic, Literal, Protocol, TypeVar, Union, cast, get_args, get_origin, get_type_hints

from automarine_cli.dofs import DOFS, YAW, Dof
from automarine_cli.errors import AutomarineError, ExcludedRun, ModelError, SettingError
from automarine_cli.text import MAX_NAME_LETTERS, Place, format_value, in_words, printable, quoted

# A model is a few kilobytes, with ten thousand runs set aside a few megabytes; TOML is written by hand.
MAX_FILE_BYTES = {"JSON": 16_000_000, "TOML": 1_000_000}
FILLER: Mapping[str, object] = {"filler": True}  # metadata of a field that is in no file: the codec's `words`


class Record(Protocol):
    __dataclass_fields__: ClassVar[dict[str, "Field[Any]"]]


Kind = TypeVar("Kind", bound=Record)
_hints = functools.cache(get_type_hints)


def keyed(*keys: str) -> Mapping[str, object]:
    """Return the metadata of a field whose key in files is a template such as "noise_{log_unit}", for the codec's
    words; of several the first that is there is read. "gap/after" is the key `after` in the table `gap`."""
    return {"keys": keys}


@dataclass(frozen=True)
class Document:
    """A file that is on no disk: what a result of Python would have been written as, or what came over a link; what is
    `built_in` is no input that could change."""

    name: str
    content: bytes
    built_in: bool = False

    def open(self, mode: Literal["rb"]) -> io.BytesIO:
        return io.BytesIO(self.content)


Source = Path | Document


def read_plain(
    path: Source, kind: Literal["JSON", "TOML"], refuse: type[AutomarineError], *, most: int | None = None
) -> dict[str, object]:
    """Read the table (JSON: object) in a file of at most `most` bytes; nothing in it is executed. Raises `refuse` with
    the file, and the key's path where there is one."""
    name, most = printable(path.name), most or MAX_FILE_BYTES[kind]
    try:
        with path.open("rb") as file:
            content = file.read(most + 1)  # what has no end (a device) must not fill the memory
    except OSError as problem:
        raise refuse(f"{name}: cannot be read ({problem.strerror or problem})") from None
    if len(content) > most:
        raise refuse(f"{name}: more than {most} bytes; expected a file of a few kilobytes")
    if kind == "JSON" and not content.strip():
        raise refuse(f"{name}: the file is empty; expected JSON")
    try:
        text = content.decode("utf-8-sig")
        data: object = tomllib.loads(text) if kind == "TOML" else json.loads(text, object_pairs_hook=_unique)
        for value, place in everything(data):
            if isinstance(value, float) and kind == "JSON" and not math.isfinite(value):
                raise refuse(f"{name}: {in_words(place)}found {format_value(value)}, expected a finite number")
            if isinstance(value, int) and abs(value) > 10**300:  # no float any more
                raise refuse(f"{name}: {in_words(place)}found a number of more than 300 digits, expected a smaller one")
    except UnicodeDecodeError:
        raise refuse(f"{name}: expected UTF-8 text, found other bytes; save it as UTF-8") from None
    except RecursionError:
        raise refuse(f"{name}: not valid {kind}: nested too deep") from None
    except ValueError as problem:
        raise refuse(f"{name}: not valid {kind}: {printable(str(problem))[:300]}") from None
    if not isinstance(data, dict):
        raise refuse(f"{name}: found {format_value(data)}, expected an object with named keys")
    return data


def _unique(pairs: list[tuple[str, object]]) -> dict[str, object]:
    data = dict(pairs)
    if len(data) < len(pairs):
        counts = Counter(key for key, _ in pairs)
        raise ValueError(f"the key {quoted(counts.most_common(1)[0][0])} is given more than once")
    return data


def read_mapping(path: Path) -> dict[str, object]:
    """Read the table in a TOML or JSON file (distinguished by the extension `.json`). Raises SettingError."""
    return read_plain(path, "JSON" if path.suffix == ".json" else "TOML", SettingError)


def schema_in(source: object) -> str:
    """Return the schema that a JSON file says it has; empty where there is none, or nothing that can be read."""
    with contextlib.suppress(AutomarineError):
        return str(read_plain(source, "JSON", AutomarineError).get("schema")) if isinstance(source, Source) else ""
    return ""


def everything(data: object, place: Place = ()) -> Iterator[tuple[object, Place]]:
    """Yield every value with its place, outer ones first."""
    yield data, place
    if isinstance(data, dict | list | tuple):
        for key, value in data.items() if isinstance(data, dict) else enumerate(data):
            yield from everything(value, (*place, key))


@dataclass(frozen=True)
class Codec:
    """How the data of one file become records. `name` is that of the file or table, for messages; `words` fill the keys
    and become the value of the field marked `FILLER`; `refuse` is raised. `writer` is the command that writes such
    files; where none is named they are settings that people write. A record of results refuses unknown keys only if it
    names in `unread` those that may be there; settings refuse all."""

    name: str
    words: Dof | None = None
    refuse: type[AutomarineError] = SettingError
    writer: str = ""

    def refusal(self, place: Place, why: str) -> AutomarineError:
        return self.refuse(f"{self.name}: {in_words(place)}{why}")

    def missing(self, place: Place, key: str, expected: str = "") -> AutomarineError:
        then = f"give a file as `automarine {self.writer}` writes it" if self.writer else f"expected {expected}"
        return self.refusal(place, f"key {format_value(key)} is missing; {then}")

    def read(self, record: type[Kind], data: object, place: Place = ()) -> Kind:
        """Return the `record` that plain data hold; raises `refuse` with the place for a key or value that is wrong."""
        if not isinstance(data, Mapping):
            table = "an object with named keys" if self.writer else "a table of settings"
            raise self.refusal(place, f"found {format_value(data)}, expected {table}")
        self._refuse_unknown(record, data, place)
        values, keys = dict[str, object](), _keys(record, self.words)
        for field in dataclasses.fields(record):
            hint, paths = _hints(record)[field.name], [key.split("/") for key in keys.get(field.name, ())]
            path = next((path for path in paths if _inner(data, path) is not MISSING), None)
            if not paths:
                values[field.name] = self.words
            elif path is not None:
                values[field.name] = self.value(hint, _inner(data, path), (*place, *path))
            elif field.default is MISSING and field.default_factory is MISSING:
                *outer, key = paths[0]
                raise self.missing((*place, *outer), key, _expected(hint))
        try:
            return record(**values)
        except SettingError as problem:
            raise self.refusal(place, str(problem)) from None

    def _refuse_unknown(self, record: type[Record], data: Mapping[object, object], place: Place) -> None:
        """Refuse a key that means nothing: it may be meant as one that is read, and must not be passed over."""
        unread, top_keys = getattr(record, "unread", None if self.writer else ()), _top_keys(record, self.words)
        accepted = [*dict.fromkeys(top_keys), *(unread or ())]
        key = next((key for key in data if key not in accepted), None)
        if unread is None or key is None:
            return
        free = [name for name in accepted if name not in data] if self.writer else accepted
        of_motions = (pair for words in DOFS.values() for pair in zip(_top_keys(record, words), top_keys))
        meant = [own_key for theirs, own_key in of_motions if theirs == key and own_key in free]
        close = meant or difflib.get_close_matches(str(key)[:MAX_NAME_LETTERS], free, 1, 0.8 if self.writer else 0.6)
        hint = f"did you mean {format_value(close[0])}?" if close else f"known are {', '.join(accepted)}"
        raise self.refusal(place, f"unknown key {format_value(key)}; {hint}")

    def value(self, hint: Any, value: Any, place: Place = ()) -> Any:
        """Return a plain value as the type `hint`, which a record's field may have. Raises `refuse` with the place."""
        origin, args = get_origin(hint), get_args(hint)
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if hasattr(hint, "of_number") and not isinstance(value, Mapping):
            return hint.of_number(self.value(float, value, place))
        if dataclasses.is_dataclass(hint):
            return self.read(cast(type[Record], hint), value, place)
        if origin in (Union, UnionType):
            if value is None and NoneType in args:
                return None
            members = [member for member in args if member is not NoneType]
            if len(members) == 1:
                return self.value(members[0], value, place)
            for member in members:
                with contextlib.suppress(AutomarineError):
                    return self.value(member, value, place)
        elif origin is tuple and isinstance(value, list | tuple):
            inner = (args[0],) * len(value) if args[-1] is Ellipsis else args
            if len(inner) == len(value):
                return tuple(self.value(part, entry, (*place, i)) for i, (part, entry) in enumerate(zip(inner, value)))
        elif isinstance(origin, type) and issubclass(origin, Mapping) and isinstance(value, Mapping):
            return {str(key): self.value(args[1], entry, (*place, key)) for key, entry in value.items()}
        elif hint is float and number and abs(value) <= sys.float_info.max:
            return float(value)
        elif (
            hint in (Any, object)
            or (origin is Literal and value in args and not isinstance(value, bool))
            or (hint in (bool, str) and isinstance(value, hint))
            or (hint is int and number and isinstance(value, int))
        ):
            return value
        text = "a table" if isinstance(value, Mapping) and not self.writer else format_value(value)
        expected = "a finite number" if hint is float and number else _expected(hint)
        raise self.refusal(place, f"found {text}, expected {expected}")


def to_mapping(record: Record) -> dict[str, object]:
    """Return the plain data of a record, field order kept; what is None is left out (TOML has no null)."""
    values = {key_of(record, name): getattr(record, name) for name in _keys(record, None)}
    return {key: plain(value) for key, value in values.items() if value is not None}


def key_of(record: Record, name: str) -> str:
    return _keys(record, next((value for value in vars(record).values() if isinstance(value, Dof)), None))[name][0]


def plain(value: object) -> object:
    """Return a value whose records, at any depth, are plain data, and files their names."""
    if isinstance(value, Source):
        return value.name
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return to_mapping(value)
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    return [plain(entry) for entry in value] if isinstance(value, list | tuple) else value


def _keys(record: Record | type[Record], words: Dof | None) -> dict[str, list[str]]:
    """Return the keys of every field that is in files, by its name."""
    fields = [field for field in dataclasses.fields(record) if "filler" not in field.metadata]
    templates = {field.name: field.metadata.get("keys") if words else None for field in fields}
    return {name: [*map(words.fill, of)] if words and of else [name.rstrip("_")] for name, of in templates.items()}


def _top_keys(record: type[Record], words: Dof | None) -> list[str]:
    return [key.partition("/")[0] for keys in _keys(record, words).values() for key in keys]


def _inner(data: object, path: Sequence[str]) -> object:
    for key in path:
        data = data.get(key, MISSING) if isinstance(data, Mapping) else MISSING
    return data


def _expected(hint: Any) -> str:
    origin, args = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        return " or ".join(_expected(arg) for arg in args if arg is not NoneType)
    if origin is Literal:
        return "one of " + ", ".join(repr(arg) for arg in args)
    if origin is tuple:
        entry = _expected(args[0]).removeprefix("a ")
        return f"a list, each entry a {entry}" if args[-1] is Ellipsis else f"a list of {len(args)} values"
    plain = {bool: "true or false", int: "a whole number", float: "a number", str: "a text in quotes"}
    return plain.get(hint, "a number" if hasattr(hint, "of_number") else "a table")


def json_text(data: object) -> str:
    """Return the JSON of automarine: order kept, indent 1, letters of any alphabet kept, newline at the end; null for
    a number that is not finite, as where a prediction runs away: one such number must not cost the rest."""
    write = functools.partial(json.dumps, indent=1, ensure_ascii=False, default=lambda array: array.tolist())
    text = write(data) + "\n"
    if re.search(r"\b(NaN|Infinity)\b", text):
        text = write(json.loads(text, parse_constant=lambda name: None)) + "\n"
    # a byte of a file's name that is not UTF-8 has no letter, only an escape
    return re.sub("[\ud800-\udfff]", lambda lone: f"\\u{ord(lone[0]):04x}", text)


def json_document(name: str, data: object) -> Document:
    return Document(name, json_text(data).encode("utf-8"))


class Shown:
    """Base of result classes, which show themselves in Python; their `@dataclass` needs `repr=False`."""

    sections_of: ClassVar[Any]
    """Gives `report.sections.Sections` of a result; set there."""

    def __repr__(self) -> str:
        return str(self.sections_of(self).text())

    def _repr_html_(self) -> str:
        return str(self.sections_of(self).html())

    def to_frame(self) -> Any:
        """Return the numbers as a `pandas.DataFrame`, one row a parameter, run or score."""
        return self.sections_of(self).frame()

    def plot(self, figure: str | None = None) -> Any:
        """Draw a `matplotlib.figure.Figure`, by default the first. Raises SettingError with the names there are."""
        return self.sections_of(self).figure(figure)

    def predict(self, commands: Any, **settings: Any) -> Any:
        """Predict where `commands`, logs or tables, take the vehicle: see `automarine_cli.predict`, whose model it
        is."""
        import automarine_cli

        return automarine_cli.predict(self, commands=commands, **settings)

    def document(self, option: str) -> Document:
        """Return the file that stands for this result where an option of that name wants one. Raises TypeError."""
        raise TypeError(f"a {type(self).__name__} is no {option}; give the result of a fit, or a file")


@dataclass(frozen=True)
class RunsUsed:
    used: int = 0
    set_aside: tuple[ExcludedRun, ...] = ()


@dataclass(frozen=True, kw_only=True)
class ResultRecord:
    """What every result file has: its schema, the motion (yaw where none is named), and the runs."""

    schema: str
    motion: str = ""
    runs: RunsUsed = RunsUsed()
    dof: Dof = dataclasses.field(metadata=FILLER)


@dataclass(frozen=True)
class ResultKind(Generic[Kind]):
    """A kind of result: its file, its name in the schema, the record of what is in it, the command that writes it, and
    the motion that its keys are of (None where the file says)."""

    file: str
    name: str
    record: type[Kind]
    writer: str
    dof: Dof | None = None

    @property
    def schema(self) -> str:
        return f"automarine/{self.name}/1"

    def read(self, path: Source, name: str = "", refuse: type[AutomarineError] = ModelError) -> Kind:
        """What the file at `path` holds, called `name` in messages. Raises `refuse` with file and place."""
        return self.of(read_plain(path, "JSON", refuse), name or printable(path.name), refuse)

    def of(self, data: object, name: str, refuse: type[AutomarineError] = ModelError) -> Kind:
        codec = self.codec(data, name, refuse)
        if isinstance(data, Mapping) and (schema := data.get("schema")) != self.schema:
            parts = str(schema).split("/")
            other = parts[1].replace("-", " ") if len(parts) == 3 and parts[1] != self.name else ""
            this = f"this is a {printable(other)}; " if other else ""
            why = f"found {format_value(schema)}, expected {format_value(self.schema)}; {this}give the {self.file}"
            raise codec.refusal(("schema",), f"{why} that `automarine {self.writer}` writes")
        return codec.read(self.record, data)

    def codec(self, data: object, name: str, refuse: type[AutomarineError] = ModelError) -> Codec:
        motion = data.get("motion") if isinstance(data, Mapping) else ""
        return Codec(name, self.dof or DOFS.get(str(motion), YAW), refuse, self.writer)
