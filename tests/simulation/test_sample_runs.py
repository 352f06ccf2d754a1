"""`sample_runs` is what its specification makes, anywhere; and what its README says it is."""

import io
import json
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from repository import ROOT, SAMPLE_RUNS
from specified import read_specification

from automarine_cli.dofs import YAW
from automarine_cli.runs.half_turn import half_turns
from automarine_cli.runs.load import load_runs
from automarine_cli.simulation.campaign import make_campaign

HIDDEN = ("hidden_one", "hidden_two")
FORCES = ("surge", "heave")
MADE = {
    "campaign": ("thrusters", "steps", "validation", "truth.json"),
    **{name: (name, f"{name}_validation", "truth.json") for name in (*FORCES, "sway", "planar")},
    **{name: (name, "truth.json") for name in (*HIDDEN, *(f"hidden_{motion}" for motion in FORCES))},
}
"""What each specification makes."""
MAKE = """
import sys
from pathlib import Path
from automarine_cli import simulate
for given in sys.argv[1:]:
    simulate(given, out=Path(given).stem)
"""
SPECIFICATIONS = {f"{name}.toml" for name in MADE} | {"paper.toml"}


def kept_as(specification: str, name: str) -> str:
    """Name in sample_runs of what a specification makes: the truth of other campaigns lies beside their logs."""
    return f"{specification}.{name}" if specification != "campaign" and name == "truth.json" else name


def files(folder: Path, names: Iterable[str]) -> list[tuple[str, bytes]]:
    """Files with these names, or in folders with these names: where they lie in them, and their bytes."""
    found = []
    for name in names:
        top = folder / name
        inside = [path for path in [top, *sorted(top.rglob("*"))] if path.is_file()]
        found += [(path.relative_to(top).as_posix(), path.read_bytes()) for path in inside]
    return found


def content(name: str, data: bytes) -> object:
    """What must be equal: the columns of Parquet, whose bytes differ between versions of pyarrow; else the bytes."""
    return pq.read_table(io.BytesIO(data)).to_pydict() if name.endswith(".parquet") else data


@pytest.mark.slow
@pytest.mark.parametrize(
    "place",
    [
        {"LC_ALL": "C", "TZ": "Pacific/Auckland", "PYTHONHASHSEED": "7", "PYTHONUTF8": "0"},
        {"LC_ALL": "de_DE.UTF-8", "TZ": "America/St_Johns", "PYTHONHASHSEED": "99"},
    ],
)
def test_sample_runs_are_made_again(tmp_path: Path, place: dict[str, str]) -> None:
    """In a process of its own in another place, one for all specifications."""
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    given = [sys.executable, "-c", MAKE, *(str(SAMPLE_RUNS / f"{name}.toml") for name in MADE)]
    subprocess.run(given, cwd=tmp_path, env=os.environ | place | {"PYTHONPATH": path}, check=True, timeout=600)
    for specification, names in MADE.items():
        kept = files(SAMPLE_RUNS, [kept_as(specification, name) for name in names])
        made = files(tmp_path / specification, names)
        assert kept and [name for name, _ in kept] == [name for name, _ in made]
        assert [one for (one, data), (_, again) in zip(kept, made) if content(one, data) != content(one, again)] == []


def test_sample_runs_are_small_and_nothing_else_is_there() -> None:
    made = {kept_as(specification, name) for specification, names in MADE.items() for name in names}
    listed = {path.name for path in SAMPLE_RUNS.iterdir() if not path.name.startswith(".")}
    others = {"README.md", "pool_day.toml", "forces.toml", "planar_day.toml", "planar_bare.json"}
    assert listed == {*others, *SPECIFICATIONS, *made}
    assert sum(len(data) for _, data in files(SAMPLE_RUNS, made)) < 1_000_000  # three times less than allowed


