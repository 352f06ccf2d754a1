"""The page around a report: one file with its style and its figures, which asks nothing of the network."""

import base64
import re
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from pathlib import Path

from automarine_cli.report.html import markdown

SAFE_PLACE = re.compile(r"[^/\\]+/[^/\\]+")
KINDS = {".svg": "svg+xml", ".png": "png"}
PIXELS_PER_POINT = 1.73  # a page-wide figure fills the page, and letters are of one size in all figures


def page(text: str, folder: Path, title: str) -> str:
    """The report `text` (Markdown) as a page, with the pictures that it names in `folder` drawn into it."""
    body = markdown.to_html(text, lambda place, alt: figure(folder, place, alt))
    style = files("automarine_cli.report.html").joinpath("page.css").read_text(encoding="utf-8").strip()
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'; img-src data:">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{escape(title)}</title>
<link rel="icon" href="data:,">
<style>{style}</style>
</head>
<body>
{_contents(body.headings)}
<main>
{body.html}
</main>
</body>
</html>
"""


def figure(folder: Path, place: str, alt: str) -> str:
    """A figure of the page, from its SVG or else its PNG; a sentence if there is neither.

    An image element lets nothing act that is in its file, and fetches nothing: the file need not be searched.
    """
    for suffix, kind in KINDS.items() if SAFE_PLACE.fullmatch(place) else ():
        path = (folder / place).with_suffix(suffix)
        if path.is_file():
            content = path.read_bytes()
            wide = re.search(rb'viewBox="0 0 ([\d.]+) ', content[:2000]) if suffix == ".svg" else None
            size = f' style="max-width:{PIXELS_PER_POINT * float(wide[1]):.0f}px"' if wide else ""
            data = base64.b64encode(content).decode()
            image = f'<img src="data:image/{kind};base64,{data}" alt="{escape(alt)}"{size}>'
            return f"<figure>{image}<figcaption>{escape(alt)}</figcaption></figure>"
    return f"<p>The figure “{escape(alt)}” is not in its folder.</p>"


def _contents(headings: Sequence[tuple[int, str, str]]) -> str:
    """Links to the sections."""
    links = "".join(f'<a href="#{name}">{escape(said)}</a>' for level, name, said in headings if level == 2)
    return f'<nav aria-label="Sections">{links}</nav>'
