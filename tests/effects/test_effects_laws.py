"""Effects of which nature has more than one law, or which differ from run to run: each law is told from the other."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from effect_contract import Floats, base_for, long_plans, measured, short_plans, unmeasured
from few_candidates import few_candidates

from automarine_cli import effects
from automarine_cli.diagnosis.diagnose import diagnose_runs, parameter_estimates
from automarine_cli.diagnosis.scores import fitted_parameters
from automarine_cli.diagnosis.study import DiagnosisProblem, study_of
from automarine_cli.diagnosis.trials import CandidateFit
from automarine_cli.effects.history_force import MEMORY_SHARES, MEMORY_TIMES
from automarine_cli.models.model import Model
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import make_batch
from automarine_cli.simulation.rollout import Start, simulate

SECOND_LAWS = {"water-swirl": (0.4, 9.0, 1.0), "dead-band": (0.17, 1.0)}
BASE = base_for("")
RUNS = [unmeasured(plan, i) for i, plan in enumerate(long_plans())]


def headings(model: Model, runs: Sequence[Run], start: Start | None = None) -> Floats:
    return simulate(model, make_batch(runs, 0.05), start=start).position[0]


MOMENT, STEP = 0.9, 5e-3
PLAN = [(MOMENT, 6.0), (-0.5, 5.0), (0.3, 4.0), (0.0, 4.0)]
"""A run that starts, turns round, eases off and stops."""


def in_fine_steps(run: Run, law: Callable[..., Floats], states: int = 0) -> Floats:
    """Headings at the samples by Heun's method in steps of STEP: `law` (state, moment, time) gives the derivative of
    heading, rate and `states` more."""
    edges, levels = np.cumsum([1.5, *(s for _, s in PLAN)]) - 0.05, [0.0, *(m for m, _ in PLAN)]
    state, out = np.zeros(2 + states), [0.0]
    for m in range(round(float(run.time[-1] - run.time[0]) / STEP)):
        time = (m + 0.5) * STEP
        moment = levels[min(int(np.searchsorted(edges, time)), len(levels) - 1)]
        first = law(state, moment, time)
        state = state + 0.5 * STEP * (first + law(state + STEP * first, moment, time + STEP))
        if (m + 1) % round(0.1 / STEP) == 0:
            out.append(state[0])
    return np.array(out)


def turning(rate: float, pushed: float, slip: float | None = None) -> float:
    through = rate if slip is None else slip
    return float((pushed - BASE.drag()[1] * abs(through) * through) / BASE.inertia)


def root(moment: float) -> float:
    return float(np.sign(moment) * np.sqrt(abs(moment)))


def lagging(spun: Callable[[float, float], float], of_thrust: bool = False) -> Callable[..., Floats]:
    """A thruster's own state n with n' = spun(moment commanded, n)."""

    def law(state: Floats, moment: float, time: float) -> Floats:
        _, rate, n = state
        pushed = n if of_thrust else n * abs(n)
        return np.array([rate, turning(rate, pushed), spun(moment, n)])

    return law


def swirling(pulled: Callable[[float, float, float, float], float]) -> Callable[..., Floats]:
    """Water w with w' = pulled(slip, rate, moment, w)."""

    def law(state: Floats, moment: float, time: float) -> Floats:
        _, rate, w = state
        return np.array([rate, turning(rate, moment, rate - w), pulled(rate - w, rate, moment, w)])

    return law


def pushed_by(extra: Callable[[float, float, float], float]) -> Callable[..., Floats]:
    """A moment beside the command: extra(heading, rate, moment)."""

    def law(state: Floats, moment: float, time: float) -> Floats:
        psi, rate = state
        return np.array([rate, turning(rate, moment + extra(psi, rate, moment))])

    return law


def sagging(state: Floats, moment: float, time: float) -> Floats:
    """A battery that follows the load after 5 s, by a quarter at MOMENT."""
    _, rate, drawn = state
    return np.array([rate, turning(rate, moment * (1.0 - 0.25 * drawn)), (abs(moment) / MOMENT - drawn) / 5.0])


def emptying(state: Floats, moment: float, time: float) -> Floats:
    """A battery that loses a share of 0.8 a minute under MOMENT."""
    _, rate, charge = state
    return np.array([rate, turning(rate, moment * np.exp(-0.8 * charge)), (abs(moment) / MOMENT) ** 1.5 / 60.0])


