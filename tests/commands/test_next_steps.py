"""Every refusal ends with what to do: read off the source, so that a new one cannot be forgotten."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import automarine_cli
from automarine_cli.logs.csv import SIGNATURES

PACKAGE = Path(automarine_cli.__file__).parent
DATA = {"LogError", "RunError", "FitError", "OutputError", "Unclear"}
"""About logs and results: what to do is a clause of its own."""
WRITTEN = {"SettingError", "ModelError", "UsageError", "Refusal"}
"""About what a person wrote, an option or a key: what is expected in its place says what to do."""
OF_A_COLUMN_MAP = "logs/columns.py"  # a file that a person wrote, too
PASSED_ON = (
    "{str(problem)}", "{problem}", "{problem.message}", "{problem.format_message()}",  # with the place in front
    "{printable(str(data.get('error')))[:600]}", "{why}", "{self.silenced}", "{misfit.sentence}",
    "{table.origin.why_not}", "{what}", "{another_pilot(heard)}", "{_cannot(target, left_out, origin)}",
    "{' or '.join(stack.motions)}", "{mend}", "{reasons}{more}", "{_meant_for(table, lacking)}",
)  # fmt: skip
"""Ends of refusals whose sentence was made elsewhere, by a refusal that is read here or a table."""
VERBS = (
    "add allow analyse ask call check choose close compare complete copy correct cut delete drop export fit free give "
    "hold install keep leave log look make map measure name plan pull rename report run save say send set shorten sort "
    "split start take tell try tune use validate wait write"
)
CLAUSE = re.compile(rf"(?:^|[.;:,}}] ?|[(]|\b(?:or|and|so|please) )(?:{VERBS.replace(' ', '|')})\b", re.IGNORECASE)
WANTED = re.compile(r"\b(?:expected|known are|takes|it has|there are|did you mean|go(?:es)? (?:with|together))\b")
DEEPEST = 4  # names that are followed in turn


@cache
def trees() -> dict[str, ast.AST]:
    return {path.relative_to(PACKAGE).as_posix(): ast.parse(path.read_text("utf-8")) for path in PACKAGE.rglob("*.py")}


@cache
def bindings(tree: ast.AST) -> dict[str, list[ast.expr]]:
    """What each name of a piece of the package stands for: what is assigned, else what calls pass for a parameter."""
    assigned: dict[str, list[ast.expr]] = {}
    passed: dict[str, list[ast.expr]] = {}
    functions = {node.name: node.args.args for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign | ast.NamedExpr):
            for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
                assigned.setdefault(getattr(target, "id", ""), []).append(node.value)
        elif isinstance(node, ast.Call):
            for parameter, value in zip(functions.get(getattr(node.func, "id", ""), ()), node.args):
                passed.setdefault(parameter.arg, []).append(value)
    return passed | assigned


def sentences(node: ast.expr, scope: tuple[ast.AST, ...], deep: int = 0) -> Iterator[str]:
    """What an expression may say, with {...} for values; a name stands for what its function, its module or, as a
    constant, any module makes it."""
    if isinstance(node, ast.IfExp | ast.BoolOp):
        for part in (node.body, node.orelse) if isinstance(node, ast.IfExp) else node.values:
            yield from sentences(part, scope, deep)
    elif isinstance(node, ast.BinOp):
        yield from (a + b for a in sentences(node.left, scope, deep) for b in sentences(node.right, scope, deep))
    elif isinstance(node, ast.Constant):
        yield str(node.value)
    elif isinstance(node, ast.JoinedStr):
        *front, last = node.values
        begin = "".join(str(piece.value) if isinstance(piece, ast.Constant) else "{}" for piece in front)
        end = last.value if isinstance(last, ast.FormattedValue) else last
        yield from (begin + text for text in sentences(end, scope, deep))
    elif isinstance(node, ast.Call) and getattr(node.func, "attr", "") == "format":
        yield from sentences(node.func.value, scope, deep)  # type: ignore[attr-defined]
    else:
        name = getattr(node, "id", getattr(node, "attr", ""))
        pieces = (*scope, *trees().values()) if name.isupper() else scope if isinstance(node, ast.Name) else ()
        values = next((values for piece in pieces if (values := bindings(piece).get(name))), [])
        for value in values if deep < DEEPEST else ():
            yield from sentences(value, scope, deep + 1)
        if not values or deep == DEEPEST:
            yield f"{{{ast.unparse(node)}}}"


@cache
def refusals() -> list[tuple[str, str, str]]:
    """Place, class and sentence of every error of the house, and of usage, that the package makes."""
    listed = []
    for place, tree in trees().items():
        functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
        inside = {node: function for function in functions for node in ast.walk(function)}
        for node in inside:
            kind = getattr(getattr(node, "func", None), "attr", getattr(getattr(node, "func", None), "id", ""))
            if kind in DATA | WRITTEN and node.args:  # type: ignore[attr-defined]
                texts = sentences(node.args[0], (inside[node], tree))  # type: ignore[attr-defined]
                listed += [(f"{place}:{node.lineno}", kind, text) for text in texts]  # type: ignore[attr-defined]
    return listed


def says_what_to_do(sentence: str, kind: str, place: str) -> bool:
    """Whether a sentence has a clause that begins with a verb; where a person wrote the value, or what is expected."""
    if sentence.endswith(PASSED_ON) or CLAUSE.search(sentence):
        return True
    return bool((kind in WRITTEN or place.startswith(OF_A_COLUMN_MAP)) and WANTED.search(sentence))


def test_every_refusal_says_what_to_do() -> None:
    assert [refusal for refusal in refusals() if not says_what_to_do(refusal[2], refusal[1], refusal[0])] == []
    assert [end for end in SIGNATURES.values() if not CLAUSE.search(end)] == []
    assert len(refusals()) > 300 and {kind for _, kind, _ in refusals()} == DATA | WRITTEN


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
