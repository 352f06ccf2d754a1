"""README and pages say what is there: floor plan, commands, options, make targets, files, links and pictures."""

import os
import re
import shlex
import subprocess
import tomllib
from pathlib import Path

import click
import numpy as np
import pytest
import yaml
from golden import OUTPUTS, read
from repository import ROOT, SAMPLE_RUNS

from automarine_cli import __version__
from automarine_cli.commands import CommandGroup, automarine
from automarine_cli.guide import ON_PAGE_OF
from automarine_cli.logs.columns import CANONICAL

MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
ABOUT, GUIDE = ROOT / ".github", ROOT / "automarine_cli" / "guide"
PAGES = {
    path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8")
    for path in (ROOT / "README.md", *sorted(ABOUT.glob("*.md")), *sorted(GUIDE.rglob("*.md")))
}
INDEXES = ("README.md", "automarine_cli/guide/contents.md")
EVERY_PAGE = pytest.mark.parametrize("page", PAGES)
ANYWHERE = "\n".join(PAGES.values())


def fences(page: str) -> list[str]:
    return re.findall(r"^```\w*\n(.*?)^```$", PAGES[page], flags=re.MULTILINE | re.DOTALL)


def without_fences(page: str) -> str:
    """A page's text, without its fenced blocks."""
    return re.sub(r"^```.*?^```$", "", PAGES[page], flags=re.MULTILINE | re.DOTALL)


def sentences(text: str) -> list[str]:
    """Sentences, headings, list items and table cells of a text without fenced blocks."""
    text = re.sub(r"\]\([^)]*\)|<[^>]*>", "", text)
    pieces = re.split(r"\n\s*\n|\n\s*(?:[-#]+|\d+\.)\s|\|", text)
    return [one for piece in pieces for one in re.split(r"[.!?][*_)\"]*\s+", piece)]


def words(sentence: str) -> int:
    return sum(bool(re.search(r"\w", word)) for word in sentence.split())


def anchors(page: str) -> set[str]:
    """What a link to a heading of that page may say after its #."""
    headings = re.findall(r"^#+ (.*)$", without_fences(page), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def pictures_of(page: str) -> list[tuple[str, str]]:
    """What is said of each picture of a page, and its path from the root."""
    marked = re.findall(r"!\[([^\]]*)\]\(([^)]+\.png)\)", PAGES[page])
    marked += [(said, place) for place, said in re.findall(r'<img src="([^"]+)"[^>]* alt="([^"]*)"', PAGES[page])]
    assert PAGES[page].count("<img ") == len(marked) - PAGES[page].count("![")
    return [(said, Path(os.path.normpath(Path(page).parent / place)).as_posix()) for said, place in marked]


def floor_plan() -> set[str]:
    """Paths of the files and folders named in the floor plan, folders with a slash at their end."""
    (plan,) = (text for text in fences(".github/ARCHITECTURE.md") if text.startswith("automarine_cli/\n"))
    found, above = set(), [""]
    for line in plan.splitlines():
        depth = (len(line) - len(line.lstrip())) // 2
        names = re.match(r"\s*((?:[\w.]+/?  ?)+)(?:\s|$)", line + "  ")
        assert names, f"no name in {line!r}"
        listed = [name for name in names[1].split() if name.endswith(("/", ".py"))]
        found |= {above[depth] + name for name in listed}
        above[depth + 1 :] = [above[depth] + listed[0]]
    return found


def command_lines() -> list[tuple[str, str]]:
    """Page and text of every `automarine ...` line in a fenced block, without prompt and comment."""
    lines = (
        (page, line.strip().removeprefix("$ ").partition("  #")[0].strip())
        for page in PAGES
        for block in fences(page)
        for line in block.replace("\\\n", " ").splitlines()
    )
    return [(page, line) for page, line in lines if line.startswith("automarine ")]


def files() -> list[Path]:
    """Every file of the project, from its root: what git knows, or all there is where this is no checkout."""
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False)
    if listed.returncode == 0 and listed.stdout:
        return [Path(line) for line in listed.stdout.splitlines()]
    return [path.relative_to(ROOT) for path in ROOT.rglob("*.*") if path.suffix != ".pyc"]


