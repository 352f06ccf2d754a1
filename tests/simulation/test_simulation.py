"""The simulator against closed forms and scipy's solver, its order, and everything a log's clock may do."""

from dataclasses import replace

import numpy as np
import pytest
from made_runs import INERTIA, K_RR, mirrored, solved, step_run
from made_sequences import sequence_run
from numpy.typing import NDArray
from tolerances import assert_close

from automarine_cli.dofs import YAW
from automarine_cli.errors import RunError
from automarine_cli.models.model import BASE_TERMS, Model, response
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import make_batch
from automarine_cli.simulation.rollout import Start, simulate, step_for

Floats = NDArray[np.float64]
DRAGS = {"1": (0.9,), "2": (0.8, 0.3), "3": (K_RR,)}


def model(number: str = "3") -> Model:
    return Model.base(number, INERTIA, DRAGS[number], "nu", YAW)


def drags(number: str) -> dict[str, float]:
    return dict(zip(("k_r", "k_rr"), model(number).drag()))


def run_of(time: Floats, moment: Floats | float) -> Run:
    return Run("run", "run.csv", time, np.zeros(len(time)), np.broadcast_to(moment, time.shape).copy(), "nu", dof=YAW)


def headings(number: str, run: Run, step: float = 0.02, **start: object) -> Floats:
    return simulate(model(number), make_batch([run], step), start=Start(**start)).position[0, 0]  # type: ignore[arg-type]


@pytest.mark.parametrize("number", tuple(BASE_TERMS))
@pytest.mark.parametrize("moment", [-1.2, -0.1, 0.4])
def test_constant_moment_against_the_closed_form(number: str, moment: float) -> None:
    run, rates = run_of(np.arange(0, 9, 0.1), moment), np.array([[-0.6], [0.0], [0.6]])
    batch = make_batch([run], step_for(model(number), moment))
    trajectory = simulate(model(number), batch, start=Start(0.3, rates))
    for p, (rate0,) in enumerate(rates):
        heading = 0.3 + solved((0.0,), (moment,), run.time, **drags(number), rate0=rate0)
        assert_close(trajectory.position[p, 0], heading, "rollout")
    heading, rate = response(run.time, moment, INERTIA, **drags(number))
    assert_close(trajectory.position[1, 0], 0.3 + heading, "rollout")
    assert_close(trajectory.velocity[1, 0], rate, "rollout")


@pytest.mark.parametrize("number", tuple(BASE_TERMS))
def test_order_of_convergence_is_four(number: str) -> None:
    run = run_of(np.arange(0, 6.5, 0.8), 0.9)
    exact = response(run.time, 0.9, INERTIA, **drags(number))[0]
    errors = [np.abs(headings(number, run, step) - exact).max() for step in (0.4, 0.2, 0.1, 0.05)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all((orders > 3.6) & (orders < 4.6)), orders


@pytest.mark.parametrize("number", tuple(BASE_TERMS))
def test_step_for_keeps_a_hundredth_of_a_degree(number: str) -> None:
    for moment in (0.05, 0.5, 5.0):
        run = run_of(np.arange(0, 8, 0.5), moment)
        exact = response(run.time, moment, INERTIA, **drags(number))[0]
        off = headings(number, run, step_for(model(number), moment)) - exact
        assert np.rad2deg(np.abs(off)).max() < 0.01


def test_uneven_clock_gap_and_shift() -> None:
    rng = np.random.default_rng(3)
    time = np.cumsum(rng.uniform(0.02, 0.25, 60)) + 1e5
    time[30:] += 3.0
    run = run_of(time, 0.7)
    exact = response(time - time[0], 0.7, INERTIA, 0.0, K_RR)[0]
    assert_close(headings("3", run), exact, "rollout")
    later = replace(run, time=run.time + 1000.0)
    np.testing.assert_allclose(headings("3", later), headings("3", run), rtol=0, atol=1e-9)
    batch = make_batch([run], 0.05)
    np.testing.assert_allclose(batch.time[0], time - time[0], atol=1e-9)
    assert batch.length.max() <= 0.05 + 1e-9


@pytest.mark.parametrize("share", [-0.5, 0.0, 0.31, 0.5])
def test_the_instant_of_a_switch_moves(share: float) -> None:
    """By default the command changes in the middle of the interval; a shift moves it, the samples stay."""
    run = run_of(0.4 * np.arange(25), np.where(np.arange(25) > 4, 0.8, 0.0))
    switch, shift = 0.4 * (4.5 + share), np.full((1, 1, 1), 0.4 * share)
    moved = headings("3", run, switch_delay=shift)
    assert_close(moved, response(run.time - switch, 0.8, INERTIA, 0.0, K_RR)[0], "rollout")
    np.testing.assert_array_equal(headings("3", mirrored(run), switch_delay=shift), -moved)


def test_mirrored_runs_turn_the_other_way() -> None:
    runs = [step_run(0.5), sequence_run()]
    there = simulate(model(), make_batch(runs, 0.05), start=Start(0.2, -0.1)).position
    back = simulate(model(), make_batch([mirrored(r) for r in runs], 0.05), start=Start(-0.2, 0.1)).position
    np.testing.assert_array_equal(back, -there)


def test_gain_and_disturbance_act_on_the_moment() -> None:
    time = np.arange(0, 5, 0.1)
    stronger = headings("3", run_of(time, 0.4), log_gain=np.full((1, 1), np.log(2.0)))
    np.testing.assert_allclose(stronger, headings("3", run_of(time, 0.8)), rtol=0, atol=1e-12)
    batch = make_batch([run_of(time, 0.4)], 0.02)
    pushed = simulate(model(), batch, start=Start(disturbance=np.full((1, 1, batch.windows), 0.3)))
    np.testing.assert_allclose(pushed.position[0, 0], headings("3", run_of(time, 0.7)), rtol=0, atol=1e-12)


def test_refusals() -> None:
    run = step_run(0.5)
    with pytest.raises(RunError, match="no runs to simulate"):
        make_batch([], 0.1)
    with pytest.raises(RunError, match="different units"):
        make_batch([run, replace(run, moment_unit="N m")], 0.1)
    with pytest.raises(RunError, match="needs column voltage_V, which the log lacks"):
        make_batch([run], 0.1, ("voltage",))
    with pytest.raises(RunError, match="no yaw moment"):
        make_batch([replace(run, moment=None)], 0.1)
