"""Every refusal ends with what to do: read off the source, so that a new one cannot be forgotten."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from itertools import product
from pathlib import Path

import automarine_cli
from automarine_cli.logs.csv import SIGNATURES

PACKAGE = Path(automarine_cli.__file__).parent
DATA = {"LogError", "RunError", "FitError", "OutputError", "Unclear"}
"""About logs and results: what to do is a clause of its own."""
WRITTEN = {"SettingError", "ModelError", "UsageError", "Refusal"}
"""About what a person wrote, an option or a key: what is expected in its place says what to do."""
OF_A_COLUMN_MAP = "logs/columns.py"  # a file that a person wrote, too
ELSEWHERE = "{}"
"""A value at the end of a refusal, whose sentence was made elsewhere: by a refusal that is read here, or a table."""
VERBS = (
    "add allow analyse ask call check choose close compare complete copy correct cut delete drop export fit free give "
    "hold install keep leave log look make map measure name plan pull rename report run save say send set shorten sort "
    "split start take tell try tune use validate wait write"
)
CLAUSE = re.compile(rf"(?:^|[.;:,}}] ?|[(]|\b(?:or|and|so|please) )(?:{VERBS.replace(' ', '|')})\b", re.IGNORECASE)
WANTED = re.compile(r"\b(?:expected|known are|takes|it has|there are|did you mean|go(?:es)? (?:with|together))\b")


def sentences(node: ast.expr) -> Iterator[str]:
    """What an expression may say, with {} for values."""
    if isinstance(node, ast.IfExp):
        yield from (*sentences(node.body), *sentences(node.orelse))
    elif isinstance(node, ast.BinOp):
        yield from (a + b for a, b in product(sentences(node.left), sentences(node.right)))
    elif isinstance(node, ast.JoinedStr):
        yield from map("".join, product(*map(sentences, node.values)))
    elif isinstance(node, ast.Call) and getattr(node.func, "attr", "") in ("format", "fill"):
        yield from sentences(node.args[0] if node.func.attr == "fill" else node.func.value)  # type: ignore[attr-defined]
    elif isinstance(node, ast.FormattedValue) and isinstance(node.value, ast.IfExp):
        yield from sentences(node.value)
    else:
        yield str(node.value) if isinstance(node, ast.Constant) else ELSEWHERE


@cache
def refusals() -> list[tuple[str, str, str]]:
    """Place, class and sentence of every error of the house, and of usage, that the package makes."""
    listed = []
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Call) and node.args:
                kind = getattr(node.func, "attr", getattr(node.func, "id", ""))
                place = f"{path.relative_to(PACKAGE).as_posix()}:{node.lineno}"
                listed += [(place, kind, text) for text in sentences(node.args[0]) if kind in DATA | WRITTEN]
    return listed


def says_what_to_do(sentence: str, kind: str, place: str) -> bool:
    """Whether a sentence has a clause that begins with a verb; where a person wrote the value, or what is expected."""
    if sentence.endswith(ELSEWHERE) or CLAUSE.search(sentence):
        return True
    return bool((kind in WRITTEN or place.startswith(OF_A_COLUMN_MAP)) and WANTED.search(sentence))


def test_every_refusal_says_what_to_do() -> None:
    assert [refusal for refusal in refusals() if not says_what_to_do(refusal[2], refusal[1], refusal[0])] == []
    assert [end for end in SIGNATURES.values() if not CLAUSE.search(end)] == []
    assert len(refusals()) > 300 and {kind for _, kind, _ in refusals()} == DATA | WRITTEN
