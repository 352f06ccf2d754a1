"""Which motion a log is of, by the columns of the records alone, and what a column is taken for or suggested as."""

from pathlib import Path

import pytest
import reader_contract

from automarine_cli.commands.check import check
from automarine_cli.commands.init import init
from automarine_cli.dofs import DOFS, SURGE, SWAY, YAW, Dof
from automarine_cli.errors import LogError
from automarine_cli.logs import LogFile, read_log, require, require_motion
from automarine_cli.logs.columns import motion_of
from automarine_cli.logs.recognise import Span, recognise

WITH_COMMANDS = [(dof, command) for dof in DOFS.values() for command, _ in dof.columns[dof.command]]


def named(pair: object) -> str:
    return pair.name if isinstance(pair, Dof) else str(pair)


def log(folder: Path, *names: str, samples: int = 60) -> LogFile:
    """A log of these columns after the time: a position that moves on, a command after a second of rest."""
    rows = [f"{i / 10:.3f}," + ",".join(
        f"{max(i / 10 - 1.0, 0.0) if name == names[0] else float(i > 9):.3f}" for name in names
    ) for i in range(samples)]  # fmt: skip
    return reader_contract.log(folder, "\n".join([",".join(("time_s", *names)), *rows, ""]).encode())


@pytest.mark.parametrize("dof", [dof for dof in DOFS.values() if dof.thrusters], ids=named)
def test_thrusters_stand_in_for_a_command(dof: Dof) -> None:
    (position, _), *_ = dof.columns[dof.position]
    assert motion_of([position, *dof.thrusters], []) is dof
    assert motion_of([position], []).position == dof.position


@pytest.mark.parametrize(("dof", "command"), WITH_COMMANDS, ids=named)
def test_motions_that_share_a_position_are_told_apart_by_their_command(tmp_path: Path, dof: Dof, command: str) -> None:
    (position, _), *_ = dof.columns[dof.position]
    assert motion_of([position, command], []) is dof and motion_of([], [position, command]) is dof
    beside = [name for name in ("n_port", "n_stbd", "n_vert") if name not in dof.thrusters]
    assert motion_of([*beside, position, command], []) is dof
    table = read_log(log(tmp_path, position, command), dof=None)
    require_motion(table)
    assert table.dof is dof and set(table.columns) == {"time", dof.position, dof.command}
    assert [run.dof for run in check([tmp_path]).runs] == [dof]


def test_a_log_of_another_motion_is_refused_with_what_is_lacking(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"^log.csv: no sway force; found .*spin; expected force_Y_N or Y\. "):
        require_motion(read_log(log(tmp_path, "distance_m", "spin"), dof=SWAY))
    with pytest.raises(LogError, match="This is a log of sway: give it to automarine fit-sway"):
        require_motion(read_log(log(tmp_path, "distance_m", "Y"), dof=SURGE))


def test_a_campaign_file_has_a_section_of_each_translation(tmp_path: Path) -> None:
    for name, dof in DOFS.items():
        (tmp_path / name).mkdir()
        log(tmp_path / name, dof.columns[dof.position][0][0], dof.columns[dof.command][0][0])
    text = init(tmp_path).text
    for dof in DOFS.values():
        if not dof.angular:
            assert f"\n[{dof.name}] " in text and f'steps = ["{dof.name}"]' in text


def test_a_rudder_stands_in_the_race_of_a_thrust_in_newtons(tmp_path: Path) -> None:
    """Without a rudder, and normalised, these columns of other motions may hold anything."""
    for names, signals in ((("rudder_deg", "force_X_N"), {"force_X"}), (("rudder_deg", "X"), set()),
                           (("tau_Nm", "force_X_N"), set())):  # fmt: skip
        folder = tmp_path / "-".join(names)
        folder.mkdir()
        table = read_log(log(folder, "heading_deg", *names), dof=YAW)
        assert {"force_X"} & table.columns.keys() == signals


def test_what_a_column_is_recognised_as() -> None:
    assert recognise("heading", ["yaw_gyro"], {"yaw_gyro": Span(-1.0, 1.0, 0.01, 0.1)}) is None
    for name in ("mean_force_N", "total_force_N", "force_n", "Force_N"):
        force = recognise("force", [name], {name: Span(-60.0, 60.0, 1.0, 5.0)})
        assert force is not None and (force.key, force.open) == ("force_N", "")
    for name, key in (("rudder_deg", "rudder_deg"), ("rudder_angle_rad", "rudder_rad"), ("Rudder", "rudder_deg")):
        rudder = recognise("rudder", [name], {name: Span(-20.0, 20.0, 0.1, 2.0)})
        assert rudder is not None and rudder.key == key and bool(rudder.open) == (name == "Rudder")
    assert recognise("moment", ["rudder_deg"], {"rudder_deg": Span(-20.0, 20.0, 0.1, 2.0)}) is None


def test_a_column_with_its_sensor_before_its_name_is_asked_about() -> None:
    turning = {
        name: Span(-179.0, 179.0, 0.3, 358.0)
        for name in ("imu.yaw", "attitude/yaw", "magnetic_heading", "heading_setpoint", "yaw_ref", "tank_psi")
    }
    asked = {name: recognise("heading", ["yaw_ref", name], turning) for name in turning}
    assert {name for name, column in asked.items() if column} == {"imu.yaw", "attitude/yaw", "magnetic_heading"}
    assert all(column is None or (column.source == name and column.open) for name, column in asked.items())
    rate = recognise("yaw_rate", ["imu_gyro_z_rad_s"], {"imu_gyro_z_rad_s": Span(-0.5, 0.5, 0.01, 0.1)})
    assert rate is not None and rate.key == "yaw_rate_rad_s" and rate.open


@pytest.mark.parametrize(
    ("quantity", "column", "line"),
    [
        ("heading", "yaw_rad", 'heading_rad = "yaw_rad"'),
        ("time", "time", 'time_s = "time"'),
        ("moment", "tau_N_nominal_Nm", 'tau_Nm = "tau_N_nominal_Nm"'),
        ("n_port", "port_cmd", 'n_port = "port_cmd"'),
    ],
)
def test_a_near_name_is_suggested_not_guessed(tmp_path: Path, quantity: str, column: str, line: str) -> None:
    table = read_log(reader_contract.log(tmp_path, f"{column},depth\n0,1\n".encode()), dof=YAW)
    assert quantity not in table.columns
    with pytest.raises(LogError, match="meant, write") as refused:
        require(table, [quantity])
    assert f"write {line} under [columns]" in str(refused.value)
