"""Errors of a search that ends at a limit of one of its parameters."""

import numpy as np
import pytest

from automarine_cli.fits.linear_mixed import bounded_solution
from automarine_cli.fits.optimise import Point
from automarine_cli.models.parameter import Parameter, Parameters
from automarine_cli.quantities import Floats

CURVATURE = np.array([[4.0, 1.6], [1.6, 1.0]])
PARAMETERS = Parameters([Parameter("first", 0.0, lower=0.0), Parameter("second", 0.0)])


def stderr(maximum: Floats) -> tuple[Floats, float]:
    """Where a search for the maximum (2,) of a parabola ends within the bounds, and the error of its second place."""
    phi = bounded_solution(CURVATURE, CURVATURE @ maximum, PARAMETERS.limits)
    point = Point(phi, 0.0, CURVATURE @ (maximum - phi), CURVATURE, None)
    _, covariance, _ = point.spread(np.arange(2), PARAMETERS)
    return phi, float(np.sqrt(covariance[1, 1]))


def test_no_error_jumps_where_a_limit_is_reached() -> None:
    beside, at = stderr(np.array([1e-6, 2.0]))[1], stderr(np.array([-1e-6, 2.0]))[1]
    assert at == pytest.approx(beside, rel=1e-5)
    further = [stderr(np.array([-far, 2.0]))[1] for far in (0.5, 1.0, 2.0, 1e3)]
    assert np.all(np.diff(further) < 0.0)
    assert further[-1] == pytest.approx(1.0, rel=1e-3)  # as if the first were known


def test_what_a_limit_stops_is_neither_free_nor_known() -> None:
    """Intervals hold the truth as often as they say, also where the search ended at the limit: of a first parameter
    that may be anything up to three errors inside it."""
    random = np.random.default_rng(5)
    root = np.linalg.cholesky(np.linalg.inv(CURVATURE))
    inside, at_limit, as_known = [], [], []
    for _ in range(4000):
        truth = np.array([random.uniform(0.0, 3.0) * np.hypot(*root[0]), 0.0])
        phi, error = stderr(truth + root @ random.standard_normal(2))
        (at_limit if phi[0] < 1e-9 else inside).append(abs(phi[1]) < 1.96 * error)
        if phi[0] < 1e-9:
            as_known.append(abs(phi[1]) < 1.96)
    assert 0.94 < np.mean(inside) < 0.96
    assert 0.93 < np.mean(at_limit) < 0.97
    assert np.mean(as_known) < 0.92
