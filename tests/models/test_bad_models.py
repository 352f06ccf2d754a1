"""Models, thruster maps, specifications and column maps that are none: refused by every command that takes one,
with the file, the key's path, what was found and what was expected.
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from broken_logs.make import csv_of, good_table
from click.testing import Result
from fuzzing import COLUMN_MAP, KINDS, THRUSTER_MAP
from small_campaign import SPECIFICATION

from automarine_cli.pipeline.records import MAX_FILE_BYTES

Ask = Callable[[str, bytes], list[Result]]

YAW_MODEL = KINDS["yaw model"].good()
JSON = {"yaw.json": YAW_MODEL, "map.json": THRUSTER_MAP}
GOOD = JSON | {"spec.toml": SPECIFICATION.encode(), "columns.toml": COLUMN_MAP}


@pytest.fixture
def ask(run: Callable[..., Result], tmp_path: Path) -> Ask:
    """`ask("yaw.json", content)`: what each command says that takes such a file."""
    log, thrusters = tmp_path / "log.csv", tmp_path / "thrusters.csv"
    log.write_bytes(csv_of(good_table().rename(columns={"tau": "n_port"}).assign(n_stbd=0.0, tau=0.0)))
    thrusters.write_text("n,force_N\n" + "".join(f"{n},{0.01 * n * abs(n)}\n" for n in (-20, -10, 10, 20)))
    (tmp_path / "good.json").write_bytes(YAW_MODEL)
    validate = ("validate", log, "--model", tmp_path / "good.json")
    commands: dict[str, list[tuple[object, ...]]] = {
        "yaw.json": [("validate", log, "--model"), ("diagnose", log, "--model")],
        "map.json": [("fit-yaw", log, "--arm", 0.4, "--thrusters"), (*validate, "--arm", 0.4, "--thrusters")],
        "spec.toml": [("simulate", "-o", tmp_path / "out")],
        "columns.toml": [("check", log, "--columns"), ("fit-thrusters", thrusters, "--columns")],
    }

    def asked(name: str, content: bytes) -> list[Result]:
        (tmp_path / name).write_bytes(content)
        return [run(*command, tmp_path / name) for command in commands[name]]

    return asked


def say(results: list[Result], start: str) -> None:
    """All refuse with exit status 1 and one line that begins so, and nothing was written."""
    for result in results:
        assert (result.exit_code, result.stdout) == (1, "") and isinstance(result.exception, SystemExit)
        assert result.stderr.startswith(f"Error: {start}") and result.stderr.count("\n") == 1, result.stderr


@pytest.mark.parametrize("name", GOOD)
def test_no_data_at_all(ask: Ask, name: str) -> None:
    kind = name[-4:].upper()
    most = 200_000 if name == "columns.toml" else MAX_FILE_BYTES[kind]  # type: ignore[index]
    begin, opened, close = (b'{"a": ', b'{"a":', b"}") if kind == "JSON" else (b"a = ", b"[", b"]")
    deep = (b"" if kind == "JSON" else begin) + opened * 10_000 + b"1" * (kind == "JSON") + close * 10_000
    say(ask(name, b"\xff\xfe" + b"a"), f"{name}: expected UTF-8 text, found other bytes; save it as UTF-8")
    say(ask(name, b" " * (most + 1)), f"{name}: more than {most} bytes; expected a file of a few kilobytes")
    say(ask(name, deep), f"{name}: not valid {kind}: nested too deep")
    say(ask(name, begin + b"9" * (most // 2) + b"}" * (kind == "JSON")), f"{name}: not valid {kind}: ")
    say(ask(name, begin if kind == "JSON" else b"a = ["), f"{name}: not valid {kind}: ")


def changed(content: bytes, path: str, value: object) -> bytes:
    """The JSON with another value at a dotted place."""
    data: Any = json.loads(content)
    *outer, last = path.split(".")
    place = data
    for key in outer:
        place = place[key]
    place[last] = value
    return json.dumps(data).encode()


@pytest.mark.parametrize(
    ("name", "path"), [("yaw.json", "models.3.k_rr.value"), ("map.json", "parameters.forward.a.value")]
)
def test_numbers_that_are_none(ask: Ask, name: str, path: str) -> None:
    for value, where, expected in (
        (float("nan"), path, "found NaN, expected a finite number"),
        (float("-inf"), path, "found -Infinity, expected a finite number"),
        (10**400, path, "found a number of more than 300 digits, expected a smaller one"),
        (1e300, path, "found 1e+300, expected 0 or a size of 1e-30 to 1e+30"),
        (float("nan"), "runs" if name == "map.json" else "heading_noise_deg", "found NaN, expected a finite number"),
    ):
        place = where.removesuffix(".value") if value == 1e300 else where
        say(ask(name, changed(GOOD[name], where, value)), f"{name}: {place}: {expected}")


def test_what_has_no_end_is_not_read_to_the_end(run: Callable[..., Result], tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_bytes(csv_of(good_table()))
    say([run("validate", tmp_path / "log.csv", "--model", "/dev/zero")], "zero: more than 16000000 bytes; expected")


def test_nothing_is_executed(ask: Ask, tmp_path: Path) -> None:
    """What would act if it were code: text stays text."""
    trap = tmp_path / "sprung"
    for code in (
        f"__import__('pathlib').Path({str(trap)!r}).touch()",
        f"$(touch {trap})",
        "!!python/object/apply:os.system",
    ):
        for name in JSON:
            for found in ask(name, changed(GOOD[name], "schema", code)):
                assert found.exit_code == 1 and f"{name}: schema: found " in found.stderr
        quoted = json.dumps(code).encode()
        ask("spec.toml", SPECIFICATION.replace("seed = 3", f"seed = {json.dumps(code)}").encode())
        ask("columns.toml", COLUMN_MAP.replace(b'"tau"', quoted))
    assert not trap.exists()
