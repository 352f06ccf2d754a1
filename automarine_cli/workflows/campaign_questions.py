"""The open questions of a campaign file, put to a person one by one."""

import re
import tomllib
from collections.abc import Callable

from automarine_cli.pipeline.records import toml_line

Ask = Callable[[str, str], str]
_QUESTION = re.compile(r'^(?P<head>(?:[^#"]|"(?!\?")[^"]*")*)"\?"(?P<rest>.*)$')


def answered(text: str, ask: Ask) -> str:
    """The file with the answers in place of the question marks; what gets none stays open.

    `ask` gets the key and the comment that goes with it. A number, a list and true or false stand as they are given,
    anything else is a text.
    """
    lines, before = text.split("\n"), ""
    for i, line in enumerate(lines):
        while (found := _QUESTION.match(line)) is not None:
            key = found["head"].strip().rstrip("= ").replace(" = { from =", ", from").replace("{", "")
            comment = line.partition(" # ")[2] or (before if before.startswith("# ? ") else "")
            answer = ask(key.strip(), comment.removeprefix("# ").removeprefix("? ")).strip()
            if not answer or answer == "?":
                break
            line = f"{found['head']}{_as_toml(answer)}{found['rest']}"
        lines[i], before = line, line
    return "\n".join(lines)


def _as_toml(answer: str) -> str:
    """A plain value as it is, a text in quotes."""
    try:
        value = tomllib.loads(f"x = {answer}")["x"]
    except tomllib.TOMLDecodeError:
        value = answer
    return toml_line("x", value).partition(" = ")[2] if isinstance(value, bool | int | float | list | str) else answer
