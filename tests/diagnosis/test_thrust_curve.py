"""A curve of the thrust that the gains of single runs hide, and what a diagnosis writes of it."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from few_candidates import few_candidates

import automarine_cli as am
from automarine_cli.diagnosis.search import curved, gain_exponent
from automarine_cli.diagnosis.study import DiagnosisProblem, study_of
from automarine_cli.diagnosis.trials import CandidateFit, candidate_fit
from automarine_cli.dofs import YAW
from automarine_cli.fits.linear_mixed import GAIN
from automarine_cli.models.model import Model
from automarine_cli.runs.run import Run

AMONG = {
    "dead-band", "thrust-exponent", "input-delay", "thruster-lag", "sensor-lag", "saturation", "coulomb-drag",
    "linear-drag",
}  # fmt: skip


def studied(power: float, idle: float, scatter: float = 0.02) -> tuple[DiagnosisProblem, CandidateFit]:
    """Steps of six sizes to both sides of a vehicle of 0.08 and 0.15, whose thrust is a power of the command beyond a
    dead-band: the closed form of a step, ln cosh."""
    random, runs = np.random.default_rng(3), []
    time = np.arange(0.0, 8.05, 0.1)
    for side in (1.0, -1.0):
        for size in (0.2, 0.35, 0.5, 0.65, 0.8, 1.0):
            moment = np.exp(scatter * random.standard_normal()) * (size - idle) ** power
            turned = 0.08 / 0.15 * np.log(np.cosh(np.sqrt(0.15 * moment) / 0.08 * np.maximum(time - 1.0, 0.0)))
            heading = side * turned + np.deg2rad(1.0) * random.standard_normal(len(time))
            command = np.where(time >= 1.0, side * size, 0.0)
            runs.append(Run(f"{side * size:+g}", "", time, heading, command, "nu", dof=YAW))
    study = replace(study_of(runs, Model.base("3", 0.1, [0.2], "nu", YAW)), driven=False)
    return study, candidate_fit(study, study.base, (), study.fit(study.base))


@pytest.mark.parametrize(("power", "idle"), [(1.6, 0.06), (2.0, 0.1)])
def test_both_are_found_together(power: float, idle: float) -> None:
    """The base hides them in gains that scatter by 0.3, the most that a fit takes."""
    study, base = studied(power, idle)
    steep, found = gain_exponent(study, base.fit), curved(study, base)
    assert base.fit.factor(GAIN) > 0.29 and steep is not None and steep.value > power - 1.0
    assert found is not None and found.added == ("dead-band", "thrust-exponent") and found.count == 1
    theta = dict(zip(found.model.parameter_names, found.model.theta))
    assert theta["dead-band.width"] == pytest.approx(idle, abs=0.015)
    assert theta["thrust-exponent.p"] == pytest.approx(power, abs=0.1)
    left = gain_exponent(study, found.fit)
    assert found.fit.factor(GAIN) < 0.04 and left is not None and left.ci95[0] < 0.05


def test_nothing_is_looked_for_where_gains_scatter_by_chance() -> None:
    study, base = studied(1.0, 0.0, scatter=0.15)
    assert base.fit.factor(GAIN) > 0.1 and curved(study, base) is None


@pytest.mark.slow
def test_a_diagnosis_names_them_and_says_what_scatters_still(tmp_path: Path) -> None:
    """Steps alone; a lag beside the curve. Tried are these and what they are mistaken for."""
    specification: dict[str, Any] = {
        "schema": "automarine/simulation/1", "seed": 5, "vehicle": {"I_r": 0.08, "k_rr": 0.15, "moment_unit": "nu"},
        "effects": [
            {"name": "dead-band", "width": 0.08}, {"name": "thrust-exponent", "p": 1.8, "tau_ref": 1.0},
            {"name": "input-delay", "t_d": 0.12},
        ],
        "logger": {"rate_hz": 10.0, "noise_deg": 1.0}, "scatter": {"gain": 0.02},
        "runs": [{"kind": "step", "turn_deg": 360.0,
                  "moments": [s * m for m in (0.2, 0.25, 0.35, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0) for s in (1, -1)]}],
    }  # fmt: skip
    (tmp_path / "truth.json").write_text(json.dumps(specification))
    am.simulate(tmp_path / "truth.json", out=tmp_path / "day")
    am.fit_yaw([str(tmp_path / "day")], fit_to="whole-runs", out=tmp_path / "fit")
    model = tmp_path / "fit" / "yaw_model.json"
    with few_candidates(AMONG, curves=False):
        am.diagnose([str(tmp_path / "day")], model=model, out=tmp_path / "diagnosis")
    named = {one["name"] for one in json.loads((tmp_path / "diagnosis" / "diagnosis.json").read_text())["effects"]}
    assert {"dead-band", "thrust-exponent"} <= named
    extended = json.loads((tmp_path / "diagnosis" / "extended_model.json").read_text())
    assert extended["gain_scatter"] < 0.05 and extended["gain_exponent"]["ci95"][0] < 0.1
