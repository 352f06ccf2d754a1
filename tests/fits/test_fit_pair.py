"""A pair of motions by its record alone: surge and heave together, without axes that turn with the vehicle."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from automarine_cli.dofs import HEAVE, SURGE, Motion
from automarine_cli.filters.course import make_course
from automarine_cli.fits.innovations import DrivenProblem, fit_innovations, randomness
from automarine_cli.models.model import Model, Term
from automarine_cli.models.parameter import Parameters
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import make_batch
from automarine_cli.simulation.rollout import Start, simulate

VERTICAL = Motion("vertical", (SURGE, HEAVE), (SURGE.position, HEAVE.position))
TRUTH = np.array([17.0, 26.0, 20.0, 45.0, -2.0])
TERMS = (
    Term("quadratic-drag", (20.0,), True),
    Term("quadratic-drag", (45.0,), True, 1),
    Term("bias-moment", (-2.0,), True, 1),
)
MODEL = Model(VERTICAL, (17.0, 26.0), TERMS, "N")
PERIOD_S, HELD = 0.2, 10


def path(forces: Floats) -> Floats:
    """Distance and depth (2, N) under forces (2, N), held from half a sample before theirs, by scipy."""

    def slope(time: float, state: Floats) -> list[float]:
        ahead, down = forces[:, min(int(time / PERIOD_S + 0.5), forces.shape[1] - 1)]
        u, w = state[2:]
        return [u, w, (ahead - 20.0 * abs(u) * u) / 17.0, (down - 2.0 - 45.0 * abs(w) * w) / 26.0]

    time = PERIOD_S * np.arange(forces.shape[1])
    solved = solve_ivp(slope, (0.0, time[-1]), [0.0] * 4, t_eval=time, max_step=0.02, rtol=1e-8)
    return np.asarray(solved.y[:2])


def runs(seed: int, noise: float = 0.01, count: int = 4) -> list[Run]:
    rng, logged = np.random.default_rng(seed), list[Run]()
    for number in range(count):
        forces = np.repeat(rng.uniform(-20.0, 20.0, (2, 15)), HELD, axis=1)
        distance, depth = path(forces) + noise * rng.standard_normal(forces.shape)
        time = PERIOD_S * np.arange(forces.shape[1])
        extras = {SURGE.command: forces[0], SURGE.position: distance}
        logged.append(Run(f"run_{number}", "log.csv", time, depth, forces[1], "N", extras, dof=HEAVE))
    return logged


def test_a_pair_moves_as_scipy_says() -> None:
    (run,) = runs(1, noise=0.0, count=1)
    batch = make_batch([run], 0.05, hold=False, motion=VERTICAL)
    moved = simulate(MODEL, batch, start=Start(np.zeros((2, 1, 1)))).positions[0, 0]
    assert moved == pytest.approx(path(np.stack([run.extras[SURGE.command], run.command])).T, abs=1e-2)


@pytest.mark.slow
def test_a_pair_is_fitted_by_the_likelihood_of_the_filter() -> None:
    assert MODEL.parameter_names == (
        "surge.m_u", "heave.m_w", "surge.X_uu", "heave.Z_ww", "heave.constant_force",
    )  # fmt: skip
    start = MODEL.with_theta([10.0, 15.0, 10.0, 20.0, 0.0])
    course = make_course(runs(2), np.ones(4, dtype=bool), motion=VERTICAL, channels=VERTICAL.positions)
    random = randomness(course, [1.0, 1.0], [], False, 1.0)
    problem = DrivenProblem(start, course, Parameters((*start.parameters([20.0, 20.0]), *random)))
    fit = fit_innovations(problem, problem.parameters.theta[None])
    stderr = np.sqrt(np.diagonal(fit.covariance)[:5]) * np.where(fit.parameters.log[:5], fit.theta[:5], 1.0)
    assert np.all(np.abs(fit.of_model - TRUTH) < 3.5 * stderr) and np.all(stderr < 0.05 * np.abs(TRUTH))
