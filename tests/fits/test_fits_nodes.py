"""Half-turns at nodes: the same sums of squares, derivatives and estimates as with every sample."""

from functools import cache

import numpy as np
import pytest
from made_campaigns import ODD_MOMENTS, PAPER, Vehicle, both_ways, campaign
from made_runs import mirrored

from automarine_cli.dofs import YAW
from automarine_cli.fits import half_turns as room
from automarine_cli.fits import whole_runs
from automarine_cli.fits.half_turns import COUNTS, StepData, half_turn_data, nodes_of, step_data, step_problem
from automarine_cli.fits.known import Known
from automarine_cli.fits.mixed_model import Problem, derivatives
from automarine_cli.fits.whole_runs import fit_half_turns
from automarine_cli.models.closed_form import response
from automarine_cli.runs.half_turn import half_turns

START = (1.2, 1.0, 1.0)


VEHICLES = {"1": Vehicle(1.0, 1.0, 0.0), "2": Vehicle(1.0, 0.3, 1.0), "3": PAPER}


@cache
def _logged(number: str, side: str) -> StepData:
    runs = campaign(seed=3, gain_scatter=0.05, period=0.01, vehicle=VEHICLES[number])
    turns, _ = half_turns(runs if side == "as it is" else [mirrored(run) for run in runs])
    return half_turn_data(turns)


@pytest.fixture(params=["as it is", "mirrored"])
def fast_logged(request: pytest.FixtureRequest, number: str) -> StepData:
    """Twelve half-turns at 100 Hz, which have hundreds of samples each, of a vehicle of model `number`."""
    return _logged(number, request.param)


def both(data: StepData, number: str) -> tuple[Problem, Problem]:
    nodes = data.nodes(COUNTS[0])
    assert nodes is not None and nodes[0].time.shape[1] < data.time.shape[1] / 5
    return step_problem(data, number), step_problem(data, number, nodes=nodes)


@pytest.mark.parametrize("number", "123")
def test_sums_of_squares_and_derivatives_are_those_of_all_samples(fast_logged: StepData, number: str) -> None:
    whole, short = both(fast_logged, number)
    theta = np.array([1.0, *{"1": (1.0,), "2": (1.1, 0.1), "3": (1.25,)}[number], 0.3])
    rng = np.random.default_rng(5)
    b = 0.1 * rng.standard_normal(whole.effects.scale.shape)
    phi = whole.search(theta)
    grams = [p.gram(j, v, f, b).at(np.zeros(3)) for p in (whole, short) for f, j, v in (derivatives(p, phi, b),)]
    for part in ("jj", "jv", "vv", "jw", "vw", "ww", "count"):
        one, other = (getattr(gram, part) for gram in grams)
        assert other == pytest.approx(one, rel=1e-5, abs=1e-6 * np.abs(one).max()), part


