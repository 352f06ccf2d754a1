"""Simulated runs against an independent integrator, in the mirror, and against what was asked of them."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from tank import pool_campaign, pool_specification

from automarine_cli.commands.simulate import simulate
from automarine_cli.dofs import YAW
from automarine_cli.models.model import Model, response
from automarine_cli.simulation import campaign as room
from automarine_cli.simulation.campaign import SimulatedRun, make_campaign, make_plans
from automarine_cli.simulation.specification import SIMULATION_SCHEMA, Specification, specification_from, time_to_turn

Floats = NDArray[np.float64]

SEED = 4
HALF_DIGIT = np.deg2rad(0.5e-3)  # of a heading logged to a thousandth of a degree
INTEGRATED = HALF_DIGIT + 2e-6  # and what two integrators may differ by [rad]

ALL_KINDS: list[dict[str, object]] = [
    {"kind": "step", "moments": [-0.4, 1.1], "turn_deg": 220},
    {"kind": "coast-down", "moments": [0.9], "turn_deg": 180, "coast_s": 8},
    {"kind": "reversal", "moments": [-0.7], "turn_deg": 150},
    {"kind": "sequence", "commands": [[0.8, 5], [-0.3, 6.5], [0, 2], [1.2, 4]]},
    {"kind": "ramp", "to": -1.0, "duration_s": 12, "steps": 30},
    {"kind": "rest", "duration_s": 5},
]


def exactly(specification: Specification, run: SimulatedRun) -> Floats:
    """The heading that the log should show [rad], by scipy's integrator from switch to switch."""
    vehicle = specification.vehicle
    bias = sum(effect.values["b"] for effect in specification.effects) + run.added_moment
    time = np.arange(run.plan.samples) * specification.logger.period
    begin, switches = time[0], run.switches.tolist()
    if switches and (specification.campaign.held or switches[0] < begin):
        begin = switches[0]
    edges = [begin, *(s for s in switches if s > begin), time[-1] + 1e-3]
    state, heading = np.array([run.start, 0.0]), np.full(len(time), run.start)
    for first, last in pairwise(edges):
        (moment,) = ((0.0,), *run.plan.moments)[int(np.searchsorted(switches, first, side="right"))]

        def slope(_: float, y: Floats, total: float = moment * run.gain + bias) -> list[float]:
            drag = vehicle.quadratic * abs(y[1]) * y[1] + vehicle.linear * y[1]
            return [y[1], (total - drag) / vehicle.inertia]

        inside = (time >= first) & (time < last)
        solution = solve_ivp(slope, (first, last), state, "DOP853", [*time[inside], last], rtol=1e-10, atol=1e-11)
        heading[inside], state = solution.y[0, :-1], solution.y[:, -1]
    return heading + np.deg2rad(run.biases["heading_deg"])


def worst_error(specification: Specification, run: SimulatedRun) -> float:
    """The largest error of a logged heading [rad]."""
    return float(np.abs(np.deg2rad(run.columns["heading_deg"]) - exactly(specification, run)).max())


