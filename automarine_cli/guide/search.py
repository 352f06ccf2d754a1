"""Search by relevance, of the terminal and of the site: sections of pages ranked by their words (Okapi BM25).

The site's script (`.docs/search.js`) adds up the worths of words that `Index` has written for it, by the rules below.
"""

import math
import re
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import chain

SYNONYMS = {
    "6dof": ("degrees of freedom",), "6 dof": ("degrees of freedom",), "angular velocity": ("rate",),
    "coefficients": ("drag", "added mass"), "damping": ("drag",),
    "deadzone": ("dead band",), "error message": ("message",), "faq": ("questions",),
    "hydrodynamic": ("drag", "added mass"), "imu": ("gyro",), "latency": ("delay",), "nonlinear": ("quadratic",),
    "pid": ("gains",), "residuals": ("innovation",), "rms": ("root mean square",), "rmse": ("root mean square",),
    "rosbag": ("ros",), "setup": ("install",), "simulink": ("matlab",), "torque": ("moment",),
    "turbulence": ("disturbance",), "xlsx": ("excel",),
}  # fmt: skip
"""Words of other fields, and those that the guide has for them."""
SYNONYM_SHARE, BEGINNING_SHARE = 0.6, 0.5  # of a word's worth, where a synonym or only its beginning is there
OF_NAME, OF_HEADING = 10.0, 6.0  # mentions in the text that a page's name and a heading of this word alone are worth
# k1 and b of BM25: Robertson & Zaragoza 2009, The Probabilistic Relevance Framework
SATURATION, LENGTH_SHARE = 1.5, 0.6
PHRASE_FACTOR = 1.6  # of a section that has all words next to each other
COUNTED_SECTIONS, REST_SHARE = 5, 0.02  # sections of a page that make its worth, and the share of all but the best
WORD = re.compile(r"\w+")


@dataclass(frozen=True)
class Section:
    """A page's text under one heading, or a row of a table there; `anchor` is its place in the page. What it is about
    stands in `subject`: its heading, or the row's first cell."""

    page: str
    heading: str
    text: str
    anchor: str = ""
    subject: str = ""


def stems(text: str) -> list[str]:
    """The words of a text in small letters, without the s of a plural."""
    return [re.sub(r"(?<=[^s]{3})s$", "", word) for word in WORD.findall(text.lower())]


def alternatives(query: str) -> list[str]:
    """The query, then what the guide calls it."""
    plain = " ".join(query.lower().replace("-", " ").split())
    synonyms = [(key, words) for key, words in SYNONYMS.items() if re.search(rf"\b{re.escape(key)}s?\b", plain)]
    return [plain, *(re.sub(rf"\b{re.escape(key)}s?\b", word, plain) for key, words in synonyms for word in words)]


@dataclass(frozen=True)
class Index:
    """Sections in the order of their pages, the first of each page being its title's, and what each word is worth."""

    sections: Sequence[Section]
    worths: dict[str, dict[int, float]] = field(init=False, default_factory=lambda: defaultdict(dict))

    def __post_init__(self) -> None:
        counts = [Counter(stems(section.text)) for section in self.sections]
        mean, titled = max(1.0, sum(count.total() for count in counts) / len(counts)), ""
        mentions = list[dict[str, float]]()
        for section, count in zip(self.sections, counts):
            length = 1.0 - LENGTH_SHARE + LENGTH_SHARE * max(count.total() / mean, 1.0)
            times = {word: many / length for word, many in count.items()}
            topic = section.page.rpartition("/")[2].replace("-", " ")
            name, titled = topic * (section.page != titled), section.page
            for words, worth in (({*stems(section.subject or section.heading)}, OF_HEADING), ({*stems(name)}, OF_NAME)):
                times |= {word: times.get(word, 0.0) + worth / math.sqrt(len(words)) for word in words}
            mentions.append(times)
        frequency = Counter(word for words in mentions for word in words)
        for number, times in enumerate(mentions):
            for word, many in times.items():
                rarity = math.log1p((len(mentions) - frequency[word] + 0.5) / (frequency[word] + 0.5))
                self.worths[word][number] = round(rarity * many / (many + SATURATION), 2)

    def ranked(self, query: str) -> list[Section]:
        """The best section of each page that has the words, the best page first. A section has its best alternative's
        worth; words that it does not have count against it twice."""
        worths, pages = dict[int, float](), dict[str, list[tuple[float, int]]]()
        for rank, words in enumerate(alternatives(query)):
            share = SYNONYM_SHARE if rank else 1.0
            for number, worth in self._worths_of(words).items():
                worths[number] = max(worths.get(number, 0.0), share * worth)
        for number, worth in sorted(worths.items()):
            pages.setdefault(self.sections[number].page, []).append((worth, -number))
        best = {page: sorted(weights, reverse=True)[:COUNTED_SECTIONS] for page, weights in pages.items()}
        order = {page: top[0][0] + REST_SHARE * sum(worth for worth, _ in top[1:]) for page, top in best.items()}
        return [self.sections[-best[page][0][1]] for page in sorted(order, key=lambda page: (-order[page], page))]

    def _worths_of(self, words: str) -> dict[int, float]:
        """What each section is worth that has one of the words, or words that begin so."""
        sums, present = defaultdict[int, float](float), Counter[int]()
        terms = stems(words)
        for word in terms:
            best = dict[int, float]()
            for other in (other for other in self.worths if other.startswith(word)):
                share = 1.0 if other == word else BEGINNING_SHARE
                for number, worth in self.worths[other].items():
                    best[number] = max(best.get(number, 0.0), share * worth)
            for number, worth in best.items():
                sums[number] += worth
                present[number] += 1
        for number in sums:
            section = self.sections[number]
            sums[number] *= (present[number] / len(terms)) ** 2
            if len(terms) > 1 and words in f"{section.heading}\n{section.text}".lower().replace("-", " "):
                sums[number] *= PHRASE_FACTOR
        return sums

    def plain(self) -> dict[str, object]:
        """What the site's script needs, as plain data."""
        return {
            "sections": [[s.page, s.heading, s.text, s.anchor] for s in self.sections],
            "worths": {word: [*chain.from_iterable(weights.items())] for word, weights in self.worths.items()},
            "synonyms": SYNONYMS, "synonymShare": SYNONYM_SHARE, "beginningShare": BEGINNING_SHARE,
            "phraseFactor": PHRASE_FACTOR, "rest": COUNTED_SECTIONS, "restShare": REST_SHARE,
        }  # fmt: skip


def line_with(section: Section, terms: Sequence[str]) -> str:
    """The first line with one of the terms, else the one with most of their words; the text's first where none has."""
    lines = [*filter(None, section.text.split("\n"))] or [""]
    words = {word for term in terms for word in stems(term)}
    verbatim = (line for term in terms for line in lines if term in line.lower().replace("-", " "))
    return next(verbatim, max(lines, key=lambda line: sum(word in line.lower() for word in words)))