def remembering(times: Sequence[float], shares: Sequence[float]) -> Callable[..., Floats]:
    """Past changes of the rate, each fading in a time of its own, hold the vehicle by these shares."""

    def law(state: Floats, moment: float, time: float) -> Floats:
        (_, rate), left = state[:2], state[2:]
        swing = turning(rate, moment - float(np.dot(shares, left)))
        return np.array([rate, swing, *(swing - left / np.array(times))])

    return law


OWN = {
    "thruster-lag 0": ((0.3, 0, MOMENT, 1), lagging(lambda u, n: (root(u) - n) / 0.3), 1),
    "thruster-lag 1": ((0.3, 1, MOMENT, 1), lagging(lambda u, n: (u - n) / 0.3, of_thrust=True), 1),
    "thruster-lag 2": ((0.3, 2, MOMENT, 1), lagging(lambda u, n: (u - n * abs(n)) / (0.6 * root(MOMENT))), 1),
    "thruster-lag 3": ((0.8, 3, MOMENT, 1), lagging(
        lambda u, n: float(np.clip((root(u) - n) / 0.004, -1, 1)) * root(MOMENT) / 0.8), 1),
    "thruster-lag 4": ((0.3, 4, MOMENT, 2.0), lagging(
        lambda u, n: (root(u) - n) / (0.6 if (root(u) - n) * n < 0 else 0.3)), 1),
    "water-swirl 1": ((0.4, 9, 1, 1, 1), swirling(lambda s, r, u, w: (0.4 * abs(s) * s - 0.6 * w) / 9), 1),
    "water-swirl 2": ((0.4, 9, 2, 1, 1), swirling(lambda s, r, u, w: (0.4 * abs(r) * s - 0.6 * w) / 9), 1),
    "water-swirl 3": ((0.2, 9, 3, MOMENT, 1), swirling(lambda s, r, u, w: (0.2 * u / MOMENT - 0.8 * w) / 9), 1),
    "water-swirl 4": ((0.4, 9, 4, 1, 1), swirling(lambda s, r, u, w: (0.4 * abs(s) * s - 0.6 * abs(w) * w) / 9), 1),
    "water-swirl 5": ((0.3, 9, 5, 1, 2.0), swirling(
        lambda s, r, u, w: (0.3 * s - 0.7 * w) / (18 if (0.3 * s - 0.7 * w) * w < 0 else 9)), 1),
    "coulomb-drag 1": ((0.03, 1, 0.06, 0.15), pushed_by(
        lambda x, r, u: -(0.03 + 0.06 * np.exp(-((r / 0.15) ** 2))) * np.tanh(r / 0.02)), 0),
    "tether-spring 1": ((0.05, 1, 1.5, 0), pushed_by(
        lambda x, r, u: -0.05 * (max(x - 1.5, 0.0) + min(x + 1.5, 0.0))), 0),
    "tether-spring 2": ((0.01, 2, 1, 0.004), pushed_by(lambda x, r, u: -0.01 * x - 0.004 * x**3), 0),
    "thrust-loss 1": ((0.3, 1), pushed_by(lambda x, r, u: -0.3 * abs(u) ** 0.5 * r if u * r > 0 else 0.0), 0),
    "saturation 1": ((1.0, 1), pushed_by(lambda x, r, u: np.tanh(u) - u), 0),
    "battery-sag 1": ((0.0, 0.25, MOMENT, 0.0, 1, 5.0), sagging, 1),
    "battery-sag 2": ((0.0, 0.8, MOMENT, 0.0, 2, 5.0), emptying, 1),
    "history-force 0": ((0.4, 3.0, 0), remembering([3.0], [0.4]), 1),
    "history-force 1": ((0.2, 2.0, 1), remembering(MEMORY_TIMES, [0.2 * share for share in MEMORY_SHARES]), 3),
    "wall 1": ((0.0, 0.0, 1, 0.15, -0.1), pushed_by(
        lambda x, r, u: -(0.15 * np.cos(2 * x) - 0.1 * np.sin(2 * x)) * u), 0),
    "wall 0": ((0.2, -0.1), pushed_by(
        lambda x, r, u: -(0.2 * np.cos(2 * x) - 0.1 * np.sin(2 * x)) * abs(r) * r), 0),
}  # fmt: skip
"""Laws written a second time: values of the effect's parameters, derivative of the state, number of further states."""


