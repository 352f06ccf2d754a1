"""The user's guide: one topic, one page of Markdown; the pages in `commands/` have the names of their commands."""

import difflib
import re
from dataclasses import dataclass
from pathlib import Path

from automarine_cli import effects
from automarine_cli.errors import SettingError

FOLDER = Path(__file__).parent
OPTIONS = "`automarine {command} --help` lists all options."  # gives way to the list itself where a page is shown
# commands without a page of their own
ON_PAGE_OF = {"fit-sway": "fit-surge", "fit-heave": "fit-surge", "fit-pitch": "fit-roll"}

SYNONYMS = {
    "6dof": ("degrees of freedom",), "angular velocity": ("rate",), "coefficients": ("drag", "added mass"),
    "confidence interval": ("interval",), "damping": ("drag",), "deadzone": ("dead band",),
    "hydrodynamic coefficients": ("drag", "added mass"), "imu": ("gyro",), "latency": ("delay",),
    "pid": ("gains",), "residuals": ("innovation",), "rmse": ("root mean square",), "rosbag": ("ros",),
    "simulink": ("matlab",), "time delay": ("delay",), "torque": ("moment",), "turbulence": ("disturbance",),
}  # fmt: skip
"""Words of other fields, and those that the guide has for them."""
HEADING_WORTH, TITLE_WORTH = 3, 10  # mentions in the text that a heading counts as, and a title


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
    """Search all pages for words (or their synonyms) from the beginnings of words on. Pages rank by mentions per
    length; headings and titles are worth more. Raises SettingError where no page has them."""
    from automarine_cli.guide.text import inline

    terms = (words.strip().lower(), *SYNONYMS.get(words.strip().lower(), ()))
    pattern = re.compile("|".join(rf"\b{re.escape(term)}" for term in terms), re.IGNORECASE)
    ranked = list[tuple[float, Place]]()
    for topic in sorted({*commands(), *pages()} - {*ON_PAGE_OF}):
        text = re.sub(r"^(?:!\[|<img|\$ |>>> ).*\n", "", page(topic).markdown, flags=re.MULTILINE)
        parts = re.split(r"^#+ ", text, flags=re.MULTILINE)[1:]
        headings = [part.partition("\n")[0] for part in parts]
        mentions = [len(pattern.findall(part)) for part in parts]
        if not any(mentions):
            continue
        titles = len(pattern.findall(headings[0])) * TITLE_WORTH
        named = [HEADING_WORTH * len(pattern.findall(heading)) for heading in headings]
        worth = titles + sum(named) + sum(mentions) / (1.0 + len(text.split()) / 1000.0)
        best = max(range(len(parts)), key=lambda k: (named[k] + mentions[k], -k))
        lines = [line for line in parts[best].splitlines()[1:] if pattern.search(line)]
        ranked.append(
            (worth, Place(topic, inline(headings[best]), _excerpt(inline(lines[0]), pattern) if lines else ""))
        )
    if not ranked or not terms[0]:
        raise SettingError(f"no page of the guide has {words!r}; try another word, or automarine guide")
    return Places(terms, tuple(place for _, place in sorted(ranked, key=lambda pair: -pair[0])))


def _excerpt(line: str, pattern: re.Pattern[str], around: int = 35) -> str:
    """The words about the first mention; of a table, those of its cell."""
    cell = next((cell for cell in line.strip("|").split("|") if pattern.search(cell)), line)
    text = re.sub(r"^(- |\d+\. )|`", "", cell.strip())
    match = pattern.search(text)
    at = match.start() if match else 0
    first = text.find(" ", at - around) + 1 if at > around else 0
    last = text.rfind(" ", at, at + 2 * around) if len(text) > at + 2 * around else len(text)
    return f"{'... ' if first else ''}{text[first:last]}{' ...' if last < len(text) else ''}"
