"""simulate of motion in the plane: its truth against an independent solution, its sensors, seeds, sides, refusals."""

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from made_planar import Craft, solved
from repository import SAMPLE_RUNS

from automarine_cli.commands.simulate import simulate
from automarine_cli.dofs import YAW
from automarine_cli.errors import SettingError
from automarine_cli.pipeline.records import read_mapping
from automarine_cli.runs.load import load_runs
from automarine_cli.runs.run import Run
from automarine_cli.simulation.campaign import SimulatedRun, make_campaign
from automarine_cli.simulation.specification import Specification, specification_from

PLAIN: dict[str, Any] = {
    "schema": "automarine/simulation/1",
    "vehicle": {
        "motion": "planar",
        "parameters": {
            "surge.m_u": 24.0, "surge.X_uu": 22.0, "sway.m_v": 36.0, "sway.Y_vv": 70.0, "yaw.I_r": 2.4, "yaw.k_rr": 3.2,
        },
    },
    "hidden": {"yaw.N_v": -6.0},
    "sensors": {name: {} for name in ("heading_deg", "yaw_rate_deg_s", "surge_m_s", "sway_m_s", "north_m", "east_m")},
    "runs": [{"name": "run", "commands": [[15, 0, 1, 5], [15, 8, -1, 6], [-5, 0, 0.5, 5]]}],
}  # fmt: skip
CRAFT = Craft(
    np.diag([24.0, 36.0, 2.4]), linear=np.array([[0, 0, 0], [0, 0, 0], [0, -6.0, 0]]), by_own=np.diag([22.0, 70.0, 3.2])
)


def specified(**changes: object) -> Specification:
    """The plain campaign with other settings."""
    return specification_from({**copy.deepcopy(PLAIN), **changes}, "plain.toml")


def single(**changes: object) -> SimulatedRun:
    """Its one run."""
    (run,) = make_campaign(specified(**changes), 3)
    return run


def test_the_truth_is_that_of_another_solver() -> None:
    simulated = single(scatter={"start_heading_deg": 40.0})
    columns, switches = simulated.columns, simulated.switches
    time = columns["time_s"]
    dense = np.sort(np.concatenate([time, switches - 1e-9, switches + 1e-9]))  # rows that show every switch at once
    held = np.vstack([np.zeros(3), simulated.plan.moments])[np.searchsorted(switches, dense)]
    extras = {"force_X": held[:, 0], "force_Y": held[:, 1]}
    run = Run("run", "run.csv", dense, 0 * dense, held[:, 2], "N m", extras, dof=YAW)
    rows, rounding = np.isin(dense, time), 6e-4
    positions, velocities = (values[rows] for values in solved(CRAFT, run, (0, 0, np.deg2rad(40.0)), (0, 0, 0)))
    assert np.abs(np.column_stack([columns["north_m"], columns["east_m"]]) - positions[:, :2]).max() < rounding
    assert np.abs((columns["heading_deg"] - np.rad2deg(positions[:, 2]) + 180) % 360 - 180).max() < rounding
    assert np.abs(np.column_stack([columns["surge_m_s"], columns["sway_m_s"]]) - velocities[:, :2]).max() < rounding
    assert np.abs(columns["yaw_rate_deg_s"] - np.rad2deg(velocities[:, 2])).max() < rounding
    assert np.ptp(positions[:, 2]) > 0.5 and np.abs(velocities[:, 1]).max() > 0.1


def test_port_is_the_mirror_image_of_starboard() -> None:
    there = single()
    mirrored = [[x, -y, -n, s] for x, y, n, s in PLAIN["runs"][0]["commands"]]
    back = single(runs=[{"name": "run", "commands": mirrored}])
    for name, side in (("north_m", 1), ("east_m", -1), ("surge_m_s", 1), ("sway_m_s", -1), ("tau_Nm", -1)):
        np.testing.assert_allclose(back.columns[name], side * there.columns[name], atol=2e-3, err_msg=name)


@pytest.mark.slow
def test_bias_and_disturbance_are_of_the_size_asked() -> None:
    rest = [{"name": "rest", "repeats": 20, "commands": [[0, 0, 0, 20]]}]
    sensors = {**PLAIN["sensors"], "yaw_rate_deg_s": {"bias": 2.0}}
    pushed = make_campaign(specified(sensors=sensors, runs=rest, disturbance={"sway_N": 2.0, "time_s": 4.0}), 0)
    assert 1.2 < np.std([run.biases["yaw_rate_deg_s"] for run in pushed]) < 2.8
    still = single(sensors=sensors, runs=[rest[0] | {"repeats": 1}])
    assert still.columns["yaw_rate_deg_s"] == pytest.approx(still.biases["yaw_rate_deg_s"], abs=6e-4)
    size = np.std(np.concatenate([run.disturbance[1] for run in pushed]))
    assert 1.5 < size < 2.5 and not pushed[0].disturbance[0].any()
    assert max(np.abs(run.columns["sway_m_s"]).max() for run in pushed) > 0.05


def test_a_slow_sensor_is_held_and_seen_through(tmp_path: Path) -> None:
    settings = read_mapping(SAMPLE_RUNS / "planar.toml")
    settings["runs"] = [settings["runs"][0] | {"repeats": 2}]
    simulate(specification_from(settings, "planar.toml"), out=tmp_path / "out")
    for run in load_runs([tmp_path / "out" / "planar"], dof=YAW, planar=True).runs:
        fresh = np.flatnonzero(np.isfinite(run.extras["surge"]))
        assert set(fresh % 5) == {0} and len(fresh) >= 38
        assert np.isfinite(run.extras["north"]).all() and run.moment_unit == "N m"
    table = pd.read_csv(tmp_path / "out" / "planar" / "driven_a.csv", comment="#")
    assert len(table.columns) == 10 and table["tau_Nm"].abs().max() <= 3 and table["heading_deg"].between(0, 360).all()


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"sensors": {"depth_m": {}}}, 'sensors: found "depth_m", expected some of north_m'),
        ({"sensors": {"surge_m_s": {}}}, "heading_deg is missing"),
        ({"hidden": {"surge.m_u": 3.0}}, "hidden: 'surge.m_u' is a parameter of the vehicle too"),
        ({"hidden": {"yaw.N_w": 3.0}}, 'vehicle: parameters: unknown key "yaw.N_w"'),
        ({"runs": []}, "nothing to simulate; expected [[runs]] or [bollard]"),
        ({"effects": [{"name": "dead-band", "width": 1}]}, "effects: runs of planar have none"),
        ({"logger": {"noise_deg": 1}}, "noise and bias are of the columns; give them in [sensors]"),
        ({"runs": [{"name": "a"}]}, 'key "commands" is missing; expected a list'),
        ({"runs": [{"name": "a", "commands": [[1, 2, 3]]}]}, "commands: expected at least one [X, Y, N, seconds]"),
        ({"runs": [{"name": "a", "largest": [1, 1, 1], "duration_s": 1e9}]}, "for 1 to 100000 commands in duration_s"),
        ({"runs": [{"name": "a", "largest": [1, 1, 1], "duration_s": 1}]}, "for 1 to 100000 commands in duration_s"),
    ],
)  # fmt: skip
def test_refusals(changes: dict[str, Any], says: str) -> None:
    with pytest.raises(SettingError) as refusal:
        specified(**changes)
    assert str(refusal.value).startswith("plain.toml: ") and says in str(refusal.value)
