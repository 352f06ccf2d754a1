"""The page around a report: one file with its style, its script and its figures, which asks nothing of the network."""

import base64
import hashlib
import re
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from pathlib import Path

from automarine_cli.report.html import markdown, svg

SAFE_PLACE = re.compile(r"[^/\\]+/[^/\\]+")


def page(text: str, folder: Path, title: str) -> str:
    """The report `text` (Markdown) as a page, with the pictures that it names in `folder` drawn into it."""
    script = _part("page.js")
    sealed = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    body = markdown.to_html(text, lambda place, alt: figure(folder, place, alt))
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'; \
script-src 'sha256-{sealed}'; img-src data:">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{escape(title)}</title>
<link rel="icon" href="data:,">
<style>{_part("page.css")}</style>
</head>
<body>
{_contents(body.headings)}
<main>
{body.html}
</main>
<script>{script}</script>
</body>
</html>
"""


def figure(folder: Path, place: str, alt: str) -> str:
    """A figure of the page: drawn inline from its SVG, else embedded as PNG; a sentence if neither can be shown."""
    caption = f"<figcaption>{escape(alt)}</figcaption>"
    path = folder / place
    drawn = path.with_suffix(".svg")
    prefix = re.sub(r"\W", "-", place.rpartition(".")[0]) + "-"
    if SAFE_PLACE.fullmatch(place) and drawn.is_file():
        try:
            return f"<figure>{svg.inline(drawn.read_text(encoding='utf-8'), prefix, alt)}{caption}</figure>"
        except ValueError:  # not what automarine draws; the PNG may serve
            pass
    if SAFE_PLACE.fullmatch(place) and path.suffix == ".png" and path.is_file():
        data = base64.b64encode(path.read_bytes()).decode()
        return f'<figure><img src="data:image/png;base64,{data}" alt="{escape(alt)}">{caption}</figure>'
    return f"<p>The figure “{escape(alt)}” is not in its folder.</p>"


def _contents(headings: Sequence[tuple[int, str, str]]) -> str:
    """Links to the sections."""
    links = "".join(f'<a href="#{name}">{escape(said)}</a>' for level, name, said in headings if level == 2)
    return f'<nav aria-label="Sections">{links}</nav>'


def _part(name: str) -> str:
    return files("automarine_cli.report.html").joinpath(name).read_text(encoding="utf-8").strip()
