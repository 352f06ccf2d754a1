"""BlueOS's recordings: MAVLink as JSON in MCAP, in both spellings, beside video; other JSON by its topic."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from made_outputs import sub_dive, wishes
from reader_contract import table_of
from vehicle_blueos import recorded
from vehicle_logs import dive, telemetry

pytest.importorskip("mcap", reason="the extra automarine[blueos] is not installed")


read = partial(table_of, "recorder.mcap")


@pytest.mark.parametrize("spelled", [True, False])
def test_a_recording_is_read_like_the_telemetry_of_the_same_dive(tmp_path: Path, spelled: bool) -> None:
    made = sub_dive(wishes(len(dive().command_time), 2))
    table = read(tmp_path, recorded(made, spelled=spelled))
    other = table_of("dive.tlog", tmp_path, telemetry(made))
    for name in ("time", "heading", "yaw_rate", "moment", "voltage"):
        np.testing.assert_allclose(table.columns[name], other.columns[name], atol=3e-3 if name == "time" else 1e-6)
    assert table.origin == other.origin and "(FRAME_CONFIG 2)" in table.origin.made_from
    assert table.labels["mode"].names == other.labels["mode"].names == ("MANUAL", "ALT_HOLD")
    assert table.labels["armed"].names == ("disarmed", "armed")
    assert "video/1/stream (1)" in table.holds


def test_any_field_of_any_topic_can_be_named(tmp_path: Path) -> None:
    topic = "mavlink/1/1/extra/range"
    columns = {"n": f"{topic}.beams[2].snr", "voltage_V": f"{topic}.distance", "heave_m_s": "ATTITUDE.roll"}
    table = read(tmp_path, recorded(dive(), delay=0.0), **columns)
    np.testing.assert_allclose(table.columns["n"][1:] * 2, table.columns["voltage"][1:])
    assert np.nanmax(table.columns["voltage"]) == pytest.approx(dive().time[::3].max())
    assert not table.columns["heave"].any()
