"""The page of troubles holds what can go wrong with each command, word for word; run as a program, this writes it anew:
`PYTHONPATH=tests/helpers python tests/guide/test_troubleshooting.py`."""

import re

from test_readme import PAGES

from automarine_cli import guide

PAGE = guide.FOLDER / "troubleshooting.md"
SECTION = re.compile(r"^## What can go wrong\n\n(.*?)(?=^## |\Z)", flags=re.MULTILINE | re.DOTALL)
HEAD = """# Troubleshooting: messages, what they mean, and what to do

Look for a word of the message on this page: `automarine guide troubleshooting`, then `/`. Messages are in italics.
Each line is from the page of its command, where you find more. No message, but a doubtful result? See
[Is my model good enough?](good-enough.md).
"""


def troubles() -> str:
    """The page as its sources have it: a section for each command, links as they are from one folder up."""
    parts = [HEAD]
    for name in sorted(set(guide.commands()) - guide.ON_PAGE_OF.keys()):
        names = (name, *(other for other, page in guide.ON_PAGE_OF.items() if page == name))
        lines = "".join(SECTION.findall(PAGES[f"automarine_cli/guide/commands/{name}.md"])).strip()
        linked = re.sub(r"\]\((?!\.\./|#|https?:)", "](commands/", lines).replace("](../", "](")
        here = f"](commands/{name}.md"
        parts.append(f"## [{', '.join(names)}{here})\n\n{linked.replace('](#', f'{here}#')}\n")
    return "\n".join(parts)


def test_every_trouble_of_a_command_is_on_the_page() -> None:
    assert PAGE.read_text(encoding="utf-8") == troubles()
    sections = [section for page in PAGES.values() for section in SECTION.findall(page)]
    assert len(sections) > 20 and troubles().count("\n- ") == sum(f"\n{each}".count("\n- ") for each in sections)


if __name__ == "__main__":
    PAGE.write_text(troubles(), encoding="utf-8")
