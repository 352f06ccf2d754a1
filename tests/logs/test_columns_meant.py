"""What a column is taken for or suggested as: no rate is a heading, and no angle is in a unit that its name denies."""

from pathlib import Path

import numpy as np
import pytest

from automarine_cli.dofs import YAW
from automarine_cli.errors import LogError
from automarine_cli.logs import LogFile, read_log, require_motion
from automarine_cli.logs.columns import likely_canonical, likely_column, read_column_map
from automarine_cli.logs.recognise import Span, recognise


def a_log(path: Path, **columns: float) -> LogFile:
    """A table of twenty rows at 10 Hz."""
    rows = [f"{0.1 * i:.1f}," + ",".join(str(value) for value in columns.values()) for i in range(20)]
    path.write_text("\n".join([f"time_s,{','.join(columns)}", *rows]) + "\n")
    return LogFile(path, path.name, True)


@pytest.mark.parametrize("name", ["yaw_rate_radps", "yaw_speed", "heading_rate", "yaw rate [deg/s]", "yaw_gyro"])
def test_a_rate_is_no_heading(name: str) -> None:
    assert likely_column("heading", [name]) is None
    assert recognise("heading", [name], {name: Span(-1.0, 1.0, 0.01, 0.1)}) is None


def test_a_log_of_a_rate_alone_is_asked_for_the_rate(tmp_path: Path) -> None:
    table = read_log(a_log(tmp_path / "rate.csv", yaw_rate_radps=0.1, tau=0.5), dof=YAW)
    with pytest.raises(LogError, match=r"no yaw rate; .*write yaw_rate_rad_s = \"yaw_rate_radps\" under") as refused:
        require_motion(table)
    assert "heading_deg" not in str(refused.value)
    assert likely_canonical("yaw_rate", "gyro_z_dps_deg") == "yaw_rate_deg_s"


def test_the_usual_word_for_a_command_comes_before_a_speed_without_sign() -> None:
    assert likely_column("n", ["RPM", "Force_kgf", "cmd", "n_rev_s", "force_n"]) == "cmd"
    assert likely_column("n", ["RPM", "n_rev_s"]) == "n_rev_s"
    assert likely_column("force", ["cmd", "mean_force_N"]) == "mean_force_N"
    for name in ("mean_force_N", "total_force_N", "force_n", "Force_N"):
        found = recognise("force", [name], {name: Span(-60.0, 60.0, 1.0, 5.0)})
        assert found is not None and (found.key, found.open) == ("force_N", "")


def test_a_rudder_is_called_one() -> None:
    found = recognise("moment", ["rudder_deg"], {"rudder_deg": Span(-20.0, 20.0, 0.1, 2.0)})
    assert found is not None and found.open.startswith("a rudder acts as a moment up to its scale")
    assert "newton" not in found.open


def test_a_signed_pwm_is_no_microsecond(tmp_path: Path) -> None:
    rows = "\n".join(f"{pwm},{0.001 * pwm * abs(pwm)}" for pwm in range(-255, 256, 15))
    (tmp_path / "cuauv.csv").write_text(f"pwm,force_N\n{rows}\n")
    columns = tmp_path / "map.toml"
    columns.write_text('[columns]\nn = "pwm"\n')
    file = LogFile(tmp_path / "cuauv.csv", "cuauv.csv", True)
    assert read_log(file, read_column_map(columns), dof=YAW).units["n"] == ""
    columns.write_text('[columns]\nn = { from = "pwm", subtract = 1500 }\n')
    assert read_log(file, read_column_map(columns), dof=YAW).units["n"] == "us"  # pulses less their neutral


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ('heading_rad = "heading_deg"', "name says deg, for rad; write { from = \"heading_deg\", unit = \"deg\" }"),
        ('heading_deg = "yaw_rad"', "name says rad, for deg"),
        ('yaw_rate_rad_s = "gyro_deg_s"', 'unit = "deg/s" }'),
    ],
)  # fmt: skip
def test_a_map_does_not_read_degrees_as_radians(tmp_path: Path, line: str, says: str) -> None:
    columns = tmp_path / "map.toml"
    columns.write_text(f"[columns]\n{line}\n")
    with pytest.raises(LogError) as refused:
        read_column_map(columns)
    assert says in str(refused.value)


def test_a_map_that_gives_the_unit_or_the_scale_is_believed(tmp_path: Path) -> None:
    columns = tmp_path / "map.toml"
    for value in ('{ from = "heading_deg", unit = "rad" }', '{ from = "heading_deg", scale = 0.0174533 }'):
        columns.write_text(f"[columns]\nheading_rad = {value}\n")
        assert read_column_map(columns).columns["heading_rad"].source == "heading_deg"
    assert np.isclose(read_column_map(columns).columns["heading_rad"].scale, np.pi / 180, rtol=1e-5)
