"""A table as lines of text: as wide as it is, or fitted to a terminal by folding cells and, at last, columns."""

import textwrap
from collections.abc import Sequence

GAP = 2  # blanks between columns
NARROW = 8  # characters below which no column is folded
LIKED = 24  # characters that a column may have when there must be several tables anyway
_TIED = "\N{NO-BREAK SPACE}"


def text_table(
    grid: Sequence[Sequence[str]], right: Sequence[bool], rules: Sequence[int], width: int | None = None
) -> list[str]:
    """Lines of a table whose first row is the header; `right` are the columns that stand to the right.

    With a `width` cells are folded at blanks, the widest columns first; what is still too wide is shown as
    several tables one below the other, each with the first column.
    """
    widths = [max(len(row[i]) for row in grid) for i in range(len(grid[0]))]
    if width is None or _total(widths) <= width:
        return _block(grid, widths, right, rules, range(len(widths)))
    least = [max(len(word) for row in grid for word in (*_words(row[i]), "")) for i in range(len(grid[0]))]
    least = [min(wide, max(NARROW, one)) for one, wide in zip(least, widths)]
    lines: list[str] = []
    liked = [min(wide, max(LIKED, one)) for one, wide in zip(least, widths)]
    whole = [list(range(len(widths)))]
    for columns in whole if _total(least) <= width else _groups(liked, width):
        narrowed = _narrowed([widths[i] for i in columns], [least[i] for i in columns], width)
        shown = [widths[i] for i in range(len(widths))]
        for i, one in zip(columns, narrowed):
            shown[i] = one
        lines += [*([""] if lines else []), *_block(grid, shown, right, rules, columns)]
    return lines


def _total(widths: Sequence[int]) -> int:
    return sum(widths) + GAP * (len(widths) - 1)


def _words(cell: str) -> list[str]:
    """What is never folded: words, and an interval in brackets as a whole."""
    inside, text = False, ""
    for character in cell:
        inside = character == "[" or (inside and character != "]")
        text += _TIED if character == " " and inside else character
    return text.split(" ")


def _groups(least: Sequence[int], width: int) -> list[list[int]]:
    """Columns that fit beside the first one, group by group."""
    groups, taken = [[0]], least[0]
    for i in range(1, len(least)):
        if taken + GAP + least[i] > width and len(groups[-1]) > 1:
            groups.append([0])
            taken = least[0]
        groups[-1].append(i)
        taken += GAP + least[i]
    return groups


def _narrowed(widths: list[int], least: list[int], width: int) -> list[int]:
    """Widths that fit: always the widest column that can still give way gives way by one."""
    now = list(widths)
    while _total(now) > width:
        free = [i for i in range(len(now)) if now[i] > least[i]]
        if not free:
            break
        now[max(free, key=lambda i: now[i])] -= 1
    return now


def _block(
    grid: Sequence[Sequence[str]], widths: Sequence[int], right: Sequence[bool], rules: Sequence[int],
    columns: Sequence[int],
) -> list[str]:  # fmt: skip
    rule = "-" * _total([widths[i] for i in columns])
    lines = []
    for number, row in enumerate(grid):
        if number == 1 or (number > 1 and number - 1 in rules):
            lines.append(rule)
        cells = [_folded(row[i], widths[i]) for i in columns]
        for k in range(max(len(cell) for cell in cells)):
            parts = (
                text.rjust(widths[i]) if right[i] else text.ljust(widths[i])
                for i, text in ((i, cell[k] if k < len(cell) else "") for i, cell in zip(columns, cells))
            )
            lines.append((" " * GAP).join(parts).rstrip())
    return lines if len(grid) > 1 else [*lines, rule]


def _folded(cell: str, width: int) -> list[str]:
    if len(cell) <= width:
        return [cell]
    text = " ".join(_words(cell))
    found = textwrap.wrap(text, width, break_long_words=False, break_on_hyphens=False) or [""]
    return [line.replace(_TIED, " ") for line in found]
