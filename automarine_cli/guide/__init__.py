"""The user's guide: one topic, one page of Markdown; the pages in `commands/` have the names of their commands."""

import difflib
from dataclasses import dataclass
from pathlib import Path

from automarine_cli.errors import SettingError

FOLDER = Path(__file__).parent
OPTIONS = "`automarine {command} --help` lists all options."  # gives way to the list itself where a page is shown
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


def commands() -> tuple[str, ...]:
    return tuple(sorted((*ON_PAGE_OF, *(path.stem for path in FOLDER.glob("commands/*.md")))))


def pages() -> tuple[str, ...]:
    return tuple(sorted(path.stem for path in FOLDER.glob("*.md")))


def title(topic: str) -> str:
    return page(topic).markdown.partition("\n")[0].removeprefix("# ")


def page(topic: str) -> Page:
    """The page on a topic, as on disk; raises SettingError with the nearest names where there is none."""
    for file in (*FOLDER.glob("commands/*.md"), *FOLDER.glob("*.md")):
        if file.stem == ON_PAGE_OF.get(topic, topic):
            return Page(topic, file.read_text(encoding="utf-8"))
    query = topic.lower().replace("_", "-").removesuffix(".md")
    similar = difflib.get_close_matches(query, (*commands(), *pages()), n=3, cutoff=0.5)
    meant = f"did you mean {' or '.join(similar)}?" if similar else "look at the list of automarine guide"
    raise SettingError(f"the guide has no page {topic!r}; {meant}")


def with_options(command: Page, listed: str) -> Page:
    """A command's page with the list of its options in place of the pointer to its --help."""
    pointer = OPTIONS.format(command=ON_PAGE_OF.get(command.topic, command.topic))
    return Page(command.topic, command.markdown.replace(pointer, f"```text\n{listed.rstrip()}\n```"))
