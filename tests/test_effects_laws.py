"""Effects of which nature has more than one law, or which differ from run to run: each law is told from the other."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from effect_contract import Floats, base_for, long_plans, measured, short_plans, unmeasured

from automarine_cli import effects
from automarine_cli.diagnosis import search
from automarine_cli.diagnosis.diagnose import diagnose_runs
from automarine_cli.diagnosis.estimates import parameter_estimates
from automarine_cli.diagnosis.scores import fitted_parameters
from automarine_cli.diagnosis.study import Study, study_of
from automarine_cli.diagnosis.trials import Trial
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import make_batch
from automarine_cli.simulation.campaign import make_runs
from automarine_cli.simulation.rollout import Start, simulate
from automarine_cli.simulation.specification import specification_from

SECOND_LAWS = {"water-swirl": (0.4, 9.0, 1.0), "dead-band": (0.17, 1.0)}
BY_LAW = pytest.mark.parametrize("name", SECOND_LAWS)
BASE = base_for("")
RUNS = [unmeasured(plan, i) for i, plan in enumerate(long_plans())]


def headings(model: YawModel, runs: Sequence[Run], start: Start | None = None) -> Floats:
    """Simulated headings (R, N)."""
    return simulate(model, make_batch(runs, 0.05), start=start).position[0]


@BY_LAW
def test_second_law_is_another_and_off_at_no_size(name: str) -> None:
    effect, values = effects.get(name), SECOND_LAWS[name]
    plain = headings(BASE, RUNS)
    first, second = (headings(BASE.with_effect(name, (*values[:-1], law)), RUNS) for law in (0.0, 1.0))
    assert np.rad2deg(np.abs(second - first).max()) > 5.0
    off = headings(BASE.with_effect(name, (*effect.off[:-1], 1.0)), RUNS)
    np.testing.assert_allclose(off, plain, rtol=0, atol=1e-9)


@BY_LAW
def test_second_law_is_even(name: str) -> None:
    model = BASE.with_effect(name, SECOND_LAWS[name])
    mirrored = [replace(run, moment=-run.command) for run in RUNS]
    np.testing.assert_allclose(headings(model, mirrored), -headings(model, RUNS), rtol=0, atol=1e-10)


def test_turbulent_swirl_against_its_own_equation() -> None:
    """w' = c |s| s - w / T_d with c = chi / T_w and T_d = T_w / (1 - chi), in small steps of its own."""
    chi, lag = SECOND_LAWS["water-swirl"][:2]
    (run,) = [unmeasured([(0.9, 20.0), (-0.5, 10.0)], 0)]
    found = headings(BASE.with_effect("water-swirl", (chi, lag, 1.0)), [run])[0]
    inertia, drag, h = BASE.inertia, BASE.drag()[1], 2e-4
    psi = rate = water = 0.0
    edges = np.array([1.5, 21.5]) - 0.05  # a change is logged half a sample interval after it
    own = [0.0]
    for m in range(round(float(run.time[-1] - run.time[0]) / h)):
        tau = (0.0, 0.9, -0.5)[int(np.searchsorted(edges, (m + 0.5) * h))]
        slip = rate - water
        psi += h * rate + 0.5 * h * h * (tau - drag * abs(slip) * slip) / inertia
        rate += h * (tau - drag * abs(slip) * slip) / inertia
        water += h * (chi / lag * abs(slip) * slip - (1.0 - chi) / lag * water)
        if (m + 1) % 500 == 0:
            own.append(psi)
    assert np.rad2deg(np.abs(found[: len(own)] - own[: len(found)]).max()) < 0.1


def fitted(study: Study, name: str, start: Sequence[float]) -> Trial:
    """The effect fitted from `start`."""
    model = BASE.with_effect(name, start)
    fit = study.fit(model)
    return Trial((name,), study.told(model, fit), fit, -2.0 * fit.log_likelihood)


@BY_LAW
def test_the_likelihood_knows_the_law(name: str) -> None:
    truth = SECOND_LAWS[name]
    study = study_of(measured(BASE.with_effect(name, truth), RUNS, seed=3), BASE)
    first = fitted(study, name, (0.03, 0.0) if name == "dead-band" else (0.3, 10.0, 0.0))
    second = fitted(study, name, truth)
    assert second.evidence < first.evidence - 10.0
    assert np.rad2deg(second.fit.noise) == pytest.approx(0.5, rel=0.1)
    if name == "water-swirl":  # where a cut lies between two moments nobody can tell
        found = parameter_estimates(study, second, name)
        for parameter, value in zip(("chi", "T_w"), truth):
            assert abs(found[parameter].value - value) < 4.0 * found[parameter].stderr
        assert found["law"].value == 1.0 and found["law"].stderr == 0.0


