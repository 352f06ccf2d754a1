"""A delay is found from wherever its fit begins: it shares its direction with the instants at which commands switch."""

import numpy as np
import pytest
from tank import pool_campaign

from automarine_cli.diagnosis.search import add_effect, trial_of
from automarine_cli.diagnosis.study import study_of
from automarine_cli.dofs import YAW
from automarine_cli.models.yaw_model import YawModel

DELAY = 0.25


def test_a_delay_is_found_from_every_start() -> None:
    runs = pool_campaign(
        seed=3, noise_deg=2.0, gain=0.05, repeats=1, turn_deg=400.0, effects=[{"name": "input-delay", "t_d": DELAY}]
    )
    study = study_of(runs, YawModel.base("3", 1.0, [1.2], runs[0].moment_unit, YAW))
    base = trial_of(study, study.base, (), study.fit(study.base))
    starts = (0.05, 0.1, 0.2, 0.4)
    trials = [add_effect(study, base, ("input-delay", np.array([start, 0.0, 0.1]))) for start in starts]
    evidence = [trial.evidence for trial in trials if trial is not None]
    assert len(evidence) == len(starts) and np.ptp(evidence) < 0.1 * (base.evidence - min(evidence))
    for trial in trials:
        assert trial is not None and trial.model.terms[-1].values[0] == pytest.approx(DELAY, abs=0.06)
