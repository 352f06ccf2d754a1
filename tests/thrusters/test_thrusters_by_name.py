"""Several thrusters in one bollard file: a column of names splits it, and says so where nobody asked."""

import json
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

import automarine_cli as am
from automarine_cli.errors import AutomarineError, FitError, LogError
from automarine_cli.logs import ColumnMap, ColumnRule

TRIALS = "time_s,heading_deg,tau,trial\n" + "".join(
    f"{i / 10:g},{0.3 * max(i - 10, 0):.2f},{0.2 * (i > 10):g},{trial}\n" for trial in "abc" for i in range(100)
)
NAMES = tuple(f"T{i}" for i in range(1, 9))
A = 1.0e-4  # N per unit of control squared
UNLIKE = {"T3": 0.5, "T7": 1.3}  # factors on the thrust of some
BY = ColumnMap({"by": ColumnRule("thruster")})
SEEDS = [1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (2, 3))]


def eight(seed: int, unlike: dict[str, float] | None = None) -> str:
    """CSV of n from -400 to 400 for each of eight thrusters, one row a reading."""
    draw = np.random.default_rng(seed)
    lines = ["n,force_N,thruster"]
    for name in NAMES:
        for n in np.arange(-400.0, 401.0, 50.0):
            force = (unlike or {}).get(name, 1.0) * A * n * abs(n) + (draw.normal(0, 0.15) if n else 0.0)
            lines.append(f"{n:g},{force:.4f},{name}")
    return "\n".join(lines) + "\n"


def bollard(folder: Path, text: str) -> Path:
    path = folder / "bollard.csv"
    path.write_text(text)
    return path


@pytest.mark.parametrize("seed", SEEDS)
def test_each_thruster_has_a_map_and_those_that_differ_are_named(tmp_path: Path, seed: int) -> None:
    fit = am.fit_thrusters([bollard(tmp_path, eight(seed, UNLIKE))], columns=BY, out=tmp_path / "out")
    compared = {part["thruster"]: part for part in fit.compared}
    assert tuple(compared) == NAMES and {name for name, part in compared.items() if part["differs"]} == set(UNLIKE)
    for name, part in fit.parts.items():
        for law in part.analysis.square.values():  # few levels: twice half the interval
            assert abs(law.value - A * UNLIKE.get(name, 1.0)) < law.ci95[1] - law.ci95[0]
    assert compared["T3"]["forward"]["differs_percent"] == pytest.approx(-50, abs=3)
    assert not np.any(fit.points.flag != "")
    single, pooled = (json.loads((tmp_path / "out" / f"thrusters{of}.json").read_text()) for of in ("_T3", ""))
    assert single["forward"]["points"] == 8
    assert pooled["forward"]["points"] == 64 and pooled["by"]["column"] == "thruster"
    assert [part["thruster"] for part in pooled["by"]["thrusters"] if part["differs"]] == ["T3", "T7"]
    for name in ("thrusters.json", "thrusters_T3.json"):  # both are maps for every command that takes one
        assert am.export(tmp_path / "out" / name, to="thrusters").text


@pytest.mark.slow
def test_a_mirrored_thruster_is_named_with_the_line_that_mends_it(tmp_path: Path) -> None:
    path = bollard(tmp_path, eight(1, {"T3": -1.0, "T5": -1.0}))
    line = 'force_N = { from = "NAME", sign_from = "n" }'
    with pytest.raises(FitError, match=f"the force of T3, T5 is opposite to its command.*{re.escape(line)}"):
        am.fit_thrusters([path], columns=BY)
    sign = ColumnRule("force_N", sign_from=ColumnRule("n"))
    fit = am.fit_thrusters([path], columns=ColumnMap({**BY.columns, "force_N": sign}))
    assert fit.map.force(100.0) == pytest.approx(A * 100.0**2, rel=0.02)
    assert not any(part["differs"] for part in fit.compared)


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_thrusters_that_are_alike_are_said_to_be(tmp_path: Path, seed: int) -> None:
    fit = am.fit_thrusters([bollard(tmp_path, eight(seed))], columns=BY)
    assert not any(part["differs"] for part in fit.compared)


def test_where_nobody_asked_the_column_is_named_and_no_point_called_faulty(tmp_path: Path) -> None:
    fit = am.fit_thrusters([bollard(tmp_path, eight(1, UNLIKE))])
    assert not np.any(fit.points.flag != "") and not fit.parts
    (note,) = [note for note in fit.notes if "The column thruster names 8 parts (T1, T2, T3, " in note]
    assert 'write by = "thruster" under [columns]' in note
    assert not any("parts" in note for note in am.fit_thrusters([bollard(tmp_path, eight(1))]).notes)


def test_a_column_that_is_not_there_or_not_whole_is_refused(tmp_path: Path) -> None:
    path = bollard(tmp_path, eight(1))
    with pytest.raises(LogError, match="no column 'motor', which the column map names with by; found the columns n, "):
        am.fit_thrusters([path], columns=ColumnMap({"by": ColumnRule("motor")}))
    path.write_text(eight(1).replace(",T4", ",", 1))
    with pytest.raises(LogError, match="row 53, column thruster: nothing named; expected a name in every row"):
        am.fit_thrusters([path], columns=BY)


def test_init_and_check_name_the_columns_of_thrusters_and_runs(tmp_path: Path) -> None:
    bollard(tmp_path, eight(1, {"T3": 0.5}))
    steps = tmp_path / "steps.csv"
    steps.write_text(TRIALS)
    columns = tomllib.loads(am.init(tmp_path, out=tmp_path / "campaign.toml", overwrite=True).text)["columns"]
    assert columns["by"] == "thruster" and columns["run"] == "trial"
    with pytest.raises(AutomarineError, match="The column trial changes there: if it names runs"):
        am.fit_yaw([steps])  # its clock begins anew
    looks = am.check([steps], columns=ColumnMap({"run": ColumnRule("trial")})).runs
    assert [look.run for look in looks] == ["a", "b", "c"]
    steps.write_text(TRIALS.replace("trial", "operator"))
    text = am.init(tmp_path, out=tmp_path / "campaign.toml", overwrite=True).text
    assert "run" not in tomllib.loads(text)["columns"] and '# run = "operator"' in text


@pytest.mark.slow
def test_a_faulty_reading_and_a_missing_direction_are_those_of_their_thruster(tmp_path: Path) -> None:
    """Numbers name thrusters too."""
    lines = eight(1, {"T3": 0.5}).replace(",T", ",").splitlines()
    lines = [line for line in lines if not line.endswith(",8") or line.startswith("0,")]
    lines[next(i for i, line in enumerate(lines) if line.startswith("250,") and line.endswith(",5"))] = "250,0.01,5"
    fit = am.fit_thrusters([bollard(tmp_path, "\n".join(lines) + "\n")], columns=BY)
    assert [fit.place(int(i)) for i in np.flatnonzero(fit.points.flag != "")] == ["bollard.csv, 5"]
    assert list(fit.parts) == [*map(str, range(1, 8))]
    assert fit.without_map["8"] == fit.compared[7]["why"] != ""
