"""Logs of surge and heave become runs: positions that never wrap, forces of thrusters, rests under a constant force."""

from pathlib import Path

import numpy as np
import pytest
from identified import identify
from specified import make_runs

from automarine_cli.dofs import HEAVE, SURGE, YAW
from automarine_cli.errors import ModelError, RunError, SettingError
from automarine_cli.logs import ColumnMap
from automarine_cli.runs.half_turn import find_steps, half_turns, released
from automarine_cli.runs.load import find_glitches, load_runs, unwrap
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
