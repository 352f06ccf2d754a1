"""CAN captures: bits against cantools, SLCAN's clock of a minute, the DBC in the column map, lines that are none."""

import json
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from reader_contract import CAN, log
from vehicle_can import COLUMNS, DBC, capture, frames, slcan
from vehicle_logs import dive

import automarine_cli as am
from automarine_cli.commands.campaign import read_campaign
from automarine_cli.dofs import YAW
from automarine_cli.errors import LogError
from automarine_cli.logs import ColumnMap, LogTable, read_log
from automarine_cli.logs.can import read_slcan

cantools = pytest.importorskip("cantools", reason="the extra automarine[can] is not installed")


def read(folder: Path, content: bytes, name: str = "dive.slcan", columns: ColumnMap = CAN) -> LogTable:
    """A capture of these bytes, read with the columns of the dive."""
    return read_log(log(folder, content, name), columns, dof=YAW)


def test_multiplexed_signals_keep_to_their_frames(tmp_path: Path) -> None:
    table = read(tmp_path, capture(".slcan", dive()))
    assert set(table.extras["Battery.Amps"]) == {-3.0}
    assert 15.5 < table.columns["voltage"].min() <= table.columns["voltage"].max() <= 16
    np.testing.assert_allclose(table.extras["Thrusters.Depth"][1:], -0.5, atol=1e-12)  # a sibling of what is named
    assert "Battery (Volt" not in " ".join(table.notes) and "Battery (Which 0)" in table.notes[0]


def test_the_converter_s_clock_goes_on_over_the_minutes() -> None:
    sent = [(at, message, data) for at, message, data in frames(dive())]
    late = [(at + 47, message, data) for at, message, data in sent]
    time, *_ = read_slcan(slcan(late), "x")
    np.testing.assert_allclose(time, [round(at, 3) for at, _, _ in late], atol=1e-9)
    apart = [*sent, *[(at + 300, message, data) for at, message, data in sent]]
    time, *_ = read_slcan(slcan(apart, host=1e9), "x")
    np.testing.assert_allclose(time - 1e9 - 0.003, [at for at, _, _ in apart], atol=1e-3)
    time, *_ = read_slcan(slcan(sent, host=50.0, clock=False), "x")
    np.testing.assert_allclose(time, [at + 50.003 for at, _, _ in sent], atol=1e-6)


def test_frames_without_a_time_are_refused(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"dive.slcan: the frames have no time; let the converter add it \(command Z1\)"):
        read(tmp_path, slcan(frames(dive()), clock=False))


@pytest.mark.parametrize("suffix", [".slcan", ".log"])
def test_lines_that_are_no_frames_are_counted(tmp_path: Path, suffix: str) -> None:
    good = capture(suffix, dive())
    end = b"\r" if suffix == ".slcan" else b"\n"
    lines = good.split(end)
    lines[40] = lines[40][:-3]
    table = read(tmp_path, end.join(lines), f"dive{suffix}")
    assert "1 line skipped: not a CAN frame" in table.notes


def test_without_a_dbc_the_identifiers_are_told(tmp_path: Path) -> None:
    with pytest.raises(LogError) as refused:
        read(tmp_path, capture(".slcan", dive()), columns=ColumnMap())
    said = str(refused.value)
    assert "found the identifiers 0x123 (200), 0x200 (84), 0x300 (41), 0x18fef002 (82)" in said
    assert '[can] with dbc = "vehicle.dbc"' in said
    part = DBC.read_text().replace("BO_ 291", "BO_ 292")
    (tmp_path / "part.dbc").write_text(part)
    with pytest.raises(LogError, match=r"no heading in it; found the CAN messages State \(41\).* 0x123 \(200\)"):
        read(tmp_path, capture(".slcan", dive()), columns=ColumnMap(CAN.columns, dbc=str(tmp_path / "part.dbc")))


def test_the_column_map_names_the_dbc_relative_to_itself(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    home = tmp_path / "maps"
    home.mkdir()
    (home / "bus.dbc").write_bytes(DBC.read_bytes())
    (home / "columns.toml").write_text('[can]\ndbc = "bus.dbc"\n[columns]' + COLUMNS)
    log(tmp_path, capture(".slcan", dive()), "dive.slcan")
    monkeypatch.chdir(tmp_path)
    made = am.check("dive.slcan", columns="maps/columns.toml", out="out")
    assert len(made.runs) == 1
    recorded = json.loads(Path("out/manifest.json").read_text())["inputs"]
    assert [(one["file"], one["role"]) for one in recorded] == [
        ("dive.slcan", "log"), ("columns.toml", "columns"), ("bus.dbc", "dbc"),
    ]  # fmt: skip
    campaign = '[can]\ndbc = "maps/bus.dbc"\n[logs]\nmanoeuvres = ["dive.slcan"]\n[columns]' + COLUMNS
    Path("campaign.toml").write_text(f'schema = "automarine/campaign/1"\n{campaign}')
    columns = read_campaign(Path("campaign.toml")).columns
    am.check("dive.slcan", columns=columns, out="again")
    assert str(tmp_path) not in Path("again/manifest.json").read_text()


def test_a_dbc_that_is_none_is_refused(tmp_path: Path) -> None:
    content = capture(".slcan", dive())
    for name, text, sentence in (
        ("bad.dbc", "BO_ what", r"bad.dbc: is not a readable DBC \("),
        ("lost.dbc", None, r"the column map: can.dbc is lost.dbc, which cannot be opened \(No such file"),
    ):
        if text is not None:
            (tmp_path / name).write_text(text)
        with pytest.raises(LogError, match=sentence):
            read(tmp_path, content, columns=ColumnMap(CAN.columns, dbc=str(tmp_path / name)))


def test_an_object_of_no_length_does_not_hold_the_reader_for_ever(tmp_path: Path) -> None:
    """A torn BLF file; python-can's own reader stays at such an object."""
    good = capture(".blf", dive())
    at = 144 + 32  # the file's header and the container's
    whole = bytearray(zlib.decompress(good[at:]))
    second = whole.find(b"LOBJ", 2000)
    whole[second + 6 : second + 12] = bytes([9, 0, 0, 0, 0, 0])  # an unknown version, no bytes
    packed = zlib.compress(bytes(whole))
    head = bytearray(good[:at])
    head[144 + 8 : 144 + 12] = struct.pack("<I", 32 + len(packed))
    with pytest.raises(LogError, match=r"dive\.blf: "):
        read(tmp_path, bytes(head) + packed, "dive.blf")


def test_a_signal_that_does_not_fit_its_message_is_left_out(tmp_path: Path) -> None:
    """Such a DBC is in use; everything else in it is read."""
    (tmp_path / "wide.dbc").write_text(DBC.read_text().replace(
        "BO_ 768", ' SG_ Wide : 40|16@1+ (1,0) [0|1] "" Vehicle\nBO_ 768'
    ))  # fmt: skip
    table = read(tmp_path, capture(".slcan", dive()), columns=ColumnMap(CAN.columns, dbc=str(tmp_path / "wide.dbc")))
    assert "Battery.Volt" in table.names and "Battery.Wide" not in table.names
