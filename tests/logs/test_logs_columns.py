"""Column maps: what they may say, and the key's path for what they may not."""

from pathlib import Path

import pytest

from automarine_cli.errors import LogError
from automarine_cli.logs import ColumnRule, read_column_map


def written(folder: Path, text: str | bytes) -> Path:
    """A column map file of this text."""
    path = folder / "columns.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def test_the_contract_s_example(tmp_path: Path) -> None:
    columns = read_column_map(
        written(
            tmp_path,
            """
            [columns]
            time_s = "t"
            heading_deg = { from = "yaw", unit = "rad", sign = -1 }
            tau_Nm = "rudder_deg"
            n = { from = " rpm ", unit = "rpm", scale = 2, offset = 1.5 }
            [defaults]
            thrusters_per_test = 2
            arm_m = 0.44
            """,
        )
    )
    assert dict(columns.columns) == {
        "time_s": ColumnRule("t"),
        "heading_deg": ColumnRule("yaw", "rad", -1),
        "tau_Nm": ColumnRule("rudder_deg"),
        "n": ColumnRule("rpm", "rpm", 1, 2.0, 1.5),
    }
    assert dict(columns.defaults) == {"thrusters_per_test": 2, "arm_m": 0.44}


REFUSED = {  # the place, what was found, what was expected
    "": ("heading_deg", "under [columns]"),
    "time_s = 't'": ("time_s", "columns_of, logs, defaults, can"),
    "columns = 3": ("columns: found 3", "a table"),
    "[columns]\nyaw = 'a'": ("columns.yaw:", "known are time_s, time_ms", "force_lbf, run, mode, armed, by"),
    "[columns]\ntau = 1": (
        "columns.tau:",
        'expected the name of a column in quotes, or a table such as { from = "yaw"',
    ),
    "[columns]\ntau = ''": ("columns.tau:", "from is ''", "expected the name of a column in quotes"),
    "[columns]\ntau = { unit = 'nu' }": ("columns.tau:", 'key "from" is missing'),
    "[columns]\ntau = { from = 'a', form = 1 }": ("columns.tau:", 'unknown key "form"', "from"),
    "[columns]\ntau = { from = 'a', subtract = true }": ("columns.tau.subtract: found true", "expected a number"),
    "[columns]\nn = { from = 'a', sign_from = 1 }": ("columns.n.sign_from: found 1", "expected a table"),
    "[columns]\nn = { from = 'a', sign_from = { from = '' } }": ("columns.n.sign_from:", "from is ''", "a column"),
    "[columns]\nn = { from = 'a', sign_from = { from = 'b', unit = 'us' } }": ("columns.n:", "from, subtract and sign"),
    "[columns]\ntime = { from = 'a', day_first = 1 }": ("columns.time.day_first: found 1", "true or false"),
    "[columns]\ntau = { from = 'a', day_first = true }": ("columns.tau.day_first:", "goes with time", "leave it out"),
    "columns_of = 1": ("columns_of: found 1", "a list, each entry a table"),
    "[[columns_of]]\nn = 'a'": ("columns_of[0].logs: missing", '["bollard/*.csv"]'),
    "[[columns_of]]\nlogs = 'a'\nyaw = 'a'": ("columns_of[0].yaw:", "known are"),
    "[logs]\nsteps = ['a']": ("logs:", 'unknown key "steps"', "join"),
    "[logs]\njoin = { logs = 'a' }": ("logs.join[0]:", 'key "with" is missing'),
    "[logs]\njoin = { logs = 'nav_*', with = '*_cmd_*' }": (
        "logs.join[0]:",
        '"*_cmd_*"',
        "expected as many stars in both",
    ),
    "[columns]\ntau = { from = 'a', sign = 2 }": ("columns.tau.sign: found 2", "1, -1"),
    "[columns]\ntau = { from = 'a', sign = true }": ("columns.tau.sign: found true", "1, -1"),
    "[columns]\ntau = { from = 'a', unit = 'N m' }": ("columns.tau.unit: found 'N m'", "expected nu"),
    "[columns]\nheading_deg = { from = 'a', unit = 'grad' }": ("columns.heading_deg.unit: found 'grad'", "deg or rad"),
    "[columns]\ntau = { from = 'a', scale = nan }": ("columns.tau.scale: found NaN", "a finite number"),
    "[columns]\ntau = { from = 'a', scale = 0 }": ("columns.tau:", "scale is 0", "other than 0"),
    "[columns]\ntau = { from = 'a', offset = 'x' }": ('columns.tau.offset: found "x"', "expected a number"),
    "[columns]\nrun = { from = 'a', sign = -1 }": ("columns.run:", "names runs", "leave them out"),
    "[can]\nfile = 1": ("can:", 'unknown key "file"', "dbc"),
    "[can]\ndbc = 1": ("can.dbc: found 1", "a text in quotes"),
    "[can]\ndbc = ' '": ("can.dbc: found no name", "a DBC file in quotes"),
    "[defaults]\narm = 1": ("defaults:", 'unknown key "arm"', "arm_m"),
    "[defaults]\narm_m = -1": ("defaults:", "arm_m is -1", "above 0"),
    "[defaults]\narm_m = inf": ("defaults.arm_m: found Infinity", "a finite number"),
    "[defaults]\nthrusters_per_test = [2]": ("defaults.thrusters_per_test: found a list", "a number"),
}


@pytest.mark.parametrize(("text", "parts"), REFUSED.items(), ids=[text[-40:] for text in REFUSED])
def test_refused_with_the_key_s_path(tmp_path: Path, text: str, parts: tuple[str, ...]) -> None:
    with pytest.raises(LogError) as refused:
        read_column_map(written(tmp_path, text))
    assert str(refused.value).startswith("columns.toml: ")
    assert [part for part in parts if part not in str(refused.value)] == []


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"\xff\xfe", "expected UTF-8 text, found other bytes; save it as UTF-8"),
        (b"[columns", "not valid TOML: "),
        (b"x = " + b"[" * 20_000, "not valid TOML: nested too deep"),
        (b"#" * 2_000_000, "more than 200000 bytes; expected a file of a few kilobytes"),
    ],
    ids=["encoding", "syntax", "deep", "huge"],
)
def test_no_column_map_at_all(tmp_path: Path, content: bytes, sentence: str) -> None:
    with pytest.raises(LogError) as refused:
        read_column_map(written(tmp_path, content))
    assert str(refused.value).startswith("columns.toml: ") and sentence in str(refused.value)
    assert str(refused.value).isprintable()


def test_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"no\.toml: cannot be read \(No such file or directory\)"):
        read_column_map(tmp_path / "no.toml")
