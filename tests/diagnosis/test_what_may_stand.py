"""What keeps an effect from being added, and columns that gains follow or that only stand for time."""

import warnings
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from effect_contract import base_for, planted, short_plans, unmeasured

from automarine_cli.diagnosis import search, verdict
from automarine_cli.diagnosis.learned_curve import gains_follow, ranges
from automarine_cli.diagnosis.residual_regions import Gap
from automarine_cli.diagnosis.scores import candidates, drag_drives
from automarine_cli.diagnosis.search import MotionSearch, clear, may_be_nothing, obstacle
from automarine_cli.diagnosis.study import DiagnosisProblem, limit_cycle, study_of
from automarine_cli.diagnosis.trials import CandidateFit, candidate_fit
from automarine_cli.diagnosis.verdict import ForecastGain, JudgedRuns
from automarine_cli.dofs import YAW
from automarine_cli.estimate import Estimate
from automarine_cli.fits.driven import ForecastScore
from automarine_cli.models.model import Model
from automarine_cli.models.parameter import Parameter, Parameters
from automarine_cli.pipeline.parallel import alone
from automarine_cli.quantities import STEERED
from automarine_cli.runs.run import Run

BASE = base_for("")


def test_neither_no_run_nor_one_shows_that_a_gain_repeats_itself() -> None:
    assert clear(np.array([1.0, 1.1])) and not clear(np.ones(1)) and not clear(np.zeros(0))


@pytest.mark.parametrize(
    ("last", "returns"), [((0.2, 4.0), True), ((0.0, 4.0), True), ((-0.4, 4.0), False), ((-0.2, 4.0), False)]
)
def test_play_is_looked_for_only_where_a_command_falls_again(last: tuple[float, float], returns: bool) -> None:
    steps = [[(s * size, 6.0)] for size in (0.2, 0.3) for s in (1.0, -1.0)]
    assert "backlash" not in candidates(study_of(planted(BASE, seed=1, plans=steps), BASE), BASE)
    study = study_of(planted(BASE, seed=1, plans=[*steps, [(0.4, 6.0), last]]), BASE)
    assert ("backlash" in candidates(study, BASE)) == returns and "dead-band" in candidates(study, BASE)


