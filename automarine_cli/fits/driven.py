"""A model of one motion on driven runs: which of its parameters are searched how, and where fits of it start."""

from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from automarine_cli import effects
from automarine_cli.dofs import Dof
from automarine_cli.errors import SettingError
from automarine_cli.filters.course import Course, make_course
from automarine_cli.fits.innovations import fit_innovations
from automarine_cli.fits.innovations_problem import DrivenProblem, randomness
from automarine_cli.models.yaw_model import YawModel, base_roles
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import Run
from automarine_cli.runs.steps import segments

INERTIAS, DRAGS = (0.3, 1.0, 3.0), (0.3, 1.0, 3.0)
"""Shares of rough values from which fits of a base model start."""
SIZES, UNSTEADY = (0.02, 0.2), (0.005, 0.1)
"""Disturbances, as shares of the acceleration of the largest command, and noises of thrust, to start from."""


SURE = 10.0
"""Deviance beyond its penalty that a disturbance has to gain."""


ENOUGH = 16
"""Runs that show whether there is one."""
HELD, NEARLY = 1.0, 0.8
"""Seconds for which a run holds its command, and share of the run that such stretches make."""


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
            lower = max(parameter.lower, least_delay if effect.shifts(term.values) and not term.own else -np.inf)
            slow = slowest if parameter.scan and effect.varies(term.values) else np.inf
            bounds.append((value, value) if held else (lower, min(parameter.upper, slow)))
            positive.append(parameter.log)
            scale.append(max(parameter.scaled(parameter.start, largest), 1e-6))
    varying = [term.name for term in model.terms if effects.get(term.name).varies(term.values)]
    pushes = [largest / max(model.inertia, 1e-9)]
    delayed = any(effects.get(term.name).delays for term in model.terms)
    random = randomness(course, pushes, varying, quiet, delayed)
    return DrivenProblem(
        model,
        course,
        (*model.parameter_names, *(one.name for one in random)),
        np.array([*bounds, *((one.lower, one.upper) for one in random)]),
        np.array([*positive, *(not one.signed for one in random)]),
        np.array([*scale, *[1.0] * len(random)]),
        random,
    )


def wanted_effects(names: Sequence[str], dof: Dof) -> tuple[str, ...]:
    """The effects that a fit is to have beside drag. Raises SettingError for what is none, or has a place already."""
    if not names:
        return ()
    may = [
        name for name in effects.names()
        if effects.get(name).acts_in(dof) and not effects.get(name).role and not effects.get(name).needs
        and not effects.get(name).per_run
    ]  # fmt: skip
    for name in names:
        if name not in may:
            raise SettingError(f"with is {name!r}; expected effects such as {', '.join(may)}, with commas between")
    return tuple(dict.fromkeys(names))


def base_starts(problem: DrivenProblem) -> Floats:
    """Starts of a base model about its own values, (S, p). One that answers within a step of the filter, whose
    arithmetic would run away, is slowed down first."""
    model = problem.model
    assert isinstance(model, YawModel)
    starts, own = [], len(model.theta)
    middle = np.array([one.median for one in problem.random])
    linear, quadratic = model.drag()
    slope = linear + 2.0 * quadratic * float(problem.course.fastest[0])
    middling = max(model.inertia, float(problem.course.length.max()) * slope)
    push = float(np.abs(problem.course.held).max()) / max(middling, 1e-9)
    for inertia, drag, size, unsteady in product(INERTIAS, DRAGS, SIZES, UNSTEADY):
        random = middle.copy()
        random[0], random[2] = size * push / inertia, unsteady
        starts.append([inertia * middling, *(drag * model.theta[1:own]), *random])
    return np.clip(np.array(starts), problem.bounds[:, 0], problem.bounds[:, 1])


def starts_near(problem: DrivenProblem, thetas: Sequence[Floats], random: dict[str, float]) -> Floats:
    """Starts (S, p) from values of the model's parameters and what is known of the random ones."""
    rest = [random.get(one.name, one.median) for one in problem.random]
    return np.clip(np.array([[*theta, *rest] for theta in thetas]), problem.bounds[:, 0], problem.bounds[:, 1])


def stepped(run: Run) -> bool:
    """Whether a run holds its command for HELD seconds at a time, nearly all of the time."""
    held = [run.time[stop - 1] - run.time[first] for first, stop, _ in segments(run.command)]
    return sum(length for length in held if length >= HELD) > NEARLY * (run.time[-1] - run.time[0])


def disturbed(
    runs: Sequence[Run], base: YawModel, at_rest: NDArray[np.bool_], channels: tuple[str, ...] | None
) -> bool:
    """Whether the evidence asks for a disturbance that is a process, or for unsteady thrust.

    Runs of held commands answer nothing: what differs in a pool is in their gains, and a disturbance would absorb just
    what is looked for. Where half of the runs are such, the question is not asked. Of others the deviance
    of a model with both drags, with a disturbance and without, is compared.
    """
    if 2 * sum(stepped(run) for run in runs) >= len(runs):
        return False
    some = np.unique(np.linspace(0, len(runs) - 1, min(len(runs), ENOUGH)).astype(int))
    course = make_course([runs[i] for i in some], at_rest[some], channels=channels)
    drags = dict(zip(("linear", "quadratic"), base.drag()))
    roles = base_roles("2", base.dof)
    values = [drags.get(role, 0.0) for role in roles[1:]]
    model = YawModel.base("2", base.inertia, values, base.moment_unit, base.dof)
    free = driven_problem(model, course)
    quiet = driven_problem(model, course, quiet=True)
    starts = base_starts(free)
    found = [fit_innovations(one, starts, brief=True).log_likelihood for one in (free, quiet)]
    chance = 3.0 * float(np.log(max(len(some), 2))) + SURE
    return bool(2.0 * (found[0] - found[1]) > chance)
