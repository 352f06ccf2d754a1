"""Logs -> campaign: what cleaning does and counts, what is set aside, what is refused."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from made_runs import step_run, written

from automarine_cli.dofs import YAW
from automarine_cli.errors import LogError, RunError
from automarine_cli.logs import ColumnMap, ColumnRule
from automarine_cli.runs import load
from automarine_cli.runs.load import Campaign, load_runs
from automarine_cli.runs.run import Run


def loaded(folder: Path, change: Callable[[pd.DataFrame], pd.DataFrame | None], **kept: bool) -> Campaign:
    """The campaign of one good run and of one whose table was changed, found in a folder."""
    run = step_run(0.5)
    written(run, folder / "good.csv")
    table = pd.read_csv(folder / "good.csv")
    changed = change(table)
    (table if changed is None else changed).to_csv(folder / "odd.csv", index=False)
    return load_runs([folder], dof=YAW, **kept)


def odd(campaign: Campaign) -> Run:
    """The run of odd.csv."""
    return next(run for run in campaign.runs if run.source.endswith("odd.csv"))


def why(campaign: Campaign) -> str:
    """The one reason for which odd.csv was set aside."""
    assert [run.name for run in campaign.runs] == ["good"]
    (aside,) = campaign.set_aside
    assert aside.file.endswith("/odd.csv") and aside.run == "odd"
    return aside.why


def test_a_good_run_comes_back_as_it_was(tmp_path: Path) -> None:
    run = step_run(-0.5)
    campaign = load_runs([written(run, tmp_path / "run.csv", depth_m=run.time * 0 + 2.5)], dof=YAW)
    (found,) = campaign.runs
    assert (found.name, found.source, found.moment_unit) == ("run", "run.csv", "nu")
    np.testing.assert_allclose(found.time, run.time, rtol=1e-15)
    turns = (found.position - run.position) / (2 * np.pi)
    np.testing.assert_allclose(turns, np.round(turns[0]), atol=1e-12)
    np.testing.assert_array_equal(found.command, run.command)
    assert set(found.extras) == {"depth_m"} and set(found.extras["depth_m"]) == {2.5}
    nothing = dict.fromkeys(("missing", "duplicates", "glitches", "gaps", "jumps"), 0)
    assert found.counts == {"rows": len(run), **nothing}
    assert found.notes == () and campaign.set_aside == () and campaign.inputs[0].name == "run.csv"


def test_what_is_dropped_is_counted(tmp_path: Path) -> None:
    def change(table: pd.DataFrame) -> pd.DataFrame:
        table.loc[[5, 6], "heading_deg"] = np.nan
        table.loc[9, "tau"] = np.nan
        table.loc[[12, 40], "time_s"] = table["time_s"].to_numpy()[[11, 39]]
        table.loc[30, "heading_deg"] = 359.0
        return table

    run = odd(loaded(tmp_path, change))
    expected = {"missing": 3, "duplicates": 2, "glitches": 1, "gaps": 0}
    assert {key: run.counts[key] for key in expected} == expected
    assert len(run) == run.counts["rows"] - 6
    assert abs(np.diff(run.position)).max() < np.deg2rad(12)


def test_what_a_compass_says_instead_of_nothing_is_dropped(tmp_path: Path) -> None:
    def change(table: pd.DataFrame) -> None:
        table["heading_deg"] = table["heading_deg"].astype(float)
        table.loc[[20, 21, 50], "heading_deg"] = [1e9, 1e9, -9999.0]

    run = odd(loaded(tmp_path, change))
    assert run.counts["glitches"] == 3 and np.ptp(run.position) < 1.2 * np.pi


def test_a_clock_coarser_than_the_log_is_told(tmp_path: Path) -> None:
    run = odd(loaded(tmp_path, lambda table: table.assign(time_s=np.floor(2 * table.time_s) / 2)))
    assert run.sample_period == 0.5
    assert run.notes == (f"{87 - len(run)} of 87 stamps repeat the one before: the clock is coarser than the log",)


def test_a_short_gap_is_flagged(tmp_path: Path) -> None:
    run = odd(loaded(tmp_path, lambda table: table.drop(index=range(45, 50))))
    assert run.counts["gaps"] == 1
    assert run.notes == ("1 gap of up to 0.6 s, bridged by the rates beside them",)


def test_an_hour_long_gap_splits_the_run(tmp_path: Path) -> None:
    def change(table: pd.DataFrame) -> None:
        table.loc[40:, "time_s"] += 3600.0

    campaign = loaded(tmp_path, change)
    assert [run.name for run in campaign.runs] == ["good", "odd.1", "odd.2"]
    first, second = campaign.runs[1:]
    assert len(first) == 40 and second.time[0] - first.time[-1] > 3600
    note = "split at 1 gap of up to 3.6e+03 s, across which the heading cannot be followed"
    assert first.notes == second.notes == (note,)


REASONS: dict[str, tuple[Callable[[pd.DataFrame], pd.DataFrame | None], str]] = {
    "one row": (
        lambda t: t.head(1),
        "only 1 sample left; at least 8 are needed. Check that the log was not cut short",
    ),
    "constant clock": (
        lambda t: t.assign(time_s=5.0),
        "units look wrong: the clock stands still at 5 s in all 87 rows; expected a rising clock. Look at the "
        "time column, or map another with --columns",
    ),
    "milliseconds called seconds": (
        lambda t: t.assign(time_s=t.time_s * 1000),
        "units look wrong: 100 s between samples. If the clock counts milliseconds or microseconds, "
        "name it time_ms "
        "or time_us, or say so with --columns",
    ),
    "seconds called milliseconds": (
        lambda t: t.rename(columns={"time_s": "time_ms"}),
        "units look wrong: 0.0001 s between samples. If the clock counts seconds, name it time_s, or "
        "say so with "
        "--columns",
    ),
    "radians called degrees": (
        lambda t: t.assign(heading_deg=np.deg2rad((t.heading_deg + 200) % 360)),
        "units look wrong: the heading wraps at 2 pi where it should at 360 degrees. If it is in "
        "radians, name it "
        'heading_rad, or say unit = "rad" with --columns',
    ),
    "degrees called radians": (
        lambda t: t.assign(heading_rad=(t.heading_deg + 200) % 360).drop(columns="heading_deg"),
        "units look wrong: the heading wraps at 360 where it should at 2 pi radians. If it is in "
        "degrees, name it "
        'heading_deg, or say unit = "deg" with --columns',
    ),
    "absurd heading": (
        lambda t: t.assign(heading_deg=t.heading_deg * 1e9),
        "units look wrong: a heading of ",
    ),
    "stuck compass": (
        lambda t: t.assign(heading_deg=123.5),
        "compass stuck: 67 samples of exactly 123.5 degrees while a moment acts. Check the compass and "
        "its cable, or "
        "whether the vehicle was held",
    ),
    "nothing but missing values": (
        lambda t: t.assign(heading_deg=np.nan),
        "no row has time, heading and command (87 rows lack one); check the columns",
    ),
    "clock backwards": (
        lambda t: t.iloc[::-1],
        "row 3, run 'odd': the clock steps back from ",
    ),
    "a column missing": (
        lambda t: t.drop(columns="tau"),
        "no yaw moment; found the columns time_s, heading_deg; expected tau or tau_Nm or both n_port "
        "and n_stbd. ",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("change", "sentence"), REASONS.values(), ids=REASONS.keys())
def test_set_aside_with_this_sentence(
    tmp_path: Path, change: Callable[[pd.DataFrame], pd.DataFrame | None], sentence: str
) -> None:
    found = why(loaded(tmp_path, change))
    assert found == sentence if not sentence.endswith(" ") else found.startswith(sentence)


def test_what_one_log_proves_of_a_column_holds_for_those_that_look_alike(tmp_path: Path) -> None:
    """Two logs in degrees under a radian name: one wraps and proves it, the other only spans too much."""
    for name, moment, wraps in (("a", 0.1, True), ("b", -0.1, False), ("c", 0.12, False)):
        file = written(step_run(moment), tmp_path / f"{name}.csv")
        table = pd.read_csv(file)
        heading = np.degrees(np.unwrap(np.radians(table.pop("heading_deg"))))
        heading -= heading.iloc[0] if hasattr(heading, "iloc") else heading[0]
        table["heading_rad"] = (heading + 300.0) % 360.0 if wraps else heading
        table.to_csv(file, index=False)
    with pytest.raises(RunError, match=r"wraps at 360 where it should at 2 pi .* of 2 other logs looks so too"):
        load_runs([tmp_path], dof=YAW)
    table = pd.read_csv(tmp_path / "c.csv")
    for name in ("b", "c"):  # in radians: what a says is true of a alone
        other = pd.read_csv(tmp_path / f"{name}.csv")
        other["heading_rad"] = np.radians(other["heading_rad"]) % (2 * np.pi)
        other.to_csv(tmp_path / f"{name}.csv", index=False)
    assert [one.run for one in load_runs([tmp_path], dof=YAW).set_aside] == ["a"]


def test_named_and_unreadable_is_refused_but_a_run_that_does_not_serve_is_set_aside(tmp_path: Path) -> None:
    good = written(step_run(0.5), tmp_path / "good.csv")
    table = pd.read_csv(good)
    back, stuck = tmp_path / "back.csv", tmp_path / "stuck.csv"
    table.iloc[::-1].to_csv(back, index=False)
    table.assign(heading_deg=1.0).to_csv(stuck, index=False)
    with pytest.raises(RunError, match=r"^back\.csv, row 3, run 'back': the clock steps back from 1\S+ s to 1\S+ s"):
        load_runs([good, back], dof=YAW)
    campaign = load_runs([good, stuck], dof=YAW)
    assert [run.name for run in campaign.runs] == ["good"] and campaign.set_aside[0].run == "stuck"
    with pytest.raises(RunError, match=r"^stuck\.csv, run 'stuck': compass stuck: .* \(refused because of --strict\)$"):
        load_runs([good, stuck], strict=True, dof=YAW)
    with pytest.raises(RunError, match=r"^no usable run in 1 log: stuck\.csv: compass stuck: "):
        load_runs([stuck], dof=YAW)
    (tmp_path / "text.csv").write_text("time_s,heading_deg,tau\n0,north,0\n")
    with pytest.raises(LogError, match=r"^text\.csv, row 2, column heading_deg: found 'north'"):
        load_runs([good, tmp_path / "text.csv"], dof=YAW)
    assert len(load_runs([tmp_path], dof=YAW).set_aside) == 3


def test_many_runs_in_one_file(tmp_path: Path) -> None:
    """Rows of two runs may even alternate; each keeps its own clock and order."""
    first, second = step_run(0.5, clock=10), step_run(-0.5, clock=500)
    tables = [
        pd.DataFrame({"time_s": r.time, "heading_deg": np.rad2deg(r.position), "tau": r.moment, "run": name})
        for r, name in ((first, "b"), (second, "a"))
    ]
    pd.concat(tables).sort_index(kind="stable").to_parquet(tmp_path / "all.parquet", index=False)
    campaign = load_runs([tmp_path / "all.parquet"], dof=YAW)
    assert [run.name for run in campaign.runs] == ["b", "a"]
    np.testing.assert_array_equal(campaign.runs[1].time, second.time)


def test_runs_of_one_name_are_told_apart(tmp_path: Path) -> None:
    for name in ("x/run.csv", "y/run.csv", "z/other.csv"):
        written(step_run(0.5), tmp_path / name)
    assert [run.name for run in load_runs([tmp_path], dof=YAW).runs] == [
        f"{tmp_path.name}/x/run", f"{tmp_path.name}/y/run", "other"]  # fmt: skip
    table = pd.read_csv(tmp_path / "x/run.csv").assign(run="7")
    table.to_csv(tmp_path / "a.csv", index=False)
    table.to_parquet(tmp_path / "a.parquet", index=False)
    runs = load_runs([tmp_path / "a.csv", tmp_path / "a.parquet"], dof=YAW).runs
    assert [run.name for run in runs] == ["a.csv:7", "a.parquet:7"]
    assert all("same name" in run.notes[-1] for run in runs)


def test_a_campaign_has_one_moment_unit(tmp_path: Path) -> None:
    first = written(step_run(0.5), tmp_path / "a.csv")
    pd.read_csv(first).rename(columns={"tau": "tau_Nm"}).to_csv(tmp_path / "b.csv", index=False)
    with pytest.raises(RunError, match=r"^a\.csv gives its moment in nu, b\.csv in N m; expected one unit"):
        load_runs([first, tmp_path / "b.csv"], dof=YAW)


def test_thruster_commands_instead_of_a_moment(tmp_path: Path) -> None:
    run = step_run(0.5)
    path = written(run, tmp_path / "run.csv", n_port=run.command, n_stbd=-run.command)
    pd.read_csv(path).drop(columns="tau").to_csv(path, index=False)
    (found,) = load_runs([path], dof=YAW).runs
    assert found.moment is None and set(found.extras) == {"n_port", "n_stbd"}
    with pytest.raises(RunError, match=r"give --thrusters MAP\.json and --arm METRES for n_port and n_stbd"):
        _ = found.command


def test_the_same_on_one_and_two_jobs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("automarine_cli.runs.load.PAYS_FROM", 0)
    for i in range(4):
        path = written(replace(step_run(0.5, seed=i), name=f"r{i}"), tmp_path / f"r{i}.csv")
        pd.read_csv(path).to_parquet(path.with_suffix(".parquet"))
    (tmp_path / "bad.csv").write_text("x\n1\n")
    one, two = load_runs([tmp_path], dof=YAW), load_runs([tmp_path], jobs=2, dof=YAW)
    assert one.set_aside == two.set_aside and one.inputs == two.inputs
    for a, b in zip(one.runs, two.runs, strict=True):
        assert a.name == b.name
        np.testing.assert_array_equal(a.position, b.position)


def test_signs_are_mirrored_by_the_column_map(tmp_path: Path) -> None:
    run = step_run(0.5)
    columns = ColumnMap({name: ColumnRule(name, sign=-1) for name in ("heading_deg", "tau")})
    (found,) = load_runs([written(run, tmp_path / "run.csv")], columns, dof=YAW).runs
    np.testing.assert_array_equal(found.command, -run.command)
    np.testing.assert_allclose(np.diff(found.position), -np.diff(run.position), atol=1e-9)


def test_processes_are_started_only_where_they_pay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []
    ordered_map = load.ordered_map

    def noted(read, files, jobs, **how):  # type: ignore[no-untyped-def]
        asked.append(jobs)
        return ordered_map(read, files, 1, **how)

    monkeypatch.setattr(load, "ordered_map", noted)
    written(step_run(0.5), tmp_path / "a.csv")
    load.load_runs([tmp_path], jobs=2, dof=YAW)
    monkeypatch.setattr(load, "PAYS_FROM", 0)
    load.load_runs([tmp_path], jobs=2, dof=YAW)
    load.load_runs([tmp_path], jobs=1, dof=YAW)
    assert asked == [1, 2, 1]
