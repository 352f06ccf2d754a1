"""Simulated runs against an independent integrator, in the mirror, and against what was asked of them."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from specified import make_runs
from tank import INERTIA, K_RR, pool_campaign, pool_specification

from automarine_cli import effects
from automarine_cli.commands.simulate import simulate
from automarine_cli.dofs import YAW
from automarine_cli.models.yaw_model import YawModel, response
from automarine_cli.simulation import campaign as room
from automarine_cli.simulation.campaign import DECIMALS, SimulatedRun, make_campaign, make_plans, sample_times
from automarine_cli.simulation.specification import SCHEMA, Specification, specification_from, time_to_turn

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


def exactly(specification: Specification, made: SimulatedRun) -> Floats:
    """The heading that the log should show [rad], by scipy's integrator from switch to switch."""
    drawn, vehicle = made.drawn, specification.vehicle
    bias = sum(effect.values["b"] for effect in specification.effects) + drawn.added_moment
    instants = sample_times(made.plan, specification.logger, SEED)  # stamps are logged to a millisecond
    time = instants[np.isin(np.round(made.plan.start + instants, DECIMALS), made.columns["time_s"])]
    begin = instants[0]
    switches = drawn.switches.tolist()
    held = specification.campaign.held and bool(switches)
    if held or (switches and switches[0] < begin):
        begin = switches[0]
    edges = [begin, *(s for s in switches if s > begin), time[-1] + 1e-3]
    state, heading = np.array([drawn.start, 0.0]), np.full(len(time), drawn.start)
    for first, last in pairwise(edges):
        moment = ([0.0, *made.plan.moments])[int(np.searchsorted(switches, first, side="right"))]

        def slope(_: float, y: Floats, total: float = moment * drawn.gain + bias) -> list[float]:
            drag = vehicle.quadratic * abs(y[1]) * y[1] + vehicle.linear * y[1]
            return [y[1], (total - drag) / vehicle.inertia]

        inside = (time >= first) & (time < last)
        found = solve_ivp(slope, (first, last), state, "DOP853", [*time[inside], last], rtol=1e-10, atol=1e-11)
        heading[inside], state = found.y[0, :-1], found.y[:, -1]
    return heading + drawn.zero


@pytest.mark.parametrize("held", [False, True])
def test_every_kind_is_what_solve_ivp_makes_of_its_truth(held: bool) -> None:
    specification = pool_specification(
        runs=ALL_KINDS,
        noise_deg=0.0,
        gain=0.05,
        vehicle={"I_r": 0.9, "k_rr": 1.1, "k_r": 0.2},
        logger={"wrap": "none", "clock_jitter_s": 0.015, "dropout": 0.1},
        scatter={"moment": 0.03, "heading_zero_deg": 1.5},
        campaign={"rest_before_s": 2.0, "held": held},
        effects=[{"name": "bias-moment", "b": 0.02}],
    )
    for made in make_campaign(specification, SEED):
        off = np.deg2rad(made.columns["heading_deg"]) - exactly(specification, made)
        assert np.abs(off).max() <= INTEGRATED, made.plan.name


def test_steps_are_the_closed_form_to_the_last_digit() -> None:
    specification = pool_specification(noise_deg=0.0, gain=0.03, logger={"wrap": "none"})
    for made in make_campaign(specification, 1):
        time = made.columns["time_s"] - made.plan.start
        on = time < made.drawn.switches[1]
        moment = made.plan.moments[0] * made.drawn.gain
        begin = made.drawn.start
        truth, _ = response(time - made.drawn.switches[0], moment, INERTIA, 0.0, K_RR, begin)
        assert np.abs(np.deg2rad(made.columns["heading_deg"]) - truth)[on].max() <= HALF_DIGIT + 1e-7


def test_log_may_begin_with_the_moment_already_on() -> None:
    specification = pool_specification(
        moments=[0.8, -0.8], noise_deg=0.0, logger={"wrap": "none"}, campaign={"rest_before_s": 0.0}
    )
    for made in make_campaign(specification, SEED):
        assert made.columns["tau"][0] == made.plan.moments[0]
        assert -0.1 < made.drawn.switches[0] <= 0.0
        assert np.abs(np.deg2rad(made.columns["heading_deg"]) - exactly(specification, made)).max() <= INTEGRATED


def test_a_turn_lasts_as_long_as_the_base_vehicle_needs() -> None:
    for inertia, linear, quadratic in ((1.018, 0.0, 1.257), (1.018, 0.5, 0.0), (0.5, 0.1, 2.0)):
        model = YawModel.base("2", inertia, (quadratic, linear), "nu", YAW)
        for moment in (0.1, -1.2):
            time = time_to_turn(3.5, moment, model)
            assert abs(response(time, moment, inertia, linear, quadratic)[0]) == pytest.approx(3.5, abs=1e-9)


