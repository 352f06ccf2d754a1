"""What a person sees of a result, once: the terminal, Python, notebooks and files are renderings of it."""

import json
import re
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial, singledispatch
from importlib import import_module
from typing import TYPE_CHECKING, Any

from automarine_cli.errors import SettingError
from automarine_cli.estimate import Estimate
from automarine_cli.pipeline.records import Shown
from automarine_cli.report.page import to_html
from automarine_cli.report.tables import Table

if TYPE_CHECKING:
    from automarine_cli.pipeline.parallel import Each
    from automarine_cli.pipeline.results_folder import ResultFolder

PROMPT_COLUMNS = 110  # columns of a result at Python's prompt
FIGURE_KINDS = "png", "svg", "pdf", "slides"
Content = str | bytes | Mapping[str, object] | Callable[[], str | bytes]


class Drawing:
    """A figure that a function of report/figures, MODULE.FUNCTION, draws of the subjects when it is called. What draws
    is imported then, and not for those who want no figures."""

    def __init__(self, place: str, *subjects: Any) -> None:
        self.place, self.subjects = place, subjects

    def __call__(self) -> Any:
        module, _, function = self.place.partition(".")
        return getattr(import_module(f"automarine_cli.report.figures.{module}"), function)(*self.subjects)


@dataclass(frozen=True)
class Sections:
    """Sections of a result, in the order in which they are read. `answer` is the one line that stands first, the only
    one with -q: by default the first sentence of `printed`, which are the tables and sentences to judge it by;
    `details` are those that the terminal shows with -v. `files` by name are texts, bytes, what makes these, or data to
    be written as JSON; `figures` draw what is saved as NAME.png, and can be pickled; `listed` is what the terminal
    names, all files and figures where nothing is given; `rows` are the numbers, one mapping a parameter, run or score,
    or columns by name;
    `warnings` say what could not be made."""

    printed: Sequence[Table | str]
    files: Mapping[str, Content] = field(default_factory=dict)
    figures: Mapping[str, Drawing] = field(default_factory=dict)
    listed: Sequence[str] = ()
    rows: Sequence[Mapping[str, object]] | Mapping[str, Any] = ()
    warnings: Sequence[str] = ()
    answer: str = ""
    details: Sequence[Table | str] = ()

    def __post_init__(self) -> None:
        if not self.answer:
            sentences = (part for part in self.printed if isinstance(part, str) and not part.startswith("Warning"))
            sentence = next(sentences, "")
            object.__setattr__(self, "answer", sentence)
            object.__setattr__(self, "printed", [part for part in self.printed if part is not sentence])
        if not self.listed:
            object.__setattr__(self, "listed", (*self.files, *(f"{name}.png" for name in self.figures)))

    @property
    def every(self) -> list[Table | str]:
        """All that a person may read, the answer first."""
        return [*filter(None, [self.answer]), *self.printed, *self.details]

    def text(self, width: int = PROMPT_COLUMNS) -> str:
        fill = partial(textwrap.fill, width=width, subsequent_indent="  ", break_on_hyphens=False)
        parts = (fill(part) if isinstance(part, str) else part.to_text(width) for part in self.every)
        return "\n".join(parts).rstrip("\n")

    def html(self) -> str:
        """Render the tables as HTML, with everything that came from files escaped."""
        tables = [part.to_markdown() for part in self.every if isinstance(part, Table)]
        return to_html("\n".join(tables), lambda place, caption: "")

    def frame(self) -> Any:
        import pandas as pd  # here, as most commands make no frame

        return pd.DataFrame(self.rows if isinstance(self.rows, Mapping) else list(self.rows))

    def figure(self, name: str | None = None) -> Any:
        """Draw a figure, by default the first. Raises SettingError with the names that there are."""
        if not self.figures:
            raise SettingError("this result has no figure; fit or validate its runs, and plot that")
        if name is not None and name not in self.figures:
            raise SettingError(f"there is no figure {name!r}; known are {', '.join(self.figures)}")
        return self.figures[name or next(iter(self.figures))]()

    def save(self, folder: "ResultFolder", formats: Sequence[str] = ("png",), each: "Each | None" = None) -> None:
        """Write the files, then the figures in each of the formats, drawn by `each`."""
        for name, content in self.files.items():
            folder.write(name, content() if callable(content) else content)
        for warning in self.warnings:
            folder.warn(warning)
        save_figures(folder, self.figures, formats, each)


