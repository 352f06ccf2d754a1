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
from automarine_cli.runs.half_turn import half_turns
from automarine_cli.runs.load import load_runs
from automarine_cli.simulation.campaign import gzip_bytes, make_campaign
from automarine_cli.simulation.specification import Specification


def test_noise_is_white_and_as_large_as_asked() -> None:
    settings = {"scatter": {"start_heading_deg": 180.0}, "runs": [{"kind": "rest", "duration_s": 600}]}
    (made,) = make_campaign(pool_specification(noise_deg=1.5, **settings), 2)
    off = made.columns["heading_deg"] - 180.0
    assert off.std() == pytest.approx(1.5, rel=4 / np.sqrt(2 * len(off)))
    assert abs(np.corrcoef(off[1:], off[:-1])[0, 1]) < 4 / np.sqrt(len(off))


@pytest.mark.parametrize(("wrap", "low", "high"), [("0..360", 0, 360), ("-180..180", -180, 180), ("none", -1e6, 1e6)])
def test_quantised_and_wrapped(wrap: str, low: float, high: float) -> None:
    logger = {"quantisation_deg": 0.5, "wrap": wrap}
    for made in make_campaign(pool_specification(moments=[1.0, -1.0], logger=logger), 3):
        degrees = made.columns["heading_deg"]
        np.testing.assert_array_equal(degrees, np.round(degrees * 2) / 2)
        assert degrees.min() >= low
        assert degrees.max() < high
    whole = pool_specification(moments=[1.0, -1.0], logger={"wrap": wrap})
    unwrapped = pool_specification(moments=[1.0, -1.0], logger={"wrap": "none"})
    for one, other in zip(make_campaign(whole, 3), make_campaign(unwrapped, 3)):
        turns = (one.columns["heading_deg"] - other.columns["heading_deg"]) / 360
        np.testing.assert_allclose(turns, np.round(turns), atol=1e-5)


def test_lost_samples_glitches_and_jitter_are_counted() -> None:
    quiet = make_campaign(pool_specification(), 4)
    logger = {"dropout": 0.1, "glitch": 0.03, "glitch_deg": 120.0}
    found = make_campaign(pool_specification(logger=logger), 4)
    whole = sum(made.plan.samples for made in found)
    lost = sum(made.lost for made in found)
    assert lost == whole - sum(len(made.columns["time_s"]) for made in found)
    assert lost / whole == pytest.approx(0.1, abs=4 * np.sqrt(0.09 / whole))
    glitches = 0
    for made, clean in zip(found, quiet):
        kept = np.isin(clean.columns["time_s"], made.columns["time_s"])
        off = (made.columns["heading_deg"] - clean.columns["heading_deg"][kept] + 180) % 360 - 180
        assert set(np.round(np.abs(off), 2)) <= {0.0, 120.0}  # losses change no other number
        assert np.count_nonzero(np.abs(off) > 1) == made.glitches
        glitches += made.glitches
    assert glitches / (whole - lost) == pytest.approx(0.03, abs=0.01)

    uneven = make_campaign(pool_specification(logger={"clock_jitter_s": 0.01}), 4)
    steps = np.concatenate([np.diff(made.columns["time_s"]) for made in uneven])
    assert steps.min() > 0
    assert steps.std() == pytest.approx(0.01 * np.sqrt(2), rel=0.05)
    assert steps.mean() == pytest.approx(0.1, rel=1e-3)


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


def test_files_read_back_as_the_runs_made_in_memory(tmp_path: Path) -> None:
    specification = formats(clock_jitter_s=0.01, dropout=0.02, glitch=0.01, rate_noise_deg_s=0.3)
    simulate(specification, out=tmp_path / "c", seed=5)
    loaded = {run.name: run for run in load_runs([tmp_path / "c" / "steps"], dof=YAW).runs}
    made = make_runs(specification, 5)
    assert sorted(loaded) == sorted(run.name for run in made)
    for run in made:
        read = loaded[run.name]
        for one, other in (
            (run.time, read.time),
            (run.position, read.position),
            (run.command, read.command),
            (run.extras["yaw_rate"], read.extras["yaw_rate"]),
        ):
            np.testing.assert_array_equal(one, other)
        assert run.counts == read.counts


