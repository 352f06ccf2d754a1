"""What the logger does to the truth is counted; files read back as what was made; bytes are the same."""

import gzip
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from specified import make_runs
from tank import pool_specification

from automarine_cli.commands.simulate import simulate
from automarine_cli.dofs import YAW
from automarine_cli.logs import find_logs, read_log
from automarine_cli.runs.load import load_runs
from automarine_cli.simulation.campaign import make_campaign
from automarine_cli.simulation.specification import Specification


def test_noise_is_white_and_as_large_as_asked() -> None:
    settings = {"scatter": {"start_heading_deg": 180.0}, "runs": [{"kind": "sequence", "commands": [[0, 300]]}]}
    (run,) = make_campaign(pool_specification(noise_deg=1.5, **settings), 2)
    off = run.columns["heading_deg"] - 180.0
    assert off.std() == pytest.approx(1.5, rel=4 / np.sqrt(2 * len(off)))
    assert abs(np.corrcoef(off[1:], off[:-1])[0, 1]) < 4 / np.sqrt(len(off))


@pytest.mark.parametrize(("wrap", "low"), [("0..360", 0), ("-180..180", -180)])
def test_wrapped(wrap: str, low: float) -> None:
    wrapped, unwrapped = (
        [run.columns["heading_deg"] for run in make_campaign(pool_specification(moments=[1.0, -1.0], logger=logger), 3)]
        for logger in ({"wrap": wrap}, {"wrap": "none"})
    )
    for inside, degrees in zip(wrapped, unwrapped):
        turns = (inside - degrees) / 360
        np.testing.assert_allclose(turns, np.round(turns), atol=1e-5)
        assert low <= inside.min() and inside.max() < low + 360


def formats(**logger: object) -> Specification:
    """A campaign in every format, with runs together and apart."""
    step = {"kind": "step", "turn_deg": 200, "folder": "steps"}
    return pool_specification(
        runs=[
            step | {"moments": [0.5, -0.5], "repeats": 2},
            step | {"moments": [0.7], "format": "csv.gz"},
            step | {"moments": [0.9], "format": "parquet"},
            step | {"moments": [1.0, -1.0], "format": "parquet", "together": "many"},
            step | {"moments": [1.1, -1.1], "format": "csv", "together": "several"},
            {"kind": "sequence", "commands": [[0.5, 5], [-0.5, 5]], "folder": "steps"},
        ],
        logger=logger,
        bollard={"a_f": 2e-4, "a_b": 1e-4, "levels": [-100, 50.5, 100], "repeats": 2, "noise_N": 0.1},
    )


def test_files_read_back_and_are_the_same_bytes_by_any_jobs(tmp_path: Path) -> None:
    specification = formats(rate_noise_deg_s=0.3)
    first, second, other = (tmp_path / name for name in ("first", "second", "other"))
    for out, seed, jobs in ((first, 5, 1), (second, 5, 2), (other, 6, 1)):
        simulate(specification, out=out, seed=seed, jobs=jobs)
    loaded = {run.name: run for run in load_runs([first / "steps"], dof=YAW).runs}
    runs = make_runs(specification, 5)
    assert sorted(loaded) == sorted(run.name for run in runs)
    for run in runs:
        read = loaded[run.name]
        for field in ("time", "position", "command"):
            np.testing.assert_array_equal(getattr(run, field), getattr(read, field))
        np.testing.assert_array_equal(run.extras["yaw_rate"], read.extras["yaw_rate"])
        assert run.counts == read.counts
    files = sorted(path.relative_to(first) for path in first.rglob("*.*"))
    assert len(files) == 12
    for file in files:
        assert (first / file).read_bytes() == (second / file).read_bytes(), file
    parquet = "steps/tau_+0.9.parquet"
    assert (first / parquet).read_bytes() != (other / parquet).read_bytes()
    says = "Simulated by automarine from specification, seed 5: no measurement."  # in every file
    assert pq.read_schema(first / parquet).metadata[b"comment"].decode() == says
    for path in sorted(first.rglob("*.csv*")):
        data = path.read_bytes()
        text = (gzip.decompress(data) if path.suffix == ".gz" else data).decode()
        assert text.splitlines()[0] == f"# {says}"


def test_bollard_test_is_the_square_law_with_noise(tmp_path: Path) -> None:
    bollard = {
        "a_f": 2e-4, "a_b": 1e-4, "levels": {"from": -150, "to": 150, "step": 10}, "repeats": 20,
        "noise_N": 0.2, "thrusters_per_test": 2,
    }  # fmt: skip
    simulate(pool_specification(runs=[], bollard=bollard), out=tmp_path / "c")
    table = read_log(find_logs([tmp_path / "c/thrusters/bollard.csv"])[0], dof=YAW)
    n, force = table.columns["n"], table.columns["force"]
    assert (len(n), len(set(n))) == (600, 30) and np.any(np.diff(n) < 0)
    off = force - 2 * np.where(n > 0, 2e-4, -1e-4) * n**2
    assert off.std() == pytest.approx(0.2, rel=0.12) and abs(off.mean()) < 4 * 0.2 / np.sqrt(len(n))
