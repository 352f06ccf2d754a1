"""Runs that stood still or went against their moment where others moved are set aside; both ways alike."""

from dataclasses import replace

import numpy as np
import pytest
from made_runs import mirrored, step_run

from automarine_cli.runs.checks import without_stuck
from automarine_cli.runs.half_turn import without_contrary
from automarine_cli.runs.run import Run


def still(moment: float, name: str, seed: int = 0) -> Run:
    """A run whose thrusters did not start: noise about one heading."""
    made = step_run(moment, seed=seed)
    noise = np.radians(1.0) * np.random.default_rng(seed).normal(size=len(made))
    return replace(made, position=0.7 + noise, name=name)


def named(run: Run, name: str) -> Run:
    return replace(run, name=name)


def both_ways(runs: list[Run]) -> list[list[Run]]:
    """The runs, and the same turning the other way."""
    return [runs, [replace(mirrored(run), name=run.name) for run in runs]]


def test_a_run_that_others_outdo_with_less_is_stuck() -> None:
    campaign = [named(step_run(0.5), "moved"), still(0.5, "as much"), still(0.8, "more"), still(0.3, "less")]
    for runs, moment in zip(both_ways(campaign), ("0.5", "-0.5")):
        moving, aside = without_stuck(runs)
        assert [run.name for run in moving] == ["moved", "less"]  # 0.3 may lie within a dead band
        assert [run.run for run in aside] == ["as much", "more"]
        assert all("though run moved did under no more; check thrusters" in run.why for run in aside)
        assert f"a moment of {moment} nu" in aside[0].why


@pytest.mark.parametrize(
    "other",
    [
        still(0.5, "other"),  # nothing moves: a dead band, or a tether, and no fault of one run
        named(mirrored(step_run(0.5)), "other"),  # the other side says nothing of this one
        named(step_run(0.7), "other"),  # more moment may do what less does not
        named(step_run(0.5, length=60.0), "other"),  # and so may more time
    ],
)
def test_what_has_no_weaker_run_that_moved_is_kept(other: Run) -> None:
    for runs in both_ways([still(0.5, "still"), other]):
        assert without_stuck(runs) == (runs, ())


def test_a_vehicle_that_holds_its_heading_is_not_stuck() -> None:
    held = still(0.5, "held")
    driven = np.where(np.arange(len(held)) % 7 < 3, 0.5, -0.4)
    moving, aside = without_stuck([replace(held, moment=driven), named(step_run(0.3), "moved")])
    assert len(moving) == 2 and aside == ()


def contrary(run: Run) -> Run:
    """The run with its headings mirrored, not its moment: the log's sign is wrong."""
    return replace(run, position=-run.position, name="contrary")


def test_a_run_that_went_against_its_moment_where_others_went_with_as_little_is_set_aside() -> None:
    others = [named(step_run(0.3), "small"), named(step_run(0.5), "same"), named(mirrored(step_run(0.2)), "back")]
    for runs in both_ways([*others, contrary(step_run(0.5, seed=3))]):
        sound, aside = without_contrary(runs)
        assert [run.name for run in sound] == ["small", "same", "back"]
        assert [run.run for run in aside] == ["contrary"]
        assert aside[0].why.startswith("units look wrong: the step of") and "sign = -1" in aside[0].why


@pytest.mark.parametrize(
    "others",
    [
        [step_run(0.7), step_run(0.9)],  # less moment may be turned round by a moment that is always there
        [mirrored(step_run(0.5)), mirrored(step_run(0.3))],  # which is on the other side's steps as well
        [step_run(0.5)],  # one against one: who is to say which?
        [],
    ],
)
def test_a_run_that_went_against_its_moment_is_kept_where_the_vehicle_may_have_done_it(others: list[Run]) -> None:
    for runs in both_ways([contrary(step_run(0.5)), *others]):
        assert without_contrary(runs) == (runs, ())
