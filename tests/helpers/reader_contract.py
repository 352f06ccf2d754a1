"""What every log format must do, one judge for all: a new format is judged by adding one writer here.

Formats of tables are judged by what a table holds; those of vehicles' recordings, with streams on their own clocks,
by a dive of which everything is known.
"""

import gzip
import io
import re
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from vehicle_bags import bag
from vehicle_blueos import recorded as blueos
from vehicle_can import COLUMNS, DBC, capture
from vehicle_logs import Dive, dataflash, dive, telemetry
from vehicle_ulog import ulog

from automarine_cli.dofs import YAW, Dof
from automarine_cli.errors import LogError
from automarine_cli.logs import ColumnMap, ColumnRule, LogFile, LogTable, column_rules, read_log
from automarine_cli.logs.find import FORMATS

Columns = dict[str, list[float] | list[str]]


def _text(separator: str) -> Callable[[Columns], bytes]:
    return lambda columns: pd.DataFrame(columns).to_csv(index=False, sep=separator).encode()


def _packed(separator: str) -> Callable[[Columns], bytes]:
    return lambda columns: gzip.compress(_text(separator)(columns), mtime=0)


def _parquet(columns: Columns) -> bytes:
    buffer = io.BytesIO()
    pq.write_table(pa.table(columns), buffer)
    return buffer.getvalue()


def _workbook(columns: Columns) -> bytes:
    pytest.importorskip("openpyxl")
    buffer = io.BytesIO()
    pd.DataFrame(columns).to_excel(buffer, index=False)
    return buffer.getvalue()


WRITERS: dict[str, Callable[[Columns], bytes]] = {
    ".csv": _text(","),
    ".csv.gz": _packed(","),
    ".tsv": _text("\t"),
    ".tsv.gz": _packed("\t"),
    ".parquet": _parquet,
    ".xlsx": _workbook,
}


@dataclass(frozen=True)
class Recorder:
    """How one kind of recording is made of a dive: `write(dive, without)`, the library that reads it (`extra` brings
    it), what its columns are called, where its clock begins [s], which of its streams hold what, and what is lost
    in it.
    """

    write: Callable[..., bytes]
    package: str
    extra: str
    columns: ColumnMap
    heading: tuple[str, ...]
    commands: tuple[str, ...]
    starts: float = 0.0
    step_deg: float = 1e-4  # of the heading
    clock: float = 1e-6  # s
    modes: tuple[str, ...] = ("MANUAL", "ALT_HOLD")
    cut_is_sound: bool = True  # whether the first part of a file is a log


def pwm(port: str, stbd: str, **more: str) -> ColumnMap:
    """Commands in microseconds about 1500 as -1 to 1; `more` are other columns by their canonical names."""
    rules = {"n_port": ColumnRule(port, scale=0.0025, offset=-3.75)}
    rules |= {"n_stbd": ColumnRule(stbd, scale=0.0025, offset=-3.75)}
    return ColumnMap(rules | {name: ColumnRule(source) for name, source in more.items()})


