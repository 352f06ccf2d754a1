"""`automarine validate` from the command line to the files, and everything it refuses."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import Result
from made_runs import written
from made_sequences import model_file, sequence_run

from automarine_cli.commands.validate import validate
from automarine_cli.models.model import Model
from automarine_cli.thrusters.curves import PowerCurve
from automarine_cli.thrusters.map import ThrusterMap

Run = Callable[..., Result]


@pytest.fixture(scope="module")
def pool(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four logs in a folder, one of them broken, two of one name, and a model and a thruster map beside them."""
    folder = tmp_path_factory.mktemp("pool")
    short = (0.6, -0.4)
    written(sequence_run(short, noise_deg=1.0), folder / "logs" / "a.csv")
    written(sequence_run(short, noise_deg=1.0, seed=1), folder / "logs" / "b c" / "a.csv")
    written(sequence_run((-0.8,), rest=0, rate0=0.3, noise_deg=1.0), folder / "logs" / "moving.csv")
    (folder / "logs" / "broken.csv").write_text("time_s,heading_deg,tau\n0,1,0\n0.1,x,0\n")
    model_file(folder / "yaw_model.json")
    thrusters = ThrusterMap("square", PowerCurve(1.0), PowerCurve(1.0))
    (folder / "thrusters.json").write_text(json.dumps(thrusters.to_json()))
    return folder


def test_refusals(pool: Path, run: Run, tmp_path: Path) -> None:
    logs, model, thrusters = pool / "logs", pool / "yaw_model.json", pool / "thrusters.json"

    def refused(*arguments: object) -> str:
        result = run("validate", logs, "--model", *arguments)
        assert (result.exit_code, result.stdout) == (1, "")
        return result.stderr.splitlines()[-1]

    newton = refused(model_file(tmp_path / "newton.json", moment_unit="N m"))
    assert newton.startswith("Error: newton.json was fitted to moments in N m, logs/a.csv gives them in nu; ")
    assert newton.endswith("Give logs in N m, or fit a model to logs in nu")
    wrong = refused(model_file(tmp_path / "wrong.json", preferred="9"))
    assert wrong.startswith('Error: wrong.json: preferred: found "9", expected')
    assert refused(model, "--strict").endswith("(refused because of --strict)")
    none = refused(model, "--thrusters", thrusters, "--arm", 0.4)
    assert none.startswith("Error: no usable run in 4 logs: ") and "no thruster command n_port or n_stbd" in none
    for options in (("--thrusters", thrusters), ("--arm", 0.4)):
        assert run("validate", logs, "--model", model, *options).exit_code == 2
    assert run("validate", logs).exit_code == 2


def test_thruster_commands(pool: Path, run: Run, tmp_path: Path) -> None:
    sequence = sequence_run((0.5, -0.8))
    command = np.sign(sequence.command) * np.sqrt(np.abs(sequence.command))
    path = written(sequence, tmp_path / "log.csv", n_port=command, n_stbd=-command)
    pd.read_csv(path).drop(columns="tau").to_csv(path, index=False)
    model = model_file(tmp_path / "yaw_model.json", moment_unit="N m")
    result = validate([path], model=model, thrusters=pool / "thrusters.json", arm=0.5)  # 0.5 m times twice |n| n N
    np.testing.assert_allclose(result.runs[0].command, sequence.command, atol=1e-9)
    assert result.models["3"].overall["rmse"].value < 2e-3  # type: ignore[operator]
    refused = run("validate", path, "--model", model)
    assert refused.exit_code == 1 and "give --thrusters MAP.json and --arm METRES" in refused.stderr


def test_a_run_without_a_signal_of_the_model_is_set_aside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Model, "signals", ("depth_m",))
    sequence, logs = sequence_run((0.5,)), tmp_path / "logs"
    written(sequence, logs / "deep.csv", depth_m=1.0)
    written(sequence, logs / "flat.csv")
    written(sequence, logs / "patchy.csv", depth_m=np.where(np.arange(len(sequence)) == 7, np.nan, 2.0))
    result = validate([logs], model=model_file(tmp_path / "m.json"))
    assert [run.name for run in result.runs] == ["deep"]
    why = {aside.run: aside.why for aside in result.set_aside}
    assert "needs the column depth_m, which the log lacks; map it with --columns" in why["flat"]
    assert "needs 'depth_m' in every row; 1 rows lack it" in why["patchy"]
