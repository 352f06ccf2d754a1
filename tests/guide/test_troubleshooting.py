"""The page of troubles is made of what can go wrong with each command; run as a program, this writes it anew:
`PYTHONPATH=.:tests/helpers python tests/guide/test_troubleshooting.py`."""

import re

import pytest
from test_readme import PAGES

from automarine_cli import guide

PAGE = guide.FOLDER / "troubleshooting.md"
SECTION = re.compile(r"^## What can go wrong\n\n(.*?)(?=^## |\Z)", flags=re.MULTILINE | re.DOTALL)
ITEM = re.compile(
    r"(?P<message>(?:\*[^*]+\*,? ?)+[^:*]*): "  # *"one"*, *"another"*, in heave:
    r"(?P<cause>.+?[.!?]\)?) "
    r"(?P<remedy>[A-Z`\[(].*[.!?]\)?)"
)
HEAD = """# Troubleshooting: messages, causes and remedies

Look for the beginning of a message in the index, or for a word of it: `automarine guide --find WORD`. Messages have
quotation marks, other symptoms have none. Each table is from the page of its command, where you find more. If a result
is doubtful, but there is no message, see [Is my model good enough?](good-enough.md).
"""


INDEX, PUNCTUATION = "## Index of messages by their first words\n\n", " \"-.'["
INDEX_WORDS = 7  # of a message, in the index

PAGES_OF_COMMANDS = sorted(path.stem for path in guide.FOLDER.glob("commands/*.md"))


def rows(name: str, section: str) -> list[tuple[str, str, str]]:
    """Message, cause and remedy of each item of a section; raises ValueError for one that is written otherwise."""
    found = []
    for item in re.split(r"^- ", section, flags=re.MULTILINE):
        line = " ".join(item.split())
        if line and not (match := ITEM.fullmatch(line)):
            raise ValueError(f"{name}.md: write `- *message or symptom*: cause. Remedy.`, not `- {line}`")
        if line:
            found.append((match["message"], match["cause"][0].upper() + match["cause"][1:], match["remedy"]))
    return found


def troubles() -> str:
    """The page as its sources have it: a table for each page of commands, links as they are from one folder up."""
    parts, begun = [HEAD], dict[str, str]()
    for name in PAGES_OF_COMMANDS:
        text, here = PAGES[f"automarine_cli/guide/commands/{name}.md"], f"](commands/{name}.md"
        title = text.partition("\n")[0].removeprefix("# ").partition(":")[0].removeprefix("automarine ")
        table = ["|message|cause|remedy|", "|---|---|---|"]
        title = title.replace("`", "")
        for row in rows(name, "".join(SECTION.findall(text))):
            place = f"[{title}](commands/{name}.md#what-can-go-wrong)"
            begun |= {message: f"- {message}: {place}\n" for message in beginnings(row[0])}
            cells = (re.sub(r"(?<!\\)\|", r"\\|", cell) for cell in row)
            linked = re.sub(r"\]\((?!\.\./|#|https?:)", "](commands/", f"|{'|'.join(cells)}|")
            table.append(linked.replace("](../", "](").replace("](#", f"{here}#"))
        parts.append(f"## [{title}{here})\n\n" + "\n".join(table) + "\n")
    index = "".join(
        begun[message] for message in sorted(begun, key=lambda message: message.lower().lstrip(PUNCTUATION))
    )
    return "\n".join([HEAD, f"{INDEX}{index}", *parts[1:]])


def beginnings(message: str) -> list[str]:
    """The first words of each message in quotation marks."""
    quoted = re.findall(r'"((?:[^"]|"(?=automarine))*?)"(?=[*" ]|$)', message)
    words = [re.sub(r"^(?:Set aside: )?\.\.\. ", "", each + '"' * (each.count('"') % 2)).split() for each in quoted]
    return [f'"{" ".join(each[:INDEX_WORDS])}{" ..." * (len(each) > INDEX_WORDS)}"' for each in words]


def test_the_index_has_every_message_by_the_alphabet() -> None:
    assert beginnings('*"a b c d e f g h" or "i"*, *"... j"* (heave)') == ['"a b c d e f g ..."', '"i"', '"j"']
    index = troubles().partition(INDEX)[2].partition("\n## ")[0].splitlines()
    firsts = [re.sub(r"\W", "", line)[:1].lower() for line in index if line]
    assert len(firsts) > 80 and firsts == sorted(firsts)


def test_every_trouble_of_a_command_is_on_the_page() -> None:
    assert PAGE.read_text(encoding="utf-8") == troubles()
    sections = [section for page in PAGES.values() for section in SECTION.findall(page)]
    items = sum(f"\n{each}".count("\n- ") for each in sections)
    assert len(sections) > 20 and troubles().count("\n|") - 2 * len(sections) == items


@pytest.mark.parametrize("name", PAGES_OF_COMMANDS)
def test_what_can_go_wrong_has_message_cause_and_remedy(name: str) -> None:
    (section,) = SECTION.findall(PAGES[f"automarine_cli/guide/commands/{name}.md"])
    assert rows(name, section)


if __name__ == "__main__":
    PAGE.write_text(troubles(), encoding="utf-8")