CAN = ColumnMap(column_rules(tomllib.loads(COLUMNS), "columns.toml"), dbc=str(DBC))
RECORDERS = {
    ".bin": Recorder(
        dataflash, "pymavlink", "ardupilot", pwm("RCOU.C1", "RCOU.C2"), ("ATT",), ("RCOU",), step_deg=0.005
    ),
    ".tlog": Recorder(
        telemetry, "pymavlink", "ardupilot", pwm("SERVO_OUTPUT_RAW.servo1_raw", "SERVO_OUTPUT_RAW.servo2_raw"),
        ("ATTITUDE",), ("SERVO_OUTPUT_RAW",), starts=1.7e9, clock=2e-3,
    ),
    ".ulg": Recorder(
        ulog, "pyulog", "px4", ColumnMap({
            "n_port": ColumnRule("actuator_motors.control[0]"), "n_stbd": ColumnRule("actuator_motors.control[1]"),
        }), ("vehicle_attitude",), ("actuator_motors", "actuator_outputs"), modes=("MANUAL", "ALTCTL"),
    ),
    **{
        suffix: Recorder(
            partial(capture, suffix), "cantools", "can", CAN, ("Compass",), ("Thrusters",), step_deg=0.005,
            starts=-0.5 if suffix in (".asc", ".blf") else 0.0,
        )
        for suffix in (".asc", ".blf", ".log", ".slcan")
    },
    **{
        suffix: Recorder(
            partial(bag, suffix), "rosbags", "ros", pwm("/thruster/port.data", "/thrusters.data[1]"),
            ("/imu/data", "/odom"), ("/thrusters", "/thruster/port"), starts=1.7e9,
            cut_is_sound=False,
        )
        for suffix in (".bag", ".db3", ".mcap")
    },
    ".json.mcap": Recorder(
        blueos, "mcap", "blueos", pwm("SERVO_OUTPUT_RAW.servo1_raw", "SERVO_OUTPUT_RAW.servo2_raw"),
        ("ATTITUDE",), ("SERVO_OUTPUT_RAW",), starts=1.7e9, clock=2e-3, cut_is_sound=False,
    ),
}  # fmt: skip
SUFFIXES = sorted(suffix for form in FORMATS for suffix in form.suffixes)

GOOD: Columns = {
    "time_s": [round(0.1 * i, 1) for i in range(40)],
    "heading_deg": [0.0] * 10 + [0.5 * i * i for i in range(30)],
    "tau": [0.0] * 10 + [0.5] * 30,
    "water_temperature": [20.25 - 0.5 * (i % 7) for i in range(40)],
    "run": ["07"] * 40,
}


def log(folder: Path, content: bytes, name: str = "log.csv") -> LogFile:
    path = folder / name
    path.write_bytes(content)
    return LogFile(path, name, True)


def table_of(name: str, folder: Path, content: bytes, dof: Dof | None = YAW, **columns: str | ColumnRule) -> LogTable:
    """The table of a log of these bytes, read with columns by these names or rules."""
    rules = {key: ColumnRule(rule) if isinstance(rule, str) else rule for key, rule in columns.items()}
    return read_log(log(folder, content, name), ColumnMap(rules), dof=dof)


def refusal(file: LogFile, columns: ColumnMap | None = None) -> str:
    """The sentence with which a log is refused; the test fails if it is read."""
    try:
        table = read_log(file, columns, dof=YAW)
    except LogError as error:
        return str(error)
    raise AssertionError(f"{file.name} was read: {len(table)} rows of {list(table.columns)}")


def judge_good_file(folder: Path, suffix: str) -> None:
    """What was written comes back in SI units, with row numbers and the columns nobody asked for."""
    table = read_log(log(folder, WRITERS[suffix](GOOD), f"good{suffix}"), dof=YAW)
    first = 1 if suffix == ".parquet" else 2
    assert isinstance(table, LogTable)
    assert sorted(table.columns) == ["heading", "moment", "time"]
    np.testing.assert_allclose(table.columns["time"], GOOD["time_s"], rtol=1e-15)
    np.testing.assert_allclose(table.columns["heading"], np.deg2rad(np.array(GOOD["heading_deg"])), rtol=1e-15)
    np.testing.assert_array_equal(table.columns["moment"], GOOD["tau"])
    np.testing.assert_array_equal(table.extras["water_temperature"], GOOD["water_temperature"])
    assert list(table.rows) == list(range(first, first + 40))
    assert table.run is not None and set(table.run) == {"07"}
    assert table.moment_unit == "nu"
    assert table.names == tuple(GOOD)


