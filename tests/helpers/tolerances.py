"""How close is close, by keyword: each pair of limits stands here once, with the reason for it."""

import numpy as np
from numpy.typing import ArrayLike

TOLERANCES = {  # relative and absolute, either of which may hold
    "same arithmetic": (1e-12, 1e-12),  # the same sum in another order: round-off of a few hundred operations
    "closed form": (1e-9, 1e-9),  # two algebraic forms of one solution: round-off of exp, log and their quotients
    "differences": (1e-5, 1e-6),  # derivatives by differences of 1e-5: their third derivative, and round-off
    "optimiser": (1e-5, 1e-8),  # a minimum found by steps: flat to the square root of round-off
    "solve_ivp": (1e-6, 1e-7),  # scipy's solver at rtol 1e-9, over some hundred steps
    "rollout": (1e-4, 1e-5),  # fixed steps of fourth order, sub-stepped to the dynamics, over one run [rad]
    "corners": (0.0, 5e-6),  # steps of 10 ms where velocities change sign: |v| v has a corner, which no step ends at
    "printed": (0.0, 5e-4),  # half a unit of the last digit in a table that prints three decimals
    "paper": (2e-3, 0.0),  # the paper prints four digits and rounds on the way
}


def assert_close(found: ArrayLike, expected: ArrayLike, keyword: str) -> None:
    """`found` equals `expected`, of any shape, within the tolerance of that name."""
    rel, absolute = TOLERANCES[keyword]
    np.testing.assert_allclose(found, expected, rtol=rel, atol=absolute, err_msg=keyword)
