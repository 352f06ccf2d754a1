"""`automarine check`: a mixed folder run by run, what is refused, and real logs of a lake."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import Result
from made_runs import mirrored, step_run, written


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