def judge_bad_files(folder: Path, suffix: str) -> None:
    """Whatever is no log is refused in one printable line that begins with the file's name."""
    good = WRITERS[suffix](GOOD)
    text = suffix in (".csv", ".tsv")
    bad = {
        "empty": b"",
        "cut": good[:-30].rsplit(b"\n", 1)[0] + b"\n1" if text else good[: len(good) // 2],
        "random": bytes(np.random.default_rng(1).integers(0, 256, 4096, dtype=np.uint8)),
        "zeros": bytes(4096),
    }
    for name, content in bad.items():
        sentence = refusal(log(folder, content, f"{name}{suffix}"))
        assert sentence.startswith(f"{name}{suffix}") and sentence.isprintable(), sentence


def recorded(folder: Path, suffix: str, content: bytes) -> LogFile:
    """A recording of these bytes; the test is skipped where its library is not installed."""
    pytest.importorskip(RECORDERS[suffix].package)
    return log(folder, content, f"dive{suffix}")


def judge_recording(folder: Path, suffix: str, mirrored: bool) -> None:
    """Every stream comes back on the heading's clock: motion as it was, commands held, their age told."""
    made, told = dive(mirrored), RECORDERS[suffix]
    pytest.importorskip(told.package)
    table = read_log(recorded(folder, suffix, told.write(made)), told.columns, dof=YAW)
    np.testing.assert_allclose(table.columns["time"] - told.starts, made.time, atol=told.clock)
    error = np.rad2deg(table.columns["heading"]) - made.heading
    assert np.abs((error + 180) % 360 - 180).max() <= 1.01 * told.step_deg
    rate = np.rad2deg(table.columns["yaw_rate"])
    steady = np.abs(np.convolve(made.rate, [1, -2, 1], "same")) == 0  # not where it jumps between two samples
    np.testing.assert_allclose(rate[1:-1][steady[1:-1]], made.rate[1:-1][steady[1:-1]], atol=1e-3)
    for name, sent in zip(("n_port", "n_stbd"), made.commands_at(made.time)):
        np.testing.assert_allclose(table.columns[name] / 0.0025 + 1500, sent, atol=1e-3)
    volts = np.searchsorted(made.voltage_time, made.time, side="right") - 1
    np.testing.assert_allclose(table.columns["voltage"], made.voltage[volts], atol=2e-3)
    judge_states(table, made, told)
    oldest = (made.time - made.command_time[np.searchsorted(made.command_time, made.time, side="right") - 1]).max()
    age = re.search(rf"{re.escape(told.commands[0])} \S+ s old in the median, (\S+) s at most", " ".join(table.notes))
    assert age is not None and float(age[1]) == pytest.approx(oldest, rel=0.1, abs=0.01), table.notes


def judge_states(table: LogTable, made: Dive, told: Recorder) -> None:
    """Mode and arming, each from when it changed (a telemetry link tells it twice a second)."""
    for name, words, changes in (
        ("mode", told.modes, [since for since, _ in made.modes]),
        ("armed", ("disarmed", "armed", "disarmed"), [since for since, _ in made.arming]),
    ):
        found = table.labels[name]
        for word, since, until in zip(words, changes, [*changes[1:], np.inf]):
            inside = (made.time > since + 0.55) & (made.time < until - 0.01)
            assert {found.names[code] for code in found.code[inside]} == {word}


def judge_cut_recording(folder: Path, suffix: str) -> None:
    """Cut at any byte it is read as far as it goes, or refused in one line."""
    told = RECORDERS[suffix]
    pytest.importorskip(told.package)
    whole = told.write(dive())
    full = read_log(recorded(folder, suffix, whole), told.columns, dof=YAW)
    lengths = set()
    for size in np.linspace(1, len(whole) - 1, 60).astype(int):
        file = recorded(folder, suffix, whole[:size])
        try:
            table = read_log(file, told.columns, dof=YAW)
        except LogError as error:
            assert str(error).startswith(file.name) and str(error).isprintable(), error
            continue
        lengths.add(len(table))
        np.testing.assert_allclose(table.columns["heading"], full.columns["heading"][: len(table)])
        assert len(table) <= len(full)
    assert (len(lengths) > 20) == told.cut_is_sound
