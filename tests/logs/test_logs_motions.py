"""Which motion a log is of: by the columns of the records alone."""

from pathlib import Path

import pytest

from automarine_cli.commands.check import check
from automarine_cli.commands.init import init
from automarine_cli.dofs import DOFS, SURGE, SWAY, YAW, Dof
from automarine_cli.errors import LogError
from automarine_cli.logs import LogFile, read_log, require_motion
from automarine_cli.logs.columns import CANONICAL, foreign, likely_column, motion_of

WITH_COMMANDS = [(dof, command) for dof in DOFS.values() for command, _ in dof.columns[dof.command]]


def named(pair: object) -> str:
    return pair.name if isinstance(pair, Dof) else str(pair)


def log(folder: Path, *names: str, samples: int = 60) -> LogFile:
    """A log of these columns after the time: a position that moves on, a command after a second of rest."""
    times = [i / 10 for i in range(samples)]
    moved = {names[0]: [max(time - 1.0, 0.0) for time in times]}
    acting = [float(time > 0.95) for time in times]
    rows = zip(times, *(moved.get(name, acting) for name in names))
    cells = [["time_s", *names], *([f"{value:.3f}" for value in row] for row in rows)]
    path = folder / "log.csv"
    path.write_text("\n".join(map(",".join, cells)) + "\n")
    return LogFile(path, path.name, True)


@pytest.mark.parametrize("dof", DOFS.values(), ids=named)
def test_every_column_of_a_record_is_known(dof: Dof) -> None:
    for quantity in (dof.position, dof.velocity, dof.command):
        assert dof.columns[quantity]
        for name, unit in dof.columns[quantity]:
            canonical = CANONICAL[name]
            assert (canonical.quantity, canonical.unit) == (quantity, unit)
            assert canonical.factor() > 0 and unit in canonical.units()
    assert all(CANONICAL[name].quantity == name for name in dof.thrusters)
    assert len(dof.mounts) == len(dof.sides) == len(dof.thrusters)


@pytest.mark.parametrize(("dof", "command"), WITH_COMMANDS, ids=named)
def test_motions_that_share_a_position_are_told_apart_by_their_command(tmp_path: Path, dof: Dof, command: str) -> None:
    (position, _), *_ = dof.columns[dof.position]
    assert motion_of([position, command], []) is dof and motion_of([], [position, command]) is dof
    beside = [name for name in ("n_port", "n_stbd", "n_vert") if name not in dof.thrusters]
    assert motion_of([*beside, position, command], []) is dof
    table = read_log(log(tmp_path, position, command), dof=None)
    require_motion(table)
    assert table.dof is dof and set(table.columns) == {"time", dof.position, dof.command}
    found = check([tmp_path])
    assert [run.dof for run in found.runs] == [dof]


@pytest.mark.parametrize("dof", [dof for dof in DOFS.values() if dof.thrusters], ids=named)
def test_thrusters_stand_in_for_a_command(dof: Dof) -> None:
    (position, _), *_ = dof.columns[dof.position]
    assert motion_of([position, *dof.thrusters], []) is dof
    assert motion_of([position], []).position == dof.position


def test_a_motion_without_thrusters_is_not_whole_without_its_command(tmp_path: Path) -> None:
    table = read_log(log(tmp_path, "distance_m", "spin"), dof=SWAY)
    with pytest.raises(LogError) as refused:
        require_motion(table)
    assert str(refused.value).startswith(
        "log.csv: no sway force; found the columns time_s, distance_m, spin; expected force_Y_N or Y. "
    )
    with pytest.raises(LogError, match="This is a log of sway: give it to automarine fit-sway"):
        require_motion(read_log(log(tmp_path, "distance_m", "Y"), dof=SURGE))


def test_what_belongs_to_other_motions_keeps_its_name(tmp_path: Path) -> None:
    """Velocities in the plane serve tests of every motion there, everything else is a column of the file's own."""
    file = log(
        tmp_path, "distance_m", "force_X_N", "force_Y_N", "heading_deg", "yaw_rate_deg_s", "sway_m_s", "heave_m_s"
    )
    table = read_log(file, dof=SURGE)
    assert set(table.columns) == {"time", "distance", "force_X", "yaw_rate", "sway"}
    assert set(table.extras) == {"force_Y_N", "heading_deg", "heave_m_s"}
    assert not foreign(YAW) & {YAW.position, YAW.velocity, YAW.command, "surge", "sway"}


def test_what_people_call_things_comes_from_the_records() -> None:
    assert likely_column("force_Y", ["lateral_force", "t"]) == "lateral_force"
    assert likely_column("distance", ["pos_y"]) == "pos_y" and likely_column("distance", ["pos_x"]) == "pos_x"
    assert likely_column("n_port", ["left"]) == "left" and likely_column("heading", ["hdg"]) == "hdg"


def test_a_campaign_file_has_a_section_of_each_translation(tmp_path: Path) -> None:
    for name, dof in DOFS.items():
        (tmp_path / name).mkdir()
        log(tmp_path / name, dof.columns[dof.position][0][0], dof.columns[dof.command][0][0])
    text = init(tmp_path).text
    for dof in DOFS.values():
        if not dof.wraps:
            assert f"\n[{dof.name}] " in text and f'steps = ["{dof.name}"]' in text
    assert text.count("one constant force each: 1 log, 1 run") == len(DOFS) - 1
    assert text.count("one constant moment each: 1 log, 1 run") == 1
