"""`sample_runs` is what its specification makes, anywhere; and what its README says it is."""

import io
import os
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from repository import ROOT, SAMPLE_RUNS
from specified import read_specification

from automarine_cli.simulation.campaign import make_campaign

FORCES = ("surge", "heave")
PRODUCTS = {
    "campaign": ("thrusters", "steps", "validation", "truth.json"),
    **{name: (name, f"{name}_validation", "truth.json") for name in (*FORCES, "sway", "roll", "planar")},
    **{name: (name, "truth.json") for name in ("hidden_one", "hidden_two", *(f"hidden_{name}" for name in FORCES))},
}
"""What each specification makes."""
MAKE = """
import sys
from pathlib import Path
from automarine_cli import simulate
for path in sys.argv[1:]:
    simulate(path, out=Path(path).stem)
"""


def stored_as(specification: str, name: str) -> str:
    """Name in sample_runs of what a specification makes: the truth of other campaigns lies beside their logs."""
    return f"{specification}.{name}" if specification != "campaign" and name == "truth.json" else name


def files(folder: Path, names: Iterable[str]) -> list[tuple[str, bytes]]:
    """Files with these names, or in folders with these names: where they lie in them, and their bytes."""
    tops = [folder / name for name in names]
    inside = [(path, top) for top in tops for path in [top, *sorted(top.rglob("*"))] if path.is_file()]
    return [(path.relative_to(top).as_posix(), path.read_bytes()) for path, top in inside]


def content(name: str, data: bytes) -> object:
    """What must be equal: the columns of Parquet, whose bytes differ between versions of pyarrow; else the bytes."""
    return pq.read_table(io.BytesIO(data)).to_pydict() if name.endswith(".parquet") else data


@pytest.mark.slow
def test_sample_runs_are_made_again(tmp_path: Path) -> None:
    """In a process of its own in another place, one for all specifications."""
    place = {"LC_ALL": "C", "TZ": "Pacific/Auckland", "PYTHONHASHSEED": "7", "PYTHONUTF8": "0"}
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    command = [sys.executable, "-c", MAKE, *(str(SAMPLE_RUNS / f"{name}.toml") for name in PRODUCTS)]
    subprocess.run(command, cwd=tmp_path, env=os.environ | place | {"PYTHONPATH": path}, check=True, timeout=600)
    for specification, names in PRODUCTS.items():
        stored = files(SAMPLE_RUNS, [stored_as(specification, name) for name in names])
        again = files(tmp_path / specification, names)
        assert stored and [name for name, _ in stored] == [name for name, _ in again]
        assert [a for (a, data), (_, new) in zip(stored, again) if content(a, data) != content(a, new)] == []


def test_sample_runs_are_small_and_nothing_else_is_there() -> None:
    products = {stored_as(specification, name) for specification, names in PRODUCTS.items() for name in names}
    listed = {path.name for path in SAMPLE_RUNS.iterdir() if not path.name.startswith(".")}
    others = {
        "README.md",
        "coasts",
        "pool_day.toml",
        "forces.toml",
        "planar_day.toml",
        "planar_bare.json",
        "paper.toml",
        "rudder",
        "zigzags.toml",
        "real_boat",
        "real_boat_validation",
    }
    assert listed == {*others, *(f"{name}.toml" for name in PRODUCTS), *products}
    assert sum(len(data) for _, data in files(SAMPLE_RUNS, products)) < 1_000_000  # three times less than allowed


def test_the_papers_campaign_has_the_papers_residuals() -> None:
    specification = read_specification(SAMPLE_RUNS / "paper.toml")
    errors = []
    for seed in range(6):
        runs = make_campaign(specification, seed)
        assert len(runs) == 44
        moment = np.array([run.plan.moments[0][0] for run in runs])
        turning = moment + [run.added_moment for run in runs]  # equals k r|r| when steady
        slope = moment @ turning / (turning @ turning)
        errors.append(np.sum((moment - slope * turning) ** 2))
    assert np.mean(errors) == pytest.approx(0.82, abs=0.2)  # Table 1 prints 0.80 and 0.83