@pytest.mark.parametrize("name", OWN)
def test_each_law_against_its_own_equation(name: str) -> None:
    """To one side: that the other mirrors it is a contract of every law."""
    values, law, states = OWN[name]
    run = unmeasured(PLAN, 0)
    model = BASE.with_effect(name.split()[0], [float(v) for v in values])
    found, own = headings(model, [run])[0], in_fine_steps(run, law, states)
    assert np.rad2deg(np.abs(found[: len(own)] - own[: len(found)]).max()) < 0.3
    assert np.rad2deg(np.ptp(found - headings(BASE, [run])[0])) > 2.0


def test_three_exponentials_are_bassets_kernel() -> None:
    age = np.geomspace(0.2, 30.0, 50)
    kernel = sum(share * np.exp(-age / time) for share, time in zip(MEMORY_SHARES, MEMORY_TIMES))
    np.testing.assert_allclose(kernel * np.sqrt(age), 1.0, atol=0.04)


def of_plan(plan: Sequence[tuple[float, float]], *effect: Any) -> Floats:
    """Headings of the base vehicle, or with an effect and its values, in a run of this plan."""
    return headings(BASE.with_effect(*effect) if effect else BASE, [unmeasured(plan, 0)])[0]


def test_a_delay_of_what_falls_is_another() -> None:
    """A step held 4 s acts 0.2 s late and ends 0.5 s late; as one that holds 0.3 s longer, 0.2 s later."""
    late = of_plan([(0.8, 4.0), (0.0, 5.0)], "input-delay", (0.2, 1.0, 0.5))
    longer = of_plan([(0.8, 4.3), (0.0, 4.7)], "input-delay", (0.2,))
    np.testing.assert_allclose(late, longer, rtol=0, atol=2e-3)
    mirrored = of_plan([(-0.8, 4.0), (0.0, 5.0)], "input-delay", (0.2, 1.0, 0.5))
    np.testing.assert_allclose(mirrored, -late, rtol=0, atol=1e-12)


def test_what_falls_late_ends_where_the_other_side_begins() -> None:
    """A propeller turns one way at a time: reversed, it is late by what rises only, and rests where that is later."""
    reversal = [(0.8, 4.0), (-0.8, 5.0)]
    held = of_plan(reversal, "input-delay", (0.2, 1.0, 0.5))
    np.testing.assert_allclose(held, of_plan(reversal, "input-delay", (0.2,)), rtol=0, atol=2e-3)
    let_go = of_plan(reversal, "input-delay", (0.5, 1.0, 0.2))
    apart = of_plan([(0.8, 3.7), (0.0, 0.3), (-0.8, 5.0)], "input-delay", (0.5,))
    np.testing.assert_allclose(let_go, apart, rtol=0, atol=2e-3)


def test_an_answer_to_delays_apart_has_no_jumps() -> None:
    """A side that would fall late ends when the other begins, wherever in a step that is."""
    run = unmeasured([(0.8, 3.0), (-0.8, 3.0)], 0)
    delays = np.linspace(0.2, 0.4, 2001)
    models = [BASE.with_effect("input-delay", (delay, 1.0, 0.6)) for delay in delays]
    ends = simulate(models[0], make_batch([run], 0.1), np.stack([model.theta for model in models])).position[:, 0, -1]
    steps = np.diff(ends)
    assert np.abs(np.diff(steps)).max() < 0.5 * np.abs(steps).mean()


def test_a_stalling_thruster_goes_on_below_its_start() -> None:
    """A moment that does not start it keeps it going once it runs; one below the lower edge stalls it."""
    stalling = ("dead-band", (0.5, 2.0, 0.2))
    np.testing.assert_allclose(of_plan([(0.3, 5.0)], *stalling), 0.0, atol=1e-9)
    for then, acts in ((0.3, 0.3), (0.15, 0.0)):
        stalled, plain = of_plan([(0.9, 3.0), (then, 5.0)], *stalling), of_plan([(0.9, 3.0), (acts, 5.0)])
        np.testing.assert_allclose(stalled, plain, rtol=0, atol=1e-9)


def test_backlash_keeps_what_it_was_pushed_to() -> None:
    """Up to 0.9 and back to 0.2 with a play of 0.3: delivered are 0.6, then 0.5."""
    loose, plain = of_plan([(0.9, 4.0), (0.2, 5.0)], "backlash", (0.3,)), of_plan([(0.6, 4.0), (0.5, 5.0)])
    np.testing.assert_allclose(loose, plain, rtol=0, atol=1e-12)


