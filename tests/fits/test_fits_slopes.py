"""Derivatives of the steps' likelihood by formula against differences: models, sides, a constant force, velocities."""

from dataclasses import replace

import numpy as np
import pytest

from automarine_cli.dofs import HEAVE, YAW, Dof
from automarine_cli.fits.half_turns import COUNTS, StepData, step_data, step_problem
from automarine_cli.fits.known import Known
from automarine_cli.fits.mixed_model import Problem, derivatives, fit_mixed
from automarine_cli.models.closed_form import response

MOMENTS = np.array([0.4, -0.4, 0.8, -0.8, 1.1, -1.1])


def steps(dof: Dof, velocities: bool) -> StepData:
    """Steps with a degree of noise, and velocities of nothing else: they play no part in the derivatives."""
    rng = np.random.default_rng(4)
    times = [np.arange(-1.05, 5.0 + 0.3 * i, 0.02) for i in range(len(MOMENTS))]
    noises = [0.02 * rng.standard_normal(len(t)) for t in times]
    positions = [response(t, tau, 1.0, 0.0, 1.2)[0] + noise for t, tau, noise in zip(times, MOMENTS, noises)]
    data = step_data([f"run {i}" for i in range(len(times))], times, positions, MOMENTS, [0.1] * len(times), dof)
    return data.rated([rng.standard_normal(len(t)) for t in times]) if velocities else data


def assert_same(problem: Problem, seed: int) -> None:
    rng = np.random.default_rng(seed)
    assert problem.slopes is not None
    theta = np.where(problem.positive, 1.1, 0.1) * rng.uniform(0.8, 1.2, len(problem.names))
    phi, b = problem.search(theta), 0.1 * rng.standard_normal(problem.effects.scale.shape)
    exact, near = derivatives(problem, phi, b), derivatives(replace(problem, slopes=None), phi, b)
    for one, other in zip(exact, near):
        assert np.isfinite(one).all()
        assert np.abs(one - other).max() < 2e-5 * np.abs(other).max()


@pytest.mark.parametrize("number", "123")
@pytest.mark.parametrize("sided", [False, True])
@pytest.mark.parametrize("velocities", [False, True])
@pytest.mark.parametrize("dof", [YAW, HEAVE], ids=lambda dof: dof.name)
def test_derivatives_are_those_by_differences(number: str, sided: bool, velocities: bool, dof: Dof) -> None:
    data = steps(dof, velocities)
    for nodes in (None, data.nodes(COUNTS[0])):
        assert_same(step_problem(data, number, Known(), nodes, sided), seed=7)


def test_a_side_without_drag_still_has_derivatives() -> None:
    problem = step_problem(steps(YAW, False), "3", sided=True)
    phi = problem.search(np.array([1.0, 0.5, -0.8, 0.0]))  # less than none one way
    b = np.zeros_like(problem.effects.scale)
    exact, near = derivatives(problem, phi, b), derivatives(replace(problem, slopes=None), phi, b)
    for one, other in zip(exact, near):
        assert np.abs(one - other).max() < 1e-4 * np.abs(other).max()


def test_a_known_instant_is_held_with_either() -> None:
    data = steps(YAW, False)
    problem = step_problem(data, "3", Known(switch_instant=True))
    theta, factors = np.array([1.1, 1.0, 0.0]), np.array([0.03, 0.5])
    both = (problem, replace(problem, slopes=None))
    one, other = (fit_mixed(one, theta, noise=0.02, factors=factors) for one in both)
    error = np.sqrt(np.diagonal(other.covariance))[:2]
    assert np.all(np.abs(one.phi - other.phi)[:2] < 1e-3 * error)
    assert one.theta[2] == 0.0
