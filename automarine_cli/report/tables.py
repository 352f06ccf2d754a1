"""One table, four forms: CSV for programs, Markdown for readers, LaTeX for papers, text for the terminal.

Cells arrive formatted (`number`, `interval`), so every form shows the same digits.
"""

import csv
import io
import math
import re
import sys
import textwrap
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from numbers import Integral
from typing import Any

from automarine_cli.estimate import Estimate

COLUMN_GAP = 2  # blanks between columns
MIN_FOLDED_COLUMNS = 8  # characters below which no column is folded
PIPE_COLUMNS = 120  # columns of a table for no terminal, where folding makes it so narrow
_TIED = "\N{NO-BREAK SPACE}"


def text_table(
    grid: Sequence[Sequence[str]], right: Sequence[bool], rules: Sequence[int], width: int | None = None, *,
    full: bool = True,
) -> list[str]:  # fmt: skip
    """Lines of a table whose first row is the header; `right` are the columns that stand to the right. Cells are folded
    at blanks, the widest columns first, to the `width`, or that of a pipe. What is still too wide for a `width` is
    shown as several tables, each with the first column; unless `full`, a line names what is left out."""
    if not grid[0]:
        return []
    widths, limit = [max(map(len, column)) for column in zip(*grid)], width or PIPE_COLUMNS
    words = [max(len(word) for cell in column for word in _words(cell)) for column in zip(*grid)]
    least = [min(wide, max(MIN_FOLDED_COLUMNS, word)) for word, wide in zip(words, widths)]
    groups = [[0]]
    for i in range(1, len(widths)):
        if width and len(groups[-1]) > 1 and _total([least[k] for k in (*groups[-1], i)]) > limit:
            groups.append([0])
        groups[-1].append(i)
    left_out = [grid[0][i] for columns in groups[1:] for i in columns[1:]]
    if left_out and not full:
        note = f"With -v also: {', '.join(left_out)}."
        return [*text_table([[row[i] for i in groups[0]] for row in grid], right, rules, width), *_wrapped(note, limit)]
    lines: list[str] = []
    for columns in groups:
        narrowed = {i: widths[i] for i in columns}
        while _total(narrowed.values()) > limit and (free := [i for i in columns if narrowed[i] > least[i]]):
            narrowed[max(free, key=narrowed.__getitem__)] -= 1  # the widest that can gives way
        lines += [*([""] if lines else []), *_block(grid, narrowed, right, rules)]
    return lines


def _total(widths: Collection[int]) -> int:
    return sum(widths) + COLUMN_GAP * (len(widths) - 1)


def _words(cell: str) -> list[str]:
    """What is never folded: words, and an interval in brackets as a whole."""
    return re.sub(r"\[[^]]*", lambda match: match[0].replace(" ", _TIED), cell).split(" ")


def _block(
    grid: Sequence[Sequence[str]], widths: Mapping[int, int], right: Sequence[bool], rules: Sequence[int]
) -> list[str]:
    rule, lines = "-" * _total(widths.values()), list[str]()
    for number, row in enumerate(grid):
        if number == 1 or number - 1 in rules:
            lines.append(rule)
        cells = ([row[i]] if len(row[i]) <= w else _wrapped(" ".join(_words(row[i])), w) for i, w in widths.items())
        for parts in zip_longest(*cells, fillvalue=""):
            aligned = (text.rjust(w) if right[i] else text.ljust(w) for text, (i, w) in zip(parts, widths.items()))
            lines.append((" " * COLUMN_GAP).join(aligned).rstrip())
    return lines if len(grid) > 1 else [*lines, rule]


def _wrapped(tied: str, width: int, indent: str = "") -> list[str]:
    lines = textwrap.wrap(tied, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)
    return [line.replace(_TIED, " ") for line in lines]


MISSING = "–"


