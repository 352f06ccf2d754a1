"""Logs of surge and heave become runs: positions that never wrap, forces of thrusters, rests under a constant force;
and logs of motion in the plane: units, names, positions on the water, what a slow sensor repeats, what is refused."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from identified import identify
from specified import make_runs
from stirred import steps_in_water

from automarine_cli.dofs import HEAVE, SURGE, SWAY, YAW
from automarine_cli.errors import LogError, ModelError, RunError, SettingError
from automarine_cli.logs import ColumnMap
from automarine_cli.logs.columns import read_column_map
from automarine_cli.runs.half_turn import find_steps, half_turns, released, start_at_rest
from automarine_cli.runs.load import EQUATORIAL_RADIUS, find_glitches, load_runs, local_plane, repeats, unwrap
from automarine_cli.runs.run import Run
from automarine_cli.simulation.specification import specification_from
from automarine_cli.thrusters.curves import PowerCurve
from automarine_cli.thrusters.map import ThrusterMap, drive_run_by_thrusters, moment_maker

MAP = ThrusterMap("square", PowerCurve(0.002), PowerCurve(0.001))
HEAVE_SPEC = {
    "schema": "automarine/simulation/1",
    "vehicle": {"motion": "heave", "m_w": 26.0, "Z_ww": 45.0, "constant_force": -2.0, "force_unit": "N"},
    "logger": {"noise_m": 0.01},
}


def log(folder: Path, header: str, *columns: np.ndarray) -> Path:
    """A log file of these columns after `time_s`, ten samples a second."""
    time = np.arange(len(columns[0])) / 10
    rows = "\n".join(",".join(f"{v:.5f}" for v in row) for row in zip(time, *columns))
    path = folder / "log.csv"
    path.write_text(f"time_s,{header}\n{rows}\n")
    return path


def read(path: Path, dof: object = SURGE) -> Run:
    (run,) = load_runs([path], dof=dof).runs  # type: ignore[arg-type]
    return run


def way(samples: int = 100) -> np.ndarray:
    return np.concatenate([np.zeros(20), 0.05 * np.arange(samples - 20)])


def test_a_position_of_many_metres_is_not_wrapped_and_a_turn_in_metres_is_a_spike(tmp_path: Path) -> None:
    distance, force = 8.0 * way(), np.where(np.arange(100) < 20, 0.0, 4.0)
    run = read(log(tmp_path, "distance_m,force_X_N,surge_m_s", distance, force, distance * 0))
    np.testing.assert_allclose(run.position, distance, atol=1e-4)
    assert (run.dof, run.moment_unit) == (SURGE, "N") and set(run.extras) == {"surge"}

    time, distance = np.arange(100) / 10, way()
    distance[50] += 2 * np.pi
    assert np.flatnonzero(find_glitches(time, distance, SURGE)).tolist() == [50]
    np.testing.assert_array_equal(unwrap(time, distance, np.array([40]), SURGE)[0], distance)


@pytest.mark.parametrize(("dof", "header", "force"), [
    (SURGE, "distance_m,n_port,n_stbd", 0.002 * 60**2 - 0.001 * 20**2), (HEAVE, "depth_m,n_vert", 0.002 * 60**2),
])  # fmt: skip
def test_thrusters_push_together(tmp_path: Path, dof: object, header: str, force: float) -> None:
    commands = [np.full(100, 60.0), np.full(100, -20.0)][: header.count("n_")]
    run = read(log(tmp_path, header, way(), *commands), dof)
    assert run.moment is None
    driven = drive_run_by_thrusters(run, MAP, 1.0)
    assert driven.moment_unit == "N" and np.allclose(driven.command, force)
    bare = Run("a", "b", run.time, run.position, None, "", dof=run.dof)
    with pytest.raises(RunError, match="no thruster command"):
        drive_run_by_thrusters(bare, MAP, 1.0)
    assert moment_maker(MAP, None, ColumnMap(), SURGE) is not None
    with pytest.raises(SettingError, match="--arm is of yaw"):
        moment_maker(MAP, 0.1, ColumnMap(), HEAVE)
    with pytest.raises(SettingError, match="only with the thrusters' lever arm; give --arm METRES"):
        moment_maker(MAP, None, ColumnMap(), YAW)
    sides = {"n_port": way(), "n_stbd": way()}
    with pytest.raises(ModelError, match=r"^a, run 'b': the arm of a thruster is 0\.0; expected a positive length"):
        drive_run_by_thrusters(Run("b", "a", run.time, way(), None, "", sides, dof=YAW), MAP, 0.0)


def test_a_speed_alone_is_summed_up_to_trim_by(tmp_path: Path) -> None:
    """Less what it reads at rest: 0.1 m/s here."""
    pushed = np.maximum(np.arange(100) / 10 - 2.0, 0.0)
    run = read(log(tmp_path, "force_X_N,surge_m_s", np.where(np.arange(100) < 20, 0.0, 4.0), 0.1 + 0.5 * pushed))
    assert run.summed_up and any(f"the {SURGE.words.rate} is summed up to trim by" in note for note in run.notes)
    np.testing.assert_allclose(run.position - run.position[20], 0.25 * pushed**2, atol=0.02)


def test_a_position_under_another_name_is_pointed_at(tmp_path: Path) -> None:
    """It was passed over, and the velocity taken alone."""
    moving = 0.1 * np.arange(100)
    run = read(log(tmp_path, "force_X_N,surge_m_s,dist", np.where(moving < 2, 0.0, 4.0), moving, 0.5 * moving**2))
    plain = read(log(tmp_path, "force_X_N,surge_m_s", np.where(moving < 2, 0.0, 4.0), moving))
    assert run.summed_up and 'write distance_m = "dist" under [columns]' in run.notes[-1]
    assert "[columns]" not in plain.notes[-1]


@pytest.mark.parametrize(("change", "why"), [
    ({"motion": "list"}, 'vehicle.motion: found "list", expected yaw or surge or heave or sway'),
    ({"half_difference": 60.0}, "half_difference is not below Z_ww"),
    ({"k_rr": 1.0}, 'vehicle: unknown key "k_rr"; did you mean "Z_ww"?'),
])  # fmt: skip
def test_specifications_are_refused_in_the_words_of_their_motion(change: dict[str, object], why: str) -> None:
    vehicle = {**HEAVE_SPEC["vehicle"], **change}  # type: ignore[dict-item]
    with pytest.raises(SettingError) as problem:
        specification_from({**HEAVE_SPEC, "vehicle": vehicle, "runs": [{"kind": "step", "forces": [12.0]}]})
    assert why in str(problem.value)


def made(commands: list[list[float]], **campaign: object) -> Run:
    group = {"kind": "sequence", "commands": commands}
    spec = {**HEAVE_SPEC, "runs": [group], "campaign": {"rest_before_s": 2.0, **campaign}}
    (run,) = make_runs(specification_from(spec))
    return run


def test_a_step_from_a_hover_starts_from_rest() -> None:
    """The command that balances the buoyancy is a rest, though it is not zero."""
    run = made([[2.0, 4.0], [15.0, 5.0]])
    (turn,), aside = half_turns([run])
    assert aside == () and turn.moment == 15.0
    assert turn.step.rest is not None and turn.step.rest.stop - turn.step.rest.start > 30


def test_who_is_let_go_and_rises_does_not_start_from_rest() -> None:
    run = made([[0.0, 4.0], [15.0, 5.0]], held=False)
    assert released(run) == 0 and not find_steps(run)[0].from_rest
    held = made([[15.0, 5.0]])
    assert released(held) == 20 and find_steps(held)[0].from_rest


def test_a_controller_that_begins_at_its_limit_holds_nothing() -> None:
    """Too short to show a motion, such a stretch was a rest, and the inertia too small beside a tight interval."""
    run = made([[-10.0, 0.4], [10.0, 3.0], [-5.0, 3.0]], rest_before_s=0.0, held=False)
    noisy = [
        replace(run, position=run.position + 0.01 * np.random.default_rng(seed).standard_normal(len(run)))
        for seed in range(20)
    ]
    assert not start_at_rest(noisy).any() and not any(find_steps(each)[1].from_rest for each in noisy)


def test_rests_together_show_a_push_that_none_shows_alone() -> None:
    still, biased, pushed = (steps_in_water(seed=2, **more) for more in ({}, {"gyro_bias": 0.02}, {"constant": 0.08}))
    assert start_at_rest(still).all() and start_at_rest(biased).all()
    assert not start_at_rest(pushed).any() and any(start_at_rest([run]).any() for run in pushed)


def test_normalised_forces_make_normalised_results(tmp_path: Path) -> None:
    vehicle = {"motion": "heave", "m_w": 1.3, "Z_ww": 2.25, "constant_force": -0.1}
    spec = {
        **HEAVE_SPEC, "vehicle": vehicle,
        "scatter": {"start_depth_m": [2.5, 2.5, 2.5, 0.2, 0.2, 0.2]},
        "runs": [{"kind": "step", "name": "Z", "forces": [-1.2, -0.8, -0.4, 0.4, 0.8, 1.2], "travel_m": 2.0}],
    }  # fmt: skip
    fit = identify(make_runs(specification_from(spec)))
    assert fit.buoyancy is not None and fit.buoyancy.ballast is None and "unit of the command" in fit.buoyancy.says
    estimates = fit.output_error["3"].estimates
    assert estimates["m_w"].unit == "nu s²/m" and estimates["Z_ww"].unit == "nu s²/m²"
    constant = estimates["constant_force"]
    assert abs(constant.value + 0.1) < 3.0 * constant.stderr < 0.03


# Logs of motion in the plane: units, names, positions on the water, what a slow sensor repeats, what is refused.


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
