"""Every refusal ends with what to do: read off the source, so that a new one cannot be forgotten."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

import automarine_cli
from automarine_cli.logs.csv import SIGNATURES
from automarine_cli.logs.mixing import ELSE, FETCH

PACKAGE = Path(automarine_cli.__file__).parent
DATA = {"LogError", "RunError", "FitError", "OutputError", "Unclear"}
"""About logs and results: what to do is a clause of its own."""
WRITTEN = {"SettingError", "ModelError", "UsageError", "Refusal"}
"""About what a person wrote, an option or a key: what is expected in its place says what to do."""
OF_A_COLUMN_MAP = "logs/columns.py"  # a file that a person wrote, too
PASSED_ON = {
    "{str(problem)}", "{where}: {problem}", "{run.source}, run {run.name}: {error}",
    "{printable(self.path.name)}: logs.{kind}: {problem}",
    "{name}: {problem}", "{f'{section}.{key}'.removeprefix('.')}: {str(problem)}",  # with the place in front
    "{problem.format_message()}", "{name} is {value}; {problem.message}",  # those of click, and of our types
    "the vehicle refuses: {printable(str(data.get('error')))[:600]}",
    "{misfit.sentence}",  # of a misfit, which ends: write a rule under [columns], or give another map
    "{self.silenced}",  # which ends: start `automarine serve` again
    "no usable run in {files} log{'s' * (files != 1)}: {reasons}{more}",
}  # fmt: skip
"""Refusals whose sentence was made elsewhere, by a refusal that is read here."""

VERBS = (
    "add", "allow", "analyse", "ask", "call", "check", "choose", "close", "compare", "complete", "copy", "correct",
    "cut", "delete", "drop", "export", "fit", "free", "give", "hold", "install", "keep", "leave", "log", "look",
    "make", "map", "measure", "name", "pull", "rename", "report", "run", "save", "say", "send", "set", "shorten",
    "sort", "split", "start", "take", "tell", "try", "use", "validate", "wait", "write",
)  # fmt: skip
CLAUSE = re.compile(rf"(?:^|[.;:,}}] ?|[(]|\b(?:or|and|so|please) )(?:{'|'.join(VERBS)})\b", re.IGNORECASE)
WANTED = re.compile(r"\b(?:expected|known are|takes|it has|there are|did you mean|go(?:es)? (?:with|together))\b")


class Refusal(NamedTuple):
    """One place where something is refused: the class, and the sentences that it may say, with {...} for values."""

    place: str
    kind: str
    sentences: tuple[str, ...]


@cache
def trees() -> dict[str, ast.AST]:
    return {path.relative_to(PACKAGE).as_posix(): ast.parse(path.read_text("utf-8")) for path in PACKAGE.rglob("*.py")}


DEEPEST = 5  # names and calls that are followed in turn
Scope = tuple[ast.AST, ...]
"""Where a name is looked for: the function that it stands in, then its module."""


def sentences(node: ast.expr, scope: Scope, deep: int = 0) -> list[str]:
    """What an expression may say; names and calls of the package are followed to where they are made."""
    if isinstance(node, ast.IfExp):
        return [*sentences(node.body, scope, deep), *sentences(node.orelse, scope, deep)]
    if isinstance(node, ast.BinOp):
        return [a + b for a in sentences(node.left, scope, deep) for b in sentences(node.right, scope, deep)]
    if isinstance(node, ast.Constant):
        return [str(node.value)]
    if is_template(node):
        template = node.func.value  # type: ignore[attr-defined]
        return sentences(ast.Name(template.attr) if isinstance(template, ast.Attribute) else template, scope, deep)
    if isinstance(node, ast.JoinedStr):
        *front, last = node.values
        said = "".join(map(placeholder, front))
        named = isinstance(last, ast.FormattedValue) and (isinstance(last.value, ast.Name) or is_template(last.value))
        tails = sentences(last.value, scope, deep + 1) if named and deep < DEEPEST else [placeholder(last)]
        return [said + tail for tail in tails]
    if deep < DEEPEST and (made := list(makers(node, scope))):
        return [said for value, there in made for said in sentences(value, there, deep + 1)]
    return [f"{{{ast.unparse(node)}}}"]


@cache
def nodes(tree: ast.AST) -> tuple[ast.AST, ...]:
    return tuple(ast.walk(tree))


@cache
def functions(tree: ast.AST) -> dict[str, list[ast.FunctionDef]]:
    """The functions of a module by name."""
    named: dict[str, list[ast.FunctionDef]] = {}
    for node in nodes(tree):
        if isinstance(node, ast.FunctionDef):
            named.setdefault(node.name, []).append(node)
    return named


@cache
def assignments(tree: ast.AST) -> tuple[ast.Assign | ast.NamedExpr | ast.For, ...]:
    return tuple(node for node in nodes(tree) if isinstance(node, ast.Assign | ast.NamedExpr | ast.For))


def is_template(node: ast.expr) -> bool:
    return isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "format"


def placeholder(node: ast.expr) -> str:
    """A piece of an f-string: its text, or the name of what stands there."""
    if isinstance(node, ast.FormattedValue):
        return f"{{{ast.unparse(node.value)}}}"
    return str(node.value) if isinstance(node, ast.Constant) else ""


def makers(node: ast.expr, scope: Scope) -> Iterator[tuple[ast.expr, Scope]]:
    """What a name was given, in its function, its module or another's constants; or what a function or a property of
    the package returns or yields."""
    if isinstance(node, ast.Name):
        constants = trees().values() if node.id.isupper() else ()
        for outer in (*scope, *constants):
            if given := list(given_to(node.id, outer)):
                yield from ((value, scope) for value in given)
                return
            if isinstance(outer, ast.FunctionDef):
                own = outer.args.args[len(outer.args.args) - len(outer.args.defaults) :]
                yield from ((d, scope) for a, d in zip(own, outer.args.defaults, strict=True) if a.arg == node.id)
                yield from ((value, scope[-1:]) for value in passed(node.id, outer, scope[-1]))
    name = node.attr if isinstance(node, ast.Attribute) else getattr(getattr(node, "func", None), "id", "")
    for there in (scope[-1],) if isinstance(node, ast.Attribute) else (scope[-1], *trees().values()):
        found = functions(there).get(name, [])
        for function in found:
            ends = [r.value for r in nodes(function) if isinstance(r, ast.Return | ast.Yield) and r.value]
            yield from ((end, (function, there)) for end in ends if getattr(end, "value", end))
        if found:
            return


def passed(name: str, function: ast.FunctionDef, tree: ast.AST) -> Iterator[ast.expr]:
    """What the calls in its module pass to a function's parameter by its place."""
    place = next((i for i, arg in enumerate(function.args.args) if arg.arg == name), None)
    for call in nodes(tree) if place is not None else ():
        if isinstance(call, ast.Call) and getattr(call.func, "id", "") == function.name and len(call.args) > place:
            yield call.args[place]


