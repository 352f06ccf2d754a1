"""`slice`: one long log becomes runs by mode, arming or constant command, each naming where it comes from."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner, Result
from repository import SAMPLE_RUNS

import automarine_cli as am
from automarine_cli.commands import automarine
from automarine_cli.dofs import YAW
from automarine_cli.errors import LogError, RunError
from automarine_cli.logs import LogFile, LogTable, find_logs, read_log
from automarine_cli.runs.slices import find_slices


def day(tau: list[tuple[float, int]], **more: list[object]) -> pd.DataFrame:
    """A log at 10 Hz with these (moment, samples) one after the other."""
    moment = np.concatenate([[level] * count for level, count in tau])
    time = 100 + np.arange(len(moment)) / 10
    heading = np.cumsum(moment * 3.0) % 360
    return pd.DataFrame({"time_s": time, "heading_deg": heading.round(4), "tau": moment} | more)


def table(folder: Path, frame: pd.DataFrame) -> LogTable:
    frame.to_csv(folder / "day.csv", index=False)
    return read_log(LogFile(folder / "day.csv", "day.csv", True), dof=YAW)


def slice_(*arguments: object) -> Result:
    """`automarine slice`."""
    return CliRunner().invoke(automarine, ["slice", *map(str, arguments)])


@pytest.mark.parametrize("sign", [1, -1])
def test_constant_moments_bring_the_rest_before_them(tmp_path: Path, sign: int) -> None:
    log = table(tmp_path, day([(0, 50), (sign * 0.5, 40), (0, 10), (-sign * 0.5, 30), (sign * 0.2, 3), (0, 30)]))
    found, passed = find_slices(log, "moment", lead=2.0)
    assert [(one.first, one.stop) for one in found] == [(30, 90), (90, 130)]
    assert [one.state for one in found] == [f"{sign * 0.5:+g}", f"{-sign * 0.5:+g}"]
    assert [(one.first, one.stop) for one in passed] == [(0, 30), (130, 133), (133, 163)]
    assert "shorter than 1 s" in passed[1].why
    assert [one.moving for one in found] == [False, False]


def test_a_command_right_after_another_is_told_apart(tmp_path: Path) -> None:
    """Alone, a run that begins with its moment on may seem to begin at rest."""
    parts = [(0, 30), (0.8, 60), (-0.8, 60), (0, 5), (0.4, 60), (0, 30), (-0.4, 60)]
    table(tmp_path, day(parts))
    made = am.slice_log(tmp_path / "day.csv", by="moment", lead=0.0, out=tmp_path / "out")
    assert [cut.moving for cut in made.cuts] == [False, True, True, False]
    assert [file.partition("/")[0] for file in made.files] == ["runs", "moving", "moving", "runs"]
    assert sorted(path.name for path in (tmp_path / "out/moving").iterdir()) == ["day_2_-0.8.csv", "day_3_+0.4.csv"]
    assert "2 of 4 begin while another command moves" in repr(am.slice_log(tmp_path / "day.csv", by="moment"))


def test_two_thrusters_change_together_or_alone(tmp_path: Path) -> None:
    frame = day([(0.0, 90)]).drop(columns="tau")
    frame["n_port"] = [0.0] * 20 + [0.3] * 70
    frame["n_stbd"] = [0.0] * 20 + [-0.3] * 40 + [0.3] * 30
    found, _ = find_slices(table(tmp_path, frame), "moment", lead=0)
    assert [(one.first, one.stop, one.state) for one in found] == [(20, 60, "+0.3_-0.3"), (60, 90, "+0.3_+0.3")]


def test_modes_and_arming_of_a_table(tmp_path: Path) -> None:
    mode = ["MANUAL"] * 40 + ["STABILIZE"] * 30 + ["MANUAL"] * 30
    armed = [0] * 20 + [1] * 60 + [0] * 20
    log = table(tmp_path, day([(0.4, 100)], mode=mode, armed=armed))
    by_mode, _ = find_slices(log, "mode")
    assert [(one.first, one.stop, one.state) for one in by_mode] == [
        (0, 40, "MANUAL"), (40, 70, "STABILIZE"), (70, 100, "MANUAL"),
    ]  # fmt: skip
    only, passed = find_slices(log, "mode", keep=("manual",))
    assert [one.first for one in only] == [0, 70] and passed[0].why == "mode STABILIZE is not asked for"
    by_arm, passed = find_slices(log, "arm")
    assert [(one.first, one.stop) for one in by_arm] == [(20, 80)]
    assert [one.why for one in passed] == ["not armed"] * 2


def test_a_clock_that_steps_back_and_another_run_end_a_slice(tmp_path: Path) -> None:
    frame = day([(0, 20), (0.5, 60)], run=["a"] * 50 + ["b"] * 30)
    frame.loc[30:, "time_s"] -= 2
    found, _ = find_slices(table(tmp_path, frame), "moment", lead=1, shortest=0.5)
    assert [(one.first, one.stop) for one in found] == [(10, 30), (30, 50), (50, 80)]


def test_the_rest_of_another_run_does_not_come_along(tmp_path: Path) -> None:
    frame = day([(0.5, 20), (0, 20), (0.7, 20)], run=["a"] * 40 + ["b"] * 20)
    found, _ = find_slices(table(tmp_path, frame), "moment")
    assert [(one.first, one.stop) for one in found] == [(0, 20), (40, 60)]


def test_missing_commands_are_held(tmp_path: Path) -> None:
    frame = day([(0.5, 60)])
    frame.loc[:9, "tau"] = np.nan
    frame.loc[30:35, "tau"] = np.nan
    found, passed = find_slices(table(tmp_path, frame), "moment")
    assert [(one.first, one.stop) for one in found] == [(10, 60)]
    assert passed[0].why == "no command known yet"


def test_runs_come_back_as_they_were_in_the_log(tmp_path: Path) -> None:
    source = SAMPLE_RUNS / "validation" / "there_and_back.csv"
    for form in ("csv", "csv.gz", "parquet"):
        out = tmp_path / form
        assert slice_(source, "--by", "moment", "--format", form, "-o", out).exit_code == 0
        whole = read_log(LogFile(source, source.name, True), dof=YAW)
        listed = json.loads((out / "slices.json").read_text())
        assert listed["schema"] == "automarine/slices/1" and len(listed["slices"]) == 4
        for one in listed["slices"]:
            part = read_log(LogFile(out / one["file"], one["file"], True), dof=YAW)
            rows = (whole.rows >= one["rows"][0]) & (whole.rows <= one["rows"][1])
            assert one["source"] == source.name and one["samples"] == len(part) == rows.sum()
            for name, values in part.columns.items():
                np.testing.assert_allclose(values, whole.columns[name][rows], rtol=1e-12)
            assert [one["from_s"], one["to_s"]] == [part.columns["time"][0], part.columns["time"][-1]]
    assert (tmp_path / "csv/runs/there_and_back_1_+0.8.csv").read_text().startswith(
        "# there_and_back.csv, rows 13 to 132, 831.8 to 843.7 s, cut by moment: +0.8\n"
    )  # fmt: skip


def test_every_column_of_the_log_goes_along(tmp_path: Path) -> None:
    odd = {"depth, m": np.linspace(1, 2, 60), "mode": ["A"] * 60, "heading_rad": [0.1] * 60, "run": ["x"] * 60}
    table(tmp_path, day([(0.5, 60)], **odd).drop(columns="heading_deg"))
    assert slice_(tmp_path / "day.csv", "--by", "mode", "-o", tmp_path / "out").exit_code == 0
    (made,) = find_logs([tmp_path / "out/runs"])
    back = read_log(made, dof=YAW)
    assert made.path.name == "day_x_1_A.csv" and back.run is None
    np.testing.assert_array_equal(back.extras["depth, m"], odd["depth, m"])
    np.testing.assert_allclose(back.columns["heading"], 0.1, rtol=1e-9)
    assert back.states["mode"].names == ("A",)


def test_a_log_of_another_motion_is_cut_by_its_force(tmp_path: Path) -> None:
    force = np.array([0.0] * 30 + [4.0] * 40)
    frame = pd.DataFrame({"time_s": np.arange(70) / 10, "depth_m": np.linspace(1, 3, 70), "force_Z_N": force})
    frame.to_csv(tmp_path / "dive.csv", index=False)
    made = am.slice_log(tmp_path / "dive.csv", by="moment", out=tmp_path / "out")
    assert [(cut.rows, cut.state) for cut in made.cuts] == [((12, 71), "+4")]
    (back,) = find_logs([tmp_path / "out/runs"])
    table = read_log(back, dof=None)
    np.testing.assert_array_equal(table.columns["depth"], frame.depth_m[10:])
    np.testing.assert_array_equal(table.columns["force_Z"], force[10:])
    assert back.path.read_text().splitlines()[1] == "time_s,depth_m,force_Z_N"


def test_a_log_that_does_not_tell_is_refused(tmp_path: Path) -> None:
    log = table(tmp_path, day([(0.5, 60)]))
    with pytest.raises(LogError, match=r'no flight mode; found the columns time_s, heading_deg, tau; .* mode = "NAME"'):
        find_slices(log, "mode")
    refused = slice_(tmp_path / "day.csv", "--by", "arm", "-o", tmp_path / "out")
    assert refused.exit_code == 1 and "no arming state" in refused.stderr and not (tmp_path / "out").exists()
    with pytest.raises(RunError, match=r"no run in it, cut by moment: shorter than 100 s"):
        am.slice_log(tmp_path / "day.csv", by="moment", shortest=100.0)
    assert slice_(tmp_path / "day.csv", "--by", "moment", "--keep", "A").exit_code == 2
    (tmp_path / "bad.csv").write_text("x\n1\n")
    mixed = json.loads(slice_(tmp_path, "--by", "moment", "--json").stdout)
    assert mixed["runs"]["used"] == 1 and "no time" in mixed["runs"]["set_aside"][0]["why"]
    assert slice_(tmp_path, "--by", "moment", "--strict").exit_code == 1


def test_slices_are_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    levels = [(sign * size, 90) for size in (0.3, 0.5, 0.8) for sign in (1, -1)]
    table(tmp_path, day([part for level in levels for part in ((0, 30), level)], mode=["M"] * 720))
    monkeypatch.chdir(tmp_path)
    made = am.slice_log("day.csv", by="moment", out="out")
    assert len(made.cuts) == len(made.to_frame()) == 6 and "+0.3" in repr(made)
    looked = am.check("out/runs")
    assert len(looked.runs) == 6 and not looked.set_aside