def test_the_current_pulls_the_compass_at_once() -> None:
    run = unmeasured([(0.8, 5.0), (-0.8, 5.0)], 0)
    pull = headings(BASE.with_effect("current-deviation", (0.06, 0.02, 0.8)), [run])[0] - headings(BASE, [run])[0]
    np.testing.assert_allclose(pull, 0.06 * run.command / 0.8 + 0.02 * np.abs(run.command) / 0.8, atol=1e-12)


def fitted(study: DiagnosisProblem, name: str, start: Sequence[float]) -> CandidateFit:
    model = BASE.with_effect(name, start)
    fit = study.fit(model)
    return CandidateFit((name,), study.with_fitted_values(model, fit), fit, -2.0 * fit.log_likelihood)


def test_the_likelihood_knows_the_law_of_a_cut() -> None:
    """Other laws are recovered with their parameters; where a cut lies between two moments nobody can tell."""
    truth = SECOND_LAWS["dead-band"]
    study = study_of(measured(BASE.with_effect("dead-band", truth), RUNS, seed=3), BASE)
    first, second = (fitted(study, "dead-band", start) for start in ((0.03, 0.0), truth))
    assert second.evidence < first.evidence - 10.0
    assert np.rad2deg(second.fit.noise) == pytest.approx(0.5, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("name", SECOND_LAWS)
def test_a_diagnosis_names_the_effect_and_its_law(name: str) -> None:
    plans = short_plans() if name == "dead-band" else long_plans()
    runs = measured(BASE.with_effect(name, SECOND_LAWS[name]), [unmeasured(p, i) for i, p in enumerate(plans)], seed=5)
    with few_candidates(effects.names(), curves=False):
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
    start = Start(own={"periodic-disturbance": np.broadcast_to([0.04, -0.02], (1, len(RUNS), 2))})
    np.testing.assert_allclose(headings(model, RUNS, start), common, rtol=0, atol=1e-12)
    np.testing.assert_allclose(headings(model, RUNS), headings(BASE, RUNS), rtol=0, atol=1e-12)


@pytest.mark.slow
def test_amplitude_and_period_of_such_waves_are_recovered() -> None:
    study = study_of(wavy(1), BASE)
    trial = fitted(study, "periodic-disturbance", (0.0, 0.0, 3.0, 1.0))
    estimates = parameter_estimates(study, trial, "periodic-disturbance")
    for parameter, value in {"A": AMPLITUDE, "T": PERIOD}.items():
        assert abs(estimates[parameter].value - value) < 4.0 * estimates[parameter].stderr < 2.0 * value
    assert estimates["B"].value == 0.0


@pytest.mark.slow
def test_such_waves_are_named() -> None:
    """Among what they are mistaken for: `make blind` has them among all."""
    among = {"periodic-disturbance", "heading-moment", "dead-band", "bias-moment"}
    assert fitted_parameters("periodic-disturbance", (0.0, 0.0, 3.0, 1.0)) == 2
    with few_candidates(among, curves=False):
        found = diagnose_runs(wavy(4), BASE, hold_out=[])
        again = diagnose_runs(wavy(4), found.search.final.model, hold_out=[])  # of a base that has them
    assert again.verdict == "nothing-missing"
    assert found.verdict == "named" and [one.name for one in found.effects] == ["periodic-disturbance"]
    assert found.effects[0].parameters["phase"].value == 1.0
    assert np.rad2deg(found.fitted.gap.after) == pytest.approx(0.5, rel=0.1)


@pytest.mark.parametrize("law", [0.0, 1.0, 2.0])
def test_a_lag_is_as_late_as_it_says_at_a_quarter_of_the_largest(law: float) -> None:
    """What a small change there still lacks adds up to the change times how late it is."""
    lag, values = effects.get("thruster-lag"), [0.1, law, 1.0, 1.0]
    length, step = np.full((1, 1, 800), 0.005), 0.01
    start, quarter = np.cumsum(length, axis=2) - length, np.full((1, 1), 0.25)
    commands = effects.Commands(np.full((1, 1, 800), 0.25 + step), start, length, quarter, np.zeros((1, 1)), {})
    delivered = lag.deliver(commands, tuple(np.full((1, 1, 1), value) for value in values))
    lacking = (0.25 + step - delivered)[0, 0] @ length[0, 0]
    assert lacking == pytest.approx(step * lag.late(values), rel=0.03)