def given_to(name: str, tree: ast.AST) -> Iterator[ast.expr]:
    """What a name stands for in a piece of the package: assigned, walrus, or over what a loop goes."""
    for assignment in assignments(tree):
        targets = assignment.targets if isinstance(assignment, ast.Assign) else [assignment.target]
        if any(getattr(target, "id", "") == name for target in targets):
            yield assignment.iter if isinstance(assignment, ast.For) else assignment.value


@cache
def refusals() -> tuple[Refusal, ...]:
    """Every error of the house, and of usage, that the package makes."""
    return tuple(read_refusals())


def read_refusals() -> Iterator[Refusal]:
    for place, tree in trees().items():
        inside = {node: f for f in nodes(tree) if isinstance(f, ast.FunctionDef) for node in nodes(f)}
        for node in nodes(tree):
            if not isinstance(node, ast.Call) or not node.args:
                continue
            kind = getattr(node.func, "attr", getattr(node.func, "id", ""))
            scope = (inside[node], tree) if node in inside else (tree,)
            if kind in DATA | WRITTEN:
                yield Refusal(f"{place}:{node.lineno}", kind, tuple(sentences(node.args[0], scope)))


def says_what_to_do(sentence: str, kind: str, place: str) -> bool:
    """Whether a sentence has a clause that begins with a verb; where a person wrote the value, or what is expected."""
    if sentence in PASSED_ON or sentence.endswith(tuple(TABLES)) or CLAUSE.search(sentence):
        return True
    return bool((kind in WRITTEN or place.startswith(OF_A_COLUMN_MAP)) and WANTED.search(sentence))


UNCLEAR = {"": ELSE, " ": FETCH}
TABLES = {"ELSE}": UNCLEAR, "FETCH}": UNCLEAR, "{table.origin.why_not}": UNCLEAR, "{what}": SIGNATURES}
"""Ends of sentences that are looked up in a table, which is read instead."""


@pytest.mark.parametrize("table", TABLES.values())
def test_every_entry_of_a_table_of_ends_says_what_to_do(table: dict[object, str]) -> None:
    assert [end for end in table.values() if not CLAUSE.search(end)] == []


def test_every_refusal_says_what_to_do() -> None:
    silent = [
        f"{one.place} {one.kind}: {sentence}"
        for one in refusals()
        for sentence in one.sentences
        if not says_what_to_do(sentence, one.kind, one.place)
    ]
    assert silent == []


def test_all_of_them_are_read() -> None:
    assert len(refusals()) > 200
    assert {one.kind for one in refusals()} == DATA | WRITTEN
    assert sum(len(one.sentences) > 1 for one in refusals()) > 5  # those that are made elsewhere are followed


@pytest.mark.parametrize(
    ("sentence", "kind", "fine"),
    [
        ("a.csv, row 3: found 'x', expected a number", "LogError", False),
        ("a.csv, row 3: found 'x', expected a number. Correct the cell", "LogError", True),
        ("jobs is 0; expected 1 or more", "SettingError", True),
        ("jobs is 0", "SettingError", False),
        ("the runs checked out badly", "FitError", False),
        ("{path} is full; make room, or choose another folder", "OutputError", True),
    ],
)
def test_silence_is_heard(sentence: str, kind: str, fine: bool) -> None:
    assert says_what_to_do(sentence, kind, "room/file.py:1") is fine
