"""Guide, README and help texts are plain English: short sentences, and none of the words that readers stumbled over."""

import re
from pathlib import Path

import click
import pytest
from test_readme import PAGES, commands, sentences, without_fences, words

MAX_WORDS = 30  # a sentence; write for 25
MAX_WORDS_IN_ALL = 34_690
MADE = ("troubleshooting", "campaign-file", "limits-file", "effects-gallery", "why-not")
"""Pages that are made of others and of the code, whose words are written elsewhere."""
DENIED = (
    r"beside", r"counts", r"holds", r"said of", r"says? nothing of", r"one's own", r"of one's", r"(?:taken|takes?) off",
    r"refuse[sd]?", r"mend(?:s|ed)?", r"told", r"asked for", r"the more", r"nobody knows", r"and not the other",
    r"were it", r"had it", r"be it", r"of which", r"by which", r"whose own", r"in so far",
)  # fmt: skip
"""Words and phrases with a plainer one: next to, is used, contains, subtracted, rejected, fixed, requested."""
HELP = {f"{name} --help": command for name, command in commands().items()}
"""Help texts by the words that show them."""


def prose(name: str) -> str:
    """The running text of a page or a help text, without fences and code."""
    return re.sub(r"`[^`\n]*`", "`code`", help_of(HELP[name]) if name in HELP else without_fences(name))


def help_of(command: click.Command) -> str:
    """A command's sentences and those of its options; examples, which follow a backspace, are left out."""
    text = [command.help or "", *(param.help or "" for param in command.params if isinstance(param, click.Option))]
    return "\n\n".join(re.sub(r"\x08.*?(?=\n\n|\Z)", "", part, flags=re.DOTALL) for part in text)


def denied(text: str) -> list[str]:
    """The denied words of a text, each with what stands around it."""
    pattern = rf".{{0,30}}\b(?:{'|'.join(DENIED)})\b.{{0,20}}"
    return re.findall(pattern, re.sub(r"\s+", " ", text), flags=re.IGNORECASE)


def chained(text: str) -> list[str]:
    """Sentences of three parts or more, strung together by semicolons."""
    return [sentence for sentence in sentences(text) if sentence.count("; ") > 1]


@pytest.mark.parametrize("name", [*PAGES, *HELP])
def test_sentences_are_short_and_plain(name: str) -> None:
    text = prose(name)
    assert [sentence for sentence in sentences(text) if words(sentence) > MAX_WORDS] == []
    assert (chained(text), denied(text)) == ([], [])


def test_readme_and_guide_stay_short() -> None:
    written = [text for page, text in PAGES.items() if Path(page).stem not in MADE and not page.startswith(".")]
    assert len(written) > 40 and sum(len(text.split()) for text in written) <= MAX_WORDS_IN_ALL


def test_the_test_can_fail() -> None:
    assert len(denied("What counts is `beside` it, and that\nholds.")) == 1
    assert denied("Accounts, threshold and remainder.") == [] and chained("One; two. Three; four") == []
    assert len(chained("One; two; three.")) == 1
    assert "Usage" not in help_of(HELP["check --help"]) and len(help_of(HELP["check --help"])) > 200