@dataclass(frozen=True)
class Table:
    """A titled table of formatted cells; `rules` are the rows (from 0) above which a line is drawn."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    rules: tuple[int, ...] = ()
    notes: tuple[str, ...] = ()

    @classmethod
    def of(
        cls, title: str, rows: Iterable[Mapping[str, Any]], notes: Iterable[str] = (), rules: tuple[int, ...] = (),
        header: Sequence[str] = (),
    ) -> "Table":  # fmt: skip
        """Make a table of rows by column: texts as they are, whole numbers and numbers of four digits, estimates with
        their intervals, a dash for None; `header` is needed where there may be no rows."""
        rows = list(rows)
        cells = tuple(tuple(_cell(value) for value in row.values()) for row in rows)
        return cls(title, tuple(rows[0] if rows else header), cells, rules, tuple(notes))

    def without_empty_rows(self) -> "Table":
        full = [i for i, row in enumerate(self.rows) if any(cell != MISSING for cell in row[1:])]
        rules = dict.fromkeys(sum(i < rule for i in full) for rule in self.rules)
        return replace(self, rows=tuple(self.rows[i] for i in full), rules=tuple(rules))

    def without_empty_columns(self) -> "Table":
        columns = zip(self.header, *self.rows)
        full = [column for column in columns if not self.rows or any(cell != MISSING for cell in column[1:])]
        header, *rows = zip(*full)
        return replace(self, header=header, rows=tuple(rows))

    def to_csv(self) -> str:
        """Header and rows; a missing cell is empty; title and notes stay out: any program reads it."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        for row in (self.header, *self.rows):
            writer.writerow("" if cell == MISSING else cell for cell in row)
        return text.getvalue()

    def to_markdown(self) -> str:
        """Title, table and notes; rules have no form in Markdown and are left out."""
        sides = ["---:" if right else "---" for right in self._right()]
        lines = [f"**{escape(self.title)}**", ""] if self.title else []
        header, *rows = ("| " + " | ".join(map(escape, row)) + " |" for row in (self.header, *self.rows))
        lines += [header, "| " + " | ".join(sides) + " |", *rows]
        lines += [line for note in self.notes for line in ("", escape(note))]
        return "\n".join(lines) + "\n"

    def to_latex(self) -> str:
        """A `table` environment with booktabs rules; symbols such as k_rr are set as such, all else is escaped."""
        sides = "".join("r" if right else "l" for right in self._right())
        lines = [r"\begin{table}", r"\centering"]
        if self.title:  # without a number, which LaTeX gives
            caption = re.sub(r"^Table \d+\. ", "", self.title)
            name = re.sub(r"[^a-z0-9]+", "-", caption.partition("[")[0].lower()).strip("-")
            lines += [rf"\caption{{{_latex(caption)}}}", rf"\label{{tab:{name}}}"]
        header, *rows = (" & ".join(map(_latex, row)) + r" \\" for row in (self.header, *self.rows))
        lines += [rf"\begin{{tabular}}{{{sides}}}", r"\toprule", header, r"\midrule"]
        for i, row in enumerate(rows):
            lines += [r"\midrule", row] if i in self.rules and i > 0 else [row]
        lines += [r"\bottomrule", r"\end{tabular}"]
        lines += [rf"\par\smallskip\footnotesize {_latex(note)}" for note in self.notes]
        lines.append(r"\end{table}")
        return "\n".join(lines) + "\n"

    def to_text(self, width: int | None = None, *, full: bool = True) -> str:
        """Aligned columns for a terminal of that width (see `text_table`), or for a pipe."""
        grid = [[_one_line(cell) for cell in row] for row in (self.header, *self.rows)]
        limit = width or sys.maxsize
        lines = [*_wrapped(_one_line(self.title), limit, "  "), ""] if self.title else []
        lines += text_table(grid, self._right(), self.rules, width, full=full)
        if self.notes:
            lines += ["", *(line for note in self.notes for line in _wrapped(note, limit, "  "))]
        return "\n".join(lines) + "\n"

    def _right(self) -> list[bool]:
        return [
            i > 0 and all(_NUMBER_CELL.match(row[i]) or row[i] in ("", MISSING) for row in self.rows)
            for i in range(len(self.header))
        ]


def _cell(value: Any) -> str:
    if value is None or isinstance(value, Estimate):
        return interval(value)
    return str(value) if isinstance(value, str | Integral) else number(value)


def number(x: float | None, digits: int = 4) -> str:
    """`x` to `digits` significant digits, without an exponent where readable; a dash for None and NaN."""
    if x is None or not math.isfinite(x):
        return MISSING
    if x == 0:
        return "0"
    rounded = float(f"{x:.{digits - 1}e}")
    size = math.floor(math.log10(abs(rounded)))
    if -5 <= size < 7:
        return f"{rounded:.{max(0, digits - 1 - size)}f}"
    mantissa, exponent = f"{x:.{digits - 1}e}".split("e")
    return f"{mantissa}e{int(exponent)}"


