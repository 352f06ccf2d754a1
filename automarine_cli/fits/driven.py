"""A model of one motion on driven runs: which of its parameters are searched how, and where fits of it start."""

from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from automarine_cli import effects
from automarine_cli.filters.course import Course
from automarine_cli.fits.innovations_problem import DrivenProblem, randomness
from automarine_cli.models.yaw_model import YawModel

Floats = NDArray[np.float64]

INERTIAS, DRAGS = (0.3, 1.0, 3.0), (0.3, 1.0, 3.0)
"""Shares of rough values from which fits of a base model start."""
SIZES, UNSTEADY = (0.02, 0.2), (0.005, 0.1)
"""Disturbances, as shares of the acceleration of the largest command, and noises of thrust, to start from."""


def driven_problem(
    model: YawModel, course: Course, *, least_delay: float = 0.0, slowest: float = np.inf, quiet: bool = False
) -> DrivenProblem:
    """Likelihood of `model` on `course`; delays of effects that are not its own are at least `least_delay` [s], what
    varies from run to run has periods of at most `slowest` [s]. `quiet`: see `randomness`."""
    largest = float(np.abs(course.held).max()) or 1.0
    bounds, positive, scale = [(0.0, np.inf)], [True], [1.0]
    for term in model.terms:
        effect = effects.get(term.name)
        for parameter, value, held in zip(effect.parameters, term.values, effect.held(term.values)):
            lower = max(parameter.lower, least_delay if effect.delays and not term.own else -np.inf)
            slow = slowest if parameter.scan and effect.varies(term.values) else np.inf
            bounds.append((value, value) if held else (lower, min(parameter.upper, slow)))
            positive.append(parameter.log)
            scale.append(max(parameter.scaled(parameter.start, largest), 1e-6))
    varying = [term.name for term in model.terms if effects.get(term.name).varies(term.values)]
    pushes = [largest / max(model.inertia, 1e-9)]
    random = randomness(course, pushes, varying, quiet)
    return DrivenProblem(
        model,
        course,
        (*model.parameter_names, *(one.name for one in random)),
        np.array([*bounds, *((one.lower, one.upper) for one in random)]),
        np.array([*positive, *[True] * len(random)]),
        np.array([*scale, *[1.0] * len(random)]),
        random,
    )


def base_starts(problem: DrivenProblem) -> Floats:
    """Starts of a base model about its own values, (S, p)."""
    model = problem.model
    assert isinstance(model, YawModel)
    starts, own = [], len(model.theta)
    middle = np.array([one.median for one in problem.random])
    push = float(np.abs(problem.course.held).max()) / max(model.inertia, 1e-9)
    for inertia, drag, size, unsteady in product(INERTIAS, DRAGS, SIZES, UNSTEADY):
        random = middle.copy()
        random[0], random[2] = size * push / inertia, unsteady
        starts.append([inertia * model.theta[0], *(drag * model.theta[1:own]), *random])
    return np.clip(np.array(starts), problem.bounds[:, 0], problem.bounds[:, 1])


def starts_near(problem: DrivenProblem, thetas: Sequence[Floats], random: dict[str, float]) -> Floats:
    """Starts (S, p) from values of the model's parameters and what is known of the random ones."""
    rest = [random.get(one.name, one.median) for one in problem.random]
    return np.clip(
        np.array([[*theta, *rest] for theta in thetas]), problem.bounds[:, 0], problem.bounds[:, 1]
    )