def test_same_seed_same_bytes(tmp_path: Path) -> None:
    for name in ("one", "two"):
        simulate(formats(), out=tmp_path / name, jobs=1 if name == "one" else 2)
    files = sorted(path.relative_to(tmp_path / "one") for path in (tmp_path / "one").rglob("*.*"))
    assert len(files) == 12
    for file in files:
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes(), file
    simulate(formats(), out=tmp_path / "other", seed=1)
    assert (tmp_path / "one/steps/tau_+0.9.parquet").read_bytes() != (
        tmp_path / "other/steps/tau_+0.9.parquet"
    ).read_bytes()


def test_every_file_says_that_it_is_simulated(tmp_path: Path) -> None:
    simulate(formats(), out=tmp_path / "c", seed=5)
    says = "Simulated by automarine from specification, seed 5: no measurement."
    for path in sorted((tmp_path / "c").rglob("*")):
        if path.suffix == ".csv":
            assert path.read_text().splitlines()[0] == f"# {says}"
        elif path.suffix == ".gz":
            assert gzip.decompress(path.read_bytes()).decode().splitlines()[0] == f"# {says}"
        elif path.suffix == ".parquet":
            assert pq.read_schema(path).metadata[b"comment"].decode() == says
    table = read_log(find_logs([tmp_path / "c/steps/tau_+0.7.csv.gz"])[0], dof=YAW)
    assert table.names == ("time_s", "heading_deg", "tau")


def test_newton_metres_are_named_so(tmp_path: Path) -> None:
    vehicle = {"I_r": 20.0, "k_rr": 15.0, "moment_unit": "N m"}
    simulate(pool_specification(vehicle=vehicle, moments=[5.0]), out=tmp_path / "c")
    assert {run.moment_unit for run in load_runs([tmp_path / "c"], dof=YAW).runs} == {"N m"}


@pytest.mark.parametrize(
    ("fault", "why"),
    [("never-moves", "never moved"), ("stuck-compass", "stuck"), ("ends-early", "ended before steady")],
)
def test_faulty_runs_are_set_aside(tmp_path: Path, fault: str, why: str) -> None:
    runs = [
        {"kind": "step", "moments": [0.6, -0.6], "turn_deg": 220},
        {"kind": "step", "moments": [0.8, -0.8], "turn_deg": 220, "suffix": "bad", "fault": fault},
    ]
    simulate(pool_specification(runs=runs), out=tmp_path / "c")
    loaded = load_runs([tmp_path / "c"], dof=YAW)
    good, aside = half_turns(loaded.runs)
    assert [turn.name for turn in good] == ["tau_+0.6", "tau_-0.6"]
    reasons = {one.run: one.why for one in (*loaded.set_aside, *aside)}
    assert set(reasons) == {"tau_+0.8_bad", "tau_-0.8_bad"}
    assert all(why in reason for reason in reasons.values()), reasons


def test_bollard_test_is_the_square_law_with_noise(tmp_path: Path) -> None:
    bollard = {
        "a_f": 2e-4, "a_b": 1e-4, "levels": {"from": -150, "to": 150, "step": 10}, "repeats": 20,
        "noise_N": 0.2, "thrusters_per_test": 2,
    }  # fmt: skip
    simulate(pool_specification(runs=[], bollard=bollard), out=tmp_path / "c")
    table = read_log(find_logs([tmp_path / "c/thrusters/bollard.csv"])[0], dof=YAW)
    n, force = table.columns["n"], table.columns["force"]
    assert (len(n), len(set(n))) == (600, 30)
    off = force - 2 * np.where(n > 0, 2e-4, -1e-4) * n**2
    assert off.std() == pytest.approx(0.2, rel=0.12)
    assert abs(off.mean()) < 4 * 0.2 / np.sqrt(len(n))
    assert np.any(np.diff(n) < 0)


def test_stored_gzip_is_read_by_gzip() -> None:
    for size in (0, 1, 65535, 65536, 200_000):
        data = bytes(i % 251 for i in range(size))
        assert gzip.decompress(gzip_bytes(data)) == data
