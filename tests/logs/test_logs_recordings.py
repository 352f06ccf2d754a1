"""Every format of vehicles' recordings before the judges of `reader_contract`, and what can be wrong with any."""

import random
import re
import sys
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from reader_contract import RECORDERS, Recorder, judge_cut_recording, judge_recording, recorded, refusal
from repository import ROOT
from vehicle_logs import Dive, dive

from automarine_cli.dofs import YAW
from automarine_cli.errors import AutomarineError, LogError
from automarine_cli.logs import (
    ColumnMap,
    ColumnRule,
    LogFile,
    column_rules,
    is_thruster_test,
    read_log,
    require_motion,
    require_thruster,
)
from automarine_cli.runs.load import load_runs, read_runs

VOLTS = {  # what stands in for a load cell
    "ardupilot": "voltage_V", "blueos": "SYS_STATUS.voltage_battery", "can": "Battery.Volt",
    "px4": "battery_status.voltage_v", "ros": "/battery.voltage",
}  # fmt: skip
EVERY = pytest.mark.parametrize("suffix", RECORDERS)


def made(suffix: str, given: Dive | None = None, without: tuple[str, ...] = ()) -> tuple[bytes, Recorder]:
    """A recording of a dive, and what is known of its format."""
    told = RECORDERS[suffix]
    pytest.importorskip(told.package)
    return told.write(given or dive(), without), told


@EVERY
@pytest.mark.parametrize("mirrored", [False, True])
def test_a_recording_is_what_the_vehicle_did(tmp_path: Path, suffix: str, mirrored: bool) -> None:
    judge_recording(tmp_path, suffix, mirrored)


@EVERY
def test_a_recording_cut_anywhere(tmp_path: Path, suffix: str) -> None:
    judge_cut_recording(tmp_path, suffix)


@EVERY
def test_a_run_of_a_recording_turns_through_north(tmp_path: Path, suffix: str) -> None:
    content, told = made(suffix)
    runs, aside = read_runs(recorded(tmp_path, suffix, content), told.columns, dof=YAW)
    assert not aside and len(runs) == 1
    assert np.rad2deg(runs[0].position[-1] - runs[0].position[0]) == pytest.approx(150, abs=0.02)
    assert set(np.round(runs[0].extras["n_port"], 6)) == {0.0, 0.25}


@EVERY
def test_a_recording_without_a_heading_says_what_it_holds(tmp_path: Path, suffix: str) -> None:
    content, told = made(suffix, without=RECORDERS[suffix].heading)
    file = recorded(tmp_path, suffix, content)
    with pytest.raises(LogError) as refused:
        read_log(file, told.columns, dof=YAW)
    sentence = str(refused.value)
    assert sentence.startswith(f"{file.name}: no heading in it; found the ") and told.commands[0] in sentence
    assert "give it with --columns FILE.toml" in sentence and sentence.isprintable()


@EVERY
def test_a_recording_without_commands_says_what_it_holds(tmp_path: Path, suffix: str) -> None:
    content, told = made(suffix, without=RECORDERS[suffix].commands)
    with pytest.raises(LogError, match="no yaw moment") as refused:
        require_motion(read_log(recorded(tmp_path, suffix, content), told.columns, dof=YAW))
    assert told.heading[0] in str(refused.value)


@EVERY
def test_a_recording_of_no_messages_is_refused(tmp_path: Path, suffix: str) -> None:
    still = dive()
    nothing = np.zeros(0)
    silent = replace(
        still, time=nothing, heading=nothing, rate=nothing, command_time=nothing, port=nothing, stbd=nothing,
        voltage_time=nothing, voltage=nothing, modes=(), arming=(),
    )  # fmt: skip
    try:
        content, told = made(suffix, silent)
    except (IndexError, ValueError):
        pytest.skip("the library writes no such file")
    with pytest.raises(LogError, match=r"no heading in it|found no|the file is empty"):
        read_log(recorded(tmp_path, suffix, content), told.columns, dof=YAW)


@EVERY
def test_an_empty_stream_is_one_that_is_not_there(tmp_path: Path, suffix: str) -> None:
    content, told = made(suffix, replace(dive(), voltage_time=np.zeros(0), voltage=np.zeros(0)))
    assert "voltage" not in read_log(recorded(tmp_path, suffix, content), told.columns, dof=YAW).columns


@EVERY
def test_commands_that_begin_late_are_missing_until_then(tmp_path: Path, suffix: str) -> None:
    whole = dive()
    late = whole.command_time > 3.2
    content, told = made(
        suffix, replace(whole, command_time=whole.command_time[late], port=whole.port[late], stbd=whole.stbd[late])
    )
    table = read_log(recorded(tmp_path, suffix, content), told.columns, dof=YAW)
    unknown = int(np.count_nonzero(whole.time < whole.command_time[late][0] - 1e-3))
    assert (
        np.isnan(table.columns["n_port"][:unknown]).all() and not np.isnan(table.columns["n_port"][unknown + 1 :]).any()
    )
    assert f"none in {unknown} rows" in " ".join(table.notes)


