"""`--channels` from the command line to the files, in every motion; logs with a velocity and no position."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from few_candidates import few_candidates
from made_campaigns import both_ways, campaign

from automarine_cli.pipeline.results_folder import read_manifest
from automarine_cli.planning.campaign import fitting_of
from automarine_cli.planning.candidates import Limits, LoggerLimits
from automarine_cli.planning.information import read_prior_results

Run = Callable[..., Result]


@pytest.fixture(scope="module")
def steps(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight step runs with a compass and a gyro."""
    folder = tmp_path_factory.mktemp("gyro") / "steps"
    folder.mkdir()
    for run in campaign(both_ways((0.3, 0.5, 0.8, 1.1)), seed=7, gyro_deg_s=0.3):
        columns = [run.time, np.rad2deg(run.position), np.rad2deg(run.extras["yaw_rate"]), run.command]
        write(folder / f"{run.name}.csv", ("time_s", "heading_deg", "yaw_rate_deg_s", "tau"), columns)
    return folder


def write(path: Path, names: Sequence[str], columns: Sequence[object]) -> None:
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=",".join(names), comments="", fmt="%.5f")


def channels_in(path: Path) -> dict[str, dict[str, Any]]:
    """The channels of a result file, by quantity."""
    return {channel["quantity"]: channel for channel in json.loads(path.read_text())["channels"]}


def test_results_say_which_sensors_they_rest_on(steps: Path, run: Run, tmp_path: Path) -> None:
    model = tmp_path / "yaw" / "yaw_model.json"
    result = run("fit-yaw", steps, "-o", model.parent)
    assert "Sensors used: heading (noise " in result.stdout and "yaw rate (noise 0." in result.stdout
    channels = channels_in(model)
    assert [channel["used"] for channel in channels.values()] == [True, True]
    assert channels["yaw_rate"]["noise"]["unit"] == "deg/s"
    assert channels["yaw_rate"]["noise"]["value"] == pytest.approx(0.3, rel=0.2)
    assert "channels" not in read_manifest(model.with_name("manifest.json")).options
    for command, name in (("validate", "validation.json"), ("diagnose", "diagnosis.json")):
        with few_candidates(("dead-band", "bias-moment"), curves=False):
            result = run(command, steps, "--model", model, "-o", tmp_path / command)
        assert result.exit_code == 0, result.output
        assert set(channels_in(tmp_path / command / name)) == {"heading", "yaw_rate"}
        assert "Sensors used" in (tmp_path / command / name.replace("json", "md")).read_text()


def test_a_choice_is_recorded_and_plans_count_on_the_model_s_gyro(steps: Path, run: Run, tmp_path: Path) -> None:
    for name, choice in (("both", "all"), ("compass", "position")):
        result = run("fit-yaw", steps, "--channels", choice, "-o", tmp_path / name)
        assert read_manifest(tmp_path / name / "manifest.json").options["channels"] == choice
    assert "The yaw rate does not count. It was not asked for (--channels)." in result.stdout
    assert channels_in(tmp_path / "compass" / "yaw_model.json")["yaw_rate"]["used"] is False
    both, compass = (read_prior_results(tmp_path / name / "yaw_model.json", None) for name in ("both", "compass"))
    assert both.rate_noise_deg_s == pytest.approx(0.3, rel=0.2) and compass.rate_noise_deg_s is None
    assert fitting_of(compass, Limits()).rate_noise is None
    limited = fitting_of(compass, Limits(logger=LoggerLimits(rate_noise_deg_s=0.5)))
    assert limited.rate_noise == np.deg2rad(0.5)