@pytest.mark.parametrize(
    ("name", "values", "error", "stands"),
    [
        ("sensor-lag", [0.05], 0.01, False),
        ("sensor-lag", [0.09], 0.03, False),
        ("sensor-lag", [0.09], 0.01, True),
        ("sensor-lag", [0.3], 0.3, True),  # more than a sample
        ("input-delay", [0.05, 0.0, 0.1], 0.01, False),
        ("input-delay", [0.09, 0.0, 0.1], 0.01, True),
        ("thruster-lag", [0.0, 3.0, 1.2, 1.0], 0.01, False),
        ("thruster-lag", [0.06, 4.0, 1.2, 5.0], 0.3, True),
        ("bias-moment", [0.05], 0.01, True),
    ],
)
def test_a_lag_of_half_a_sample_is_a_shift_of_the_switches(
    name: str, values: list[float], error: float, stands: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = replace(study_of(planted(BASE, seed=1, plans=short_plans()), BASE), driven=False)
    assert study.logger_delay == pytest.approx(0.05)
    model = BASE.with_effect(name, values)
    stderrs = error * (np.arange(len(model.theta)) == len(BASE.theta))
    monkeypatch.setattr(DiagnosisProblem, "covariance", lambda *of: np.diag(stderrs**2))
    linearised = np.diag((2.0 * stderrs) ** 2)
    monkeypatch.setattr(search, "run_covariance", lambda fit: linearised)
    monkeypatch.setattr(
        search, "estimate_of", lambda fit, c, i: Estimate.from_stderr(model.theta[i], np.sqrt(c[i, i]), 30.0, "")
    )
    of_fit = {"at_bound": (), "driven": False}
    fit, gained = (SimpleNamespace(predictive=predictive, **of_fit) for predictive in (np.zeros(3), np.ones(3)))
    before, trial = (CandidateFit(*of, 0.0) for of in (((), BASE, fit), ((name,), model, gained)))
    assert bool(obstacle(study, trial, before)) != stands
    assert ("half a sample" in obstacle(study, trial, before)) != stands
    assert "predicted better" in obstacle(study, replace(trial, fit=fit), before)


@pytest.mark.parametrize(
    ("ci95", "says"), [((3.6, 4.4), ""), ((2.0, 6.0), "may be 2 s or 6 s"), ((0.0, np.inf), "may be 0 s or inf s")]
)
def test_what_has_no_period_is_not_periodic(
    ci95: tuple[float, float], says: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = replace(study_of(planted(BASE, seed=1, plans=short_plans()), BASE), driven=False)
    model = BASE.with_effect("periodic-disturbance", [0.1, 0.0, 4.0, 0.0])
    monkeypatch.setattr(search, "run_covariance", lambda fit: np.eye(len(model.theta)))
    monkeypatch.setattr(search, "estimate_of", lambda fit, c, i: Estimate(model.theta[i], 1.0, ci95, "s"))
    of_fit = {"at_bound": (), "driven": False}
    fit, gained = (SimpleNamespace(predictive=predictive, **of_fit) for predictive in (np.zeros(3), np.ones(3)))
    trial = CandidateFit(("periodic-disturbance",), model, gained, 0.0)
    why = obstacle(study, trial, CandidateFit((), BASE, fit, 0.0))
    assert says in why and bool(why) == bool(says)


@pytest.mark.parametrize(
    ("law", "sizes", "errors", "at_bound", "nothing"),
    [
        (0.0, (0.208, 0.03), (0.066, 0.0), (), False),  # five runs: t is 2.78
        (0.0, (0.150, 0.03), (0.066, 0.0), (), True),
        (1.0, (0.0, 0.337), (0.0, 0.138), (2,), True),  # a boat on a lake: the constant part at its bound
        (1.0, (0.180, 0.180), (0.066, 0.066), (), False),  # neither alone is clear of zero, both together are
    ],
)
def test_an_effect_whose_interval_holds_nothing_is_not_added(
    law: float, sizes: tuple[float, float], errors: tuple[float, float], at_bound: tuple[int, ...], nothing: bool
) -> None:
    model = BASE.with_effect("coulomb-drag", [sizes[0], law, sizes[1], 0.15])
    first, theta = len(model.theta) - 4, model.theta
    covariance = np.zeros((len(theta), len(theta)))
    covariance[[first, first + 2], [first, first + 2]] = np.square(errors)
    parameters = Parameters(tuple(map(Parameter, model.parameter_names, theta)))
    fit: Any = SimpleNamespace(theta=theta, parameters=parameters, at_bound=at_bound, left_out=np.zeros((5, 1)))
    study: Any = SimpleNamespace(covariance=lambda *of: covariance)
    assert may_be_nothing(study, CandidateFit(("coulomb-drag",), model, fit, 0.0), "coulomb-drag") == nothing


@pytest.mark.parametrize(("law", "lag", "nothing"), [(0.0, 0.0, False), (1.0, 0.1, True), (1.0, 0.5, False)])
def test_a_limit_without_which_nothing_is_limited_counts_for_nothing(law: float, lag: float, nothing: bool) -> None:
    """Its distance from there is infinite, and was no number times a covariance."""
    model = Model.base("1", 1.0, [1.0], STEERED, YAW).with_effect("rudder-rate", [0.3, law, lag])
    parameters = Parameters(tuple(map(Parameter, model.parameter_names, model.theta)))
    fit: Any = SimpleNamespace(theta=model.theta, parameters=parameters, at_bound=(), left_out=np.zeros((5, 1)))
    study: Any = SimpleNamespace(covariance=lambda *of: 0.01 * np.eye(len(model.theta)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert may_be_nothing(study, CandidateFit(("rudder-rate",), model, fit, 0.0), "rudder-rate") == nothing


@pytest.mark.slow
def test_a_lag_comes_back_to_its_law_when_what_stood_for_the_law_is_taken_out() -> None:
    """What stood beside it had the lag in the law of one that is faster at speed."""
    true = BASE.with_effect("thruster-lag", [0.5, 0.0, 1.2, 1.0])
    study = replace(study_of(planted(true, seed=4, plans=short_plans()), BASE), driven=False)
    other = BASE.with_effect("thruster-lag", [0.2, 2.0, 1.2, 1.0]).with_effect("bias-moment", [0.01])
    both = candidate_fit(study, other, ("thruster-lag", "bias-moment"), study.fit(other))
    reduced = MotionSearch(study, 0, alone).without(both, "bias-moment")
    assert reduced is not None and reduced.added == ("thruster-lag",)
    lag, law, *_ = reduced.model.terms[-1].values
    assert law == 0.0 and lag == pytest.approx(0.5, rel=0.1)
    assert reduced.evidence < both.evidence - 100.0


def in_water(count: int, column: str = "water_temp_C") -> list[Run]:
    """Runs one after the other, each at another temperature in no order of time."""
    runs = [unmeasured([(0.5, 6.0)], i) for i in range(count)]
    order = np.random.default_rng(3).permutation(count)
    return [
        replace(run, position=0.0 * run.time, extras={column: np.full(len(run), 14.0 + 6.0 * at / (count - 1))})
        for run, at in zip(runs, order)
    ]


def follows(runs: list[Run], gains: np.ndarray) -> str:
    study = DiagnosisProblem(tuple(runs), BASE, False, ())
    trial: Any = SimpleNamespace(fit=SimpleNamespace(effects_of=lambda name: gains[:, None]))
    return gains_follow(study, trial, 0)


def test_gains_that_go_up_and_down_with_a_column_are_seen() -> None:
    """A sine of 1.8 periods, of which no line and no cubic says anything."""
    runs = in_water(32)
    warm = np.array([run.extras["water_temp_C"][0] for run in runs])
    luck = 0.05 * np.random.default_rng(1).standard_normal(len(runs))
    assert follows(runs, 0.3 * np.sin(1.9 * (warm - 14.0)) + luck) == "water_temp_C"
    assert follows(runs[:4], luck[:4]) == ""  # too few to say
    drawn = np.random.default_rng(7).standard_normal((100, len(runs)))
    assert sum(bool(follows(runs, gains)) for gains in drawn) <= 5  # of 100 at 1 %: more than 5 once in 1000


def test_over_a_few_runs_no_curve_runs_over_what_only_stands_for_time() -> None:
    clocked = {
        count: [replace(run, extras={**run.extras, "row": 3.0 + 0.1 * run.time}) for run in in_water(count)]
        for count in (9, 10)
    }
    few, many = (set(ranges(DiagnosisProblem(tuple(runs), BASE, False, ()))) for runs in clocked.values())
    assert many - few == {"campaign-clock", "row"} and "water_temp_C" in few


def test_no_curve_runs_over_what_a_controller_is_after() -> None:
    setpoints = dict.fromkeys(("heading_setpoint_deg", "Desired yaw", "target"))
    runs = [
        replace(run, extras={**run.extras, **dict.fromkeys((*setpoints, "offset_cm"), run.time**2)})
        for run in in_water(10)
    ]
    variables = set(ranges(DiagnosisProblem(tuple(runs), BASE, False, ())))
    assert "offset_cm" in variables and not variables & {*setpoints}


@pytest.mark.parametrize(
    ("gained", "unexplained", "after", "doubt"),
    [
        (-3.0, -9.0, 0.05, "log density falls by 3.0"),
        (3.0, -9.0, 0.101, ""),  # what is left is chance, and commands answer it
        (3.0, 8.0, 0.101, "5 s ahead"),
        (3.0, 8.0, 0.099, "closes 2 %"),
        (3.0, 8.0, 0.09, ""),
    ],
)
def test_what_leaves_much_unexplained_has_to_predict_held_out_runs_better(
    monkeypatch: pytest.MonkeyPatch, gained: float, unexplained: float, after: float, doubt: str
) -> None:
    errors = {2.0: after, 5.0: after, 15.0: 0.2}
    scores = [tuple(ForecastScore(h, x, 0.3, 0.3, 10) for x in (0.1, error)) for h, error in errors.items()]
    driven: Any = SimpleNamespace(driven=True, base=BASE)
    result: Any = SimpleNamespace(study=driven, base=None, final=None)
    monkeypatch.setattr(verdict, "gained_density", lambda *_: np.array([gained]))
    monkeypatch.setattr(verdict, "unexplained_density", lambda *_: unexplained)
    outlook: Any = ForecastGain(tuple(scores), gained)  # type: ignore[arg-type]
    says = verdict._borne_out(result, driven, JudgedRuns((), Gap(0.1, after, 0.0), outlook))
    assert doubt in says and bool(doubt) == bool(says)


# Drag that drives is refused, either way round, and every drag that brakes is let through


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_an_asymmetry_drives_where_it_outgrows_the_drag(sign: float) -> None:
    """k_r r + e r² changes its sign at |r| = k_r/|e|; within the quadratic drag it brakes at all rates."""
    linear, quadratic = (Model.base(number, 20.0, [10.0], "nu", YAW) for number in "13")
    drives = linear.with_effect("drag-asymmetry", [sign * 20.0])
    assert drag_drives(drives, 0.6) and not drag_drives(drives, 0.4)
    brakes = quadratic.with_effect("drag-asymmetry", [sign * 9.0])
    assert not drag_drives(brakes, 1e-3) and not drag_drives(brakes, 100.0)
    still = Model.base("1", 20.0, [0.0], "nu", YAW).with_effect("cross-coupling", [sign * 30.0])
    assert not drag_drives(still.with_effect("bias-moment", [sign]), 1.0)  # what is no drag is not asked


# Limit cycles of controllers

STEP = 0.05  # s


def relay_loop(sign: float, late: float, seed: int, relay: bool = True) -> Run:
    """A bang-bang (or, without `relay`, a soft PD) controller round an inertia with linear drag and a dead time [s]."""
    random = np.random.default_rng(seed)
    count, delay = int(90.0 / STEP), int(late / STEP)
    heading, rate, command = np.zeros(count), 0.0, np.zeros(count)
    for k in range(1, count):
        acting = command[k - 1 - delay] if k - 1 >= delay else 0.0
        rate += STEP * (acting - 0.8 * rate)
        heading[k] = heading[k - 1] + STEP * rate
        error = 0.5 * sign * ((k * STEP // 20.0) % 2) - heading[k] - 0.002 * random.standard_normal()
        wanted = error - 0.4 * rate
        command[k] = sign * np.sign(sign * wanted) if relay else 0.6 * wanted
    time = STEP * np.arange(count)
    return Run(f"run_{seed}", "loop", time[::2], heading[::2], command[::2], "nu", dof=YAW)


def test_a_relay_with_a_dead_time_swings_and_a_loop_that_follows_its_setpoint_does_not() -> None:
    periods = []
    for sign in (1.0, -1.0):
        runs = [relay_loop(sign, 0.4, seed) for seed in range(4)]
        cycle = limit_cycle(runs)
        assert cycle is not None
        swings = np.flatnonzero(np.diff(np.sign(np.gradient(runs[0].position[500:]))))
        period = 2.0 * 2.0 * STEP * float(np.median(np.diff(swings)))
        assert cycle.period == pytest.approx(period, rel=0.15)
        assert cycle.holds(period) and not cycle.holds(2.0 * period)
        assert 0.5 * np.pi < cycle.phase < 1.5 * np.pi  # an inertia and a dead time behind the command
        assert "a limit cycle of the controller" in cycle.sentence(YAW)
        periods.append(cycle.period)
    assert periods[0] == pytest.approx(periods[1], rel=0.1)
    assert limit_cycle([run.cut(0, 100) for run in runs]) is None  # too short for a spectrum
    assert limit_cycle([relay_loop(1.0, 0.0, seed, relay=False) for seed in range(4)]) is None
