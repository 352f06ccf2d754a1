"""`check`: a mixed folder run by run, what is refused. `slice`: one long log becomes runs by mode, arming or constant
command, each naming where it comes from."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import Result
from made_runs import mirrored, step_run, written
from repository import SAMPLE_RUNS

import automarine_cli as am
from automarine_cli.dofs import YAW
from automarine_cli.errors import LogError, RunError
from automarine_cli.logs import LogFile, LogTable, find_logs, read_log
from automarine_cli.report.log_tables import run_pages
from automarine_cli.report.sections import sections
from automarine_cli.runs.slices import find_slices


@pytest.fixture
def campaign(tmp_path: Path) -> Path:
    """A folder with two good runs, a run that is too short, a broken log and a thruster test."""
    folder = tmp_path / "pool"
    written(step_run(0.5), folder / "a_ahead.csv", depth_m=1.0)
    written(mirrored(step_run(0.5)), folder / "b_back.csv")
    written(step_run(0.5, length=1.5), folder / "c_short.csv")
    (folder / "d_broken.csv").write_text("time_s,heading_deg,tau\n0,1,0\n0.1,x,0\n")
    levels = np.repeat([-1.0, 0.0, 1.0], 2)
    table = pd.DataFrame({"n": levels, "force_kgf": 2 * levels, "voltage_V": 12.0})
    table.loc[6] = [0.5, np.nan, 12.0]
    table.to_csv(folder / "e_bollard.csv", index=False)
    return folder


def test_what_is_in_a_folder(campaign: Path, run: Callable[..., Result]) -> None:
    data = json.loads(run("check", campaign, "--json").stdout)
    assert (data["schema"], data["logs"], data["runs"]["used"]) == ("automarine/check/1", 5, 4)
    (aside,) = data["runs"]["set_aside"]
    assert (aside["file"], aside["run"]) == ("pool/d_broken.csv", "d_broken")
    assert aside["why"].startswith("row 3, column heading_deg: found 'x', expected a number.")
    ahead, back, short = data["yaw_runs"]
    assert (ahead["samples"], ahead["jitter_ms"], ahead["columns"], ahead["moment_unit"]) == (87, 0, ["depth_m"], "nu")
    assert ahead["rate_hz"] == pytest.approx(10) and ahead["heading_noise_deg"] == pytest.approx(1, rel=0.4)
    assert (ahead["levels"], back["levels"]) == ([0, 0.5], [-0.5, 0])
    for turning, way in ((ahead, 1), (back, -1)):
        turn = turning["half_turn"]
        assert turn == turning["steps"][0] and turning["why"] is None
        assert turn["switch_from_s"] < 100 < turn["switch_to_s"]
        assert turn["cut_by"] == "half a turn" and turn["steady"] and turn["from_rest"]
        assert 165 < way * turn["turned_deg"] <= 180
    assert ahead["half_turn"]["kept_samples"] == back["half_turn"]["kept_samples"]
    assert short["half_turn"] is None and short["why"].startswith("ended before steady: the log ended after ")
    (test,) = data["thruster_tests"]
    assert (test["points"], test["missing"], test["levels"], test["voltages"]) == (6, 1, 3, [12])
    assert (test["lowest_force_N"], test["highest_force_N"]) == (-19.6133, 19.6133)


def test_what_runs_share_is_said_once(tmp_path: Path, run: Callable[..., Result]) -> None:
    """Five short runs with one fault each say so in one line; no line of a pipe is longer than a sentence or two."""
    for name in "abcde":
        written(step_run(0.5, length=0.6), tmp_path / f"{name}.csv")
    written(step_run(0.5), tmp_path / "good.csv")
    lines = run("check", tmp_path).stdout.splitlines()
    (line,) = (line for line in lines if "too short: " in line)
    assert line.startswith("a, b, c and 2 more: too short: the step of 0.5 nu has 6 samples")
    assert max(map(len, lines)) < 240


# `slice`: one long log becomes runs by mode, arming or constant command, each naming where it comes from.


def day(tau: list[tuple[float, int]], **more: list[object]) -> pd.DataFrame:
    """A log at 10 Hz with these (moment, samples) one after the other."""
    moment = np.concatenate([[level] * count for level, count in tau])
    time = 100 + np.arange(len(moment)) / 10
    heading = np.cumsum(moment * 3.0) % 360
    return pd.DataFrame({"time_s": time, "heading_deg": heading.round(4), "tau": moment} | more)


def table(folder: Path, frame: pd.DataFrame) -> LogTable:
    frame.to_csv(folder / "day.csv", index=False)
    return read_log(LogFile(folder / "day.csv", "day.csv", True), dof=YAW)


def slices(log: LogTable, by: str, **how: object) -> tuple[list[tuple[int, int, str]], list[tuple[int, int, str]]]:
    """What is cut out, by its state, and what is passed over, by its reason."""
    parts = find_slices(log, by, **how)  # type: ignore[arg-type]
    cuts = [(part.first, part.stop, part.state) for part in parts if not part.why]
    return cuts, [(part.first, part.stop, part.why) for part in parts if part.why]


@pytest.mark.parametrize("sign", [1, -1])
def test_constant_moments_bring_the_rest_before_them(tmp_path: Path, sign: int) -> None:
    log = table(tmp_path, day([(0, 50), (sign * 0.5, 40), (0, 10), (-sign * 0.5, 30), (sign * 0.2, 3), (0, 30)]))
    cuts, passed = slices(log, "moment", lead=2.0)
    assert cuts == [(30, 90, f"{sign * 0.5:+g}"), (90, 130, f"{-sign * 0.5:+g}")]
    assert [piece[:2] for piece in passed] == [(0, 30), (130, 133), (133, 163)]
    assert "shorter than 1 s" in passed[1][2]


def test_a_command_right_after_another_is_told_apart(tmp_path: Path) -> None:
    """Alone, a run that begins with its moment on may seem to begin at rest."""
    table(tmp_path, day([(0, 30), (0.8, 60), (-0.8, 60), (0, 5), (0.4, 60), (0, 30), (-0.4, 60)]))
    result = am.slice_log(tmp_path / "day.csv", by="moment", lead=0.0, out=tmp_path / "out")
    assert [cut["moving"] for cut in result.cuts] == [False, True, True, False]
    assert [cut["file"].partition("/")[0] for cut in result.cuts] == ["runs", "moving", "moving", "runs"]
    assert sorted(path.name for path in (tmp_path / "out/moving").iterdir()) == ["day_2_-0.8.csv", "day_3_+0.4.csv"]
    assert "of which 2 begin in motion" in repr(am.slice_log(tmp_path / "day.csv", by="moment"))


def test_modes_and_arming_of_a_table(tmp_path: Path) -> None:
    mode = ["MANUAL"] * 40 + ["STABILIZE"] * 30 + ["MANUAL"] * 30
    log = table(tmp_path, day([(0.4, 100)], mode=mode, armed=[0] * 20 + [1] * 60 + [0] * 20))
    assert slices(log, "mode")[0] == [(0, 40, "MANUAL"), (40, 70, "STABILIZE"), (70, 100, "MANUAL")]
    cuts, passed = slices(log, "mode", keep=("manual",))
    assert [cut[0] for cut in cuts] == [0, 70] and passed[0][2] == "mode STABILIZE is not asked for"
    cuts, passed = slices(log, "arm")
    assert [cut[:2] for cut in cuts] == [(20, 80)] and [piece[2] for piece in passed] == ["not armed"] * 2


def test_a_clock_that_steps_back_another_run_and_missing_commands_end_a_slice(tmp_path: Path) -> None:
    frame = day([(0, 20), (0.5, 60)], run=["a"] * 50 + ["b"] * 30)
    frame.loc[30:, "time_s"] -= 2
    cuts, _ = slices(table(tmp_path, frame), "moment", lead=1, shortest=0.5)
    assert [cut[:2] for cut in cuts] == [(10, 30), (30, 50), (50, 80)]
    frame = day([(0.5, 20), (0, 20), (0.7, 20)], run=["a"] * 40 + ["b"] * 20)
    cuts, _ = slices(table(tmp_path, frame), "moment")
    assert [cut[:2] for cut in cuts] == [(0, 20), (40, 60)]  # the rest of another run does not come along
    frame = day([(0.5, 60)])
    frame.loc[[*range(10), *range(30, 36)], "tau"] = np.nan
    cuts, passed = slices(table(tmp_path, frame), "moment")
    assert [cut[:2] for cut in cuts] == [(10, 60)]  # a command that is missing for a while is held
    assert passed[0][2] == "no command known yet"


@pytest.mark.parametrize("form", ["csv", "csv.gz", "parquet"])
def test_runs_come_back_as_they_were_in_the_log(tmp_path: Path, run: Callable[..., Result], form: str) -> None:
    source = SAMPLE_RUNS / "validation" / "there_and_back.csv"
    assert run("slice", source, "--by", "moment", "--format", form, "-o", tmp_path).exit_code == 0
    log = read_log(LogFile(source, source.name, True), dof=YAW)
    listed = json.loads((tmp_path / "slices.json").read_text())["slices"]
    assert len(listed) == 4
    for piece in listed:
        part = read_log(LogFile(tmp_path / piece["file"], piece["file"], True), dof=YAW)
        rows = (log.rows >= piece["rows"][0]) & (log.rows <= piece["rows"][1])
        assert piece["source"] == source.name and piece["samples"] == len(part) == rows.sum()
        for name, values in part.columns.items():
            np.testing.assert_allclose(values, log.columns[name][rows], rtol=1e-12)
        assert [piece["from_s"], piece["to_s"]] == [part.columns["time"][0], part.columns["time"][-1]]


def test_a_log_that_does_not_tell_is_refused(tmp_path: Path, run: Callable[..., Result]) -> None:
    log = table(tmp_path, day([(0.5, 60)]))
    with pytest.raises(LogError, match=r'no mode; found the columns time_s, heading_deg, tau; .* mode = "NAME"'):
        find_slices(log, "mode")
    refused = run("slice", tmp_path / "day.csv", "--by", "arm", "-o", tmp_path / "out")
    assert refused.exit_code == 1 and "no armed; found" in refused.stderr and not (tmp_path / "out").exists()
    with pytest.raises(RunError, match=r"no run in it, cut by moment: shorter than 100 s"):
        am.slice_log(tmp_path / "day.csv", by="moment", shortest=100.0)
    assert run("slice", tmp_path / "day.csv", "--by", "moment", "--keep", "A").exit_code == 2
    (tmp_path / "bad.csv").write_text("x\n1\n")
    mixed = json.loads(run("slice", tmp_path, "--by", "moment", "--json").stdout)
    assert mixed["runs"]["used"] == 1 and "no time" in mixed["runs"]["set_aside"][0]["why"]
    assert run("slice", tmp_path, "--by", "moment", "--strict").exit_code == 1


def test_every_column_of_the_log_goes_along(tmp_path: Path) -> None:
    odd = {"depth, m": np.linspace(1, 2, 60), "mode": ["A"] * 60, "heading_rad": [0.1] * 60, "run": ["x"] * 60}
    table(tmp_path, day([(0.5, 60)], **odd).drop(columns="heading_deg"))
    am.slice_log(tmp_path / "day.csv", by="mode", out=tmp_path / "out")
    (file,) = find_logs([tmp_path / "out/runs"])
    back = read_log(file, dof=YAW)
    assert file.path.name == "day_x_1_A.csv" and back.run is None
    np.testing.assert_array_equal(back.extras["depth, m"], odd["depth, m"])
    np.testing.assert_allclose(back.columns["heading"], 0.1, rtol=1e-9)
    assert back.labels["mode"].names == ("A",)


def test_of_many_runs_some_are_drawn_and_those_that_cannot_be_fitted_first() -> None:
    """49 steps of which one never moves, and a hundred and fifty of them."""
    seen = am.check(SAMPLE_RUNS / "steps")
    assert len(run_pages(seen.runs)) == 3
    many = replace(seen, runs=(*seen.runs, *seen.runs, *seen.runs))
    drawn = [run for page in run_pages(many.runs).values() for run in page.subjects[0]]
    assert len(drawn) == 100 and [bool(run.why) for run in drawn] == [True] * 3 + [False] * 97
    says = "The figures show 100 runs of a motion, those without a step to fit first."
    assert says in sections(many).printed and says not in sections(seen).printed