@pytest.mark.parametrize("name", HIDDEN)
def test_what_is_hidden_is_kept_apart_from_the_logs(name: str) -> None:
    """Logs and nothing else lie in the folder, and no log says what is in it."""
    loaded = load_runs([SAMPLE_RUNS / name], dof=YAW)
    assert (len(loaded.runs), loaded.set_aside) == (23, ())
    specification = read_specification(SAMPLE_RUNS / f"{name}.toml")
    hidden = [effect.name for effect in specification.effects]
    assert len(hidden) == {"hidden_one": 1, "hidden_two": 2}[name]
    for path in (SAMPLE_RUNS / name).iterdir():
        assert path.suffix == ".csv"
        assert not any(effect in path.read_text(encoding="utf-8") for effect in hidden)
    truth = json.loads((SAMPLE_RUNS / f"{name}.truth.json").read_text(encoding="utf-8"))
    assert [effect["name"] for effect in truth["effects"]] == hidden
    kinds = Counter(one["kind"] for one in truth["made"])
    assert kinds == {"step": 12, "coast-down": 4, "reversal": 4, "sequence": 3}
    assert {one["run"] for one in truth["made"]} == {run.name for run in loaded.runs}


def test_they_are_what_the_readme_says() -> None:
    loaded = load_runs([SAMPLE_RUNS / "steps"], dof=YAW)
    good, aside = half_turns(loaded.runs)
    assert loaded.set_aside == ()
    assert len(good) == 48
    assert [(one.file, one.run) for one in aside] == [("steps/tau_-0.6_c.csv", "tau_-0.6_c")]
    assert aside[0].why.startswith("never moved")
    assert {turn.cut_by for turn in good} == {YAW.words.reach}
    moments, counts = np.unique([turn.moment for turn in good], return_counts=True)
    np.testing.assert_allclose(moments, [m / 10 for m in range(-12, 13) if m], atol=1e-12)
    assert set(counts) == {2}
    assert {run.moment_unit for run in loaded.runs} == {"nu"}
    endings = {Path(run.source).suffix for run in loaded.runs}
    assert endings == {".csv", ".gz", ".parquet"}
    assert sum(run.source.endswith("all_runs_at_1.1_and_1.2.parquet") for run in loaded.runs) == 8
    validation = load_runs([SAMPLE_RUNS / "validation"], dof=YAW).runs
    assert len(validation) == 4
    for run in validation:
        assert 40 < run.time[-1] - run.time[0] < 60
        assert run.command.min() < 0 < run.command.max()


def test_the_truth_beside_them_is_theirs() -> None:
    truth = json.loads((SAMPLE_RUNS / "truth.json").read_text(encoding="utf-8"))
    runs = load_runs([SAMPLE_RUNS / "steps", SAMPLE_RUNS / "validation"], dof=YAW).runs
    named = {run.name: run for run in runs}
    assert len(truth["made"]) == len(named) == 53
    for one in truth["made"]:
        run = named[one["run"]]
        assert run.source == one["file"]
        assert len(run) == one["samples"]
        changed = np.flatnonzero(np.diff(run.command))
        for index, command in zip(changed, one["commands"], strict=True):
            assert run.time[index] < command["from_s"] <= run.time[index + 1] + 5e-4
            assert run.command[index + 1] == command["moment"]
        rest = run.position[run.time < one["commands"][0]["from_s"]]
        off = (rest.mean() - one["start_heading_rad"] + np.pi) % (2 * np.pi) - np.pi
        assert abs(off) < np.deg2rad(4.0 / np.sqrt(len(rest)))
    gains = np.log([one["gain"] for one in truth["made"]])
    assert gains.std() == pytest.approx(0.03, rel=0.4)


def test_the_papers_campaign_has_the_papers_residuals() -> None:
    specification = read_specification(SAMPLE_RUNS / "paper.toml")
    errors = []
    for seed in range(6):
        made = make_campaign(specification, seed)
        assert len(made) == 44
        moment = np.array([one.plan.moments[0] for one in made])
        added = np.array([one.drawn.added_moment for one in made])
        turning = moment + added  # equals k r|r| when steady
        slope = moment @ turning / (turning @ turning)
        errors.append(np.sum((moment - slope * turning) ** 2))
    assert np.mean(errors) == pytest.approx(0.82, abs=0.2)  # Table 1 prints 0.80 and 0.83