@BY_LAW
def test_a_diagnosis_names_the_effect_and_its_law(name: str) -> None:
    plans = short_plans() if name == "dead-band" else long_plans()
    runs = measured(
        BASE.with_effect(name, SECOND_LAWS[name]), [unmeasured(p, i) for i, p in enumerate(plans)], seed=5
    )
    found = diagnose_runs(runs, BASE, hold_out=[])
    assert found.verdict == "named"
    assert [one.name for one in found.effects] == [name]
    assert found.effects[0].parameters["law"].value == 1.0


# Waves that meet every run at another phase

AMPLITUDE, PERIOD = 0.05, 2.7


def wavy(seed: int, amplitude: float = AMPLITUDE) -> list[Run]:
    """The campaign with such waves in it, noise and scatter as in the other planted campaigns."""
    random = np.random.default_rng(seed)
    phase = random.uniform(0.0, 2.0 * np.pi, len(RUNS))
    own = amplitude * np.stack([np.cos(phase), np.sin(phase)], axis=1)[None]
    batch = make_batch(RUNS, 0.05)
    start = Start(
        position=random.uniform(-np.pi, np.pi, (1, len(RUNS))),
        log_gain=0.02 * random.standard_normal((1, len(RUNS))),
        own={"periodic-disturbance": own},
    )
    truth = BASE.with_effect("periodic-disturbance", (amplitude, 0.0, PERIOD, 1.0))
    found = simulate(truth, batch, start=start).position[0]
    found = found + np.deg2rad(0.5) * random.standard_normal(found.shape)
    return [replace(run, position=row[: len(run)]) for run, row in zip(RUNS, found)]


def test_own_phases_are_the_run_s_and_not_the_model_s() -> None:
    """A run's own sine is the common sine of a model that has it; without coefficients there is no wave at all."""
    common = headings(BASE.with_effect("periodic-disturbance", (0.04, -0.02, PERIOD, 0.0)), RUNS)
    model = BASE.with_effect("periodic-disturbance", (0.3, 0.0, PERIOD, 1.0))
    own = np.broadcast_to([0.04, -0.02], (1, len(RUNS), 2))
    np.testing.assert_allclose(
        headings(model, RUNS, Start(own={"periodic-disturbance": own})), common, rtol=0, atol=1e-12
    )
    np.testing.assert_allclose(headings(model, RUNS), headings(BASE, RUNS), rtol=0, atol=1e-12)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_amplitude_and_period_of_such_waves_are_recovered(seed: int) -> None:
    study = study_of(wavy(seed), BASE)
    found = parameter_estimates(
        study, fitted(study, "periodic-disturbance", (0.0, 0.0, 3.0, 1.0)), "periodic-disturbance"
    )
    for parameter, value in {"A": AMPLITUDE, "T": PERIOD}.items():
        assert abs(found[parameter].value - value) < 4.0 * found[parameter].stderr < 2.0 * value
    assert found["B"].value == 0.0


def test_such_waves_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """Among what they are mistaken for: `make blind` has them among all."""
    among = {"periodic-disturbance", "heading-moment", "dead-band", "bias-moment"}
    every = search.candidates
    monkeypatch.setattr(search, "candidates", lambda *of: [name for name in every(*of) if name in among])
    assert fitted_parameters("periodic-disturbance", (0.0, 0.0, 3.0, 1.0)) == 2
    found = diagnose_runs(wavy(4), BASE, hold_out=[])
    assert found.verdict == "named" and [one.name for one in found.effects] == ["periodic-disturbance"]
    assert found.effects[0].parameters["phase"].value == 1.0
    assert np.rad2deg(found.gap.after) == pytest.approx(0.5, rel=0.1)


def test_simulated_campaigns_draw_a_phase_for_every_run() -> None:
    plain = {
        "schema": "automarine/simulation/1",
        "vehicle": {"I_r": 0.3, "k_rr": 1.0},
        "logger": {"noise_deg": 0.0},
        "runs": [{"kind": "step", "moments": [-0.8, -0.6, -0.4, 0.4, 0.6, 0.8], "duration_s": 12.0}],
    }
    waves = {"name": "periodic-disturbance", "A": 0.05, "B": 0.0, "T": 3.0, "phase": 1.0}
    still = make_runs(specification_from(plain), seed=1)
    runs = make_runs(specification_from({**plain, "effects": [waves]}), seed=1)
    added = [run.position - flat.position for run, flat in zip(runs, still)]
    assert len(added) == 6 and all(np.ptp(one) > 0.01 for one in added)
    assert all(np.abs(a - b).max() > 3e-3 for i, a in enumerate(added) for b in added[:i])