def test_floor_plan_is_the_one_on_disk() -> None:
    plan = floor_plan()
    assert [name for name in sorted(plan) if not (ROOT / name).exists()] == []
    shown = [path for path in files() if path.parts[0] in ("automarine_cli", "tests", "sample_runs")]
    there = {f"{path.parent.as_posix()}/" for path in shown}
    there |= {path.as_posix() for path in shown if re.fullmatch(r"automarine_cli/[a-z]+\.py", path.as_posix())}
    mirrors = {f"tests/{name.split('/')[1]}/" for name in plan if name.startswith("automarine_cli/")}
    assert there - plan - mirrors == set()


@pytest.mark.parametrize(("page", "line"), command_lines())
def test_commands_shown_are_commands(page: str, line: str) -> None:
    name, *arguments = shlex.split(line)[1:]
    if name.startswith("-"):
        assert name in ("--version", "--help")
        return
    words = [word.partition("=")[0].replace("-qq", "-q") for word in arguments if re.match(r"--?[a-z]", word)]
    assert [word for word in words if word not in flags_of(commands()[name])] == []


def flags_of(command: click.Command) -> set[str]:
    """Every way to write an option of a command."""
    return {"-h", "--help"} | {flag for param in command.params for flag in (*param.opts, *param.secondary_opts)}


@EVERY_PAGE
def test_options_named_in_the_text_exist(page: str) -> None:
    """On a page of commands, those of these commands; elsewhere those of any command."""
    name = page.rpartition("/")[2].removesuffix(".md")
    known = commands()
    if page.startswith("automarine_cli/guide/commands/"):
        known = {one: known[one] for one in known if ON_PAGE_OF.get(one, one) == name}
    flags = {flag for command in known.values() for flag in flags_of(command)} | {"--version"}
    named = re.findall(r"(?<=`)--[a-z][a-z-]*", without_fences(page))
    assert [flag for flag in named if flag not in flags] == []


def commands() -> dict[str, click.Command]:
    assert isinstance(automarine, CommandGroup)
    ctx = automarine.make_context("automarine", ["--help"], resilient_parsing=True)
    return {name: automarine.get_command(ctx, name) for name in automarine.list_commands(ctx)}  # type: ignore[misc]


def test_every_command_has_its_page() -> None:
    pages = {page.rpartition("/")[2].removesuffix(".md") for page in PAGES if "/commands/" in page}
    assert pages == {ON_PAGE_OF.get(name, name) for name in commands()}
    assert ON_PAGE_OF.keys() <= set(commands()) - pages


def test_make_targets_exist() -> None:
    shown = set(re.findall(r"(?:`|\$ )make ([a-z-]+)", ANYWHERE))
    targets = set(re.findall(r"^([a-z-]+):", MAKEFILE, flags=re.MULTILINE))
    assert {"demo", "test", "reproduce", "paper", "bench", "pictures"} <= shown
    assert shown - targets == set()


@EVERY_PAGE
def test_links_lead_somewhere(page: str) -> None:
    wrong = []
    for place in re.findall(r"\]\(([^)\s]+)\)", without_fences(page)):
        path, _, heading = place.partition("#")
        if "://" in place:
            continue
        there = Path(os.path.normpath(Path(page).parent / path)).as_posix() if path else page
        if not (ROOT / there).exists() or (heading and heading not in anchors(there)):
            wrong.append(place)
    assert wrong == []


def test_every_page_is_linked_to() -> None:
    linked = {
        Path(os.path.normpath(Path(page).parent / place.partition("#")[0])).as_posix()
        for page in INDEXES
        for place in re.findall(r"\]\(([^)\s]+)\)", PAGES[page])
    }
    assert set(PAGES) - linked - {"README.md"} == set()


