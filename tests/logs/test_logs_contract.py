"""Every log format before the judges of `reader_contract`, what can be wrong with any recording; torn, random and
hostile files: a right answer or one clear sentence, nothing else."""

import os
import re
import sys
import tomllib
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from broken_logs.make import csv_of
from fuzzing import KINDS, case, judge_log, outcome
from hypothesis import given, settings
from hypothesis import strategies as st
from reader_contract import (
    RECORDERS,
    SUFFIXES,
    WRITERS,
    Recorder,
    judge_bad_files,
    judge_cut_recording,
    judge_good_file,
    judge_recording,
    log,
    recorded,
    refusal,
)
from repository import ROOT
from vehicle_logs import Dive, dive

from automarine_cli.dofs import YAW
from automarine_cli.errors import AutomarineError, LogError
from automarine_cli.logs import (
    ColumnMap,
    ColumnRule,
    LogFile,
    column_rules,
    find_logs,
    is_thruster_test,
    read_log,
    require_motion,
    require_thruster,
)
from automarine_cli.logs.find import format_of, stem_of
from automarine_cli.runs.load import load_runs


def test_formats_are_found_by_themselves_and_each_has_a_writer_to_be_judged_with() -> None:
    assert format_of("a/B.CSV.GZ").name == "CSV"  # type: ignore[union-attr]
    assert format_of("notes.txt") is None and stem_of("run.1.csv.gz") == "run.1"
    assert set(SUFFIXES) == {*WRITERS, *(suffix.removeprefix(".json") for suffix in RECORDERS)}, (
        "add a writer for the new format to tests/helpers/reader_contract.py"
    )


@pytest.mark.parametrize("suffix", WRITERS)
def test_good_and_bad_files(tmp_path: Path, suffix: str) -> None:
    judge_good_file(tmp_path, suffix)
    judge_bad_files(tmp_path, suffix)