def test_mirrored_campaign_is_the_mirror_image(monkeypatch: pytest.MonkeyPatch) -> None:
    specification = pool_specification(
        runs=ALL_KINDS, noise_deg=0.0, gain=0.05, logger={"wrap": "none"}, scatter={"start_heading_deg": 0.0}
    )
    there = make_campaign(specification, 8)
    plans = tuple(replace(p, moments=tuple(-m for m in p.moments)) for p in make_plans(specification, 8))
    monkeypatch.setattr(room, "make_plans", lambda *_: plans)
    back = make_campaign(specification, 8)
    for one, other in zip(there, back):
        np.testing.assert_array_equal(one.columns["time_s"], other.columns["time_s"])
        np.testing.assert_array_equal(one.columns["tau"], -other.columns["tau"])
        np.testing.assert_array_equal(one.columns["heading_deg"], -other.columns["heading_deg"])


def test_switch_is_anywhere_in_the_interval_before_it_shows() -> None:
    found = make_campaign(pool_specification(moments=[0.7, -0.7], repeats=60), 5)
    late = np.array([made.plan.changes[0] * 0.1 - made.drawn.switches[0] for made in found]) / 0.1
    assert np.all((late >= 0) & (late < 1))
    assert late.mean() == pytest.approx(0.5, abs=4 / np.sqrt(12 * len(late)))
    assert late.std() == pytest.approx(np.sqrt(1 / 12), rel=0.2)
    for made in found:
        first = int(np.argmax(made.columns["tau"] != 0))
        before, after = made.columns["time_s"][first - 1 : first + 1] - made.plan.start
        assert before < made.drawn.switches[0] <= after


def test_scatter_is_as_asked() -> None:
    settings = {"moment": 0.1, "heading_zero_deg": 2.0}
    found = make_campaign(pool_specification(moments=[0.6, -0.9], repeats=200, gain=0.05, scatter=settings), 6)
    four_sigma = 4 / np.sqrt(2 * len(found))  # of a standard deviation, in parts
    for values, expected in (
        ([made.drawn.log_gain for made in found], 0.05),
        ([made.drawn.added_moment for made in found], 0.1),
        ([np.rad2deg(made.drawn.zero) for made in found], 2.0),
    ):
        assert np.std(values) == pytest.approx(expected, rel=four_sigma)
        assert abs(np.mean(values)) < 4 * expected / np.sqrt(len(found))
    headings = np.array([made.drawn.start for made in found])
    assert np.all((headings >= 0) & (headings < 2 * np.pi))
    assert headings.std() == pytest.approx(2 * np.pi / np.sqrt(12), rel=0.1)


def test_moment_scatter_leaves_every_run_a_share_of_its_moment() -> None:
    settings = {"moment": 0.2, "moment_most": 0.5}
    found = make_campaign(pool_specification(moments=[0.2, -1.0], repeats=100, scatter=settings), 7)
    ratio = np.array([made.drawn.added_moment / made.plan.moments[0] for made in found])
    assert np.abs(ratio).max() <= 0.5
    weak = np.array([abs(made.plan.moments[0]) < 0.5 for made in found])
    assert np.abs(ratio[weak]).max() > 0.4


def test_one_run_does_not_change_another() -> None:
    few = make_campaign(pool_specification(moments=[0.3, -0.5]), 9)
    many = make_campaign(pool_specification(moments=[-1.2, 0.3, 0.8, -0.5], repeats=3, campaign={"order": "listed"}), 9)
    by_name = {made.plan.name: made for made in many}
    for made in few:
        same = by_name[made.plan.name]
        np.testing.assert_array_equal(made.columns["heading_deg"], same.columns["heading_deg"])
        np.testing.assert_array_equal(made.drawn.switches, same.drawn.switches)


def test_one_clock_over_all_runs_and_random_order() -> None:
    runs = pool_campaign(3, campaign={"wait_between_s": 45.0})
    assert [run.name for run in runs] != [run.name for run in pool_campaign(3, campaign={"order": "listed"})]
    gaps = [later.time[0] - earlier.time[-1] for earlier, later in pairwise(runs)]
    np.testing.assert_allclose(gaps, 45.1, atol=2e-3)  # one sample period more: the last sample has a length


