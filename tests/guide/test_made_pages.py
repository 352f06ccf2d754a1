"""The pages of the campaign file and of the limits file, and the list of functions for Python, are made of the code, so
that they cannot differ; run as a program, this writes them anew:
`PYTHONPATH=.:tests/helpers python tests/guide/test_made_pages.py`."""

import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import click
import pytest
from click.testing import CliRunner
from repository import SAMPLE_RUNS

import automarine_cli as am
from automarine_cli import guide
from automarine_cli.commands import automarine, in_python, load
from automarine_cli.commands.campaign import COMMAND_OF, EXPECTED, GIVEN, KEYS
from automarine_cli.dofs import SURGE
from automarine_cli.planning.candidates import example_limits
from automarine_cli.report.campaign_file import SAY, SCHEMA

CAMPAIGN, LIMITS, PYTHON = (guide.FOLDER / f"{name}.md" for name in ("campaign-file", "limits-file", "python"))
KEY = re.compile(r"(?:# )?(\w+) = (.*?)(?: +# (.*))?$")
OTHER_WORDS = {
    "schema": f'always "{SCHEMA}"',
    "columns": "a [column map](logs.md)",
    "columns_of": "the same, for some logs",
    "can": "the DBC of CAN logs",
    "logs.join": "files that are one log",
    "thrusters.map": 'a thrusters.json, or "newtons"',
    "force": "as `moment`",
    "tune.thrusters": "use the campaign's thruster map",
}
"""Of keys that neither an option nor the file of `init` explains."""
CAMPAIGN_HEAD = """# The campaign file: keys and defaults

[`init`](commands/init.md) writes it, [`run`](commands/run.md) reads it. Lists contain files, folders and globs,
relative to this file.

|section|key|value|meaning|
|---|---|---|---|
"""
CAMPAIGN_SETTINGS = """
A section also has the options of its command, such as [`fit-yaw`](commands/fit-yaw.md) or [`tune`](commands/tune.md).
`known` is a table such as `{ I_r = [915, 50] }`.

|section|key|default|meaning|
|---|---|---|---|
"""
LIMITS_HEAD = """# The limits file: what the next campaign may cost

[`plan`](commands/plan.md) reads this file with `--limits`; `--example-limits` prints it. Every line may be left out.
*off* means not set. About 1 *nu* is full command.

|section|key|default|meaning|
|---|---|---|---|
"""
FUNCTIONS = "The functions are "
LONG, MOST_WORDS = 6, 370


def lines(text: str) -> Iterator[tuple[str, str, str, str]]:
    """Section, key, value (none where it is off) and comment of each line with a key of a TOML file."""
    section = ""
    for line in text.splitlines():
        if found := re.match(r"(?:# )?\[(\w+)\]", line):
            section = found[1]
        elif found := KEY.match(line):
            yield section, found[1], "" if line.startswith("#") else found[2].strip(), found[3] or ""


def of_init() -> dict[str, str]:
    """What `init` says of keys, by section and key."""
    with TemporaryDirectory() as folder:
        place = Path(folder, "campaign.toml")
        CliRunner().invoke(
            automarine, ["init", str(SAMPLE_RUNS), "-o", str(place), "--figures", "none", "-qq"], catch_exceptions=False
        )
        written = lines(place.read_text(encoding="utf-8"))
        return {f"{section}.{key}".removeprefix("."): said for section, key, _, said in written if said}


def options(name: str) -> dict[str, click.Option]:
    return {str(param.name): param for param in load(name).own if isinstance(param, click.Option)}


def help_of(option: click.Option) -> str:
    """The first sentence of an option's help, and what there is to choose from."""
    first = re.split(r"(?<=[.])\s|\s\s|: \w+=|, (?:for|instead|such)\b", option.help or "")[0].removesuffix(".")
    return f"{first}: {'/'.join(option.type.choices)}" if isinstance(option.type, click.Choice) else first


