"""A delay is found from wherever its fit begins: it shares its direction with the instants at which commands switch."""

import numpy as np
import pytest
from tank import pool_campaign

from automarine_cli.diagnosis.diagnose import parameter_estimates
from automarine_cli.diagnosis.search import add_effect, candidate_fit
from automarine_cli.diagnosis.study import study_of
from automarine_cli.dofs import YAW
from automarine_cli.models.yaw_model import YawModel

DELAY = 0.25


@pytest.mark.slow
def test_a_delay_is_found_from_every_start() -> None:
    runs = pool_campaign(
        seed=3, noise_deg=2.0, gain=0.05, repeats=1, turn_deg=400.0, effects=[{"name": "input-delay", "t_d": DELAY}]
    )
    study = study_of(runs, YawModel.base("3", 1.0, [1.2], runs[0].moment_unit, YAW))
    base = candidate_fit(study, study.base, (), study.fit(study.base))
    trials = [add_effect(study, base, ("input-delay", np.array([start, 0.0, 0.1]))) for start in (0.05, 0.1, 0.2, 0.4)]
    evidence = []
    for trial in trials:
        assert trial is not None and trial.fit.converged
        estimate = parameter_estimates(study, trial, "input-delay")["t_d"]
        assert abs(estimate.value - DELAY) < 3.0 * estimate.stderr < 3.0 * 0.05
        evidence.append(trial.evidence)
    assert np.ptp(evidence) < 1.0