def test_start_headings_are_taken_in_turn() -> None:
    specification = pool_specification(moments=[0.5, -0.5], scatter={"start_heading_deg": [0, 120, 240]})
    made = sorted(make_campaign(specification, 1), key=lambda one: one.plan.turn)
    np.testing.assert_allclose([np.rad2deg(one.drawn.start) for one in made], [0, 120, 240, 0])


def test_jobs_change_nothing_and_seeds_do() -> None:
    specification = pool_specification(moments=[0.2, 0.7, 1.2], repeats=1)
    first, parallel, other = (make_campaign(specification, 1), make_campaign(specification, 1, jobs=2),
                              make_campaign(specification, 2))  # fmt: skip
    for one, two, three in zip(first, parallel, other):
        np.testing.assert_array_equal(one.columns["heading_deg"], two.columns["heading_deg"])
        assert not np.array_equal(one.columns["heading_deg"][:30], three.columns["heading_deg"][:30])


def test_runs_made_in_memory_are_clean() -> None:
    runs = make_runs(pool_specification(logger={"rate_noise_deg_s": 0.5}), 1)
    assert len(runs) == 48
    for run in runs:
        assert np.abs(np.diff(run.position)).max() < 0.5  # unwrapped
        step = run.command != 0
        rate = np.gradient(run.position[step], run.time[step])
        assert np.median(run.extras["yaw_rate"][step] / rate) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("motion", ["yaw", "surge"])
def test_rates_have_a_bias_a_run_that_the_truth_tells(motion: str, tmp_path: Path) -> None:
    """Standard deviation as asked for, mean of reading less truth as told, and no other number changes."""
    key, noise, unit = ("rate", "noise_deg", "deg_s") if motion == "yaw" else ("speed", "noise_m", "m_s")
    held = {"kind": "step", "duration_s": 10.0, "repeats": 100}
    plain: dict[str, object] = {"schema": SCHEMA, "logger": {"rate_hz": 10, noise: 0.0}}
    if motion == "yaw":
        plain |= {"vehicle": {"I_r": 0.4, "k_rr": 1.2}, "runs": [held | {"moments": [1.0]}]}
    else:
        vehicle = {"motion": "surge", "m_u": 20.0, "X_uu": 30.0, "force_unit": "N"}
        plain |= {"vehicle": vehicle, "runs": [held | {"forces": [20.0]}]}
    sensed = {**plain, "logger": {"rate_hz": 10, noise: 0.0, f"{key}_noise_{unit}": 0.3, f"{key}_bias_{unit}": 0.5}}
    still = {**plain, "logger": {"rate_hz": 10, noise: 0.0, f"{key}_noise_{unit}": 0.0}}
    out = simulate(specification_from(sensed), out=tmp_path / "sensed", seed=3)
    true = make_campaign(specification_from(still), 3)
    base = "rad_s" if motion == "yaw" else "m_s"
    told = np.array([one[f"{key}_bias_{base}"] for one in out.to_json()["made"]])  # type: ignore[attr-defined]
    told = np.rad2deg(told) if motion == "yaw" else told
    assert np.std(told) == pytest.approx(0.5, rel=0.2) and abs(np.mean(told)) < 0.15
    column = "yaw_rate_deg_s" if motion == "yaw" else "surge_m_s"
    off = [one.columns[column] - other.columns[column] for one, other in zip(out.runs, true)]
    assert [np.mean(one) for one in off] == pytest.approx(told, abs=5 * 0.3 / np.sqrt(130))
    assert np.std(off - told[:, None]) == pytest.approx(0.3, rel=0.03)
    for one, other in zip(out.runs, true):
        np.testing.assert_array_equal(*(list(part.columns.values())[1] for part in (one, other)))
    (first, *_) = sorted((tmp_path / "sensed" / "runs").iterdir())
    assert first.read_text().splitlines()[1].split(",")[-1] == column


@pytest.mark.parametrize("name", [name for name in effects.names() if not effects.get(name).needs])
def test_any_effect_of_the_library_acts(name: str) -> None:
    settings = {"moments": [0.3, -1.1], "noise_deg": 0.0, "repeats": 1, "logger": {"wrap": "none"}}
    values = {YAW.fill(parameter.name): parameter.start for parameter in effects.get(name).parameters}
    plain = make_campaign(pool_specification(**settings), 1)
    hidden = make_campaign(pool_specification(effects=[{"name": name} | values], **settings), 1)
    apart = [
        np.abs(one.columns["heading_deg"] - other.columns["heading_deg"]).max() for one, other in zip(plain, hidden)
    ]
    assert np.all(np.isfinite(apart))
    assert 0.01 < max(apart) < 360.0
