"""The user's guide: one topic, one page of Markdown; the pages in `commands/` have the names of their commands."""

import difflib
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from automarine_cli import effects
from automarine_cli.errors import SettingError

if TYPE_CHECKING:
    from automarine_cli.guide.search import Index, Section

FOLDER = Path(__file__).parent
OPTIONS = "`automarine {command} --help` lists all options."  # gives way to the list itself where a page is shown
ROW = re.compile(r"\|+([^|]*)\||- \*\*([^*]*)\*\*: ")  # of a table, or of a list that begins with what it explains
# commands without a page of their own
ON_PAGE_OF = {"fit-sway": "fit-surge", "fit-heave": "fit-surge", "fit-pitch": "fit-roll"}


@dataclass(frozen=True)
class Contents:
    """All topics with what each is about in one line: the commands, and the other pages."""

    commands: tuple[tuple[str, str], ...]
    pages: tuple[tuple[str, str], ...]

    def to_json(self) -> dict[str, object]:
        topics = [{"topic": name, "about": about} for name, about in (*self.commands, *self.pages)]
        return {"schema": "automarine/guide/1", "topics": topics}


@dataclass(frozen=True)
class Page:
    topic: str
    markdown: str

    def to_json(self) -> dict[str, str]:
        return {"schema": "automarine/guide/1", "topic": self.topic, "text": self.markdown}


@dataclass(frozen=True)
class Place:
    """A page that has the words: the heading under which they are first or most, and a line with them."""

    topic: str
    heading: str
    line: str


@dataclass(frozen=True)
class Places:
    """Pages that have the words or their synonyms, the best first."""

    words: tuple[str, ...]
    places: tuple[Place, ...]

    def to_json(self) -> dict[str, object]:
        return {"schema": "automarine/guide/1", "words": list(self.words), "places": [vars(p) for p in self.places]}


def commands() -> tuple[str, ...]:
    return tuple(sorted((*ON_PAGE_OF, *(path.stem for path in FOLDER.glob("commands/*.md")))))


def pages() -> tuple[str, ...]:
    return tuple(sorted(path.stem for path in FOLDER.glob("*.md")))


def groups() -> dict[str, list[str]]:
    """Topics of pages that are no commands, by the headings of the contents, which come first."""
    headings = re.split(r"^## ", page("contents").markdown, flags=re.MULTILINE)[1:]
    listed = {part.partition("\n")[0]: re.findall(r"\]\(([a-z0-9-]+)\.md\)", part) for part in headings}
    listed["Start"] = ["contents", *listed["Start"]]
    return {heading: topics for heading, topics in listed.items() if topics}


def title(topic: str) -> str:
    return page(topic).markdown.partition("\n")[0].removeprefix("# ")


def page(topic: str) -> Page:
    """The page on a topic, as on disk; raises SettingError with the nearest names where there is none."""
    for file in (*FOLDER.glob("commands/*.md"), *FOLDER.glob("*.md")):
        if file.stem == ON_PAGE_OF.get(topic, topic):
            return Page(topic, file.read_text(encoding="utf-8"))
    query = topic.lower().replace("_", "-").removesuffix(".md")
    similar = difflib.get_close_matches(query, (*commands(), *pages()), n=3, cutoff=0.5)
    meant = f"did you mean {' or '.join(similar)}?" if similar else f"try automarine guide --find {query}"
    if query in effects.names():
        meant = f"look at automarine effects {query}"
    raise SettingError(f"the guide has no page {topic!r}; {meant}")


def with_options(command: Page, listed: str) -> Page:
    """A command's page with the list of its options in place of the pointer to its --help."""
    pointer = OPTIONS.format(command=ON_PAGE_OF.get(command.topic, command.topic))
    return Page(command.topic, command.markdown.replace(pointer, f"```text\n{listed.rstrip()}\n```"))


def find(words: str) -> Places:
    """Search all pages for words, their beginnings or their synonyms. Raises SettingError where no page has them."""
    from automarine_cli.guide.search import alternatives, line_with

    terms = alternatives(words)
    best = _index().ranked(words) if terms[0] else []
    if not best:
        raise SettingError(f"no page of the guide has {words!r}; try another word, or automarine guide")
    return Places(tuple(terms), tuple(Place(s.page, s.heading, _excerpt(line_with(s, terms), terms)) for s in best))


@cache
def _index() -> "Index":
    from automarine_cli.guide.search import Index

    return Index(list(sections()))


def sections() -> "Iterator[Section]":
    """What the pages say under each heading, and each row of a table and entry of the glossary by itself."""
    from automarine_cli.guide.search import Section
    from automarine_cli.guide.text import inline

    for topic in sorted({*commands(), *pages()} - {*ON_PAGE_OF, "contents"}):
        text = re.sub(r"^(?:!\[|<img|\$ |>>> |\|.*\n\|[-:| ]+\|$).*\n", "", page(topic).markdown, flags=re.MULTILINE)
        pieces = re.split(r"^```.*\n", text, flags=re.MULTILINE)
        pieces[::2] = [re.sub(r"(?<=[^\n|])\n(?=[^\s|#-])", " ", prose) for prose in pieces[::2]]
        pieces[1::2] = [re.sub(r"^", "  ", code, flags=re.MULTILINE) for code in pieces[1::2]]
        for part in re.split(r"^#+ ", "".join(pieces), flags=re.MULTILINE)[1:]:
            heading, *lines = part.splitlines()
            rows = {line: row for line in lines if (row := ROW.match(line))}
            yield Section(topic, inline(heading), inline("\n".join(line for line in lines if line not in rows)))
            for line, row in rows.items():
                cells = inline(" | ".join(line.strip("|").split("|")))
                yield Section(topic, inline(heading), cells, subject=inline(row[1] or row[2]))


def _excerpt(line: str, terms: Sequence[str], around: int = 35) -> str:
    """The words about the first mention; of a table, those of its cell."""
    from automarine_cli.guide.search import stems

    found = [term for term in (*terms, *stems(" ".join(terms))) if term in line.lower()]
    cell = next((cell for cell in line.strip("|").split("|") if found and found[0] in cell.lower()), line)
    text = re.sub(r"^(- |\d+\. )|`", "", cell.strip())
    at = max(text.lower().find(found[0]), 0) if found else 0
    first = text.find(" ", at - around) + 1 if at > around else 0
    last = text.rfind(" ", at, at + 2 * around) if len(text) > at + 2 * around else len(text)
    return f"{'... ' if first else ''}{text[first:last]}{' ...' if last < len(text) else ''}"
