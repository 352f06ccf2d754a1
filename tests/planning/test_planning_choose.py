"""Which runs are chosen: designs known from theory, budgets kept to the last run, goals, and sides kept even."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from automarine_cli.planning.campaign import PlanBudget, choose
from automarine_cli.planning.information import Intervals
from automarine_cli.planning.rivals import Contest, Splitting

Floats = NDArray[np.float64]

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
    """The D-optimal design of a straight line: half of the runs at each end (Fedorov 1972, section 2.3)."""
    counts = choose(intervals(np.eye(2)), shop((10, 10, 10, 10)))
    assert counts[[0, -1]].tolist() == [5, 5]
    assert counts.sum() == 10


def test_for_the_intercept_alone_the_places_must_only_balance() -> None:
    counts = choose(intervals(np.eye(2)[:, :1]), shop((10, 10, 10, 10)))
    assert counts.sum() == 10
    assert counts @ PLACES == pytest.approx(0.0, abs=0.3)


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
    assert counts[4] >= 2
    assert counts.max() <= 3
    assert counts.sum() == 10


def test_the_choice_is_the_same_each_time() -> None:
    found = [choose(intervals(np.eye(2)), shop((17, 17, 17, 17))) for _ in range(2)]
    assert found[0].tolist() == found[1].tolist()


def test_a_dear_run_is_chosen_only_for_its_worth() -> None:
    """At the ends a run costs three times as much: for the intercept they are not worth it."""
    costs = np.ones((9, 4))
    costs[[0, -1]] = 3.0
    counts = choose(intervals(np.eye(2)[:, :1]), shop((12, 12, 12, 12), costs))
    assert counts[[0, -1]].sum() == 0
    assert counts.sum() == 12


def test_a_line_and_a_parabola_are_split_where_they_differ() -> None:
    """The straight line is fitted to a parabola: the squared misfit of x² at -1, 0 and 1 is 2/3 (by least squares)."""
    curved = PLACES**2
    contest = Contest(curved**2, LINE * curved[:, None], EACH, 1e-9 * np.eye(2))
    three = np.zeros(9)
    three[[0, 4, 8]] = 1.0
    assert contest.misfit(three[None])[0] == pytest.approx(2.0 / 3.0, rel=1e-6)
    split = Splitting((contest,), np.array([2.0]))
    counts = choose(split, shop((40, 40, 40, 40)))
    assert split.reached(counts.astype(float))
    assert counts.sum() <= 9  # T-optimal: a quarter at each end, half in the middle, 8 runs for 2.0
    assert set(np.flatnonzero(counts)) == {0, 4, 8}
