"""`automarine check`: a mixed folder, told run by run, as a table and as JSON."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import Result
from made_runs import mirrored, step_run, written
from repository import DATA

from automarine_cli.commands.check import check
from automarine_cli.errors import LogError, RunError
from automarine_cli.logs import ColumnMap, ColumnRule
from automarine_cli.report.sections import sections


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


def test_json(campaign: Path, run: Callable[..., Result]) -> None:
    result = run("check", campaign, "--json")
    assert result.exit_code == 0
    data = json.loads(result.stdout)
    assert (data["schema"], data["logs"]) == ("automarine/check/1", 5)
    assert data["runs"]["used"] == 4
    (aside,) = data["runs"]["set_aside"]
    assert (aside["file"], aside["run"]) == ("pool/d_broken.csv", "d_broken")
    assert aside["why"].startswith("row 3, column heading_deg: found 'x', expected a number.")
    ahead, back, short = data["yaw_runs"]
    assert ahead["rate_hz"] == pytest.approx(10) and ahead["jitter_ms"] == 0
    assert ahead["duration_s"] == pytest.approx(8.6) and ahead["samples"] == 87
    assert ahead["heading_noise_deg"] == pytest.approx(1, rel=0.4)
    assert (ahead["levels"], back["levels"]) == ([0, 0.5], [-0.5, 0])
    assert ahead["columns"] == ["depth_m"] and ahead["moment_unit"] == "nu"
    assert ahead["turns"] == pytest.approx(0.58, abs=0.02)
    for seen, way in ((ahead, 1), (back, -1)):
        turn = seen["half_turn"]
        assert turn == seen["steps"][0] and seen["why"] is None
        assert turn["switch_from_s"] < 100 < turn["switch_to_s"]
        assert turn["cut_by"] == "half a turn" and turn["steady"] and turn["from_rest"]
        assert 165 < way * turn["turned_deg"] <= 180
    assert ahead["half_turn"]["kept_samples"] == back["half_turn"]["kept_samples"]
    assert short["half_turn"] is None and short["why"].startswith("ended before steady: the log ended after ")
    (test,) = data["thruster_tests"]
    assert (test["points"], test["missing"], test["levels"], test["voltages"]) == (6, 1, 3, [12])
    assert (test["lowest_force_N"], test["highest_force_N"]) == (-19.6133, 19.6133)


def test_refused(campaign: Path, run: Callable[..., Result]) -> None:
    result = run("check", campaign / "a_ahead.csv", campaign / "d_broken.csv")
    assert (result.exit_code, result.stdout) == (1, "")
    assert result.stderr.startswith("Error: d_broken.csv, row 3, column heading_deg: found 'x'")
    assert result.stderr.count("\n") == 1
    strict = run("check", campaign, "--strict")
    assert strict.exit_code == 1 and strict.stderr.endswith("(refused because of --strict)\n")
    with pytest.raises(LogError, match="no control signal; found the columns u, force_N"):
        (campaign / "f.csv").write_text("u,force_N\n1,2\n")
        check([campaign / "f.csv"])
    with pytest.raises(RunError, match="no usable run in 1 log: "):
        (campaign / "sub").mkdir()
        (campaign / "d_broken.csv").rename(campaign / "sub/d.csv")
        check([campaign / "sub"])


def test_the_same_on_two_jobs_and_from_anywhere(campaign: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    one = check([campaign])
    monkeypatch.chdir(campaign.parent)
    assert check(["pool"], jobs=2) == one
    monkeypatch.chdir(campaign)
    assert check(["."]).to_json() == one.to_json()


def test_thruster_commands_are_looked_at_as_their_difference(tmp_path: Path) -> None:
    run = step_run(0.5)
    path = written(run, tmp_path / "run.csv", n_port=100 * run.command, n_stbd=-100 * run.command)
    pd.read_csv(path).drop(columns="tau").to_csv(path, index=False)
    (seen,) = check([path]).runs
    assert seen.moment_unit == "n_port - n_stbd" and seen.levels == [0, 100]
    assert seen.half_turn is not None and seen.half_turn[seen.dof.words.force] == 100


def test_what_cleaning_did_is_told(tmp_path: Path) -> None:
    run = step_run(0.5)
    heading = np.rad2deg(run.position) % 360
    heading[30] += 150
    path = written(replace(run), tmp_path / "run.csv", heading_deg=heading)
    result = check([path])
    assert result.runs[0].counts["glitches"] == 1
    assert "run: 1 heading spike dropped" in sections(result).printed[0].to_text()


@pytest.mark.real_data(DATA)
def test_the_lake_runs() -> None:
    """Ten closed-loop runs of a boat at 10 Hz: every one is read, none has a step from rest that serves; the heading of
    run_11 jumps twice in its first seconds, of which too little is left."""
    columns = ColumnMap(
        {
            "heading_deg": ColumnRule("heading_deg", sign=-1),
            "tau_Nm": ColumnRule("tau_N_nominal_Nm", sign=-1),
            "n_port": ColumnRule("port_cmd"),
            "n_stbd": ColumnRule("stbd_cmd"),
        }
    )
    result = check([DATA / "yaw" / "kingfisher_lake"], columns=columns)
    names = [f"run_{i:02d}" for i in (1, 3, 5, 11, 15, 19, 21, 23, 25, 29)]
    assert [run.run for run in result.runs] == [name.replace("11", "11.3") for name in names]
    assert [run.samples for run in result.runs] == [901, 901, 901, 537, 601, 601, 601, 1201, 901, 601]
    assert {round(run.rate_hz, 6) for run in result.runs} == {10.0}
    assert all(run.half_turn is None and run.extent < 0.5 for run in result.runs)
    whole = [run for run in result.runs if "." not in run.run]
    assert all(sum(run.counts.values()) == run.samples for run in whole)
    *pieces, aside = sorted(result.set_aside, key=lambda one: one.run)
    assert [one.run for one in pieces] == ["run_11.1", "run_11.2"]
    assert all("beside a jump of the heading" in one.why for one in pieces)
    assert aside.run == "thrust_curve_static_bollard"
    assert aside.why.startswith("no control signal and force; found the columns command, mean_force_N;")


@pytest.mark.real_data(DATA)
def test_the_thruster_tables() -> None:
    rules = {"n": ColumnRule("cmd"), "force_N": ColumnRule("force_n"), "voltage_V": ColumnRule("nominal_voltage_V")}
    result = check([DATA / "thrusters"], columns=ColumnMap(rules))
    points = {test.run: (test.points, test.levels, test.voltages) for test in result.tests}
    assert points == {
        "kingfisher_heron_bollard_mean": (21, 21, []),
        "t200_br2019_10-20V": (1206, 201, [10, 12, 14, 16, 18, 20]),
        "videoray_m5_nezprop": (41, 41, []),
        "videoray_m5_vrprop": (47, 47, []),
    }
    raw = {"n": ColumnRule("cmd"), "force_N": ColumnRule("force_two_thrusters_n"), "run": ColumnRule("file")}
    series = check([DATA / "thrusters" / "kingfisher_heron_bollard_raw.csv"], columns=ColumnMap(raw)).tests
    assert len(series) == 20 and {(test.points, test.levels) for test in series} == {(1000, 1)}


@pytest.mark.real_data(DATA)
def test_a_lake_run_that_turns_already_is_not_from_rest() -> None:
    """Runs 1, 3, 21 and 29 begin at full moment while the boat still turns the other way."""
    columns = ColumnMap({n: ColumnRule(f, sign=-1) for n, f in
                         (("heading_deg", "heading_deg"), ("tau_Nm", "tau_N_nominal_Nm"))})  # fmt: skip
    runs = check([DATA / "yaw" / "kingfisher_lake"], columns=columns).runs
    moving = [run.run for run in runs if run.why is not None and run.why.startswith("not from rest")]
    assert moving == ["run_01", "run_03", "run_21", "run_29"]


def test_what_runs_share_is_said_once(tmp_path: Path, run: Callable[..., Result]) -> None:
    """Five short runs with one fault each say so in one line; no line of a pipe is longer than a sentence or two."""
    for name in "abcde":
        written(step_run(0.5, length=0.6), tmp_path / f"{name}.csv")
    written(step_run(0.5), tmp_path / "good.csv")
    shown = run("check", tmp_path).stdout.splitlines()
    lines = [line for line in shown if "too short: " in line]
    assert len(lines) == 1 and lines[0].startswith("a, b, c and 2 more: too short: the step of 0.5 nu has 6 samples")
    assert max(map(len, shown)) < 240
