"""From the one log of a pool day to the model: an ArduSub log is cut into its steps, and these are fitted."""

from pathlib import Path

import numpy as np
import pytest
from made_runs import INERTIA, K_RR, step_heading
from vehicle_logs import Dive, dataflash

import automarine_cli as am

pytest.importorskip("pymavlink", reason="the extra automarine[ardupilot] is not installed")
MOMENTS = (0.4, -0.4, 0.6, -0.6, 0.9, -0.9, 1.2, -1.2)
REST, STEP = 4.0, 9.0  # s
COLUMNS = '[columns]\ntau = { from = "RCOU.C1", scale = 0.0025, offset = -3.75 }\n'


def day(noise: float) -> Dive:
    """Steps to each moment from rest, logged at 20 Hz with `noise` [deg]; the command goes out at 20 Hz too.

    After each step the vehicle is held until it stands still.
    """
    time = np.arange(round((REST + STEP) * len(MOMENTS) * 20)) / 20 + 1.003
    heading, moment = np.zeros(len(time)), np.zeros(len(time))
    for i, tau in enumerate(MOMENTS):
        since = time - 1 - i * (REST + STEP) - REST
        acts = (since > 0) & (since < STEP)
        heading[since > 0] = np.rad2deg(step_heading(np.array([0.0]), tau))[0]
        heading[acts] = np.rad2deg(step_heading(since[acts], tau))
        moment[acts] = tau
    heading += np.random.default_rng(4).normal(0, noise, len(time))
    pulses = np.round(1500 + 400 * moment)
    return Dive(
        time, heading, np.zeros(len(time)), time - 0.003, pulses, 3000 - pulses, time[::10], 16 + 0 * time[::10],
        modes=((0.5, 19),), arming=((0.5, True),),
    )  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`day.bin` and its column map."""
    folder = tmp_path_factory.mktemp("day")
    (folder / "day.bin").write_bytes(dataflash(day(noise=0.4), without=("RATE", "IMU", "EV")))
    (folder / "columns.toml").write_text(COLUMNS)
    return folder


def test_a_day_in_one_log_becomes_runs_that_give_back_the_vehicle(folder: Path, tmp_path: Path) -> None:
    columns, out = folder / "columns.toml", tmp_path / "out"
    made = am.slice_log(folder / "day.bin", by="moment", columns=columns, lead=3.0, out=out)
    assert [float(cut.state) for cut in made.cuts] == list(MOMENTS)
    fit = am.fit_yaw(out / "runs")
    assert len(fit.read) == len(MOMENTS)
    estimates = fit.output_error["3"].estimates
    for name, true in (("I_r", INERTIA), ("k_rr", K_RR)):
        assert abs(estimates[name].value - true) < 4 * estimates[name].stderr, (name, estimates[name])
        assert estimates[name].stderr < 0.03 * true
    assert "readings" not in fit.to_json()["runs"]  # a table: nothing was held
