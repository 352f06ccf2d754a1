"""Logs -> campaign: what cleaning does and counts, what is set aside (more in broken_logs), what is refused; commands
that do not fit the thruster map: told with the likely cause, or refused where they cannot be of it."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from made_runs import step_run, written

from automarine_cli.dofs import YAW
from automarine_cli.errors import RunError
from automarine_cli.runs import load
from automarine_cli.runs.load import LoadedRuns, load_runs
from automarine_cli.runs.run import CommandRange, Run, command_warnings, misfit_of

Change = Callable[[pd.DataFrame], pd.DataFrame | None]


def loaded(folder: Path, change: Change) -> LoadedRuns:
    """The campaign of one good run and of one whose table was changed, found in a folder."""
    table = pd.read_csv(written(step_run(0.5), folder / "good.csv"))
    changed = change(table)
    (table if changed is None else changed).to_csv(folder / "odd.csv", index=False)
    return load_runs([folder], dof=YAW)


def odd(campaign: LoadedRuns) -> Run:
    return next(run for run in campaign.runs if run.source.endswith("odd.csv"))


def test_a_good_run_comes_back_as_it_was(tmp_path: Path) -> None:
    run = step_run(-0.5)
    campaign = load_runs([written(run, tmp_path / "run.csv", depth_m=run.time * 0 + 2.5)], dof=YAW)
    (back,) = campaign.runs
    assert (back.name, back.source, back.moment_unit) == ("run", "run.csv", "nu")
    np.testing.assert_allclose(back.time, run.time, rtol=1e-15)
    turns = (back.position - run.position) / (2 * np.pi)
    np.testing.assert_allclose(turns, np.round(turns[0]), atol=1e-12)
    np.testing.assert_array_equal(back.command, run.command)
    assert set(back.extras) == {"depth_m"} and set(back.extras["depth_m"]) == {2.5}
    nothing = dict.fromkeys(("missing", "duplicates", "glitches", "gaps", "jumps"), 0)
    assert back.counts == {"rows": len(run), **nothing}
    assert back.notes == () and campaign.set_aside == () and campaign.inputs[0].name == "run.csv"


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_long_run_is_cut_into_pieces_where_it_moves_least(tmp_path: Path, side: float) -> None:
    """Ten minutes become ten pieces; the vehicle stands still for 4 s near each whole minute, and moves elsewhere."""
    time = 0.2 * np.arange(3001)
    turns = np.where(np.abs((time + 33.0) % 60.0 - 30.0) < 2.0, 0.0, side)  # still at 57 s, 117 s, ...
    run = replace(step_run(side), time=time, position=0.2 * np.cumsum(0.3 * turns), moment=0.5 * turns)
    whole = load_runs([written(run, tmp_path / "long.csv")], dof=YAW)
    assert [piece.name for piece in whole.runs] == [f"long.{i}" for i in range(1, 11)] and whole.set_aside == ()
    np.testing.assert_array_equal(np.concatenate([piece.time for piece in whole.runs]), time)
    starts = [piece.time[0] for piece in whole.runs[1:]]
    np.testing.assert_allclose(starts, 57.0 + 60.0 * np.arange(9), atol=2.0)
    assert all("cut into 10 pieces of about 60 s" in piece.notes for piece in whole.runs)
    assert sum(piece.counts["rows"] for piece in whole.runs) == len(time)
    idle = replace(run, moment=np.where(time < 300.0, run.command, 0.0))  # no command acts in half of the pieces
    assert len(load_runs([written(idle, tmp_path / "idle.csv")], dof=YAW).runs) == 1
    for rows, name in ((slice(0, 1190), "short.csv"), (slice(0, 3001, 10), "sparse.csv")):
        part = replace(run, time=time[rows], position=run.position[rows], moment=run.command[rows])
        assert len(load_runs([written(part, tmp_path / name)], dof=YAW).runs) == 1


def test_what_is_dropped_is_counted(tmp_path: Path) -> None:
    def change(table: pd.DataFrame) -> pd.DataFrame:
        table.loc[[5, 6], "heading_deg"] = np.nan
        table.loc[9, "tau"] = np.nan
        table.loc[[12, 40], "time_s"] = table["time_s"].to_numpy()[[11, 39]]
        table.loc[30, "heading_deg"] = 359.0
        table.loc[[60, 61, 70], "heading_deg"] = [1e9, 1e9, -9999.0]  # what a compass says instead of nothing
        return table.drop(index=range(45, 50))

    run = odd(loaded(tmp_path, change))
    expected = {"missing": 3, "duplicates": 2, "glitches": 4, "gaps": 1}
    assert {key: run.counts[key] for key in expected} == expected
    assert len(run) == run.counts["rows"] - 9
    assert np.ptp(run.position) < 1.2 * np.pi
    assert any("1 gap of up to 0.6 s, bridged" in note for note in run.notes)


def test_a_clock_coarser_than_the_log_is_told(tmp_path: Path) -> None:
    run = odd(loaded(tmp_path, lambda table: table.assign(time_s=np.floor(2 * table.time_s) / 2)))
    assert run.sample_period == 0.5
    assert run.notes[0].startswith(f"{87 - len(run)} of 87 stamps repeat the one before")


@pytest.mark.parametrize(
    ("change", "parts"),
    [
        (lambda t: t.rename(columns={"time_s": "time_ms"}), ("units look wrong: 0.0001 s", "name it time_s")),
        (
            lambda t: t.assign(heading_rad=(t.heading_deg + 200) % 360).drop(columns="heading_deg"),
            ("units look wrong: the heading wraps at 360", "name it heading_deg"),
        ),
        (
            lambda t: t.assign(heading_deg=np.nan),
            ("no row has time, heading and command (87 rows lack one)", "columns"),
        ),
    ],
    ids=["seconds called milliseconds", "degrees called radians", "nothing but missing values"],
)
def test_set_aside_with_cause_and_remedy(tmp_path: Path, change: Change, parts: tuple[str, str]) -> None:
    campaign = loaded(tmp_path, change)
    assert [run.name for run in campaign.runs] == ["good"]
    (aside,) = campaign.set_aside
    assert aside.file.endswith("/odd.csv") and aside.run == "odd"
    assert aside.why.startswith(parts[0]) and parts[1] in aside.why


def test_what_one_log_proves_of_a_column_holds_for_those_that_look_alike(tmp_path: Path) -> None:
    """Two logs in degrees under a radian name: one wraps and proves it, the other only spans too much."""
    headings = {}
    for name, moment, wraps in (("a", 0.1, True), ("b", -0.1, False), ("c", 0.12, False)):
        run = step_run(moment)
        heading = np.rad2deg(run.position - run.position[0])
        headings[name] = (heading + 300.0) % 360.0 if wraps else heading
        table = pd.DataFrame({"time_s": run.time, "heading_rad": headings[name], "tau": run.moment})
        table.to_csv(tmp_path / f"{name}.csv", index=False)
    with pytest.raises(RunError, match=r"wraps at 360 where it should at 2 pi .* of 2 other logs looks so too"):
        load_runs([tmp_path], dof=YAW)
    for name in ("b", "c"):  # in radians: what a says is true of a alone
        table = pd.read_csv(tmp_path / f"{name}.csv")
        table["heading_rad"] = np.radians(headings[name]) % (2 * np.pi)
        table.to_csv(tmp_path / f"{name}.csv", index=False)
    assert [aside.run for aside in load_runs([tmp_path], dof=YAW).set_aside] == ["a"]


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
    names = [run.name for run in load_runs([tmp_path], dof=YAW).runs]
    assert names == [f"{tmp_path.name}/x/run", f"{tmp_path.name}/y/run", "other"]
    table = pd.read_csv(tmp_path / "x/run.csv").assign(run="7")
    table.to_csv(tmp_path / "a.csv", index=False)
    table.to_parquet(tmp_path / "a.parquet", index=False)
    runs = load_runs([tmp_path / "a.csv", tmp_path / "a.parquet"], dof=YAW).runs
    assert [run.name for run in runs] == ["a.csv:7", "a.parquet:7"]
    assert all("same name" in run.notes[-1] for run in runs)


def test_the_same_on_one_and_two_jobs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(load, "PARALLEL_FROM_LOGS", 0)
    for i in range(3):
        path = written(replace(step_run(0.5, seed=i), name=f"r{i}"), tmp_path / f"r{i}.csv")
        pd.read_csv(path).to_parquet(path.with_suffix(".parquet"))
    (tmp_path / "bad.csv").write_text("x\n1\n")
    serial, parallel = (load_runs([tmp_path], jobs=jobs, dof=YAW) for jobs in (1, 2))
    assert serial.set_aside == parallel.set_aside and serial.inputs == parallel.inputs
    for a, b in zip(serial.runs, parallel.runs, strict=True):
        assert a.name == b.name
        np.testing.assert_array_equal(a.position, b.position)


# Commands that do not fit the thruster map: told with the likely cause, or refused where they cannot be of it.


def commands(low: float, high: float, of_map: tuple[float, float], usual: float = 0.0, unit: str = "") -> CommandRange:
    return CommandRange(low, high, usual, ("n_port", "n_stbd"), of_map, unit)


def warnings_of(ranges: list[CommandRange]) -> tuple[str, ...]:
    return command_warnings([SimpleNamespace(commanded=part) for part in ranges])  # type: ignore[misc]


@pytest.mark.parametrize(
    ("logged", "words", "impossible"),
    [
        (commands(-1, 1, (-400, 400), unit="us"), "-400 to 400 us: they look normalised (-1 to 1)", True),
        (commands(-0.33, 0.29, (-400, 400)), "scale = 400 }", True),
        (commands(1100, 1900, (-400, 400), 1500), "pulses of which the neutral was not subtracted", True),
        (commands(-100, 100, (-1, 1)), "they look like percent, not the signal of this map", True),
        (commands(-100, 100, (-400, 400)), "they look like percent, or the vehicle was hardly driven", False),
        (commands(-100, 100, (-3000, 3000)), "scale = 30 }", False),
        (commands(0, 1, (-1, 1), 0.5), "mostly 0.5, half the range, a neutral that was not subtracted", False),
        (commands(-500, 450, (-400, 400)), "beyond its ends the thrust is a guess", False),
    ],
)
def test_the_likely_cause_is_told(logged: CommandRange, words: str, impossible: bool) -> None:
    coasting = commands(0, 0, logged.of_map, logged.usual, logged.unit)
    misfit = misfit_of([logged, coasting] if logged.low < 0 else [logged])
    assert misfit is not None and words in misfit.sentence and misfit.impossible is impossible
    if impossible:
        with pytest.raises(RunError) as refused:
            warnings_of([logged])
        assert str(refused.value) == misfit.sentence
    else:
        assert warnings_of([logged])[0].endswith(".")


@pytest.mark.parametrize(
    "fine",
    [
        [commands(-400, 400, (-400, 400))],
        [commands(-120, 100, (-400, 400))],  # a calm day
        [commands(0, 0, (-400, 400)), commands(-200, 200, (-400, 400))],  # one run coasts
        [commands(0, 60, (0, 400), 30)],  # ahead only, as the map
        [commands(0, 0, (-400, 400))],
        [],
    ],
)
def test_what_fits_is_not_told(fine: list[CommandRange]) -> None:
    assert misfit_of(fine) is None
    assert warnings_of(fine) == ()
