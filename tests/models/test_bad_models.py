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
from fuzzing import COLUMN_MAP, KINDS, SPECIFICATION, THRUSTER_MAP

from automarine_cli.pipeline.records import MOST_BYTES

Command = Callable[..., Result]

YAW_MODEL = KINDS["yaw model"].good()
JSON, TOML = (
    {"yaw.json": YAW_MODEL, "map.json": THRUSTER_MAP},
    {"spec.toml": SPECIFICATION, "columns.toml": COLUMN_MAP},
)
GOOD = JSON | TOML
NUMBER = {"yaw.json": "models.3.k_rr.value", "map.json": "parameters.forward.a.value"}
"""A number that each file needs, by its path."""


@pytest.fixture
def ask(run: Command, tmp_path: Path) -> Callable[[str, bytes], list[Result]]:
    """`ask("yaw.json", content)`: what each command says that takes such a file."""
    log, thrusters = tmp_path / "log.csv", tmp_path / "thrusters.csv"
    log.write_bytes(csv_of(good_table().rename(columns={"tau": "n_port"}).assign(n_stbd=0.0, tau=0.0)))
    thrusters.write_text("n,force_N\n" + "".join(f"{n},{0.01 * n * abs(n)}\n" for n in (-20, -10, 10, 20)))
    commands: dict[str, list[tuple[object, ...]]] = {
        "yaw.json": [("validate", log, "--model"), ("diagnose", log, "--model")],
        "map.json": [
            ("fit-yaw", log, "--arm", 0.4, "--thrusters"),
            ("validate", log, "--model", tmp_path / "good" / "yaw.json", "--arm", 0.4, "--thrusters"),
        ],
        "spec.toml": [("simulate", "-o", tmp_path / "out")],
        "columns.toml": [("check", log, "--columns"), ("fit-thrusters", thrusters, "--columns")],
    }
    (tmp_path / "good").mkdir()
    (tmp_path / "good" / "yaw.json").write_bytes(YAW_MODEL)

    def asked(name: str, content: bytes) -> list[Result]:
        (tmp_path / name).write_bytes(content)
        return [run(*command, tmp_path / name) for command in commands[name]]

    return asked


def say(results: list[Result], sentence: str) -> None:
    """All refuse with exit status 1 and this sentence, and nothing was written."""
    for found in results:
        assert (found.exit_code, found.stdout, found.stderr) == (1, "", f"Error: {sentence}\n")
        assert isinstance(found.exception, SystemExit)


@pytest.mark.parametrize("name", GOOD)
def test_no_data_at_all(ask: Callable[[str, bytes], list[Result]], name: str) -> None:
    kind = name[-4:].upper()
    most = 200_000 if name == "columns.toml" else MOST_BYTES[kind]  # type: ignore[index]
    open_ended = b'{"a":' if kind == "JSON" else b"a = ["
    say(ask(name, b"\xff\xfe" + b"a"), f"{name}: expected UTF-8 text, found other bytes; save it as UTF-8")
    say(ask(name, b" " * (most + 1)), f"{name}: more than {most} bytes; expected a file of a few kilobytes")
    deep = b'{"a":' * 10_000 + b"1" + b"}" * 10_000 if kind == "JSON" else b"a = " + b"[" * 10_000 + b"]" * 10_000
    say(ask(name, deep), f"{name}: not valid {kind}: nested too deep")
    digits = b"9" * (most // 2)
    long = b'{"a": ' + digits + b"}" if kind == "JSON" else b"a = " + digits
    for found in (*ask(name, long), *ask(name, open_ended)):
        assert found.exit_code == 1 and found.stderr.startswith(f"Error: {name}: not valid {kind}: ")


def changed(content: bytes, path: str, value: object) -> bytes:
    """The JSON with another value at a dotted place."""
    data: Any = json.loads(content)
    *outer, last = path.split(".")
    place = data
    for key in outer:
        place = place[key]
    place[last] = value
    return json.dumps(data).encode()


@pytest.mark.parametrize("name", JSON)
def test_numbers_that_are_none(ask: Callable[[str, bytes], list[Result]], name: str) -> None:
    path = NUMBER[name]
    for value in (float("nan"), float("inf"), float("-inf")):
        content = changed(GOOD[name], path, value)
        say(ask(name, content), f"{name}: {path}: found {json.dumps(value)}, expected a finite number")
    say(
        ask(name, changed(GOOD[name], path, 10**400)),
        f"{name}: {path}: found a number of more than 300 digits, expected a smaller one",
    )
    say(
        ask(name, changed(GOOD[name], path, 1e300)),
        f"{name}: {path.removesuffix('.value')}: found 1e+300, expected 0 or a size of 1e-30 to 1e+30",
    )
    elsewhere = changed(GOOD[name], "runs" if name == "map.json" else "heading_noise_deg", float("nan"))
    place = "runs" if name == "map.json" else "heading_noise_deg"
    say(ask(name, elsewhere), f"{name}: {place}: found NaN, expected a finite number")


SPECIFICATIONS = {
    ("simulation/1", "simulation/2"): 'schema: found "automarine/simulation/2", expected the line schema = '
    '"automarine/simulation/1"',
    ("rate_hz = 10", "rate_hz = nan"): "logger.rate_hz: found NaN, expected 0 or a size of 1e-12 to 1e+12",
    ("I_r = 1.018", "I_r = 1e-300"): "vehicle.I_r: found 1e-300, expected 0 or a size of 1e-12 to 1e+12",
    ("levels = [-50, 50, 100]", "levels = [-50, 1e99]"): "bollard.levels[1]: found 1e+99, expected 0 or a size of "
    "1e-12 to 1e+12",
    ("seed = 4", "seed = 0x" + "f" * 400): "seed: found a number of more than 300 digits, expected a smaller one",
    ("seed = 4", "seed = '4'"): 'seed: found "4", expected a whole number',
    ("I_r = 1.018", "I_r = [1]"): "vehicle.I_r: found a list of 1, expected a number",
    ("[logger]", "[loger]"): 'unknown key "loger"; did you mean "logger"?',
    ("seed = 4", 'seed = 4\n"\\u001b[31m" = 1'): 'unknown key "\\u001b[31m"; known are schema, vehicle, seed, '
    "effects, logger, scatter, campaign, runs, bollard",
    ("repeats = 2", "repeats = 1_000_000_000"): "more than 1000000 runs would be made; ask for fewer",
}  # fmt: skip


@pytest.mark.parametrize(("old", "new"), SPECIFICATIONS, ids=lambda text: text[:25])
def test_a_specification(ask: Callable[[str, bytes], list[Result]], tmp_path: Path, old: str, new: str) -> None:
    assert SPECIFICATION.count(old.encode()) == 1
    content = SPECIFICATION.replace(old.encode(), new.encode())
    say(ask("spec.toml", content), f"spec.toml: {SPECIFICATIONS[old, new]}")
    assert not (tmp_path / "out").exists()


def test_what_has_no_end_is_not_read_to_the_end(run: Command, tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_bytes(csv_of(good_table()))
    found = run("validate", tmp_path / "log.csv", "--model", "/dev/zero")
    assert (found.exit_code, found.stderr) == (
        1,
        "Error: zero: more than 16000000 bytes; expected a file of a few kilobytes\n",
    )


def test_nothing_is_executed(ask: Callable[[str, bytes], list[Result]], tmp_path: Path) -> None:
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
        ask("spec.toml", SPECIFICATION.replace(b"seed = 4", b"seed = " + quoted))
        ask("columns.toml", COLUMN_MAP.replace(b'"tau"', quoted))
    assert not trap.exists()