def test_pictures_are_shown_described_and_small() -> None:
    shown = [(said, place) for page in PAGES for said, place in pictures_of(page)]
    assert [place for _, place in shown if not place.startswith(".github/pictures/")] == []
    shown = [(said, Path(place).name) for said, place in shown]
    pictures = sorted((ROOT / ".github" / "pictures").glob("*.png"))
    assert {path.name for path in pictures} == {name for _, name in shown}
    assert [name for described, name in shown if len(described) < 20] == []
    assert [path.name for path in pictures if path.stat().st_size > 64_000] == []


def test_files_named_in_the_text_exist() -> None:
    named = re.findall(r"`((?:automarine_cli|sample_runs|tests)/[\w./-]+)`", ANYWHERE)
    assert named and [name for name in named if not (ROOT / name).exists()] == []


def test_columns_are_those_that_are_read() -> None:
    cells = re.findall(r"^\|[^|]*\|(.*)\|$", PAGES["automarine_cli/guide/logs.md"], flags=re.MULTILINE)
    listed = {name for cell in cells for name in re.findall(r"`(\w+)`", cell)}
    assert listed == set(CANONICAL)


def test_changes_and_citation_say_this_version() -> None:
    assert re.findall(r"^- \*\*([\d.]+)\*\*", PAGES[".github/CHANGELOG.md"], flags=re.MULTILINE)[0] == __version__
    citation = yaml.safe_load((ABOUT / "CITATION.cff").read_text(encoding="utf-8"))
    assert (citation["version"], citation["license"]) == (__version__, PROJECT["license"])
    urls = PROJECT.get("urls", {})
    assert (citation.get("repository-code"), citation.get("url")) == (urls.get("Repository"), urls.get("Documentation"))


def test_the_licence_is_where_the_package_takes_it_from() -> None:
    (place,) = PROJECT["license-files"]
    assert (ROOT / place).read_text(encoding="utf-8").startswith(f"{PROJECT['license']} License\n")


def test_readme_is_short_and_begins_with_the_two_commands() -> None:
    assert PAGES["README.md"].count("\n") < 120
    assert re.findall(r"^\$ (.*)$", fences("README.md")[0], flags=re.MULTILINE) == ["make demo", "make test"]


NUMBER = re.compile(r"\d+(?:\.\d+)?")
DEMO = ("fit-yaw", "validate-yaw", "diagnose-one", "diagnose-one", "tune")  # what prints the rows of README's results


def not_printed(shown: str, printed: str) -> list[str]:
    """Numbers of a text that no printed one rounds to, but for one in the last decimal."""
    found = np.array([float(number) for number in NUMBER.findall(printed)])
    steps = {number: 10.0 ** -len(number.partition(".")[2]) for number in NUMBER.findall(shown)}
    return [number for number, step in steps.items() if np.abs(found - float(number)).min(initial=9.0) > 1.5 * step]


def test_results_of_the_demo_are_those_that_its_commands_print() -> None:
    rows = re.findall(r"^\|([^|]*)\|([^|]*)\|([^|]*)\|$", PAGES["README.md"], flags=re.MULTILINE)[2 : 2 + len(DEMO)]
    outputs = [read(OUTPUTS / f"{name}.txt")["printed"] for name in DEMO]
    assert [not_printed(step + result, text) for (step, result, _), text in zip(rows, outputs, strict=True)] == [[]] * 5
    logs = " ".join(
        (SAMPLE_RUNS / name).read_text(encoding="utf-8") for name in ("truth.json", "hidden_one.truth.json")
    )
    assert not_printed("".join(truth for *_, truth in rows), logs) == []
    assert not_printed("1.018, 2.5", "1.02 1.0175") == ["2.5"]