def default_of(option: click.Option) -> str:
    value: Any = option.get_default(click.Context(load("check")))
    if option.is_flag:
        return "false"
    if isinstance(value, tuple):
        value = list(value)
    elif not isinstance(value, str | int | float):
        value = ""
    in_words = re.search(r"\[default: (.*)\]", option.help or "")
    default = str(value) or (in_words[1] if in_words else "none")
    return default if len(default.split()) < LONG else "best"


def own(section: str, key: str, said: dict[str, str]) -> tuple[str, str]:
    """The value of a key of a campaign's own, and what it means."""
    where = f"{section}.{key}".removeprefix(".")
    expected = (EXPECTED.get(where) or EXPECTED.get(key) or ("a table", None))[0]
    expected = re.sub("^a | above 0", "", expected).replace(" or ", "/")
    if key in ("seed", "strict"):
        return ("true/false" if key == "strict" else "number"), help_of(options("validate")[key])
    if key == "per_test":
        return "number", help_of(options("fit-thrusters")["thrusters_per_test"])
    if words := OTHER_WORDS.get(where) or OTHER_WORDS.get(key):
        return expected, words
    if key in SAY:
        return "list", SAY[key].format(force="moment or force").partition(";")[0]
    return expected, said[where]


def grouped(rows: Iterable[tuple[str, tuple[str, ...]]]) -> str:
    """Rows of a table; of several sections that have the same one, one row."""
    sections: dict[tuple[str, ...], list[str]] = {}
    for section, cells in rows:
        sections.setdefault(cells, []).append(section or "(top)")
    return "".join(row("/".join(names), *cells) for cells, names in sections.items())


def row(*cells: str) -> str:
    return "|" + "|".join(cell.replace("|", r"\|") for cell in cells) + "|\n"


def campaign_page() -> str:
    said = of_init()
    keys = [(section, (f"`{key}`", *own(section, key, said))) for section, names in KEYS.items() for key in names]
    settings = [
        (section, (f"`{name}`", default_of(option), help_of(option)))
        for section, command in COMMAND_OF.items() for name, option in options(command).items() if name not in GIVEN
    ]  # fmt: skip
    return CAMPAIGN_HEAD + grouped(keys) + CAMPAIGN_SETTINGS + grouped(settings)


def limits_page() -> str:
    keys = [entry for entry in lines(example_limits()) if entry[0]]
    return LIMITS_HEAD + "".join(row(section, f"`{key}`", value or "off", said) for section, key, value, said in keys)


def python_page() -> str:
    """The page as it is, with its list of functions made anew."""
    offered = {*am.__all__} - {"effects"}
    listed = [f"`{name}({', '.join(needed(command))})`" for name, command in in_python().items() if name in offered]
    text = PYTHON.read_text(encoding="utf-8")
    return re.sub(rf"{FUNCTIONS}.*", lambda _: f"{FUNCTIONS}{', '.join(listed)}.", text)


def needed(command: str) -> list[str]:
    """What a function cannot do without."""
    return [str(param.name) for param in load(command).own if param.required or param is load(command).own[0]]


MADE = {CAMPAIGN: campaign_page, LIMITS: limits_page, PYTHON: python_page}


@pytest.mark.parametrize("page", MADE, ids=lambda page: page.stem)
def test_the_page_is_what_the_code_says(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert text == MADE[page]()
    assert re.search(r"[^|]\|\|[^|]", text) is None and (page == PYTHON or len(text.split()) <= MOST_WORDS)


def test_every_public_name_is_on_the_page() -> None:
    text = PYTHON.read_text(encoding="utf-8")
    assert [name for name in am.__all__ if not re.search(rf"`(am\.)?{name}\b", text)] == []


def test_words_of_our_own_are_of_keys_that_there_are() -> None:
    keys = {f"{section}.{key}".removeprefix(".") for section, names in KEYS.items() for key in names}
    assert {key for key in OTHER_WORDS if key not in keys} == {"force"} <= {*KEYS[SURGE.name]}


if __name__ == "__main__":
    for page, made in MADE.items():
        page.write_text(made(), encoding="utf-8")