@EVERY
def test_a_clock_that_steps_back_is_refused_with_its_row(tmp_path: Path, suffix: str) -> None:
    whole = dive()
    back = replace(whole, time=np.where(np.arange(200) == 120, whole.time - 0.35, whole.time))
    content, told = made(suffix, back)
    try:
        runs, aside = read_runs(recorded(tmp_path, suffix, content), told.columns, dof=YAW)
    except AutomarineError as error:
        assert "the clock steps back" in str(error) and "row 1" in str(error)
    else:  # the format sorts its messages
        assert len(runs) == 1 and not aside


@EVERY
def test_a_missing_library_is_told_with_what_installs_it(
    tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    content, told = made(suffix)
    for module in [name for name in sys.modules if name.partition(".")[0] == told.package] + [told.package]:
        monkeypatch.setitem(sys.modules, module, None)
    file = recorded_without_library(tmp_path, suffix, content)
    sentence = refusal(file)
    assert sentence.startswith(f"dive{suffix}: ") and f"read by {told.package}, which is not installed" in sentence
    assert sentence.endswith(f"say pip install 'automarine[{told.extra}]'")


def recorded_without_library(folder: Path, suffix: str, content: bytes) -> LogFile:
    """A recording, though its library cannot be imported."""
    path = folder / f"dive{suffix}"
    path.write_bytes(content)
    return LogFile(path, path.name, True)


@EVERY
def test_torn_recordings_give_an_answer_or_one_clear_line(tmp_path: Path, suffix: str) -> None:
    content, told = made(suffix)
    rng, outcomes = random.Random(suffix), set()
    for _ in range(20):
        torn = bytearray(content)
        for _ in range(rng.choice([1, 4, 40])):
            place = rng.randrange(len(torn))
            torn[place : place + rng.choice([1, 1, 1, 30])] = rng.choice(
                [b"", b"\xff", b"\0", bytes([rng.randrange(256)])]
            )
        try:
            require_motion(read_log(recorded(tmp_path, suffix, bytes(torn)), told.columns, dof=YAW))
            outcomes.add("read")
        except AutomarineError as error:
            assert str(error).isprintable() and str(error).startswith(f"dive{suffix}"), error
            outcomes.add("refused")
    for hostile in (b"", bytes(4096), bytes(np.random.default_rng(1).integers(0, 256, 4096, dtype=np.uint8))):
        assert refusal(recorded(tmp_path, suffix, hostile)).startswith(f"dive{suffix}: ")
    assert outcomes


@EVERY
def test_one_bad_recording_in_a_folder_is_set_aside(tmp_path: Path, suffix: str) -> None:
    content, told = made(suffix)
    recorded(tmp_path, suffix, content)
    (tmp_path / f"cut{suffix}").write_bytes(content[: len(content) // 50])
    found = load_runs([tmp_path], told.columns, dof=YAW)
    assert [run.name.removesuffix(".json") for run in found.runs] == ["dive"]
    assert [one.file.rpartition("/")[2] for one in found.set_aside] == [f"cut{suffix}"]


def pages_maps() -> list[dict[str, Any]]:
    """The column maps that the page about formats shows."""
    page = (ROOT / "automarine_cli" / "guide" / "vehicle-logs.md").read_text(encoding="utf-8")
    return [tomllib.loads(text) for text in re.findall(r"^```toml\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)]


@pytest.mark.parametrize(
    ("suffix", "number"), [(".bin", 0), (".bag", 1), (".db3", 1), (".mcap", 1), (".ulg", 2), (".asc", 3)]
)
def test_the_column_maps_of_the_page_work(tmp_path: Path, suffix: str, number: int) -> None:
    content, told = made(suffix)
    shown = pages_maps()[number]
    columns = ColumnMap(column_rules(shown["columns"], "columns.toml"), dbc=told.columns.dbc if "can" in shown else "")
    table = read_log(recorded(tmp_path, suffix, content), columns, dof=YAW)
    require_motion(table)
    assert not any("the file has no such column" in note for note in table.notes)
    assert len(pages_maps()) == 4


@EVERY
def test_a_thruster_test_is_on_the_clock_of_its_force(tmp_path: Path, suffix: str) -> None:
    """With a control signal and a force named, a recording is a thruster test, whatever else was on."""
    content, told = made(suffix)
    port = told.columns.columns["n_port"]
    rules = {"n": port, "force_N": ColumnRule(VOLTS[told.extra])}
    table = read_log(recorded(tmp_path, suffix, content), replace(told.columns, columns=rules), dof=YAW)
    assert is_thruster_test(table) and "heading" not in table.columns
    np.testing.assert_allclose(table.columns["force"], dive().voltage, atol=2e-3)
    require_thruster(table)
    both = replace(told.columns, columns=rules | dict(told.columns.columns))  # as in a campaign file
    assert not is_thruster_test(read_log(recorded(tmp_path, suffix, content), both, dof=YAW))
