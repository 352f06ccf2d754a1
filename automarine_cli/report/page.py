"""The page around a report: one file with its style, its script and its figures, which asks nothing of the network."""

import base64
import hashlib
import re
from collections.abc import Callable, Sequence
from html import escape, unescape
from importlib.resources import files
from itertools import count, groupby
from pathlib import Path

from automarine_cli.report.tables import with_symbols

Picture = Callable[[str, str], str]
"""HTML of the picture at a place (relative, as written), told in words by the other argument."""

FOLD_TAG = re.compile(r"<details><summary>(.*)</summary>|</details>")
PICTURE_LINE = re.compile(r"!\[((?:\\.|[^\]\\])*)\]\(([^()\s]+)\)")
HEADING_LINE = re.compile(r"(#{1,6}) +(.+)")
TOKEN = re.compile(r"(?<!\\)`([^`]*)`|(?<!\\)\*\*((?:\\.|[^*\\])+)\*\*")
LONG_CELL_LETTERS = 36  # letters from which on a cell may be broken


def to_html(text: str, picture: Picture) -> str:
    ids, groups = set[str](), groupby(map(str.strip, text.splitlines()), _mark)
    return "\n".join(_block(block, picture, ids) for _, group in groups if (block := list(group))[0])


def _mark(line: str) -> object:
    """What the lines of a table, of a list or of a choice of pictures begin with; all others stand alone."""
    return next((mark for mark in ("|", "- ", "![") if line.startswith(mark)), object())


def plain(text: str) -> str:
    return unescape(re.sub(r"\\([!-/:-@\[-`{-~])|\*\*|(?<!\\)`", lambda match: match[1] or "", text))


def _block(block: Sequence[str], picture: Picture, ids: set[str]) -> str:
    line = block[0]
    if line.startswith("|") and len(block) > 1:
        return _table(block)
    if line.startswith("- "):
        return "<ul>" + "".join(f"<li>{words(item[2:])}</li>" for item in block) + "</ul>"
    if match := HEADING_LINE.fullmatch(line):
        level, title = len(match[1]), plain(match[2])
        stem = re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-") or "part"
        name = next(name for n in count(1) if (name := stem if n == 1 else f"{stem}-{n}") not in ids)
        ids.add(name)
        anchor = f'<a class="anchor" href="#{name}" aria-label="Link to: {escape(title)}">#</a>'
        return f'<h{level} id="{name}">{words(match[2])} {anchor}</h{level}>'
    if match := FOLD_TAG.fullmatch(line):
        return f"<details><summary>{words(match[1])}</summary>" if match[1] is not None else "</details>"
    if all(matches := [PICTURE_LINE.fullmatch(line) for line in block]):
        figures = "".join(picture(match[2], plain(match[1])) for match in matches if match)
        return f'<div class="choice">{figures}</div>' if len(block) > 1 else figures
    return f"<p>{words(line)}</p>"


def words(text: str) -> str:
    """Render text of one line with code, bold, and symbols with their index below."""
    parts, at = [], 0
    for match in TOKEN.finditer(text):
        code = match[1] is not None
        inner = f"<code>{escape(match[1])}</code>" if code else f"<strong>{words(match[2])}</strong>"
        parts += [_symbols(plain(text[at : match.start()])), inner]
        at = match.end()
    return "".join([*parts, _symbols(plain(text[at:]))])


def _symbols(text: str) -> str:
    """Escaped text with symbols as in print, in which no per cent sign begins a line."""
    return with_symbols(escape(text).replace(" %", "\N{NO-BREAK SPACE}%"), "<var>{}</var><sub>{}</sub>")


def _table(block: Sequence[str]) -> str:
    head, sides, *rows = ([cell.strip() for cell in re.split(r"(?<!\\)\|", line)][1:-1] for line in block)
    right = [side.endswith(":") for side in sides] + [False] * len(head)

    def row(cells: Sequence[str], head: bool) -> str:
        texts = ""
        for i, cell in enumerate(cells):
            tag, scope = ("th", ' scope="col"') if head else ("th", ' scope="row"') if i == 0 else ("td", "")
            kind = ' class="n"' if right[i] else ' class="long"' if len(cell) > LONG_CELL_LETTERS else ""
            texts += f"<{tag}{scope}{kind}>{words(cell)}</{tag}>"
        return f"<tr>{texts}</tr>"

    body = "".join(row(cells, False) for cells in rows)
    return (
        '<div class="table"><div class="scroll" tabindex="0" role="region" aria-label="Table">'
        f"<table><thead>{row(head, True)}</thead><tbody>{body}</tbody></table></div></div>"
    )


SAFE_PLACE = re.compile(r"[^/\\]+/[^/\\]+")
MEDIA_TYPES = {".svg": "svg+xml", ".png": "png"}
PIXELS_PER_POINT = 1.73  # a page-wide figure fills the page, and letters are of one size in all figures


def page(text: str, folder: Path, title: str) -> str:
    """The report `text` (Markdown) as a page, with the pictures that it names in `folder` drawn into it."""
    body = to_html(text, lambda place, alt: figure(folder, place, alt))
    headings = re.findall(r'^<h2 id="(.+?)">(.*) <a class="anchor"', body, flags=re.MULTILINE)
    links = (f'<a href="#{name}">{heading}</a>' for name, heading in headings)
    css, js, html = (files(__package__).joinpath(f"page.{kind}").read_text("utf-8") for kind in ("css", "js", "html"))
    allowed = base64.b64encode(hashlib.sha256(js.strip().encode()).digest()).decode()  # this script, and no other
    policy = f"default-src 'none'; style-src 'unsafe-inline'; img-src data:; script-src 'sha256-{allowed}'"
    return html.format(
        css=css.strip(), js=js.strip(), policy=policy, title=escape(title), links="".join(links), body=body
    )


def figure(folder: Path, place: str, alt: str) -> str:
    """A figure of the page, from its SVG or else its PNG; a sentence if there is neither. An image element lets nothing
    act that is in its file, and fetches nothing: the file need not be searched."""
    for suffix, kind in MEDIA_TYPES.items() if SAFE_PLACE.fullmatch(place) else ():
        path = (folder / place).with_suffix(suffix)
        if path.is_file():
            content = path.read_bytes()
            wide = re.search(rb'viewBox="0 0 ([\d.]+) ', content[:2000])
            size = f' style="max-width:{PIXELS_PER_POINT * float(wide[1]):.0f}px"' if wide else ""
            data = base64.b64encode(content).decode()
            image = f'<img src="data:image/{kind};base64,{data}" alt="{escape(alt)}"{size}>'
            return f'<figure tabindex="0">{image}<figcaption>{escape(alt)}</figcaption></figure>'
    return f"<p>The figure “{escape(alt)}” is not in its folder.</p>"
