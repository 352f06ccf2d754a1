"""A figure's SVG made fit to stand inside a page: only what draws, names of its own, and as few bytes as serve.

The file is read as if anybody had written it: elements and attributes that draw are kept, all others fall away,
scripts, links and places outside of the page among them.
"""

import re
from collections.abc import Iterator
from html import escape
from xml.etree import ElementTree

ELEMENTS = frozenset(
    {"svg", "g", "defs", "clipPath", "path", "rect", "circle", "ellipse", "line", "polyline", "polygon", "use",
     "text", "tspan", "image"}
)  # fmt: skip
ATTRIBUTES = frozenset(
    {"id", "class", "d", "x", "y", "x1", "y1", "x2", "y2", "cx", "cy", "r", "rx", "ry", "dx", "dy", "width", "height",
     "points", "transform", "style", "clip-path", "clip-rule", "fill", "fill-rule", "stroke", "stroke-width", "opacity",
     "text-anchor", "viewBox", "preserveAspectRatio", "data-panels"}
)  # fmt: skip
HREF = "{http://www.w3.org/1999/xlink}href"
INSIDE = re.compile(r"#[\w.:-]+|data:image/png;base64,[A-Za-z0-9+/=\s]+")
STYLE = re.compile(r"[\w\s#:;,.%()'\"+-]*")
OUTWARD = re.compile(r"url\((?!#)|@import|expression", re.IGNORECASE)
PIXELS_PER_POINT = 1.73  # a page-wide figure fills the page, and letters are of one size in all figures
LONG_NUMBER = re.compile(r"-?\d+\.\d{3,}")
UNUSED_FONT = re.compile(r"font-family: 'DejaVu Sans',[^;]*;? ?")


def inline(text: str, prefix: str, title: str) -> str:
    """The SVG as an element of a page, its ids begun with `prefix`, told to those who cannot see it by `title`.

    Raises ValueError for what is not an SVG.
    """
    if "<!ENTITY" in text:
        raise ValueError("an SVG with entities of its own")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as problem:
        raise ValueError(f"not an SVG: {problem}") from None
    if _name(root) != "svg":
        raise ValueError("not an SVG")
    for attribute in ("width", "height", "style"):
        root.attrib.pop(attribute, None)
    wide = re.fullmatch(r"0 0 ([\d.]+) [\d.]+", root.get("viewBox", ""))
    size = f' style="max-width:{PIXELS_PER_POINT * float(wide[1]):.0f}px"' if wide else ""
    head = f'<svg role="img" aria-label="{escape(title)}"{size}{_attributes(root, prefix)}>'
    return head + "".join(piece for child in root for piece in _pieces(child, prefix)) + "</svg>"


def _pieces(element: ElementTree.Element, prefix: str, given: str = "") -> Iterator[str]:
    """An element and what is in it; `given` is the style that it has from the group around it."""
    name = _name(element)
    if name not in ELEMENTS:
        return
    shared = _shared_style(element) if name == "g" else ""
    if shared:
        element.set("style", shared)
    if given and element.get("style") == given:
        del element.attrib["style"]
    if not len(element) and not element.text:
        yield f"<{name}{_attributes(element, prefix)}/>"
        return
    yield f"<{name}{_attributes(element, prefix)}>"
    if name in ("text", "tspan"):
        yield escape(element.text or "", quote=False)
    for child in element:
        yield from _pieces(child, prefix, shared)
        if name in ("text", "tspan"):
            yield escape((child.tail or "").strip("\n "), quote=False)
    yield f"</{name}>"


def _shared_style(group: ElementTree.Element) -> str:
    """The style that all markers of a group have: said once."""
    styles = {child.get("style", "") for child in group}
    alike = len(group) > 1 and len(styles) == 1 and {_name(child) for child in group} == {"use"}
    return styles.pop() if alike and not group.get("style") else ""


def _attributes(element: ElementTree.Element, prefix: str) -> str:
    kept = []
    for key, value in element.attrib.items():
        if key in (HREF, "href"):
            if INSIDE.fullmatch(value):
                kept.append(("href", f"#{prefix}{value[1:]}" if value[0] == "#" else "".join(value.split())))
        elif key in ATTRIBUTES and not OUTWARD.search(value) and (key != "style" or STYLE.fullmatch(value)):
            kept.append((key, _shorter(key, value, prefix)))
    return "".join(f' {key}="{escape(value)}"' for key, value in kept)


def _shorter(key: str, value: str, prefix: str) -> str:
    """The value with the page's ids, and a hundredth of a point for the last digit of places."""
    if key == "id":
        return prefix + value
    if key == "clip-path":
        return value.replace("url(#", f"url(#{prefix}")
    if key == "data-panels":
        return value
    if key == "style":
        return UNUSED_FONT.sub("", value).replace("; ", ";").replace(": ", ":")
    value = " ".join(value.split()) if key == "d" else value
    return LONG_NUMBER.sub(lambda found: f"{float(found[0]):.2f}", value)


def _name(element: ElementTree.Element) -> str:
    """The tag without its namespace; nothing for comments and instructions."""
    return element.tag.rpartition("}")[2] if isinstance(element.tag, str) else ""