def with_band(value: float | None, ends: Sequence[float] | None) -> str:
    """`26.8 [10.1, 37.7]`: a number to three digits, with the ends of its interval where it has one."""
    return number(value, 3) + (f" [{number(ends[0], 3)}, {number(ends[1], 3)}]" if ends else "")


def interval(estimate: Estimate | None) -> str:
    """`1.257 [1.240, 1.274]`: as many decimals as two significant digits of the standard error need; marked where it
    was known before the fit, or stands at its bound."""
    if estimate is None or not math.isfinite(estimate.value):
        return MISSING
    (low, high), mark = estimate.ci95, " (known)" if estimate.known else " (at its bound)" if estimate.at_bound else ""
    if not (math.isfinite(estimate.stderr) and estimate.stderr > 0 and math.isfinite(low) and math.isfinite(high)):
        return f"{number(estimate.value)}{mark}"
    decimals = max(0, 1 - math.floor(math.log10(estimate.stderr)))
    if decimals > 8 or max(-low, high) >= 1e7:
        return f"{number(estimate.value)} [{number(low)}, {number(high)}]{mark}"
    return f"{estimate.value:.{decimals}f} [{low:.{decimals}f}, {high:.{decimals}f}]{mark}"


_NUMBER_CELL = re.compile(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?( ?%)?( \[.*\])?( \((known|at its bound)\))?$")
SYMBOL = re.compile(r"(?<![\w.-])([kIXYZNmanT])\\?_(rr|uu|vv|ww|pp|qq|sat|[a-z0])(?!\\?[\w|])")
"""A letter and its index, such as k_r and k_rr, printed with the index r|r|; LaTeX escapes the line between."""
_LATEX = {
    "\\": r"\textbackslash{}", "{": r"\{", "}": r"\}", "$": r"\$", "&": r"\&", "#": r"\#", "%": r"\%",
    "_": r"\_", "^": r"\textasciicircum{}", "~": r"\textasciitilde{}", "<": r"\textless{}",
    ">": r"\textgreater{}", "|": r"\textbar{}", '"': r"\textquotedbl{}", "–": "--", "—": "---", "−": "$-$",
    "±": r"$\pm$", "×": r"$\times$", "·": r"$\cdot$", "≤": r"$\leq$", "≥": r"$\geq$", "≈": r"$\approx$",
    "∞": r"$\infty$", "°": r"$^\circ$", "²": "$^2$", "³": "$^3$", "√": r"$\surd$", "τ": r"$\tau$",
    "ψ": r"$\psi$", "ε": r"$\varepsilon$", "Δ": r"$\Delta$", "σ": r"$\sigma$", "π": r"$\pi$",
    "θ": r"$\theta$", "µ": r"$\mu$", "μ": r"$\mu$", "→": r"$\to$", "½": r"$\frac{1}{2}$",
}  # fmt: skip


def _one_line(text: str) -> str:
    return " ".join(text.split())


def escape(text: str) -> str:
    """Return text on one line, without meaning to Markdown or HTML: k_r stays k_r, but no `_x_`, `$x$` or `&lt;`; the
    commands that our own sentences name stay code."""
    text = re.sub(r"([\\|`*<>\[\]$~]|^#)", r"\\\1", _one_line(text))
    text = re.sub(r"(?<![A-Za-z0-9])_|_(?![A-Za-z0-9])", r"\\_", text)
    return re.sub(r"\\`(automarine [\w. -]+)\\`", r"`\1`", re.sub(r"&(?=#?\w+;)", "&amp;", text))


def _latex(cell: str) -> str:
    text = _one_line(cell)
    if match := re.fullmatch(r"([-+]?\d+(?:\.\d+)?)(?:e([-+]?\d+))?", text):
        mantissa, exponent = match.groups()
        if exponent:
            return rf"${mantissa}\times 10^{{{int(exponent)}}}$"
        return f"${mantissa}$" if mantissa[0] in "-+" else mantissa
    safe = "{}" if text[:1] in ("[", "*") else ""  # after the line end of a row these two would be its options
    return safe + in_math("".join(_LATEX.get(c, c) for c in text))


def in_math(text: str) -> str:
    """Set every symbol of a text as LaTeX and matplotlib do."""
    return with_symbols(text, "${}_{{{}}}$")


def with_symbols(text: str, form: str) -> str:
    """Set every symbol of a text in a `form` that takes letter and index."""
    return SYMBOL.sub(lambda match: form.format(match[1], re.sub(r"^(.)\1$", r"\1|\1|", match[2])), text)
