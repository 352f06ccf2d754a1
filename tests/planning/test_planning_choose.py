"""A whole choice: sides even, start headings and voltages where they tell, turns of the tether, what is not reached."""

from dataclasses import replace

import numpy as np
import pytest

from automarine_cli.dofs import YAW
from automarine_cli.models.model import Model
from automarine_cli.models.store import StoredModels
from automarine_cli.planning.campaign import (
    NARROWS_INTERVALS,
    SHOWS_DRIFT,
    Plan,
    PlanBudget,
    choose,
    plan_campaign,
    ways_back,
)
from automarine_cli.planning.candidates import Limits, LoggerLimits, Moments, Pool, Runs, Supply
from automarine_cli.planning.information import Ambiguity, Intervals, PriorResults
from automarine_cli.planning.rivals import Discrimination, ModelPair
from automarine_cli.quantities import Floats

MODEL = Model.base("3", 1.018, [1.257], "nu", YAW)
LIMITS = Limits(
    pool=Pool(minutes=25, runs=12), moments=Moments(levels=3), logger=LoggerLimits(gain_scatter=0.03, noise_deg=1.0)
)


def planned(limits: Limits = LIMITS, model: Model = MODEL, doubts: tuple[Ambiguity, ...] = ()) -> Plan:
    prior = PriorResults(StoredModels({"3": MODEL}, "3", 0.0, "model"), model, {}, 1.0, 0.03, 0, doubts)
    return plan_campaign(prior, limits, 1.2, Supply(0.3, 6.0, 1.2))


def test_a_plain_plan() -> None:
    """Both sides alike, start headings in turn, no run turns far."""
    campaign = planned()
    sides = [np.sign(slot.candidate.commands[0][0]) for slot in campaign.slots if slot.why == NARROWS_INTERVALS]
    assert abs(sum(sides)) <= 1
    assert campaign.slots[0].why == campaign.slots[-1].why == SHOWS_DRIFT
    assert campaign.candidates[0].label == campaign.candidates[-1].label
    headings = [run.start_heading for run in campaign.candidates]
    assert headings == [90.0 * (i % 4) for i in range(len(campaign.slots))]
    assert not any(run.turns for run in campaign.candidates)


@pytest.mark.slow
def test_a_voltage_exponent_is_split_from_a_sag_by_runs_at_another_voltage() -> None:
    limits = replace(LIMITS, runs=Runs(voltages_V=(19.0,), kinds=("step", "other-voltage")))
    model = MODEL.with_effect("voltage-exponent", (1.2, 24.0))
    campaign = planned(limits, model, (Ambiguity("voltage-exponent", "battery-sag"),))
    assert any(run.kind == "other-voltage" for run in campaign.candidates)
    assert campaign.splits[0].evidence > 20.0
    assert campaign.notes == ()


@pytest.mark.slow
def test_what_the_limits_do_not_split_is_said() -> None:
    limits = replace(LIMITS, pool=Pool(minutes=4, runs=3), runs=Runs(kinds=("step", "coast-down")))
    campaign = planned(limits, MODEL.with_effect("thruster-lag", (0.06,)), (Ambiguity("thruster-lag", "input-delay"),))
    assert campaign.splits[0].evidence < 20.0
    assert campaign.notes[0].startswith("Not split within these limits: thruster-lag from input-delay")


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_whole_turns_of_the_tether_are_turned_back(sign: float) -> None:
    turned, headings = sign * np.array([1000.0, 400.0, -100.0, 30.0]), [0.0, 90.0, 180.0, 270.0]
    back = ways_back(turned, headings)
    twist = np.cumsum(back) + np.concatenate([[0.0], np.cumsum(turned[:-1])])
    assert back[0] == 0.0 and back[1] == 90.0 - sign * 1000.0 and np.abs(twist).max() <= 180.0
    assert np.allclose((twist - headings) % 360.0, 0.0)  # and each run starts where it should
    assert list(ways_back(sign * np.array([10.0, 0.0]), [0.0, 180.0])) == [
        0.0,
        sign * 170.0,
    ]  # either half turn will do


# Choices among nine places of a straight line

PLACES = np.linspace(-1.0, 1.0, 9)
LINE = np.stack([np.ones(9), PLACES], axis=1)
EACH = LINE[:, :, None] * LINE[:, None, :]


def shop(room: tuple[float, float, float, float], costs: Floats | None = None, most: float = 100.0) -> PlanBudget:
    cost = np.ones((9, 4)) if costs is None else costs
    return PlanBudget(
        cost, np.array(room), np.zeros(9), np.full(9, most), np.arange(9)[::-1].copy(), np.zeros((9, 1)), np.inf
    )


def intervals(wanted: Floats, goal: float | None = None) -> Intervals:
    return Intervals(EACH, 1e-6 * np.eye(2), wanted, goal)


def test_a_line_is_best_known_from_its_two_ends() -> None:
    """The D-optimal design of a straight line: half of the runs at each end (Fedorov 1972, section 2.3). For the
    intercept alone the places must only balance."""
    counts = choose(intervals(np.eye(2)), shop((10, 10, 10, 10)))
    assert counts.tolist() == [5, *[0] * 7, 5]
    counts = choose(intervals(np.eye(2)[:, :1]), shop((10, 10, 10, 10)))
    assert counts.sum() == 10 and counts @ PLACES == pytest.approx(0.0, abs=0.3)


@pytest.mark.parametrize("column", range(4))
def test_no_budget_is_overdrawn_and_none_left_that_a_run_fits_in(column: int) -> None:
    costs = np.random.default_rng(column).uniform(0.5, 2.0, (9, 4))
    room = np.full(4, 40.0)
    room[column] = 12.5
    market = shop(tuple(room), costs)  # type: ignore[arg-type]
    counts = choose(intervals(np.eye(2)), market)
    spent = counts @ costs
    assert np.all(spent <= room + 1e-9)
    assert room[column] - spent[column] < costs[:, column].max()


def test_a_goal_stops_the_choice_and_nothing_needless_is_kept() -> None:
    wanted = intervals(np.eye(2), goal=0.5)
    counts = choose(wanted, shop((100, 100, 100, 100)))
    assert wanted.reached(counts.astype(float))
    for out in np.flatnonzero(counts):
        assert not wanted.reached(counts - np.eye(9)[out])


def test_fixed_runs_stay_and_no_run_is_repeated_more_than_allowed() -> None:
    market = replace(shop((10, 10, 10, 10), most=3.0), fixed=np.eye(9)[4] * 2.0)
    counts = choose(intervals(np.eye(2)), market)
    assert counts[4] >= 2 and counts.max() <= 3 and counts.sum() == 10


def test_a_line_and_a_parabola_are_split_where_they_differ() -> None:
    """The straight line is fitted to a parabola: the squared misfit of x² at -1, 0 and 1 is 2/3 (by least squares)."""
    curved = PLACES**2
    contest = ModelPair(curved**2, LINE * curved[:, None], EACH, 1e-9 * np.eye(2))
    three = np.zeros(9)
    three[[0, 4, 8]] = 1.0
    assert contest.misfit(three[None])[0] == pytest.approx(2.0 / 3.0, rel=1e-6)
    split = Discrimination((contest,), np.array([2.0]))
    counts = choose(split, shop((40, 40, 40, 40)))
    assert split.reached(counts.astype(float))
    assert counts.sum() <= 9  # T-optimal: a quarter at each end, half in the middle, 8 runs for 2.0
    assert set(np.flatnonzero(counts)) == {0, 4, 8}
