"""The site that `make docs` builds: every page is in its menu, every command has its options, and it fits a phone."""

import os
import re
import runpy
from html import unescape
from pathlib import Path
from urllib.parse import quote, unquote, urlsplit

import pytest
from browser import looked_at
from repository import ROOT
from test_guide import BEST
from test_notebooks import NOTEBOOKS
from test_readme import PAGES, without_fences

from automarine_cli.commands import names

SITE = runpy.run_path(str(ROOT / ".docs" / "conf.py"))
MENU = SITE["navigation"]()
LONGEST = 40  # letters of an entry of the menu, which is narrow
WIDTHS = (400, 800, 1280, 1366)  # of phones, tablets and laptops [pixels]
NOT_WORDS = re.compile(
    rf"!\[[^]]*\]\([^)]*\)|\]\([^)]*\)|<img[^>]*>|\$[^$`]+\$|{SITE['POINTER'].pattern}", flags=re.MULTILINE
)
LOOK = """<body>{frames}<script>addEventListener("load", () => {{
  const seen = [...document.querySelectorAll("iframe")].map(frame => {{
    const page = frame.contentDocument, content = page.querySelector(".content");
    return {{
      name: frame.src, wide: frame.clientWidth, width: Math.max(page.scrollingElement.scrollWidth, content.scrollWidth),
      broken: [...page.images].filter(image => !image.naturalWidth).length,
      asked: frame.contentWindow.performance.getEntriesByType("resource").map(each => each.name),
    }};
  }});
  document.documentElement.textContent = JSON.stringify(seen);
}})</script>"""
RESULTS = """<body>{frames}<script>addEventListener("load", () => {{
  const found = [...document.querySelectorAll("iframe")].map(frame => {{
    const results = [...frame.contentDocument.querySelectorAll("#results li")].slice(0, 5);
    return results.map(each => [each.firstChild.href, each.firstChild.textContent, each.lastChild.innerHTML]);
  }});
  document.documentElement.textContent = JSON.stringify(found);
}})</script>"""


def test_every_page_is_in_the_menu_once() -> None:
    listed = [name for pages in MENU.values() for name in pages]
    assert sorted([*listed, "index", "contents"]) == sorted(SITE["PAGES"])
    on_disk = {path.relative_to(ROOT).as_posix() for path in SITE["PAGES"].values()}
    notebooks = {f".docs/notebooks/{path.name}" for path in NOTEBOOKS}
    assert len(notebooks) == 2 and on_disk == {*PAGES, ".docs/python-reference.md", *notebooks}
    assert list(MENU) == ["Start", "How-to", "Reference", "Explanation", "Project"]
    titles = [title for pages in MENU.values() for title in pages.values()]
    assert len(set(titles)) == len(titles) and [title for title in titles if len(title) > LONGEST] == []


def test_every_command_has_its_options_on_one_page() -> None:
    pages = {
        name: PAGES[path.relative_to(ROOT).as_posix()]
        for name, path in SITE["PAGES"].items()
        if name.startswith("commands/")
    }
    listed = [re.findall(r"^\{\.options .*\}$", SITE["options"](name), flags=re.MULTILINE) for name in pages]
    assert sum(map(len, listed)) == len(names()) and all(listed)
    assert [name for name, text in pages.items() if len(SITE["POINTER"].findall(text)) != 1] == []


def words(text: str) -> set[str]:
    return set(re.findall(r"[A-Za-z]{3,}", text))


@pytest.fixture
def built() -> Path:
    if "SITE" not in os.environ:
        pytest.skip("`make docs` builds the site and tests it")
    return Path(os.environ["SITE"]).resolve()


def test_no_word_of_a_page_is_lost(built: Path) -> None:
    for name, path in SITE["PAGES"].items():
        if (page := path.relative_to(ROOT).as_posix()) in PAGES:
            shown = (built / f"{name}.html").read_text(encoding="utf-8")
            said = NOT_WORDS.sub(" ", without_fences(page))
            assert words(said) - words(unescape(re.sub("<[^>]*>", " ", shown))) == set(), name


def test_no_page_is_wider_than_its_window_or_asks_a_network(built: Path, tmp_path: Path) -> None:
    pages = list(built.rglob("*.html"))
    frame = '<iframe src="{}" width="{}" frameborder="0"></iframe>'
    frames = [frame.format(page.as_uri(), wide) for page in pages for wide in WIDTHS]
    seen = looked_at(tmp_path, LOOK.format(frames="".join(frames)), quiet=False)
    assert len(seen) == len(WIDTHS) * len(pages) > 200
    assert [page for page in seen if page["width"] > page["wide"] or page["broken"]] == []
    assert {place for page in seen for place in page["asked"] if not place.startswith("file:")} == set()


def test_the_search_of_the_site_shows_the_best_page_first_with_an_excerpt(built: Path, tmp_path: Path) -> None:
    asked = [f"{(built / 'search.html').as_uri()}?q={quote(words)}" for words in (*BEST, "zeppelin")]
    frames = [f'<iframe src="{each}"></iframe>' for each in asked]
    *found, nothing = looked_at(tmp_path, RESULTS.format(frames="".join(frames)), quiet=False)
    firsts = [Path(unquote(urlsplit(results[0][0]).path)).stem for results in found]
    assert dict(zip(BEST, firsts, strict=True)) == BEST and nothing == []
    for place, title, excerpt in (each for results in found for each in results):
        page = urlsplit(place)
        assert f'id="{page.fragment}"' in Path(unquote(page.path)).read_text(encoding="utf-8")
        assert title and ("<mark>" in excerpt or "›" in title or page.fragment)
    assert all("<mark>" in results[0][2] for results in found[:4])
