"""Steps in water that pushes the vehicle: what wanders from run to run gets no name."""

import numpy as np
import pytest
from made_surge import LINEAR, MASS, QUADRATIC, steps

from automarine_cli.diagnosis.diagnose import diagnose_runs
from automarine_cli.diagnosis.residual_regions import find_where
from automarine_cli.diagnosis.scores import DRAWS, larger, signed_scores
from automarine_cli.diagnosis.study import study_of
from automarine_cli.diagnosis.trials import candidate_fit
from automarine_cli.dofs import SURGE
from automarine_cli.models.model import Model

TRUTH = Model.base("2", MASS, (QUADRATIC, LINEAR), "N", SURGE)


def test_noise_of_the_distance_makes_no_place_stand_out() -> None:
    """Readings below the start have errors below nothing: places are those of the model, not as measured."""
    for seed in (1, 2, 3):
        study = study_of(steps(seed), TRUTH, ("distance", "surge"))
        regions = find_where(study, candidate_fit(study, TRUTH, (), study.fit(TRUTH)), 0).regions
        assert not regions, regions


@pytest.mark.parametrize(("push", "wider"), [(0.0, 1.0), (2.0, 5.0)])
def test_runs_that_are_pushed_widen_what_chance_reaches_by_their_scatter(push: float, wider: float) -> None:
    """A push of `push` times the noise adds its square, whatever all runs have in common."""
    random, runs = np.random.default_rng(3), 60
    informations = np.tile(np.diag([1.0, 4.0]), (runs, 1, 1))
    noise = np.sqrt(1.0 + push**2) * random.standard_normal((runs, 2)) * [1.0, 2.0]
    noise -= noise.mean(axis=0)
    common = np.array([3.0, 0.0])
    signed = signed_scores(informations, noise + informations @ common, slice(0, 1), common[:1], random)
    ratio = (signed**2).mean(axis=0) / informations.sum(axis=0).diagonal()
    assert signed.shape == (DRAWS, 2)
    assert ratio == pytest.approx(wider, rel=4.0 * np.sqrt(2.0 / runs))
    assert larger(signed[:, 0], 2.0 * signed[:, 0]) is not signed[:, 0]


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 3, 5])
def test_a_push_that_wanders_gets_no_name(seed: int) -> None:
    """0.3 N beside thrusts of 6 to 50: no period, no friction and no curve over the speed is named."""
    diagnosis = diagnose_runs(steps(seed, push=0.3), TRUTH)
    assert diagnosis.verdict != "named", diagnosis.effects


@pytest.mark.slow
def test_still_water_has_nothing_missing() -> None:
    assert diagnose_runs(steps(4), TRUTH).verdict == "nothing-missing"


@pytest.mark.slow
def test_cubic_drag_brings_the_linear_drag_that_it_hid_from_the_base() -> None:
    """The base is quadratic drag alone, as fits without cubic drag prefer."""
    diagnosis = diagnose_runs(steps(5, cubic=20.0), Model.base("3", MASS, (48.0,), "N", SURGE))
    assert diagnosis.verdict == "named" and {e.name for e in diagnosis.effects} == {"cubic-drag", "linear-drag"}
    for name, truth in (("cubic-drag", 20.0), ("linear-drag", LINEAR)):
        (estimate,) = next(e for e in diagnosis.effects if e.name == name).parameters.values()
        assert estimate.value == pytest.approx(truth, abs=3.0 * estimate.stderr)