@pytest.mark.parametrize("held", [False, True])
def test_every_kind_is_what_solve_ivp_makes_of_its_truth(held: bool) -> None:
    specification = pool_specification(
        runs=ALL_KINDS,
        noise_deg=0.0,
        gain=0.05,
        vehicle={"I_r": 0.9, "k_rr": 1.1, "k_r": 0.2},
        logger={"wrap": "none"},
        scatter={"moment": 0.03, "heading_zero_deg": 1.5},
        campaign={"rest_before_s": 2.0, "held": held},
        effects=[{"name": "bias-moment", "b": 0.02}],
    )
    for run in make_campaign(specification, SEED):
        assert worst_error(specification, run) <= INTEGRATED, run.plan.name


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_zigzag_is_what_solve_ivp_makes_of_it_and_goes_over_where_it_should(side: float) -> None:
    """Nomoto's boat at two speeds: the rudder's moment follows the square of the speed but for a share of the race."""
    vehicle = {"moment_unit": "rad", "I_r": 0.9, "k_r": 0.7}
    inflow = {"name": "rudder-inflow", "race": 0.2, "U": 1.2}
    zigzags = [
        {"kind": "zigzag", "name": f"at_{ahead}", "angles_deg": [side * 10, side * 20], "swings": 4, "surge_m_s": ahead}
        for ahead in (0.9, 1.5)
    ]
    specification = pool_specification(
        runs=zigzags, vehicle=vehicle, noise_deg=0.0, gain=0.0, logger={"wrap": "none"}, effects=[inflow],
        scatter={"start_heading_deg": 0.0}, campaign={"rest_after_s": 0.0},
    )  # fmt: skip
    for run in make_campaign(specification, SEED):
        ahead, size = run.columns["surge_m_s"][0], abs(run.plan.moments[0][0])
        share = 0.2 + 0.8 * (ahead / 1.2) ** 2
        edges = [*run.switches.tolist(), (run.plan.samples - 1) * specification.logger.period]
        state, heading = np.zeros(2), []
        for number, (begin, end) in enumerate(pairwise(edges)):
            (rudder,) = run.plan.moments[number]
            assert rudder == pytest.approx(side * (-1.0) ** number * size)
            if number:  # this switch and those before are up to a sample early or late, in which it turns so far
                assert abs(abs(state[0]) - size) <= 3.0 * specification.logger.period * size * share / 0.7

            def slope(_: float, y: Floats, push: float = rudder * share) -> list[float]:
                return [y[1], (push - 0.7 * y[1]) / 0.9]

            state = solve_ivp(slope, (begin, end), state, "DOP853", rtol=1e-10, atol=1e-11).y[:, -1]
            heading.append(state[0])
        np.testing.assert_allclose(np.deg2rad(run.columns["heading_deg"][-1]), heading[-1], atol=INTEGRATED)
        logged = run.columns["rudder_deg"]
        assert logged[0] == 0.0 and np.abs(logged).max() == pytest.approx(np.rad2deg(size))


def test_a_turn_lasts_as_long_as_the_base_vehicle_needs() -> None:
    for inertia, linear, quadratic in ((1.018, 0.0, 1.257), (1.018, 0.5, 0.0), (0.5, 0.1, 2.0)):
        model = Model.base("2", inertia, (quadratic, linear), "nu", YAW)
        for moment in (0.1, -1.2):
            time = time_to_turn(3.5, moment, model)
            assert abs(response(time, moment, inertia, linear, quadratic)[0]) == pytest.approx(3.5, abs=1e-9)


def test_mirrored_campaign_is_the_mirror_image(monkeypatch: pytest.MonkeyPatch) -> None:
    specification = pool_specification(
        runs=ALL_KINDS, noise_deg=0.0, gain=0.05, logger={"wrap": "none"}, scatter={"start_heading_deg": 0.0}
    )
    there = make_campaign(specification, 8)
    plans = tuple(replace(p, moments=tuple((-m,) for (m,) in p.moments)) for p in make_plans(specification, 8))
    monkeypatch.setattr(room, "make_plans", lambda *_: plans)
    for run, mirrored in zip(there, make_campaign(specification, 8), strict=True):
        for name, sign in (("time_s", 1), ("tau", -1), ("heading_deg", -1)):
            np.testing.assert_array_equal(run.columns[name], sign * mirrored.columns[name])


def test_switch_is_anywhere_in_the_interval_before_it_shows() -> None:
    runs = make_campaign(pool_specification(moments=[0.7, -0.7], repeats=60), 5)
    late = np.array([run.plan.changes[0] * 0.1 - run.switches[0] for run in runs]) / 0.1
    assert np.all((late >= 0) & (late < 1))
    assert late.mean() == pytest.approx(0.5, abs=4 / np.sqrt(12 * len(late)))
    assert late.std() == pytest.approx(np.sqrt(1 / 12), rel=0.2)
    for run in runs:
        first = int(np.argmax(run.columns["tau"] != 0))
        before, after = run.columns["time_s"][first - 1 : first + 1] - run.plan.start
        assert before < run.switches[0] <= after


