"""A page of the guide as plain text: paragraphs and tables fitted to a width, code as it stands."""

import re
import textwrap
from collections.abc import Callable, Iterator, Sequence
from itertools import groupby

from automarine_cli.report.tables import text_table

INDENT = "  "  # of code
LINK = re.compile(r"(?<!!)\[((?:\\.|[^\]\\])*)\]\(([^)\s]+)\)")
PICTURE = re.compile(r'!\[([^\]]*)\]\([^)]+\)|<img [^>]*alt="([^"]*)"[^>]*>')
HEADING = re.compile(r"(#+) (.*)")
ITEM = re.compile(r"- |\d+\. ")
EMPHASIS = re.compile(r"\*\*|(?<![\w*])\*(?=\S)([^*]+)(?<=\S)\*(?![\w*])")
FORMULA = re.compile(r"(?<![\\`$\w])\$([^$`]+)\$(?!\w)")
LETTERS = {
    "tau": "τ", "psi": "ψ", "varepsilon": "ε", "delta": "δ", "Phi": "Φ", "pi": "π", "infty": "∞", "le": "≤", "to": "→",
    "sum": "Σ", "mp": "∓", "vert": "|", "qquad": " ",
}  # fmt: skip
ESCAPED = re.compile(r"\\([][|*_])")


def to_text(markdown: str, width: int, heading: Callable[[str], str] = str) -> str:
    """The page for a terminal or a file of `width` columns; `heading` paints the lines of headings."""
    return "\n\n".join("\n".join(_shown(block, width, heading)) for block in _blocks(markdown)) + "\n"


def _blocks(markdown: str) -> Iterator[list[str]]:
    """Lines that belong together: a fenced block with its fences, a table, a list, a paragraph."""
    pieces = re.split(r"^(```.*?^```)$", markdown, flags=re.MULTILINE | re.DOTALL)
    for number, piece in enumerate(pieces):
        if number % 2:
            yield piece.split("\n")
            continue
        for filled, lines in groupby(piece.split("\n"), key=lambda line: bool(line.strip())):
            if filled:
                yield from _parted(list(lines))


def _parted(lines: list[str]) -> Iterator[list[str]]:
    """Headings and pictures stand alone, also where no empty line parts them from what follows."""
    for alone, some in groupby(lines, key=lambda line: bool(HEADING.match(line) or PICTURE.fullmatch(line))):
        together = list(some)
        yield from ([line] for line in together) if alone else [together]


def _shown(block: Sequence[str], width: int, heading: Callable[[str], str]) -> list[str]:
    first = block[0]
    if first.startswith("```"):
        inner = [formula(" ".join(block[1:-1]))] if first == "```math" else block[1:-1]
        return [f"{INDENT}{line}".rstrip() for line in inner]
    if match := HEADING.match(first):
        text = inline(match[2])
        return [heading(text), heading(("=" if len(match[1]) == 1 else "-") * len(text))]
    if first.startswith("|"):
        return _table(block, width)
    if match := PICTURE.fullmatch(first):
        return textwrap.wrap(f"[Picture: {match[1] or match[2]}]", width)
    if ITEM.match(first):
        items = re.split(rf"\n(?={ITEM.pattern})", "\n".join(block))
        return [line for item in items for line in _filled(re.sub(r"\s*\n\s*", " ", item), width, hanging="  ")]
    return _filled(" ".join(block), width)


def _filled(text: str, width: int, hanging: str = "") -> list[str]:
    return textwrap.wrap(inline(text), width, subsequent_indent=hanging, break_long_words=False, break_on_hyphens=False)


def _table(block: Sequence[str], width: int) -> list[str]:
    header, sides, *rows = ([cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in block)
    grid = [[inline(cell) for cell in row] for row in (header, *rows)]
    return text_table(grid, [side.endswith(":") for side in sides], (), width)


def formula(tex: str) -> str:
    """A formula in letters that a terminal has: k_r|r| ṙ², √(x), (a)/(b)."""
    text = re.sub(r"\\(?:left|right|mathrm|text)(?![a-z])|\\[,!]", "", tex)
    for name, letter in LETTERS.items():
        text = re.sub(rf"\\{name}(?![a-z])", letter, text)
    text = re.sub(r"\\(ln|cosh|max|min)(?![a-z])", r"\1 ", text)
    text = re.sub(r"\\dot\s*\{?(\w)\}?", "\\1\N{COMBINING DOT ABOVE}", text)
    text = re.sub(r"([_^])\{(\w|-\w)\}", r"\1\2", re.sub(r"_\{([^{}]*)\}", r"_\1", text))
    before = ""
    while before != text:  # from the inside out
        before = text
        text = re.sub(r"\\frac\s*\{([^{}]*)\}\s*\{([^{}]*)\}", _fraction, text)
        text = re.sub(r"\\sqrt\s*\{([^{}]*)\}", r"√(\1)", text)
        text = re.sub(r"\^\{([^{}]*)\}", r"^(\1)", text)
    text = re.sub(r"\{([^{}]*)\}", r"\1", text).replace("\\ ", " ")
    text = re.sub(r"\^([234])", lambda match: "²³⁴"[int(match[1]) - 2], text)
    return re.sub(r"\s+", " ", text).replace("( ", "(").replace(" (", " (").strip()


def _fraction(match: re.Match[str]) -> str:
    above, below = (part if re.fullmatch(r"[^\s/]+", part) else f"({part})" for part in match.groups())
    return f"({above}/{below})"


def inline(text: str) -> str:
    """Links as words and where they lead; emphasis and escapes as the words alone."""
    text = FORMULA.sub(lambda match: formula(match[1]), text)
    plain = EMPHASIS.sub(lambda match: match[1] or "", LINK.sub(_followed, text))
    return ESCAPED.sub(r"\1", plain)


def _followed(match: re.Match[str]) -> str:
    """A link's words, and the page of the guide that it leads to unless they say it."""
    words, place = match[1], match[2].partition("#")[0]
    if "://" in place:
        return f"{words} ({place})"
    topic = place.rpartition("/")[2].removesuffix(".md")
    bare = words.strip("`").removeprefix("automarine ")
    if topic in ("", bare):
        return words
    return f"{words} (guide {topic})" if topic.islower() else f"{words} ({topic})"
