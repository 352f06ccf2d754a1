"""Several thrusters in one bollard file: a column of names splits it, and says so where nobody asked."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from made_bollard import NAMES, A, eight

import automarine_cli as am
from automarine_cli.errors import AutomarineError, LogError
from automarine_cli.logs import ColumnMap, ColumnRule
from automarine_cli.report import thruster_tables

TRIALS = "time_s,heading_deg,tau,trial\n" + "".join(
    f"{i / 10:g},{0.3 * max(i - 10, 0):.2f},{0.2 * (i > 10):g},{trial}\n" for trial in "abc" for i in range(100)
)
BY = ColumnMap({"by": ColumnRule("thruster")})
SEEDS = [1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (2, 3))]


def bollard(folder: Path, text: str) -> Path:
    """A bollard file."""
    path = folder / "bollard.csv"
    path.write_text(text)
    return path


@pytest.mark.parametrize("seed", SEEDS)
def test_each_thruster_has_a_map_and_those_that_differ_are_named(tmp_path: Path, seed: int) -> None:
    path = bollard(tmp_path, eight(seed, {"T3": 0.5, "T7": 1.3}))
    fit = am.fit_thrusters([path], columns=BY, out=tmp_path / "out")
    found = {one.name: one for one in fit.compared}
    assert tuple(found) == NAMES and {name for name, one in found.items() if one.differs} == {"T3", "T7"}
    for name, one in found.items():
        true = A * {"T3": 0.5, "T7": 1.3}.get(name, 1.0)
        for law in one.law.values():
            assert abs(law.value - true) < law.ci95[1] - law.ci95[0]  # few levels: twice half the interval
    assert found["T3"].percent["forward"] == pytest.approx(-50, abs=3)
    assert not np.any(fit.points.flag != "")
    own = json.loads((tmp_path / "out" / "thrusters_T3.json").read_text())
    assert own["schema"] == "automarine/thruster-map/1" and own["forward"]["points"] == 8
    pooled = json.loads((tmp_path / "out" / "thrusters.json").read_text())
    assert pooled["forward"]["points"] == 64 and pooled["by"]["column"] == "thruster"
    assert [one["thruster"] for one in pooled["by"]["thrusters"] if one["differs"]] == ["T3", "T7"]
    assert thruster_tables.thrusters(fit).rows[2][-1] == "differs"
    for each in ("thrusters.json", "thrusters_T3.json"):  # both are maps for every command that takes one
        assert am.export(tmp_path / "out" / each, to="thrusters").text


@pytest.mark.parametrize("seed", SEEDS)
def test_thrusters_that_are_alike_are_said_to_be(tmp_path: Path, seed: int) -> None:
    fit = am.fit_thrusters([bollard(tmp_path, eight(seed))], columns=BY)
    assert not any(one.differs for one in fit.compared)


def test_where_nobody_asked_the_column_is_named_and_no_point_called_faulty(tmp_path: Path) -> None:
    fit = am.fit_thrusters([bollard(tmp_path, eight(1, {"T3": 0.5, "T7": 1.3}))])
    assert not np.any(fit.points.flag != "") and not fit.parts
    told = [note for note in fit.notes if "The column thruster names 8 parts (T1, T2, T3, " in note]
    assert len(told) == 1 and 'write by = "thruster" under [columns] in a file and give it with --columns' in told[0]
    assert not any("parts" in note for note in am.fit_thrusters([bollard(tmp_path, eight(1))]).notes)


@pytest.mark.slow
def test_a_faulty_reading_of_one_thruster_is_still_one(tmp_path: Path) -> None:
    lines = eight(1, {"T3": 0.5}).splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith("250,") and line.endswith("T5"))
    lines[at] = "250,0.01,T5"
    fit = am.fit_thrusters([bollard(tmp_path, "\n".join(lines) + "\n")], columns=BY)
    bad = np.flatnonzero(fit.points.flag != "")
    assert [fit.place(int(i)) for i in bad] == ["bollard.csv, T5"]


def test_a_column_that_is_not_there_or_not_whole_is_refused(tmp_path: Path) -> None:
    path = bollard(tmp_path, eight(1))
    with pytest.raises(LogError, match="no column 'motor', which the column map names with by; found the columns n, "):
        am.fit_thrusters([path], columns=ColumnMap({"by": ColumnRule("motor")}))
    path.write_text(eight(1).replace(",T4", ",", 1))
    with pytest.raises(LogError, match="row 53, column thruster: nothing named; expected a name in every row"):
        am.fit_thrusters([path], columns=BY)


def test_init_offers_the_columns_that_name_thrusters_and_runs(tmp_path: Path) -> None:
    bollard(tmp_path, eight(1, {"T3": 0.5}))
    (tmp_path / "steps.csv").write_text(TRIALS)
    columns = tomllib.loads(am.init(tmp_path, out=tmp_path / "campaign.toml", overwrite=True).text)["columns"]
    assert columns["by"] == "thruster" and columns["run"] == "trial"
    (tmp_path / "steps.csv").write_text(TRIALS.replace("trial", "operator"))
    text = am.init(tmp_path, out=tmp_path / "campaign.toml", overwrite=True).text
    assert "run" not in tomllib.loads(text)["columns"] and '# run = "operator"' in text


def test_a_clock_that_begins_anew_names_the_column_of_the_runs(tmp_path: Path) -> None:
    path = tmp_path / "steps.csv"
    path.write_text(TRIALS)
    with pytest.raises(AutomarineError, match=r"The column trial names something else from there on \(a, b, c\): if "):
        am.fit_yaw([path])
    looks = am.check([path], columns=ColumnMap({"run": ColumnRule("trial")})).runs
    assert [one.run for one in looks] == ["a", "b", "c"]


@pytest.mark.slow
def test_numbers_name_thrusters_too_and_one_without_a_direction_says_why(tmp_path: Path) -> None:
    text = eight(1).replace(",T", ",")
    text = "\n".join(line for line in text.splitlines() if not line.endswith(",8") or line.startswith("0,")) + "\n"
    fit = am.fit_thrusters([bollard(tmp_path, text)], columns=BY)
    assert list(fit.parts) == [*map(str, range(1, 9))]
    assert isinstance(fit.parts["8"], str) and fit.compared[7].why