def test_scatter_is_as_asked() -> None:
    settings = {"moment": 0.1, "heading_zero_deg": 2.0}
    runs = make_campaign(pool_specification(moments=[0.6, -0.9], repeats=200, gain=0.05, scatter=settings), 6)
    four_sigma = 4 / np.sqrt(2 * len(runs))  # of a standard deviation, in parts
    for values, expected in (
        ([run.log_gain for run in runs], 0.05),
        ([run.added_moment for run in runs], 0.1),
        ([run.biases["heading_deg"] for run in runs], 2.0),
    ):
        assert np.std(values) == pytest.approx(expected, rel=four_sigma)
        assert abs(np.mean(values)) < 4 * expected / np.sqrt(len(runs))
    headings = np.array([run.start for run in runs])
    assert np.all((headings >= 0) & (headings < 2 * np.pi))
    assert headings.std() == pytest.approx(2 * np.pi / np.sqrt(12), rel=0.1)


def test_other_runs_and_jobs_change_nothing_and_seeds_do() -> None:
    pair = pool_specification(moments=[0.3, -0.5])
    few, parallel, other = (make_campaign(pair, seed, jobs=jobs) for seed, jobs in ((9, 1), (9, 2), (8, 1)))
    many = make_campaign(pool_specification(moments=[-1.2, 0.3, 0.8, -0.5], repeats=3, campaign={"order": "listed"}), 9)
    by_name = {run.plan.name: run for run in many}
    for run, again, unlike in zip(few, parallel, other):
        for same in (again, by_name[run.plan.name]):
            np.testing.assert_array_equal(run.columns["heading_deg"], same.columns["heading_deg"])
            np.testing.assert_array_equal(run.switches, same.switches)
        assert not np.array_equal(run.columns["heading_deg"][:30], unlike.columns["heading_deg"][:30])


def test_one_clock_over_all_runs_random_order_and_headings_in_turn() -> None:
    runs = pool_campaign(3, campaign={"wait_between_s": 45.0}, logger={"rate_noise_deg_s": 0.5})
    assert len(runs) == 48
    assert [run.name for run in runs] != [run.name for run in pool_campaign(3, campaign={"order": "listed"})]
    gaps = [later.time[0] - earlier.time[-1] for earlier, later in pairwise(runs)]
    np.testing.assert_allclose(gaps, 45.1, atol=2e-3)  # one sample period more: the last sample has a length
    for run in runs:
        step = run.command != 0
        rate = np.gradient(run.position[step], run.time[step])
        assert np.median(run.extras["yaw_rate"][step] / rate) == pytest.approx(1.0, abs=0.1)
    listed = pool_specification(moments=[0.5, -0.5], scatter={"start_heading_deg": [0, 120, 240]})
    turns = sorted(make_campaign(listed, 1), key=lambda run: run.plan.turn)
    np.testing.assert_allclose([np.rad2deg(run.start) for run in turns], [0, 120, 240, 0])


def test_rates_have_a_bias_a_run_that_the_truth_tells() -> None:
    """Standard deviation as asked for, mean of reading less truth as written, and no other number changes."""
    step = {"kind": "step", "forces": [20.0], "duration_s": 10.0, "repeats": 100}
    vehicle = {"motion": "surge", "m_u": 20.0, "X_uu": 30.0, "force_unit": "N"}
    table = {"schema": SIMULATION_SCHEMA, "vehicle": vehicle, "runs": [step]}
    logger = {"rate_hz": 10, "noise_m": 0.0, "speed_noise_m_s": 0.0}
    sensed = specification_from(table | {"logger": logger | {"speed_noise_m_s": 0.3, "speed_bias_m_s": 0.5}})
    result, true = simulate(sensed, seed=3), make_campaign(specification_from(table | {"logger": logger}), 3)
    bias = np.array([run["speed_bias_m_s"] for run in result.to_json()["made"]])  # type: ignore[attr-defined]
    assert np.std(bias) == pytest.approx(0.5, rel=0.2) and abs(np.mean(bias)) < 0.15
    off = np.array([run.columns["surge_m_s"] - exact.columns["surge_m_s"] for run, exact in zip(result.runs, true)])
    assert np.mean(off, axis=1) == pytest.approx(bias, abs=5 * 0.3 / np.sqrt(130))
    assert np.std(off - bias[:, None]) == pytest.approx(0.3, rel=0.03)
    for run, exact in zip(result.runs, true):
        np.testing.assert_array_equal(*(list(part.columns.values())[1] for part in (run, exact)))
