"""Logs of motion in the plane: units, names, positions on the water, what a slow sensor repeats, what is refused."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from automarine_cli.dofs import SURGE, SWAY, YAW
from automarine_cli.errors import LogError
from automarine_cli.logs.columns import read_column_map
from automarine_cli.runs.load import EQUATORIAL_RADIUS, load_runs, local_plane, repeats
from automarine_cli.runs.run import Run

TIME = np.arange(0, 40, 0.2)


def columns(**more: object) -> dict[str, object]:
    """A log of everything: a turn to starboard under way."""
    return {
        "time_s": TIME, "heading_deg": (350 + 3 * TIME) % 360, "yaw_rate_deg_s": np.full(len(TIME), 3.0),
        "tau_Nm": 0.5 + 0 * TIME, "force_X_N": 20.0 + 0 * TIME, "force_Y_N": -4.0 + 0 * TIME,
        "surge_m_s": 0.5 + 0.01 * TIME, "sway_m_s": -0.02 * TIME, "north_m": 0.3 * TIME, "east_m": -0.4 * TIME, **more,
    }  # fmt: skip


def loaded(folder: Path, table: Mapping[str, object], suffix: str = "csv", map: str = "") -> Run:
    path, frame = folder / f"log.{suffix}", pd.DataFrame(table)
    _ = frame.to_parquet(path) if suffix == "parquet" else frame.to_csv(path, index=False)
    (folder / "map.toml").write_text(map)
    rules = read_column_map(folder / "map.toml") if map else None
    (run,) = load_runs([path], rules, dof=YAW, planar=True).runs
    return run


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_every_channel_and_command_in_si_units(tmp_path: Path, suffix: str) -> None:
    run = loaded(tmp_path, columns(), suffix)
    expected = {
        "yaw_rate": np.deg2rad(3.0) + 0 * TIME, "surge": 0.5 + 0.01 * TIME, "sway": -0.02 * TIME,
        "north": 0.3 * TIME, "east": -0.4 * TIME,
    }  # fmt: skip
    for name, values in expected.items():
        np.testing.assert_allclose(run.channel(name), values, atol=1e-9, err_msg=name)
    np.testing.assert_allclose(run.position, np.deg2rad(350 + 3 * TIME), atol=1e-9)
    assert (run.command[0], run.command_of(SURGE)[0], run.command_of(SWAY)[0]) == (0.5, 20.0, -4.0)
    assert run.moment_unit == "N m" and run.reading == ()


@pytest.mark.parametrize(("lat", "lon"), [(63.4, 10.4), (-33.9, 179.99998), (0.0001, -120.0)])
def test_latitude_and_longitude_become_metres(tmp_path: Path, lat: float, lon: float) -> None:
    """Against distances on the ellipsoid by its own arc length, to a tenth of a percent."""
    table = {k: v for k, v in columns().items() if not k.endswith(("th_m", "st_m"))}
    north, east = 3e-6 * TIME, (lon + 5e-6 * TIME + 180) % 360 - 180
    run = loaded(tmp_path, table | {"lat_deg": lat + north, "lon_deg": east})
    squared = 1 - 6.69437999014e-3 * np.sin(np.deg2rad(lat)) ** 2
    meridian = EQUATORIAL_RADIUS * (1 - 6.69437999014e-3) / squared**1.5
    parallel = EQUATORIAL_RADIUS / squared**0.5 * np.cos(np.deg2rad(lat))
    np.testing.assert_allclose(run.channel("north"), np.deg2rad(north) * meridian, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(run.channel("east"), np.deg2rad(5e-6 * TIME) * parallel, rtol=1e-6, atol=1e-5)
    assert "lat" not in run.extras


def test_a_fix_of_zero_is_none() -> None:
    lat, lon = np.deg2rad([0.0, 59.0, np.nan, 59.00001]), np.deg2rad([0.0, 5.0, 5.0, 5.0])
    north, east = local_plane(lat, lon)
    assert np.isnan(north[[0, 2]]).all() and north[1] == 0 and north[3] == pytest.approx(1.114, abs=1e-3)
    assert np.isnan(local_plane(lat[:1], lon[:1])[0]).all() and east[3] == 0


def test_a_row_without_a_reading_stays_and_one_without_a_force_goes(tmp_path: Path) -> None:
    surge, force = 0.5 + 0.01 * TIME, 20 + 0 * TIME
    surge[10:50], force[100:103] = np.nan, np.nan
    run = loaded(tmp_path, columns(surge_m_s=surge, force_X_N=force))
    assert len(run) == len(TIME) - 3 and run.counts["missing"] == 3
    assert np.isnan(run.extras["surge"][10:50]).all() and np.isfinite(run.extras["surge"][50:]).all()


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_what_a_slow_sensor_repeats_counts_once(tmp_path: Path, sign: float) -> None:
    """A Doppler log at 1 Hz in a log at 5 Hz, in steps of a tenth of a millimetre a second."""
    rng = np.random.default_rng(1)
    slow = np.round(sign * (0.5 + 0.3 * np.sin(TIME[::5] / 5)) + 0.02 * rng.standard_normal(40), 4)
    run = loaded(tmp_path, columns(surge_m_s=np.repeat(slow, 5)))
    new = np.isfinite(run.extras["surge"])
    np.testing.assert_array_equal(np.flatnonzero(new), np.arange(5, len(TIME), 5))
    np.testing.assert_array_equal(run.extras["surge"][new], slow[1:])
    (note,) = run.reading
    assert note.startswith("surge: 80 % of the rows") and np.isfinite(run.extras["sway"]).all()


@pytest.mark.parametrize("noise", [0.004, 0.02, 0.0])
def test_a_coarse_sensor_that_reads_every_row_is_not_held(noise: float) -> None:
    """In steps of a centimetre a second, at rest, creeping and under way."""
    rng, time = np.random.default_rng(0), np.arange(400) / 5
    speed = 0.4 * (1 - np.exp(-np.maximum(time - 20, 0) / 15)) + noise * rng.standard_normal(400)
    assert not repeats(np.round(speed, 2)).any()


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ({"force_X_N": None, "force_Y_N": None}, "no force in the log (force_X_N or force_Y_N)"),
        ({"tau_Nm": None}, "no yaw moment"),
        ({"force_X_N": None, "X": 0.5 + 0 * TIME}, "force X is normalised (X); motions that are coupled need"),
        ({"tau_Nm": None, "tau": 0.5 + 0 * TIME}, "moment is normalised (tau); motions that are coupled need"),
    ],
)
def test_refusals(tmp_path: Path, more: dict[str, object], says: str) -> None:
    table = {name: column for name, column in columns(**more).items() if column is not None}
    with pytest.raises(LogError) as refusal:
        loaded(tmp_path, table)
    assert says in str(refusal.value) and "--columns" in str(refusal.value)
