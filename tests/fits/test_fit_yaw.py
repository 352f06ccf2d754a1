"""`automarine fit-yaw` from logs to files: the contract's names, whole results or none, one sentence for what cannot
be."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner, Result
from made_campaigns import campaign, moving_run
from made_runs import K_RR, written

from automarine_cli.commands import automarine
from automarine_cli.dofs import YAW
from automarine_cli.runs.run import Run

Command = Callable[..., Result]


def write_logs(runs: Sequence[Run], folder: Path, **columns: Any) -> Path:
    """Each run as a CSV of its own."""
    for run in runs:
        written(run, folder / f"{run.name}.csv", **columns)
    return folder


def model_of(out: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((out / "yaw_model.json").read_text())
    return content


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twelve step runs, and one in which the vehicle never moves."""
    runs = campaign(seed=1, gain_scatter=0.02)
    folder = write_logs(runs, tmp_path_factory.mktemp("made") / "logs")
    still = campaign([0.4], seed=2)[0]
    heading = np.zeros(len(still)) + np.radians(np.random.default_rng(0).normal(size=len(still)))
    written(Run("still", "", still.time, heading, still.moment, "nu", dof=YAW), folder / "still.csv")
    return folder


@pytest.fixture(scope="module")
def results(logs: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Result]:
    """Where `fit-yaw` wrote its results, and what it said."""
    out = tmp_path_factory.mktemp("fitted") / "out"
    return out, CliRunner().invoke(automarine, ["fit-yaw", str(logs), "-o", str(out)])


def one_sentence(result: Result, *parts: str) -> None:
    """The command refused with exit status 1, one line that says all of `parts`, and no traceback."""
    assert result.exit_code == 1, result.output
    assert result.exception is None or isinstance(result.exception, SystemExit)
    lines = [line for line in result.stderr.splitlines() if line.startswith("Error: ")]
    assert len(lines) == 1 and "Traceback" not in result.output
    for part in parts:
        assert part in lines[0], lines[0]


def test_table_1_is_that_of_the_points_in_runs_parquet(results: tuple[Path, Result]) -> None:
    """Plain least squares of the points, and without what the noise of the rates adds to the sum of fourth powers."""
    out, model = results[0], model_of(results[0])
    table = pq.read_table(out / "runs.parquet").to_pydict()
    rate, moment = np.radians(table["steady_rate_deg_s"]), np.array(table["moment"])
    found = model["models"]["3"]["velocity_error"]
    plain = np.sum(moment * rate * np.abs(rate)) / np.sum(rate**4)
    assert found["k_rr"]["value"] - found["dilution_taken_off"]["k_rr"] == pytest.approx(plain, rel=1e-9)
    assert model["models"]["3"]["sse"] == pytest.approx(np.sum((moment - plain * rate * np.abs(rate)) ** 2), rel=1e-9)
    noise = np.radians(table["steady_rate_stderr_deg_s"]) ** 2
    squares = np.sum(moment * np.sign(rate) * (rate**2 - noise))
    k_rr = squares / np.sum(rate**4 - 6 * noise * rate**2 + 3 * noise**2)
    assert found["k_rr"]["value"] == pytest.approx(k_rr, rel=1e-9)
    eps = np.radians(np.abs(table["velocity_error_deg"]))
    assert table["I_r_model_3"] == pytest.approx(eps * k_rr / np.log(2), rel=1e-9)


def of_two_units() -> list[Run]:
    return [run.with_moment(run.command, "nu" if i < 6 else "N m") for i, run in enumerate(campaign(seed=1))]


def moved_by(factor: float) -> list[Run]:
    """A campaign whose logs tell so many times the moments that acted."""
    return [run.with_moment(factor * run.command, "nu") for run in campaign(seed=1)]


HALF_TURNS = ("--fit-to", "half-turns")


@pytest.mark.parametrize(
    ("make", "options", "parts"),
    [
        (lambda: campaign(seed=1), ("--tail", "90", "--fit-to", "whole-runs"), ["whole runs have no tails; leave it"]),
        (lambda: [moving_run(seed, length=18.0)[0] for seed in range(2)], ("--tail", "90"), ["too few for Table 1"]),
        (of_two_units, (), ["expected one unit in a campaign", "--columns"]),
        (lambda: moved_by(0.0), (), ["none of 12 runs can be fitted"]),
        (
            lambda: campaign([0.5, -0.5, 0.5, -0.5], seed=1), HALF_TURNS,
            ["4 half-turns at 1 size of moment are usable", "at least 3 at 2 are needed", "--fit-to whole-runs"],
        ),
        (lambda: moved_by(-1.0), HALF_TURNS, ["turned the vehicle", "sign = -1"]),
    ],
)  # fmt: skip
def test_what_cannot_be_fitted_is_refused_in_one_sentence(
    run: Command, tmp_path: Path, make: Callable[[], list[Run]], options: tuple[str, ...], parts: list[str]
) -> None:
    for each in make():
        path = written(each, tmp_path / "logs" / f"{each.name}.csv")
        if each.moment_unit == "N m":
            path.write_text(path.read_text().replace("tau", "tau_Nm", 1))
    one_sentence(run("fit-yaw", tmp_path / "logs", *options), *parts)


@pytest.mark.parametrize(
    "moments", [pytest.param([0.5, -0.5, 0.5, -0.5], marks=pytest.mark.slow), [0.2, 0.4, 0.6, 0.8, 1.0]]
)
def test_drag_of_one_size_of_moment_or_side_is_the_truth(run: Command, tmp_path: Path, moments: list[float]) -> None:
    """One size tells inertia and one drag, from how the turn begins and how it ends; then runs are fitted whole."""
    folder = write_logs(campaign(moments, seed=1), tmp_path / "logs")
    result = run("fit-yaw", folder, "-o", tmp_path / "out")
    assert result.exit_code == 0, result.output
    model = model_of(tmp_path / "out")
    entry = model["models"]["3"]
    assert abs(entry["k_rr"]["value"] - K_RR) < 4 * entry["k_rr"]["stderr"]
    if len(moments) == 4:
        assert entry["velocity_error"] is None and "whole runs" in entry["why"]
    else:
        (warning,) = (one for one in model["warnings"] if one.startswith("Every run turns to starboard"))
        assert f"Warning: {warning}" in result.stdout.replace("\n", " ")
        assert warning in (tmp_path / "out" / "table1.md").read_text()
