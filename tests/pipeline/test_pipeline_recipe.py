"""Settings to and from plain data: round trips, and refusals that name the key."""

import dataclasses
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from automarine_cli.dofs import DOFS, Dof
from automarine_cli.errors import SettingError
from automarine_cli.pipeline.codec import FILLER, key_of, keyed, to_mapping
from automarine_cli.pipeline.recipe import from_mapping, read_mapping, toml_text


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


FULL = Pool(
    'two ‘pools’ "deep"\\\n\x7f',
    (Level(-1.0), Level(0.1, 3)),
    (0.0, 1e-7),
    2.5,
    False,
    {"time_s": "t", "heading deg": Source("yaw", "rad", -1)},
    Level(3.0),
)


def test_round_trip_through_plain_data() -> None:
    assert from_mapping(Pool, to_mapping(FULL), "x") == FULL
    assert to_mapping(FULL)["columns"]["heading deg"] == {"from": "yaw", "unit": "rad", "sign": -1}


@pytest.mark.parametrize("recipe", [FULL, Pool("bare"), Pool("none", (), rest_s=0.0)])
def test_round_trip_through_toml(tmp_path: Path, recipe: Pool) -> None:
    path = tmp_path / "pool.toml"
    path.write_text(toml_text(to_mapping(recipe)), encoding="utf-8")
    assert from_mapping(Pool, read_mapping(path), path.name) == recipe


KEYS = st.text(st.characters(codec="utf-8", exclude_categories=("Cs",)), max_size=5)
VALUES = st.recursive(
    st.booleans() | st.integers(-(2**60), 2**60) | st.floats(allow_nan=False, allow_infinity=False) | KEYS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=3),
    max_leaves=12,
)


@given(st.dictionaries(KEYS, VALUES, max_size=4))
def test_toml_reads_back_the_same(data: dict[str, Any]) -> None:
    assert tomllib.loads(toml_text(data)) == data


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"name": "a", "levls": []}, 'unknown key "levls"; did you mean "levels"?'),
        ({"name": "a", "levels": [{"tau": 1}, {"tua": 1}]}, 'levels[1]: unknown key "tua"; did you mean "tau"?'),
        ({}, 'key "name" is missing; expected a text in quotes'),
        ({"name": 3}, "name: found 3, expected a text in quotes"),
        ({"name": "a", "noisy": 1}, "noisy: found 1, expected true or false"),
        ({"name": "a", "rest_s": "2"}, 'rest_s: found "2", expected a number'),
        ({"name": "a", "rest_s": True}, "rest_s: found true, expected a number"),
        ({"name": "a", "rest_s": float("nan")}, "rest_s: found NaN, expected a finite number"),
        ({"name": "a", "levels": {"tau": 1}}, "levels: found a table, expected a list, each entry a table"),
        ({"name": "a", "first": {"tau": 1, "repeats": 1.5}}, "first.repeats: found 1.5, expected a whole number"),
        ({"name": "a", "span": [1.0]}, "span: found a list of 1, expected a list of 2 values"),
        ({"name": "a", "span": [1, 0]}, "span must rise"),
        (
            {"name": "a", "columns": {"t": {"from": "x", "sign": 2}}},
            "columns.t: found a table, expected a table or a text",
        ),
        ({"name": "a", "first": 1}, "first: found 1, expected a table of settings"),
        ([1], "found a list of 1, expected a table of settings"),
    ],
)
def test_refusals_name_the_key(data: object, message: str) -> None:
    with pytest.raises(SettingError) as caught:
        from_mapping(Pool, data, "pool.toml")
    assert str(caught.value).startswith(f"pool.toml: {message}")


def test_numbers_keep_their_type() -> None:
    level = from_mapping(Level, {"tau": 1, "repeats": 2}, "x")
    assert isinstance(level.tau, float)
    assert isinstance(level.repeats, int)


def test_json_by_its_ending_and_a_byte_order_mark(tmp_path: Path) -> None:
    path = tmp_path / "level.json"
    path.write_bytes(b'\xef\xbb\xbf{"tau": 2}')
    assert from_mapping(Level, read_mapping(path), path.name) == Level(2.0)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.toml", b"tau = \n", "a.toml: not valid TOML: Invalid value (at line 1"),
        ("a.json", b"{", "a.json: not valid JSON: "),
        ("a.json", b"[1]", "a.json: found a list of 1, expected an object with named keys"),
        ("a.toml", b"tau = '\xff'", "a.toml: expected UTF-8 text"),
    ],
)
def test_broken_files(tmp_path: Path, name: str, content: bytes, message: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(SettingError) as caught:
        read_mapping(tmp_path / name)
    assert str(caught.value).startswith(message)


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(SettingError, match=r"gone\.toml: cannot be read"):
        read_mapping(tmp_path / "gone.toml")


def test_recipes_are_frozen() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        FULL.name = "other"  # type: ignore[misc]


@dataclass(frozen=True)
class Sensor:
    noise: float = field(metadata=keyed("{position}_noise_{log_unit}"))
    start: float | None = field(default=None, metadata=keyed("start_{position}_{log_unit}"))
    rate_hz: float = 10.0
    dof: Dof = field(kw_only=True, metadata=FILLER)

    def __post_init__(self) -> None:
        if self.noise < 0:
            raise SettingError(f"{key_of(self, 'noise')} is below 0")


@dataclass(frozen=True)
class Vessel:
    sensors: tuple[Sensor, ...] = ()


@pytest.mark.parametrize("dof", DOFS.values(), ids=lambda dof: dof.name)
def test_keys_are_filled_by_whom_the_reader_gives(dof: Dof) -> None:
    key, start = f"{dof.position}_noise_{dof.units.log}", f"start_{dof.position}_{dof.units.log}"
    found = from_mapping(Vessel, {"sensors": [{key: 1}, {key: 2, start: 0.5}]}, "x", dof)
    assert found == Vessel((Sensor(1.0, dof=dof), Sensor(2.0, 0.5, dof=dof)))
    assert to_mapping(found.sensors[1]) == {key: 2.0, start: 0.5, "rate_hz": 10.0}
    for data, message in (
        ({"noise": 1}, f'x: sensors[0]: unknown key "noise"; known are {key}, {start}, rate_hz'),
        ({}, f'x: sensors[0]: key "{key}" is missing; expected a number'),
        ({key: -1}, f"x: sensors[0]: {key} is below 0"),
        ({key: "a"}, f'x: sensors[0].{key}: found "a", expected a number'),
    ):
        with pytest.raises(SettingError) as caught:
            from_mapping(Vessel, {"sensors": [data]}, "x", dof)
        assert str(caught.value) == message
