"""A whole choice: sides kept even, start headings and voltages where they tell, and what is not reached is said."""

from dataclasses import replace

import numpy as np
import pytest

from automarine_cli.dofs import YAW
from automarine_cli.models.store import StoredModels
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.planning.campaign import DRIFT, NARROW, Campaign, plan_campaign
from automarine_cli.planning.candidates import Limits, Logger, Moments, Pool, Runs, Supply
from automarine_cli.planning.information import Doubt, PriorResults

MODEL = YawModel.base("3", 1.018, [1.257], "nu", YAW)
LIMITS = Limits(
    pool=Pool(minutes=25, runs=12), moments=Moments(levels=3), logger=Logger(gain_scatter=0.03, noise_deg=1.0)
)


def planned(limits: Limits = LIMITS, model: YawModel = MODEL, doubts: tuple[Doubt, ...] = ()) -> Campaign:
    known = PriorResults(StoredModels({"3": MODEL}, "3", "nu", 0.0, "model", YAW), model, {}, None, None, 0, doubts)
    return plan_campaign(known, limits, 1.2, Supply(0.3, 6.0, 1.2))


@pytest.fixture(scope="module")
def plain() -> Campaign:
    return planned()


def test_as_many_runs_to_one_side_as_to_the_other(plain: Campaign) -> None:
    own = [1 if one.candidate.commands[0][0] > 0 else -1 for one in plain.slots if one.why == NARROW]
    assert abs(sum(own)) <= 1
    assert plain.slots[0].why == plain.slots[-1].why == DRIFT
    assert plain.candidates[0].label == plain.candidates[-1].label


@pytest.mark.parametrize("percent", [50.0, 34.0])
def test_not_all_runs_are_of_one_size(percent: float) -> None:
    """Quadratic drag alone is best known from the largest moment; how drag grows is told by other sizes only."""
    made = planned(replace(LIMITS, pool=Pool(minutes=25, runs=16), runs=Runs(of_one_size_percent=percent)))
    largest = [max(abs(moment) for moment, _ in one.commands) for one in made.candidates if one.kind != "rest"]
    times = np.unique(largest, return_counts=True)[1]
    assert len(largest) >= 12 and times.max() <= np.ceil(16 * percent / 100)
    assert len(times) >= (2 if percent == 50 else 3)


def test_runs_of_one_size_are_few_whatever_is_wanted() -> None:
    """Only the inertia asked for, of steps to be fitted as half-turns: still several sizes."""
    runs = Runs(kinds=("step",), fit="half-turns", most_alike=100)
    made = [planned(replace(LIMITS, runs=replace(runs, of_one_size_percent=share))) for share in (100.0, 50.0)]
    sizes = [np.unique([abs(one.commands[0][0]) for one in each.candidates], return_counts=True)[1] for each in made]
    assert sizes[0].max() > 6 >= sizes[1].max(), "what the limit is for"


def test_start_headings_come_in_turn_and_no_run_turns_far(plain: Campaign) -> None:
    assert [one.start_heading for one in plain.candidates] == [90.0 * (i % 4) for i in range(len(plain.slots))]
    assert not any(one.turns for one in plain.candidates)


def test_the_plan_needs_less_of_the_pool_than_the_grid_for_the_same_inertia(plain: Campaign) -> None:
    reached = [
        m
        for m, e in zip(plain.plan.minutes, plain.plan.stderr_percent["I_r"])
        if e <= plain.grid.stderr_percent["I_r"][23]
    ]
    assert reached and reached[0] < plain.grid.minutes[23]


def test_one_run_more_of_any_kind_never_widens(plain: Campaign) -> None:
    for curve in plain.more:
        for name, (value,) in curve.stderr_percent.items():
            assert value <= plain.plan.stderr_percent[name][-1] * (1 + 1e-9)


@pytest.mark.slow
def test_a_voltage_exponent_is_split_from_a_sag_by_runs_at_another_voltage() -> None:
    limits = replace(LIMITS, runs=Runs(voltages_V=(19.0,), kinds=("step", "other-voltage")))
    model = MODEL.with_effect("voltage-exponent", (1.2, 24.0))
    made = planned(limits, model, (Doubt("voltage-exponent", "battery-sag"),))
    assert any(one.kind == "other-voltage" for one in made.candidates)
    assert made.splits[0].evidence > 20.0 > made.grid_splits[0].evidence
    assert made.notes == ()


def test_what_the_limits_do_not_split_is_said() -> None:
    limits = replace(LIMITS, pool=Pool(minutes=4, runs=3), runs=Runs(kinds=("step", "coast-down")))
    made = planned(limits, MODEL.with_effect("thruster-lag", (0.06,)), (Doubt("thruster-lag", "input-delay"),))
    assert made.splits[0].evidence < 20.0
    assert made.notes[0].startswith("Not split within these limits: thruster-lag from input-delay")
