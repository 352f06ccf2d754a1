"""CAN captures: bits against cantools, SLCAN's clock of a minute, the DBC in the column map, lines that are none."""

import json
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from reader_contract import CAN, log, refusal
from vehicle_can import COLUMNS, DBC, capture, frames, slcan
from vehicle_logs import dive

import automarine_cli as am
from automarine_cli.commands.campaign import read_campaign
from automarine_cli.dofs import YAW
from automarine_cli.logs import ColumnMap, LogTable, read_log
from automarine_cli.logs.can import read_slcan

cantools = pytest.importorskip("cantools", reason="the extra automarine[can] is not installed")


@pytest.fixture(scope="module")
def content() -> bytes:
    return capture(".slcan", dive())


def read(folder: Path, content: bytes, name: str = "dive.slcan", columns: ColumnMap = CAN) -> LogTable:
    return read_log(log(folder, content, name), columns, dof=YAW)


def with_dbc(folder: Path, text: str) -> ColumnMap:
    (folder / "other.dbc").write_text(text)
    return ColumnMap(CAN.columns, dbc=str(folder / "other.dbc"))


def test_multiplexed_signals_keep_to_their_frames(tmp_path: Path, content: bytes) -> None:
    table = read(tmp_path, content)
    assert set(table.extras["Battery.Amps"]) == {-3.0}
    assert 15.5 < table.columns["voltage"].min() <= table.columns["voltage"].max() <= 16
    np.testing.assert_allclose(table.extras["Thrusters.Depth"][1:], -0.5, atol=1e-12)  # a sibling of what is named
    assert "Battery (Volt" not in " ".join(table.notes) and "Battery (Which 0)" in table.notes[0]


def test_the_converter_s_clock_goes_on_over_the_minutes(tmp_path: Path) -> None:
    sent = frames(dive())
    late = [(at + 47, message, data) for at, message, data in sent]
    (time, *_), _ = read_slcan(slcan(late), "x")
    np.testing.assert_allclose(time, [round(at, 3) for at, _, _ in late], atol=1e-9)
    apart = [*sent, *[(at + 300, message, data) for at, message, data in sent]]
    (time, *_), _ = read_slcan(slcan(apart, host=1e9), "x")
    np.testing.assert_allclose(time - 1e9 - 0.003, [at for at, _, _ in apart], atol=1e-3)
    (time, *_), _ = read_slcan(slcan(sent, host=50.0, clock=False), "x")
    np.testing.assert_allclose(time, [at + 50.003 for at, _, _ in sent], atol=1e-6)
    sentence = refusal(log(tmp_path, slcan(sent, clock=False), "dive.slcan"), CAN)
    assert sentence.startswith("dive.slcan: the frames have no time") and "command Z1" in sentence


@pytest.mark.parametrize("suffix", [".slcan", ".log"])
def test_lines_that_are_no_frames_are_counted(tmp_path: Path, suffix: str) -> None:
    end = b"\r" if suffix == ".slcan" else b"\n"
    lines = capture(suffix, dive()).split(end)
    lines[40] = lines[40][:-3]
    assert "1 line skipped: not a CAN frame" in read(tmp_path, end.join(lines), f"dive{suffix}").notes


def test_without_a_dbc_the_identifiers_are_told(tmp_path: Path, content: bytes) -> None:
    file = log(tmp_path, content, "dive.slcan")
    sentence = refusal(file, ColumnMap())
    assert "the identifiers 0x123 (200), 0x200 (84), 0x300 (41), 0x18fef002 (82)" in sentence
    assert '[can] with dbc = "vehicle.dbc"' in sentence
    sentence = refusal(file, with_dbc(tmp_path, DBC.read_text().replace("BO_ 291", "BO_ 292")))
    assert "no heading in it; found State (41)" in sentence and " 0x123 (200)" in sentence


def test_the_column_map_names_the_dbc(tmp_path: Path, content: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "bus.dbc").write_bytes(DBC.read_bytes())
    (tmp_path / "maps" / "columns.toml").write_text('[can]\ndbc = "bus.dbc"\n[columns]' + COLUMNS)
    log(tmp_path, content, "dive.slcan")
    monkeypatch.chdir(tmp_path)
    assert len(am.check("dive.slcan", columns="maps/columns.toml", out="out").runs) == 1
    inputs = json.loads(Path("out/manifest.json").read_text())["inputs"]
    roles = {"dive.slcan": "log", "columns.toml": "columns", "bus.dbc": "dbc"}
    assert {row["file"]: row["role"] for row in inputs} == roles
    campaign = '[can]\ndbc = "maps/bus.dbc"\n[logs]\nmanoeuvres = ["dive.slcan"]\n[columns]' + COLUMNS
    Path("campaign.toml").write_text(f'schema = "automarine/campaign/1"\n{campaign}')
    am.check("dive.slcan", columns=read_campaign(Path("campaign.toml")).columns, out="again")
    assert str(tmp_path) not in Path("again/manifest.json").read_text()


def test_a_dbc_that_is_none_is_refused(tmp_path: Path, content: bytes) -> None:
    file = log(tmp_path, content, "dive.slcan")
    assert refusal(file, with_dbc(tmp_path, "BO_ what")).startswith("other.dbc: is not a readable DBC (")
    sentence = refusal(file, ColumnMap(CAN.columns, dbc=str(tmp_path / "lost.dbc")))
    assert sentence.startswith("lost.dbc: is not a readable DBC (") and "relative to the column map" in sentence


def test_an_object_of_no_length_does_not_hold_the_reader_for_ever(tmp_path: Path) -> None:
    """A torn BLF file; python-can's own reader stays at such an object."""
    good = capture(".blf", dive())
    at = 144 + 32  # the file's header and the container's
    objects = bytearray(zlib.decompress(good[at:]))
    second = objects.find(b"LOBJ", 2000)
    objects[second + 6 : second + 12] = bytes([9, 0, 0, 0, 0, 0])  # an unknown version, no bytes
    packed = zlib.compress(bytes(objects))
    head = bytearray(good[:at])
    head[144 + 8 : 144 + 12] = struct.pack("<I", 32 + len(packed))
    assert refusal(log(tmp_path, bytes(head) + packed, "dive.blf"), CAN).startswith("dive.blf: ")


def test_a_signal_that_does_not_fit_its_message_is_left_out(tmp_path: Path, content: bytes) -> None:
    """Such a DBC is in use; everything else in it is read."""
    wide = DBC.read_text().replace("BO_ 768", ' SG_ Wide : 40|16@1+ (1,0) [0|1] "" Vehicle\nBO_ 768')
    table = read(tmp_path, content, columns=with_dbc(tmp_path, wide))
    assert "Battery.Volt" in table.names and "Battery.Wide" not in table.names
