"""`--channels` from the command line to the files, in every motion; logs with a velocity and no position."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from few_candidates import few_candidates
from identified import identify
from made_campaigns import both_ways, campaign

from automarine_cli.dofs import HEAVE, SWAY, Dof
from automarine_cli.logs.columns import names_of
from automarine_cli.models.yaw_model import response
from automarine_cli.pipeline.results_folder import read_manifest
from automarine_cli.planning.campaign import fitting_of
from automarine_cli.planning.candidates import Limits, Logger
from automarine_cli.planning.information import read_prior_results
from automarine_cli.report.fit_report import sentences
from automarine_cli.runs.load import load_runs

Run = Callable[..., Result]
TRANSLATIONS = (HEAVE, SWAY)  # with a constant force and without


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


def written_steps(folder: Path, dof: Dof, sensors: Sequence[str], force: float = 0.0) -> Path:
    """Steps of a translation, logged in metres with these sensors; `force` acts always."""
    folder.mkdir()
    random, names = np.random.default_rng(2), [names_of(dof.command)[0]]
    for i, size in enumerate(side * one for one in (4.0, 8.0, 12.0, 16.0) for side in (1.0, -1.0)):
        time = 0.1 * np.arange(90)
        since = time - 2.0 + 0.1 * random.uniform()
        way, speed = response(since, size + force, 30.0, 0.0, 40.0)
        commanded = np.where(since > 0, size, -force if dof.has_constant else 0.0)
        read = {
            dof.position: 1.5 + way + 0.01 * random.standard_normal(90),
            dof.velocity: speed + 0.01 * random.standard_normal(90) + 0.01 * random.standard_normal(),
        }
        columns = [names_of(one)[0] for one in sensors]
        write(folder / f"step_{i}.csv", ["time_s", *names, *columns], [time, commanded, *(read[s] for s in sensors)])
    return folder


def told(out: Path, name: str) -> dict[str, dict[str, object]]:
    """The channels of a result, by quantity."""
    return {one["quantity"]: one for one in json.loads((out / name).read_text())["channels"]}


def test_results_say_which_sensors_they_rest_on(steps: Path, run: Run, tmp_path: Path) -> None:
    out = tmp_path / "yaw"
    result = run("fit-yaw", steps, "-o", out)
    assert "Sensors that count: heading (noise " in result.stdout and "yaw rate (noise 0." in result.stdout
    channels = told(out, "yaw_model.json")
    assert [one["used"] for one in channels.values()] == [True, True]
    assert channels["yaw_rate"]["noise"]["unit"] == "deg/s"  # type: ignore[index]
    assert channels["yaw_rate"]["noise"]["value"] == pytest.approx(0.3, rel=0.2)  # type: ignore[index]
    assert "channels" not in read_manifest(out / "manifest.json").options
    for command, name in (("validate", "validation.json"), ("diagnose", "diagnosis.json")):
        there = tmp_path / command
        with few_candidates(("dead-band", "bias-moment")):
            result = run(command, steps, "--model", out / "yaw_model.json", "-o", there)
        assert result.exit_code == 0, result.output
        assert "Sensors that count: heading" in result.stdout
        assert set(told(there, name)) == {"heading", "yaw_rate"}
        assert "Sensors that count" in (there / name.replace("json", "md")).read_text()


def test_what_was_asked_is_recorded(steps: Path, run: Run, tmp_path: Path) -> None:
    out = tmp_path / "yaw"
    result = run("fit-yaw", steps, "--channels", "position", "-o", out)
    assert "The yaw rate does not count. It was not asked for (--channels)." in result.stdout
    assert read_manifest(out / "manifest.json").options["channels"] == "position"
    assert told(out, "yaw_model.json")["yaw_rate"]["used"] is False


def test_what_is_no_sensor_is_refused(steps: Path, run: Run) -> None:
    result = run("fit-yaw", steps, "--channels", "gyro")
    assert result.exit_code == 1
    assert "channels is 'gyro'; expected auto, position, all, or some of heading, yaw_rate" in result.stderr


def test_a_campaign_file_says_it_too(steps: Path, run: Run, tmp_path: Path) -> None:
    file = tmp_path / "campaign.toml"
    text = 'schema = "automarine/campaign/1"\n[logs]\nsteps = ["{}"]\n[yaw]\nchannels = "{}"\n'
    file.write_text(text.format(steps, "yaw_rate"))
    with few_candidates(("dead-band", "bias-moment")):
        result = run("run", file, "-o", tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert told(tmp_path / "out" / "yaw", "yaw_model.json")["heading"]["used"] is False
    assert "Sensors that count: yaw rate" in (tmp_path / "out" / "report.md").read_text()
    file.write_text(text.format(steps, "compass"))
    refused = run("run", file, "-o", tmp_path / "none")
    assert refused.exit_code == 1 and "yaw.channels is 'compass'; expected auto" in refused.stderr


def test_a_thruster_map_has_no_such_sensors(run: Run, tmp_path: Path) -> None:
    file = tmp_path / "thrusters.json"
    file.write_text('{"schema": "automarine/thruster-map/1"}')
    result = run("diagnose", file, "--model", file, "--channels", "all")
    assert result.exit_code == 1 and "--channels belongs to a motion; leave it out" in result.stderr


@pytest.mark.parametrize("dof", TRANSLATIONS, ids=lambda dof: dof.name)
def test_translations_use_position_and_speed(dof: Dof, tmp_path: Path) -> None:
    both = load_runs([written_steps(tmp_path / "both", dof, dof.channels)], dof=dof).runs
    fit = identify(both)
    assert fit.channels.names == dof.channels
    assert fit.preferred.mixed.noise_of[dof.velocity] == pytest.approx(0.01, rel=0.15)
    assert fit.preferred.estimates[dof.symbols.inertia].value == pytest.approx(30.0, rel=0.05)
    told = next(line for line in sentences(fit) if line.startswith("Sensors"))
    assert f"{dof.words.position} (noise " in told and f"{dof.words.rate} (noise " in told and " cm/s)" in told


@pytest.mark.parametrize("dof", TRANSLATIONS, ids=lambda dof: dof.name)
def test_a_speed_alone_is_summed_up(dof: Dof, tmp_path: Path) -> None:
    runs = load_runs([written_steps(tmp_path / "speed", dof, [dof.velocity])], dof=dof).runs
    assert all(run.summed_up for run in runs)
    note = f"no {dof.words.position} in the log: the {dof.words.rate} is summed up to trim by and to look at"
    assert note in runs[0].notes and note in runs[0].reading
    fit = identify(runs)
    assert fit.channels.names == (dof.velocity,) and fit.preferred.noise is None
    assert fit.preferred.estimates[dof.symbols.inertia].value == pytest.approx(30.0, rel=0.05)


def test_plans_count_on_a_gyro_that_the_model_rests_on(steps: Path, run: Run, tmp_path: Path) -> None:
    run("fit-yaw", steps, "-o", tmp_path / "both")
    run("fit-yaw", steps, "--channels", "position", "-o", tmp_path / "one")
    both, one = (read_prior_results(tmp_path / name / "yaw_model.json", None) for name in ("both", "one"))
    assert both.rate_noise_deg_s == pytest.approx(0.3, rel=0.2) and one.rate_noise_deg_s is None
    assert fitting_of(one, Limits()).channels is None
    limited = fitting_of(one, Limits(logger=Logger(rate_noise_deg_s=0.5)))
    assert limited.channels == ("heading", "yaw_rate") and limited.rate_noise == np.deg2rad(0.5)
