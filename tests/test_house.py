"""The rules of the house that a program can check: size, import order, libraries, what is executed."""

import ast
import subprocess
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "automarine_cli"
ROOMS = (
    "text", "errors", "quantities", "estimate", "dofs", "pipeline", "logs", "runs", "effects", "models", "simulation",
    "filters", "fits", "thrusters", "comparison", "diagnosis", "planning", "control", "link", "report", "exports",
    "guide", "commands",
)  # fmt: skip
OPEN_TO_ALL = {"__version__"}
NOT_FROM = {"effects": {"logs", "runs"}, "models": {"logs", "runs"}}  # a model knows nothing of files
FORBIDDEN_CALLS = {"eval", "exec", "compile", "__import__", "print"}
FORBIDDEN_LIBRARIES = {
    "pickle", "shelve", "marshal", "dill", "joblib", "cloudpickle", "yaml", "subprocess", "pty", "runpy", "code",
}  # fmt: skip
FORBIDDEN_METHODS = {
    "system", "popen", "read_pickle", "to_pickle", "eval", "query", "literal_eval", "spawnl", "execv", "fork_exec",
}  # fmt: skip
FORBIDDEN_KEYWORDS = {"allow_pickle", "shell"}
HEAVY = {"numpy", "scipy", "pandas", "pyarrow", "matplotlib"}
LIGHT_ROOMS = {"commands", "errors", "dofs", "text", "__init__", "__main__"}
TOP_LEVEL = {"pyproject.toml", "automarine_cli", "tests", "sample_runs", "Makefile", "README.md"}

MAX_LINES = {
    "fits": 6779, "report": 5228, "logs": 4056, "diagnosis": 4487, "commands": 3486, "runs": 3105,
    "thrusters": 2734, "link": 2648, "control": 2167, "effects": 2407, "planning": 1873, "simulation": 1879,
    "exports": 1855, "comparison": 1700, "models": 1283, "filters": 1218, "pipeline": 805, "dofs": 504, "top": 292,
    "guide": 397,
}  # fmt: skip
MAX_LINES_IN_ALL = 48_903
MAX_FILES = 225

MODULES = sorted(PACKAGE.rglob("*.py"))


@cache
def trees() -> dict[Path, ast.Module]:
    return {path: ast.parse(path.read_text(encoding="utf-8")) for path in MODULES}


def room(path: Path) -> str:
    """The room that a module stands in: its folder, or its own name at the top of the package."""
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def inside(path: Path) -> str:
    """A module's path in the package, for messages."""
    return path.relative_to(PACKAGE).as_posix()


def imported(tree: ast.AST, path: Path) -> Iterator[tuple[str, int]]:
    """Full dotted names that code imports, at any depth (also under TYPE_CHECKING), with line numbers."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((alias.name, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            if node.level:
                folder = path.parents[node.level - 1].relative_to(ROOT).parts
                base = ".".join([*folder, *([node.module] if node.module else [])])
            else:
                base = node.module or ""
            yield from ((f"{base}.{alias.name}", node.lineno) for alias in node.names)


@cache
def every_import() -> list[tuple[Path, str, int]]:
    return [(path, name, line) for path, tree in trees().items() for name, line in imported(tree, path)]


def test_imports_come_from_rooms_to_the_left() -> None:
    wrong = []
    for path, name, line in every_import():
        here, there = room(path), name.split(".")[1] if name.startswith("automarine_cli.") else ""
        if not there or there in OPEN_TO_ALL or here in ("__init__", "__main__"):
            continue
        left = there in ROOMS[: ROOMS.index(here) + 1] and there not in NOT_FROM.get(here, ())
        if not left:
            wrong.append(f"{inside(path)}:{line} imports {name}, which is not to its left")
    assert wrong == []


def test_libraries_stay_in_their_rooms() -> None:
    wrong = []
    for path, name, line in every_import():
        here, library = room(path), name.partition(".")[0]
        fine = {
            "pyplot": "pyplot" not in name,
            "nothing that executes what it reads": library not in FORBIDDEN_LIBRARIES,
            "matplotlib in report/figures": library != "matplotlib" or inside(path).startswith("report/figures/"),
            "click in commands": library != "click" or here == "commands",
            "pandas at the edges": library != "pandas" or here in ("logs", "runs", "report"),
            "light rooms stay light": library not in HEAVY or here not in LIGHT_ROOMS,
        }
        wrong += [f"{inside(path)}:{line} imports {name}: {rule}" for rule, holds in fine.items() if not holds]
    assert wrong == []


def test_commands_import_their_workflow_inside_their_body() -> None:
    at_top = [
        f"{inside(path)}:{line} imports {name}"
        for path in MODULES
        if room(path) == "commands"
        for node in trees()[path].body
        if isinstance(node, ast.Import | ast.ImportFrom)
        for name, line in imported(node, path)
        if name.startswith("automarine_cli.")
        and name.split(".")[1] not in {"commands", "dofs", "errors", "pipeline", "text"} | OPEN_TO_ALL
    ]
    assert at_top == []


def test_nothing_is_executed_and_nothing_printed() -> None:
    calls = [
        f"{inside(path)}:{node.lineno} calls {node.func.id}"
        for path, tree in trees().items()
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in FORBIDDEN_CALLS
    ]
    assert calls == []


def test_nothing_that_was_read_can_act() -> None:
    """No shell, no pickle, no expression of pandas or numpy, however it is called."""
    calls = [
        f"{inside(path)}:{node.lineno} calls {ast.unparse(node.func)}"
        for path, tree in trees().items()
        for node in ast.walk(tree)
        if isinstance(node, ast.Call)
        and (
            (isinstance(node.func, ast.Attribute) and node.func.attr in FORBIDDEN_METHODS)
            or any(keyword.arg in FORBIDDEN_KEYWORDS for keyword in node.keywords)
        )
    ]
    assert calls == []


def test_every_folder_is_a_room() -> None:
    found = {room(path) for path in MODULES} - {"__init__", "__main__"}
    assert found <= set(ROOMS)


def test_rooms_stay_within_their_lines() -> None:
    """The bounds only sink: lower that of a room, and those of all, whenever it shrinks.

    A new room takes its lines from the bounds of the rooms that it replaces.
    """
    lines: Counter[str] = Counter()
    for path in MODULES:
        top = path.parent == PACKAGE
        lines["top" if top else room(path)] += path.read_text(encoding="utf-8").count("\n")
    assert [
        f"{name} has {count} lines, at most {MAX_LINES.get(name, 0)}"
        for name, count in lines.items()
        if count > MAX_LINES.get(name, 0)
    ] == []
    assert lines.total() <= MAX_LINES_IN_ALL and len(MODULES) <= MAX_FILES


def test_top_level_is_what_the_user_fixed() -> None:
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False)
    if listed.returncode:
        pytest.skip("not a git checkout")
    names = {line.split("/")[0] for line in listed.stdout.splitlines()}
    assert {name for name in names if not name.startswith(".")} <= TOP_LEVEL
    assert (ROOT / ".ci" / "run").stat().st_mode & 0o111
