"""Effects of which every run has coefficients of its own, through the whole command to its last file."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from few_candidates import few_candidates

from automarine_cli import effects
from automarine_cli.commands import automarine
from automarine_cli.commands.fit_motion import fit_yaw
from automarine_cli.commands.simulate import simulate
from automarine_cli.dofs import YAW
from automarine_cli.pipeline.results_folder import read_manifest
from automarine_cli.report.sections import toml_text

FILES = ("diagnosis.json", "extended_model.json", "diagnosis.md", "where.png", "why.png", "before_after.png")
STRONG = 3.0
"""Times the usual start of an effect's size: it shows at once."""
pytestmark = pytest.mark.slow
VARYING = [name for name in effects.names() if effects.get(name).per_run and effects.get(name).acts_in(YAW)]
assert VARYING


def hidden(name: str) -> dict[str, object]:
    """The effect in a specification: large, and another in every run."""
    values = {
        p.name: 1.0 if p.choices else STRONG * p.start if "{moment}" in p.unit else p.start
        for p in effects.get(name).parameters
    }
    return {"name": name, **values}


def diagnosed(out: Path, *arguments: object) -> dict[str, Any]:
    """The result of the command line's `diagnose`, which left every file and drew every figure."""
    done = CliRunner().invoke(automarine, ["diagnose", *map(str, arguments), "-o", str(out)])
    assert (done.exit_code, done.stderr) == (0, "")
    assert {path.name for path in out.iterdir()} == {*FILES, "manifest.json"}
    assert "warnings" not in json.loads((out / "manifest.json").read_text())
    assert {entry.file for entry in read_manifest(out / "manifest.json").outputs} == set(FILES)
    found: dict[str, Any] = json.loads((out / "diagnosis.json").read_text())
    return found


@pytest.fixture(scope="module", autouse=True)
def few() -> Iterator[None]:
    """What varies, and two that do not."""
    with few_candidates({*VARYING, "dead-band", "bias-moment"}, curves=False):
        yield


@pytest.fixture(scope="module", params=VARYING)
def campaign(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory, few: None) -> tuple[str, Path]:
    """An effect, and a folder with ten long steps in which it is hidden, their fit as whole runs and a diagnosis."""
    folder = tmp_path_factory.mktemp(request.param)
    specification = {
        "schema": "automarine/simulation/1", "seed": 3, "effects": [hidden(request.param)],
        "vehicle": {"I_r": 1.018, "k_rr": 1.257, "moment_unit": "nu"}, "logger": {"rate_hz": 5, "noise_deg": 0.5},
        "scatter": {"gain": 0.02, "start_heading_deg": "random"},
        "campaign": {"rest_before_s": 1.0, "rest_after_s": 0.0},
        "runs": [{"kind": "step", "moments": {"from": -1.0, "to": 1.0, "step": 0.2}, "duration_s": 12.0}],
    }  # fmt: skip
    (folder / "made.toml").write_text(toml_text(specification))
    simulate(folder / "made.toml", out=folder / "logs")
    fit_yaw([folder / "logs"], fit_to="whole-runs", out=folder / "yaw")
    diagnosed(folder / "diagnosis", folder / "logs", "--model", folder / "yaw" / "yaw_model.json")
    return request.param, folder


def result_in(folder: Path) -> dict[str, Any]:
    result: dict[str, Any] = json.loads((folder / "diagnosis" / "diagnosis.json").read_text())
    assert result["verdict"] == "named"
    return result


def test_it_is_named_and_its_share_is_its_own(campaign: tuple[str, Path], tmp_path: Path) -> None:
    """What the runs have of their own of it counts as the effect's, not as scatter between runs."""
    name, folder = campaign
    logs, result = sorted((folder / "logs").rglob("*.csv")), result_in(folder)
    assert [effect["name"] for effect in result["effects"]] == [name] and len(result["held_out"]) == len(logs) // 4
    gap = result["gap"]["held_out_runs"]
    before, after = (gap[f"{when}_deg"] ** 2 - gap["noise_floor_deg"] ** 2 for when in ("before", "after"))
    assert after < 0.3 * before
    options = [word for log in logs[::4] for word in ("--hold-out", log)]  # and with runs held out by name
    fitted = [log for log in logs if log not in logs[::4]]
    result = diagnosed(tmp_path / "out", *fitted, "--model", folder / "yaw" / "yaw_model.json", *options)
    assert result["verdict"] == "named" and [effect["name"] for effect in result["effects"]] == [name]
    assert len(result["held_out"]) == len(logs[::4])


def test_a_model_that_has_it_is_diagnosed_again(campaign: tuple[str, Path], tmp_path: Path) -> None:
    """The extended model is the base of the next diagnosis: now the base, too, lets something vary."""
    folder = campaign[1]
    model = folder / "diagnosis" / "extended_model.json"
    assert diagnosed(tmp_path / "out", folder / "logs", "--model", model)["verdict"] == "nothing-missing"