@pytest.mark.parametrize("number", "123")
def test_a_fit_at_nodes_is_the_fit_to_all_samples(
    fast_logged: StepData, number: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    short = fit_half_turns(fast_logged, number, START, "nu", Known())
    monkeypatch.setattr(whole_runs, "COUNTS", ())
    whole = fit_half_turns(fast_logged, number, START, "nu", Known())
    for name, estimate in whole.estimates.items():
        found = short.estimates[name]
        assert abs(found.value - estimate.value) < 1e-2 * estimate.stderr
        assert found.stderr == pytest.approx(estimate.stderr, rel=1e-2)
    assert short.mixed.fitted.shape == fast_logged.heading.shape
    off = np.where(fast_logged.seen, short.mixed.fitted - whole.mixed.fitted, 0.0)
    assert np.abs(off).max() < 0.05 * whole.noise
    assert short.mixed.log_likelihood == pytest.approx(whole.mixed.log_likelihood, rel=1e-6)
    assert short.mixed.predictive == pytest.approx(whole.mixed.predictive, rel=1e-3)


def sharp(inertia: float, seconds: float = 8.0) -> StepData:
    """Steps of a vehicle that is at its steady rate after a small part of them."""
    time = np.arange(-0.995, seconds, 0.01)
    moments = (0.5, 0.7, 1.0, -0.5, -0.7, -1.0)
    rng = np.random.default_rng(2)
    turned = [
        response(time, moment, inertia, 0.0, PAPER.k_rr)[0] + np.radians(0.5) * rng.standard_normal(len(time))
        for moment in moments
    ]
    return step_data([str(m) for m in moments], [time] * 6, turned, moments, [0.01] * 6, YAW)


@pytest.mark.parametrize("inertia", [1.0, 0.12, 0.03])
def test_as_many_nodes_are_taken_as_the_answer_needs(inertia: float, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []
    original = StepData.nodes

    def noted(self: StepData, count: int) -> room.Nodes | None:
        asked.append(count)
        return original(self, count)

    monkeypatch.setattr(StepData, "nodes", noted)
    data = sharp(inertia)
    short = fit_half_turns(data, "3", (2.0 * inertia, 1.0, 1.0), "nu", Known())
    assert (len(asked) > 1) == (inertia < 0.5)
    monkeypatch.setattr(whole_runs, "COUNTS", ())
    whole = fit_half_turns(data, "3", (2.0 * inertia, 1.0, 1.0), "nu", Known())
    for name, estimate in whole.estimates.items():
        assert abs(short.estimates[name].value - estimate.value) < 1e-2 * estimate.stderr


def test_interpolation_is_as_exact_as_it_says() -> None:
    """Headings of a model reduce to its headings at the nodes times the roots of the weights, and leave nothing."""
    data = sharp(1.0)
    (fast,) = data.nodes(COUNTS[0]) or ()
    exact = np.stack([response(data.time[i], m, 1.0, 0.0, PAPER.k_rr)[0] for i, m in enumerate(data.moment)])
    at_nodes = np.stack([response(fast.time[i], m, 1.0, 0.0, PAPER.k_rr)[0] for i, m in enumerate(data.moment)])
    reduced = nodes_of(data.time, exact, data.seen, data.interval, COUNTS[0])
    carried = fast.root * at_nodes
    off = np.sqrt(((carried - reduced.heading) ** 2).sum(axis=1) + reduced.left)
    assert off.max() / np.sqrt(data.time.shape[1]) < room.CLOSE_ENOUGH
    assert fast.show(carried, data.seen.sum(axis=1))


def test_short_runs_keep_their_samples() -> None:
    turns, _ = half_turns(campaign(seed=1))
    data = half_turn_data(turns)
    few = data.seen.sum(axis=1).max()
    assert data.nodes(int(few)) is None


@pytest.mark.parametrize("number", "23")
@pytest.mark.parametrize("side", ["as it is", "mirrored"])
def test_many_runs_fitted_in_two_steps_are_fitted_as_in_one(
    number: str, side: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs = campaign(3 * tuple(both_ways(ODD_MOMENTS)), seed=4, gain_scatter=0.05, vehicle=VEHICLES[number])
    data = half_turn_data(half_turns(runs if side == "as it is" else [mirrored(run) for run in runs])[0])
    once = fit_half_turns(data, number, START, "nu", Known())
    monkeypatch.setattr(whole_runs, "MANY_RUNS", 35)
    monkeypatch.setattr(whole_runs, "ITERATIONS_OF_MANY", 60)  # few runs take as many as they take at once
    asked: list[int] = []
    some = StepData.some
    monkeypatch.setattr(StepData, "some", lambda self, count: asked.append(count) or some(self, count))
    twice = fit_half_turns(data, number, START, "nu", Known())
    assert asked == [17]
    for name, estimate in once.estimates.items():
        assert abs(twice.estimates[name].value - estimate.value) < 2e-2 * estimate.stderr


def test_some_runs_are_drawn_from_both_sides_and_keep_their_order() -> None:
    data = _logged("3", "as it is")
    few = data.some(6)
    places = [data.names.index(name) for name in few.names]
    assert places == sorted(places) and len(set(places)) == 6
    assert few.moment == pytest.approx(data.moment[places]) and len(set(np.sign(few.moment))) == 2
    assert data.some(99) is data