def test_what_is_no_regular_file_does_not_hang(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.csv")
    (tmp_path / "folder.csv").mkdir()
    for name, what in (("pipe", "not a regular file"), ("folder", "a directory"), ("absent", "not a regular file")):
        sentence = refusal(LogFile(tmp_path / f"{name}.csv", f"{name}.csv", True))
        assert sentence.startswith(f"{name}.csv: {what}; ") and "leave it out" in sentence


def test_a_workbook_is_read_as_its_text_would_be(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Unnamed index, dates, empty cells, truth values; without its library the extra is told."""
    pytest.importorskip("openpyxl")
    stamps = pd.date_range("2026-05-03 14:00:00", periods=30, freq="100ms")
    sheet = pd.DataFrame({"time": stamps, "heading_deg": np.arange(30.0), "tau": 0.5, "on": True})
    sheet.loc[7, "heading_deg"] = np.nan
    book, text = tmp_path / "log.xlsx", tmp_path / "log.csv"
    sheet.to_excel(book)
    sheet.to_csv(text)
    tables = [read_log(LogFile(path, path.name, True), dof=YAW) for path in (book, text)]
    for quantity in ("time", "heading", "moment"):
        np.testing.assert_allclose(*(table.columns[quantity] for table in tables), atol=1e-6)
    assert np.flatnonzero(np.isnan(tables[0].columns["heading"])).tolist() == [7]
    monkeypatch.setitem(sys.modules, "openpyxl", None)
    assert refusal(LogFile(book, "log.xlsx", True)).endswith("say pip install 'automarine[excel]'")


def test_files_of_other_programs_are_told_how_to_be_saved(tmp_path: Path) -> None:
    (tmp_path / "run.mat").write_bytes(b"MATLAB 5.0 MAT-file")
    for place in (tmp_path, tmp_path / "run.mat"):
        with pytest.raises(LogError, match=r"\.xlsx; in MATLAB save a table with writetable\(T, 'log\.csv'\)$"):
            find_logs([place])


# Every format of vehicles' recordings before the judges of `reader_contract`, and what can be wrong with any.


VOLTS = {  # what stands in for a load cell
    "ardupilot": "voltage_V", "blueos": "SYS_STATUS.voltage_battery", "can": "Battery.Volt",
    "px4": "battery_status.voltage_v", "ros": "/battery.voltage",
}  # fmt: skip
EVERY = pytest.mark.parametrize("suffix", RECORDERS)
NONE = np.zeros(0)


@cache
def usual(suffix: str) -> bytes:
    return bytes(RECORDERS[suffix].write(dive()))


def made(suffix: str, of: Dive | None = None, without: tuple[str, ...] = ()) -> tuple[bytes, Recorder]:
    """A recording of a dive, and what is known of its format."""
    recorder = RECORDERS[suffix]
    pytest.importorskip(recorder.package)
    return recorder.write(of or dive(), without) if of or without else usual(suffix), recorder


@EVERY
@pytest.mark.parametrize("mirrored", [False, True])
def test_a_recording_is_what_the_vehicle_did(tmp_path: Path, suffix: str, mirrored: bool) -> None:
    judge_recording(tmp_path, suffix, mirrored)


@EVERY
def test_a_recording_cut_anywhere(tmp_path: Path, suffix: str) -> None:
    judge_cut_recording(tmp_path, suffix)


@EVERY
def test_a_run_turns_through_north_and_a_bad_recording_beside_it_is_set_aside(tmp_path: Path, suffix: str) -> None:
    content, recorder = made(suffix)
    recorded(tmp_path, suffix, content)
    (tmp_path / f"cut{suffix}").write_bytes(content[: len(content) // 50])
    campaign = load_runs([tmp_path], recorder.columns, dof=YAW)
    assert [aside.file.rpartition("/")[2] for aside in campaign.set_aside] == [f"cut{suffix}"]
    (run,) = campaign.runs
    assert run.name.removesuffix(".json") == "dive"
    assert np.rad2deg(run.position[-1] - run.position[0]) == pytest.approx(150, abs=0.02)
    assert set(np.round(run.extras["n_port"], 6)) == {0.0, 0.25}


@EVERY
def test_a_recording_without_heading_or_commands_says_what_it_holds(tmp_path: Path, suffix: str) -> None:
    content, recorder = made(suffix, without=RECORDERS[suffix].heading)
    sentence = refusal(recorded(tmp_path, suffix, content), recorder.columns)
    assert sentence.startswith(f"dive{suffix}: no heading in it; found ") and recorder.commands[0] in sentence
    assert "give it with --columns FILE.toml" in sentence and sentence.isprintable()
    content, recorder = made(suffix, without=RECORDERS[suffix].commands)
    with pytest.raises(LogError, match=f"no yaw moment.*{re.escape(recorder.heading[0])}"):
        require_motion(read_log(recorded(tmp_path, suffix, content), recorder.columns, dof=YAW))


@EVERY
def test_a_recording_of_nothing_or_of_noise_is_refused(tmp_path: Path, suffix: str) -> None:
    for hostile in (bytes(4096), bytes(np.random.default_rng(1).integers(0, 256, 4096, dtype=np.uint8))):
        assert refusal(recorded(tmp_path, suffix, hostile)).startswith(f"dive{suffix}: ")


@EVERY
def test_streams_that_are_empty_or_begin_late_are_missing_until_then(tmp_path: Path, suffix: str) -> None:
    first = dive()
    late = first.command_time > 3.2
    sent = first.command_time[late]
    of = replace(
        first, voltage_time=NONE, voltage=NONE, command_time=sent, port=first.port[late], stbd=first.stbd[late]
    )
    content, recorder = made(suffix, of)
    table = read_log(recorded(tmp_path, suffix, content), recorder.columns, dof=YAW)
    assert "voltage" not in table.columns
    before = int(np.count_nonzero(first.time < sent[0] - 1e-3))
    missing = np.isnan(table.columns["n_port"])
    assert missing[:before].all() and not missing[before + 1 :].any()
    assert f"none in {before} rows" in " ".join(table.notes)


@EVERY
def test_a_missing_library_is_told_with_its_extra(tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch) -> None:
    content, recorder = made(suffix)
    for module in [name for name in sys.modules if name.partition(".")[0] == recorder.package] + [recorder.package]:
        monkeypatch.setitem(sys.modules, module, None)
    sentence = refusal(log(tmp_path, content, f"dive{suffix}"))
    assert sentence.startswith(f"dive{suffix}: ") and recorder.package in sentence
    assert sentence.endswith(f"pip install 'automarine[{recorder.extra}]'")


@pytest.mark.parametrize(
    ("suffix", "number"), [(".bin", 0), (".bag", 1), (".db3", 1), (".mcap", 1), (".ulg", 2), (".asc", 3)]
)
def test_the_column_maps_of_the_page_work(tmp_path: Path, suffix: str, number: int) -> None:
    page = (ROOT / "automarine_cli" / "guide" / "vehicle-logs.md").read_text(encoding="utf-8")
    maps = re.findall(r"^```toml\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    assert len(maps) == 4
    shown = tomllib.loads(maps[number])
    content, recorder = made(suffix)
    dbc = recorder.columns.dbc if "can" in shown else ""
    columns = ColumnMap(column_rules(shown["columns"], "columns.toml"), dbc=dbc)
    table = read_log(recorded(tmp_path, suffix, content), columns, dof=YAW)
    require_motion(table)
    assert not any("the file has no such column" in note for note in table.notes)


@EVERY
def test_a_thruster_test_is_on_the_clock_of_its_force(tmp_path: Path, suffix: str) -> None:
    """With a control signal and a force named, a recording is a thruster test, whatever else was on."""
    content, recorder = made(suffix)
    rules = {"n": recorder.columns.columns["n_port"], "force_N": ColumnRule(VOLTS[recorder.extra])}
    file = recorded(tmp_path, suffix, content)
    table = read_log(file, replace(recorder.columns, columns=rules), dof=YAW)
    assert is_thruster_test(table) and "heading" not in table.columns
    np.testing.assert_allclose(table.columns["force"], dive().voltage, atol=2e-3)
    require_thruster(table)
    both = replace(recorder.columns, columns=rules | dict(recorder.columns.columns))  # as in a campaign file
    assert not is_thruster_test(read_log(file, both, dof=YAW))


# Torn, random and hostile files before the readers: a right answer or one clear sentence, nothing else.


@pytest.mark.parametrize("name", KINDS)
def test_torn_files(tmp_path: Path, name: str) -> None:
    kind = KINDS[name]
    path = tmp_path / f"torn{kind.suffix}"
    outcomes = set()
    for number in range(kind.cases):
        path.write_bytes(case(name, number, seed=0))
        outcomes.add(outcome(kind, path))
    assert outcomes == {"read", "refused"}


NUMBERS = st.one_of(
    st.floats(-1e3, 1e3), st.floats(), st.sampled_from([0.0, 0.5, -0.5, 1e9, -9999.0, 1e-320, 1e300, np.nan, np.inf])
)


@settings(max_examples=60)
@given(data=st.data(), count=st.integers(1, 60), steady=st.booleans())
def test_any_table(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject, count: int, steady: bool) -> None:
    """Tables with the right columns and any numbers; half of them with a clock that runs evenly."""
    columns = {
        name: np.array(data.draw(st.lists(NUMBERS, min_size=count, max_size=count)))
        for name in ("time_s", "heading_deg", "tau")
    }
    if steady:
        columns["time_s"] = 0.1 * np.arange(count)
    if data.draw(st.booleans()):
        columns["tau"] = np.where(np.arange(count) > count // 3, columns["tau"][0], 0.0)
    path = tmp_path_factory.getbasetemp() / "table.csv"
    path.write_bytes(csv_of(pd.DataFrame(columns)))
    try:
        judge_log(path)
    except AutomarineError as refusal:
        assert str(refusal).isprintable(), refusal
