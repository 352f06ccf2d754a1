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


REFUSED = {
    "": ': the column map is empty; write lines such as heading_deg = "yaw" under [columns]',
    "time_s = 't'": ": unknown key 'time_s'; a column map holds [columns], [[columns_of]], [logs], "
    "[defaults] and [can] only; write it below one of them",
    "columns = 3": ": columns is 3; expected a table, written [columns]",
    "[columns]\nyaw = 'a'": ": columns.yaw is no column that automarine knows; known are time_s, "
    "time_ms, time_us, "
    "time, heading_deg, heading_rad, yaw_rate_deg_s, yaw_rate_rad_s, tau, tau_Nm, n_port, n_stbd, voltage_V, "
    "surge_m_s, sway_m_s, heave_m_s, distance_m, depth_m, force_X_N, X, force_Z_N, Z, force_Y_N, Y, n_vert, "
    "north_m, east_m, lat_deg, lon_deg, "
    "n, force_N, force_kgf, force_lbf, run, mode, armed, by",
    "[columns]\ntau = 1": ": columns.tau is 1; expected the name of a column in quotes, or a table such as "
    '{ from = "yaw", unit = "rad", sign = -1 }',
    "[columns]\ntau = ''": ": columns.tau.from is ''; expected the name of a column in quotes",
    "[columns]\ntau = { unit = 'nu' }": ": columns.tau.from is missing; expected the name of a column in quotes",
    "[columns]\ntau = { from = 'a', form = 1 }": ": columns.tau.form is not known; a column takes from, "
    "unit, sign, "
    "scale, offset, subtract, sign_from, day_first",
    "[columns]\ntau = { from = 'a', subtract = true }": ": columns.tau.subtract is true; expected a finite number",
    "[columns]\nn = { from = 'a', sign_from = 1 }": ": columns.n.sign_from is 1; expected the name of a column in "
    'quotes, or a table such as { from = "pwm", subtract = 1500 }',
    "[columns]\nn = { from = 'a', sign_from = { from = '' } }": ": columns.n.sign_from.from is ''; expected the name "
    "of a column in quotes",
    "[columns]\ntime = { from = 'a', day_first = 1 }": ": columns.time.day_first is 1; expected true or false",
    "[columns]\ntau = { from = 'a', day_first = true }": ": columns.tau.day_first goes with time, a column of dates, "
    "only; leave it out",
    "columns_of = 1": ": columns_of is 1; expected tables, each written [[columns_of]]",
    "[[columns_of]]\nn = 'a'": ": columns_of[0].logs is missing; expected the logs that it is of, such as "
    '["bollard/*.csv"]',
    "[logs]\nsteps = ['a']": ": logs.steps is not known; [logs] of a column map takes join",
    "[logs]\njoin = { logs = 'a' }": ': logs.join: [0]: key "with" is missing; expected a text in quotes or a list, '
    "each entry a text in quotes",
    "[logs]\njoin = { logs = 'nav_*', with = '*_cmd_*' }": ': logs.join: [0]: join of "nav_*" with "*_cmd_*": expected '
    "as many stars in both, or none in the second; a star stands for the same letters in both names",
    "[columns]\ntau = { from = 'a', sign = 2 }": ": columns.tau.sign is 2; expected 1 or -1",
    "[columns]\ntau = { from = 'a', sign = true }": ": columns.tau.sign is true; expected 1 or -1",
    "[columns]\ntau = { from = 'a', unit = 'N m' }": ": columns.tau.unit is 'N m'; expected nu",
    "[columns]\nheading_deg = { from = 'a', unit = 'grad' }": ": columns.heading_deg.unit is 'grad'; "
    "expected deg or rad",
    "[columns]\ntau = { from = 'a', scale = nan }": ": columns.tau.scale is nan; expected a finite number other than 0",
    "[columns]\ntau = { from = 'a', scale = 0 }": ": columns.tau.scale is 0; expected a finite number other than 0",
    "[columns]\ntau = { from = 'a', offset = 'x' }": ": columns.tau.offset is 'x'; expected a finite number",
    "[columns]\nrun = { from = 'a', sign = -1 }": ": columns.run names runs; unit, sign, scale and "
    "offset do not apply; leave them out",
    "[defaults]\narm = 1": ": defaults.arm is not known; [defaults] takes thrusters_per_test, arm_m",
    "[defaults]\narm_m = -1": ": defaults.arm_m is -1; expected a number above 0",
    "[defaults]\narm_m = inf": ": defaults.arm_m is inf; expected a number above 0",
    "[defaults]\nthrusters_per_test = [2]": ": defaults.thrusters_per_test is a list; expected a number above 0",
}


@pytest.mark.parametrize(("text", "sentence"), REFUSED.items(), ids=[text[-40:] for text in REFUSED])
def test_refused_with_the_key_s_path(tmp_path: Path, text: str, sentence: str) -> None:
    with pytest.raises(LogError) as refused:
        read_column_map(written(tmp_path, text))
    assert str(refused.value) == "columns.toml" + sentence


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
