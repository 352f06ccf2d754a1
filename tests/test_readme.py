"""The README says what is there: floor plan, commands, options, make targets, files, links and pictures."""

import re
import shlex
import subprocess
from pathlib import Path

import click
import pytest

from automarine_cli import __version__
from automarine_cli.cli import CommandFolder, automarine
from automarine_cli.logs.canonical import CANONICAL

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
FENCES = re.findall(r"^```(\w*)\n(.*?)^```$", README, flags=re.MULTILINE | re.DOTALL)


def floor_plan() -> set[str]:
    """Paths of the files and folders named in the floor plan, folders with a slash at their end."""
    (plan,) = (text for _, text in FENCES if text.startswith("automarine_cli/\n"))
    found, above = set(), [""]
    for line in plan.splitlines():
        depth = (len(line) - len(line.lstrip())) // 2
        names = re.match(r"\s*((?:[\w.]+/?  ?)+)(?:\s|$)", line + "  ")
        assert names, f"no name in {line!r}"
        listed = [name for name in names[1].split() if name.endswith(("/", ".py"))]
        found |= {above[depth] + name for name in listed}
        above[depth + 1 :] = [above[depth] + listed[0]]
    return found


def lines_that_start_with(word: str) -> list[str]:
    """Command lines of that program in the fenced blocks, without prompt and comment."""
    lines = (line.strip().removeprefix("$ ") for _, text in FENCES for line in text.splitlines())
    return [line.partition("  #")[0] for line in lines if line.startswith(f"{word} ")]


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
    there |= {
        path.as_posix() for path in shown if re.fullmatch(r"automarine_cli/[a-z]+\.py", path.as_posix())
    }
    assert there - plan == set()


@pytest.mark.parametrize("line", lines_that_start_with("automarine"))
def test_commands_shown_are_commands(line: str) -> None:
    name, *arguments = shlex.split(line)[1:]
    command = commands()[name]
    flags = {flag for param in command.params for flag in (*param.opts, *param.secondary_opts)}
    assert [word for word in arguments if word.startswith("-") and word not in flags] == []


def commands() -> dict[str, click.Command]:
    """Every command of the group."""
    assert isinstance(automarine, CommandFolder)
    ctx = automarine.make_context("automarine", ["--help"], resilient_parsing=True)
    return {name: automarine.get_command(ctx, name) for name in automarine.list_commands(ctx)}  # type: ignore[misc]


def test_every_command_stands_in_the_table() -> None:
    listed = re.findall(r"^\| `automarine ([\w-]+)", README, flags=re.MULTILINE)
    assert sorted(listed) == sorted(commands())


def test_make_targets_exist() -> None:
    shown = set(re.findall(r"(?:`|\$ )make ([a-z-]+)", README))
    targets = set(re.findall(r"^([a-z-]+):", MAKEFILE, flags=re.MULTILINE))
    assert {"demo", "test", "reproduce", "paper", "bench", "pictures"} <= shown
    assert shown - targets == set()


def test_links_and_pictures_exist() -> None:
    places = re.findall(r"\]\(([^)#]+)\)", README)
    inside = [place for place in places if "://" not in place]
    assert inside and [place for place in inside if not (ROOT / place).exists()] == []
    pictures = sorted((ROOT / ".github" / "pictures").glob("*.png"))
    assert [f".github/pictures/{path.name}" for path in pictures] == sorted(inside)
    assert [path.name for path in pictures if path.stat().st_size > 60_000] == []


def test_files_named_in_the_text_exist() -> None:
    named = re.findall(r"`((?:automarine_cli|sample_runs|tests)/[\w./-]+)`", README)
    assert named and [name for name in named if not (ROOT / name).exists()] == []


def test_columns_are_those_that_are_read() -> None:
    logs = README.partition("\n## Logs\n")[2].partition("\n## ")[0]
    cells = re.findall(r"^\|[^|]*\|(.*)\|$", logs, flags=re.MULTILINE)
    listed = {name for cell in cells for name in re.findall(r"`(\w+)`", cell)}
    assert listed == set(CANONICAL)


def test_changes_begin_with_this_version() -> None:
    changes = README.partition("\n## Changes")[2]
    assert re.findall(r"^- \*\*([\d.]+)\*\*", changes, flags=re.MULTILINE)[0] == __version__