def save_figures(
    folder: "ResultFolder", figures: Mapping[str, Drawing], formats: Sequence[str], each: "Each | None" = None
) -> None:
    """Write the figures in each of the formats, drawn by `each`."""
    if formats and figures:
        from automarine_cli.report.figures.style import write_figures

        write_figures(folder, figures, formats, each)


def refuse_unknown(formats: Sequence[str]) -> None:
    """Raise SettingError for a kind of figures that there is not: before any work is done."""
    for kind in formats:
        if kind not in FIGURE_KINDS:
            raise SettingError(f"figure format {kind!r} is not known; known are {', '.join(FIGURE_KINDS)}")


def figure_file(name: str, kind: str) -> str:
    return f"{name}.{'slide.png' if kind == 'slides' else kind}"


@singledispatch
def sections(result: Any) -> Sections:
    """Give the sections of a result; a module of this room registers those of each type. Raises TypeError for none."""
    raise TypeError(f"nothing says how a {type(result).__name__} is shown")


Shown.sections_of = staticmethod(sections)


def forms_of(stem: str, *tables: Table) -> dict[str, Content]:
    """Render tables as the files STEM.csv (the first), STEM.md and STEM.tex."""
    return {
        f"{stem}.csv": tables[0].to_csv(),
        f"{stem}.md": document(*tables),
        f"{stem}.tex": "\n".join(table.to_latex() for table in tables),
    }


def document(*blocks: Table | str | None) -> str:
    """Write a page in Markdown: paragraphs, headings and tables with a blank line between; empty ones are left out."""
    texts = (block.to_markdown() if isinstance(block, Table) else block or "" for block in blocks)
    return "\n\n".join(text.strip() for text in texts if text.strip()) + "\n"


def bullets(lines: Iterable[str]) -> str:
    return "\n".join(f"- {line}" for line in lines)


def numbers(estimate: Estimate) -> dict[str, object]:
    low, high = estimate.ci95
    return {"value": estimate.value, "stderr": estimate.stderr, "low": low, "high": high, "unit": estimate.unit}


def file_stems(names: Sequence[str]) -> list[str]:
    """Return a safe, distinct part of a file name for each run name (which may hold slashes, blanks, anything)."""
    stems: dict[str, str] = {}  # by lower case: some file systems do not tell A from a
    for name in names:
        stem = "".join(c if c.isalnum() or c in "-_.+" else "_" for c in name).strip(".")[:80] or "run"
        unique, n = stem, 1
        while unique.lower() in stems:
            unique, n = f"{stem}_{n + 1}", n + 1
        stems[unique.lower()] = unique
    return list(stems.values())


def toml_text(mapping: Mapping[str, object], prefix: str = "") -> str:
    """Return plain data as TOML: values first, then tables, then arrays of tables; read back it is the same data."""
    values, tables = [], []
    for key, value in mapping.items():
        name = prefix + _toml_key(key)
        if isinstance(value, Mapping):
            tables.append(f"\n[{name}]\n" + toml_text(value, f"{name}."))
        elif isinstance(value, list | tuple) and value and all(isinstance(entry, Mapping) for entry in value):
            tables += [f"\n[[{name}]]\n" + toml_text(entry, f"{name}.") for entry in value]
        else:
            values.append(f"{toml_line(key, value)}\n")
    return "".join(values + tables)


def toml_line(key: str, value: object) -> str:
    """Return `key = value` on one line, a table as an inline one."""
    return f"{_toml_key(key)} = {toml_value(value)}"


def _toml_key(key: str) -> str:
    return key if re.fullmatch("[A-Za-z0-9_-]+", key) else toml_value(key)


def toml_value(value: object) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(toml_line(key, entry) for key, entry in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(toml_value(entry) for entry in value) + "]"
    return json.dumps(value, ensure_ascii=False, allow_nan=False).replace("\x7f", "\\u007f")  # as TOML wants that one
