"""Runs command lines on `sample_runs`, and compares what they print and write with outputs on file."""

import json
import re
import shlex
import tomllib
from collections.abc import Iterator
from itertools import zip_longest
from math import isclose
from pathlib import Path
from typing import Any

from click.testing import CliRunner
from printed import same, words

from automarine_cli.commands import automarine

HERE = Path(__file__).parent
OUTPUTS = HERE / "outputs"
LINES: dict[str, dict[str, str]] = tomllib.loads((HERE / "commands.toml").read_text(encoding="utf-8"))
COMMANDS = {name: shlex.split(line) for lines in LINES.values() for name, line in lines.items()}

CLOSE = 1e-6  # relative, and one in the last decimal of printed numbers
ZERO = 1e-12  # round-off
TEXTS = {".csv", ".html", ".md", ".param", ".py", ".sdf", ".tex", ".toml", ".txt", ".xml"}
LONG = 100  # lines of a table; of a longer one, a log, the first two and each hundredth
NOT_RESULTS = {"automarine", "libraries", "sha256"}  # keys of manifests
OTHERWHERE = re.compile(r"\b\d+\.\d+\.\d+\b|(?<![.\w])(?=\d*[a-f])[0-9a-f]{16,64}\b")  # versions and hashes in texts
SECONDS = re.compile(  # steps, how far, how long
    r"^(\d+/\d+ [\w-]+: .*|[a-z][^:\n]*: \d+( of \d+)?|The diagnosis takes about .*)\n", re.MULTILINE
)
MARKUP = re.compile(r"<(style|script).*?</\1>|<[^>]*>", re.DOTALL)
HEADER = "=====> "


def folder(arguments: list[str]) -> str | None:
    return arguments[arguments.index("-o") + 1] if "-o" in arguments else None


def sources(name: str) -> Iterator[str]:
    """Commands that write what this one reads."""
    for argument in COMMANDS[name]:
        for other, arguments in COMMANDS.items():
            out = folder(arguments)
            if other != name and out and out != folder(COMMANDS[name]) and f"{argument}/".startswith(f"{out}/"):
                yield other


def run(arguments: list[str]) -> dict[str, str]:
    """Run one line in the current folder: what it printed, the names of the files it wrote, and their texts."""
    before = stamps()
    result = CliRunner(env={"COLUMNS": "80"}).invoke(automarine, arguments, catch_exceptions=False)
    status = f"exit status {result.exit_code}\n" if result.exit_code else ""
    written = [path for path, stamp in stamps().items() if before.get(path) != stamp]
    printed = SECONDS.sub("", result.output)
    texts = {
        "printed": (rounded(printed) if "--json" in arguments and not status else printed) + status,
        "files": "".join(f"{path.as_posix()}\n" for path in written),
        **{path.as_posix(): brief(path) for path in written if path.suffix in TEXTS | {".json"}},
    }
    return {name: OTHERWHERE.sub("*", text) for name, text in texts.items()}


def stamps() -> dict[Path, int]:
    """Every file under `out`, and when it was written."""
    return {path: path.stat().st_mtime_ns for path in sorted(Path("out").rglob("*")) if path.is_file()}


def brief(path: Path) -> str:
    """The text of a file: numbers of JSON to nine digits, pages without markup, logs by a few lines."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".json":
        return rounded(text)
    if path.suffix == ".html":
        text = "\n".join(line for line in MARKUP.sub(" ", text).splitlines() if line.strip())
    lines = text.splitlines()
    if path.suffix == ".csv" and len(lines) > LONG:
        lines = [*lines[:2], *lines[LONG::LONG]]
    return "".join(f"{line}\n" for line in lines)


def rounded(text: str) -> str:
    """JSON with floats of nine digits, without what differs between machines."""
    data = json.loads(text, parse_float=lambda number: float(f"{float(number):.9g}"), object_pairs_hook=results_only)
    return json.dumps(data, indent=0, ensure_ascii=False) + "\n"


def results_only(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    return {key: value for key, value in pairs if key not in NOT_RESULTS}


def write(path: Path, texts: dict[str, str]) -> None:
    path.parent.mkdir(exist_ok=True)
    path.write_text("".join(f"{HEADER}{name}\n{text}" for name, text in texts.items()), encoding="utf-8", newline="\n")


def read(path: Path) -> dict[str, str]:
    blocks = path.read_text(encoding="utf-8").split(HEADER)[1:] if path.exists() else []
    return {name: text for name, _, text in (block.partition("\n") for block in blocks)}


def differences(expected: dict[str, str], actual: dict[str, str]) -> list[str]:
    """Where outputs differ: the file, the key or the word, and both values."""
    listed = []
    for name in expected | actual:
        if name not in expected or name not in actual:
            listed.append(f"{name}: {'written, not expected' if name in actual else 'expected, not written'}")
        elif expected[name].startswith("{") and actual[name].startswith("{"):
            listed += [f"{name}: {line}" for line in unequal(json.loads(expected[name]), json.loads(actual[name]), "")]
        else:
            listed += [f"{name}: {line}" for line in unequal_words(expected[name], actual[name])]
    return listed


def unequal(expected: Any, actual: Any, key: str) -> Iterator[str]:
    """Unequal leaves of two JSON values, as `models.3.k_rr.value: expected 1.25, got 1.3`."""
    if isinstance(expected, dict) and isinstance(actual, dict):
        for name in expected | actual:
            yield from unequal(expected.get(name, "nothing"), actual.get(name, "nothing"), f"{key}.{name}".lstrip("."))
    elif isinstance(expected, list) and isinstance(actual, list) and len(expected) == len(actual):
        for number, pair in enumerate(zip(expected, actual)):
            yield from unequal(*pair, f"{key}.{number}")
    elif type(expected) in (int, float) and type(actual) in (int, float):
        if not isclose(expected, actual, rel_tol=CLOSE, abs_tol=ZERO):
            yield f"{key}: expected {expected!r}, got {actual!r}"
    elif isinstance(expected, str) and isinstance(actual, str):
        yield from (f"{key}: {line}" for line in unequal_words(expected, actual))
    elif expected != actual or type(expected) is not type(actual):
        yield f"{key}: expected {expected!r:.200}, got {actual!r:.200}"


def unequal_words(expected: str, actual: str) -> Iterator[str]:
    """The first word that differs, among its neighbours."""
    pairs = list(zip_longest(words(expected), words(actual), fillvalue=""))
    for number, (a, b) in enumerate(pairs):
        if not same(a, b, CLOSE):
            near = zip(*pairs[max(0, number - 4) : number + 5])
            yield "expected `{}`, got `{}`".format(*(" ".join(side) for side in near))
            return
