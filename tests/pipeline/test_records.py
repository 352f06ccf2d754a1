"""Records to and from plain data: round trips, and refusals that name the key."""

import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from automarine_cli.errors import SettingError
from automarine_cli.pipeline.records import Codec, json_text, read_mapping, to_mapping
from automarine_cli.report.sections import toml_text


@dataclass(frozen=True)
class Level:
    tau: float
    repeats: int = 1


@dataclass(frozen=True)
class Source:
    from_: str
    unit: Literal["deg", "rad"] = "deg"
    sign: Literal[-1, 1] = 1


@dataclass(frozen=True)
class Pool:
    name: str
    levels: tuple[Level, ...] = ()
    span: tuple[float, float] = (-1.2, 1.2)
    rest_s: float | None = None
    noisy: bool = True
    columns: Mapping[str, Source | str] = field(default_factory=dict)
    first: Level | None = None

    def __post_init__(self) -> None:
        if self.span[0] >= self.span[1]:
            raise SettingError("span must rise")


COLUMNS: dict[str, Source | str] = {"time_s": "t", "heading deg": Source("yaw", "rad", -1)}
FULL = Pool('"deep"\\\n\x7fψ', (Level(-1.0), Level(0.1, 3)), (0.0, 1e-7), 2.5, False, COLUMNS, Level(3.0))
POOL, DIAGNOSIS = Codec("pool.toml"), Codec("x.json", writer="diagnose")


@pytest.mark.parametrize("pool", [FULL, Pool("none", (), rest_s=0.0)])
def test_round_trip_through_toml(tmp_path: Path, pool: Pool) -> None:
    (tmp_path / "pool.toml").write_text(toml_text(to_mapping(pool)), encoding="utf-8")
    assert POOL.read(Pool, read_mapping(tmp_path / "pool.toml")) == pool


KEYS = st.text(max_size=5)
VALUES = st.recursive(
    st.booleans() | st.integers(-(2**60), 2**60) | st.floats(allow_nan=False, allow_infinity=False) | KEYS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=3),
    max_leaves=6,
)


@settings(max_examples=30)
@given(st.dictionaries(KEYS, VALUES, max_size=3))
def test_toml_reads_back_the_same(data: dict[str, Any]) -> None:
    assert tomllib.loads(toml_text(data)) == data


@pytest.mark.parametrize(
    ("codec", "record", "data", "message"),
    [
        (POOL, Pool, {"name": "a", "levls": []}, 'unknown key "levls"; did you mean "levels"?'),
        (POOL, Pool, {"name": "a", "levels": [{"tau": 1}, {"tua": 1}]}, 'levels[1]: unknown key "tua"; did you mean'),
        (POOL, Pool, {}, 'key "name" is missing; expected a text in quotes'),
        (POOL, Pool, {"name": "a", "noisy": 1}, "noisy: found 1, expected true or false"),
        (POOL, Pool, {"name": "a", "rest_s": True}, "rest_s: found true, expected a number"),
        (POOL, Pool, {"name": "a", "rest_s": float("nan")}, "rest_s: found NaN, expected a finite number"),
        (POOL, Pool, {"name": "a", "first": {"tau": 1, "repeats": 1.5}}, "first.repeats: found 1.5, expected a whole"),
        (POOL, Pool, {"name": "a", "span": [1.0]}, "span: found a list of 1, expected a list of 2 values"),
        (POOL, Pool, {"name": "a", "span": [1, 0]}, "span must rise"),
        (POOL, Pool, {"name": "a", "columns": {"t": {"sign": 2}}}, "columns.t: found a table, expected a table or a"),
        (POOL, Pool, [1], "found a list of 1, expected a table of settings"),
        (POOL, Pool, {"name": "a", "zzz": 1}, 'unknown key "zzz"; known are name, levels, span, rest_s, noisy'),
        (DIAGNOSIS, Pool, {}, 'key "name" is missing; give a file as `automarine diagnose`'),
    ],
)
def test_refusals_name_the_key(codec: Codec, record: type, data: object, message: str) -> None:
    with pytest.raises(SettingError) as caught:
        codec.read(record, data)
    where = {POOL: "pool.toml", DIAGNOSIS: "x.json"}[codec]
    assert str(caught.value).startswith(f"{where}: {message}")


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.toml", b"tau = \n", "a.toml: not valid TOML: Invalid value (at line 1"),
        ("a.json", b"{", "a.json: not valid JSON: "),
        ("a.json", b"[1]", "a.json: found a list of 1, expected an object with named keys"),
        ("a.toml", b"tau = '\xff'", "a.toml: expected UTF-8 text"),
        ("gone.toml", None, "gone.toml: cannot be read"),
    ],
)
def test_broken_files(tmp_path: Path, name: str, content: bytes | None, message: str) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(SettingError) as caught:
        read_mapping(tmp_path / name)
    assert str(caught.value).startswith(message)


def test_json_by_its_ending_and_numbers_keep_their_type(tmp_path: Path) -> None:
    (tmp_path / "level.json").write_bytes(b'\xef\xbb\xbf{"tau": 2, "repeats": 2}')
    level = Codec("level.json").read(Level, read_mapping(tmp_path / "level.json"))
    assert level == Level(2.0, 2) and isinstance(level.tau, float) and isinstance(level.repeats, int)


def test_json_has_one_form_and_never_holds_nan() -> None:
    data = {"b": np.float64(0.1), "a": [np.int64(2), np.bool_(True)], "ψ": np.array([1.0]), "none": None}
    assert json_text(data) == '{\n "b": 0.1,\n "a": [\n  2,\n  true\n ],\n "ψ": [\n  1.0\n ],\n "none": null\n}\n'
    for bad, written in ((float("nan"), None), (np.float64("-inf"), None), (np.array([1.0, np.nan]), [1.0, None])):
        data = {"fine": 1.0, "models": {"NaN": [bad]}}
        assert json.loads(json_text(data)) == {"fine": 1.0, "models": {"NaN": [written]}}
