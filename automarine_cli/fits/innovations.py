"""Maximum likelihood of driven and disturbed runs by the innovations of a filter (see filters/kalman.py).

Each reading is compared with what all readings before it let expect; that holds for commands that answer the readings
too, as those of a controller do. Everything random has its size estimated with the model: the disturbing acceleration
and its time constant, noise in proportion to the thrust, scatter of the thrust from run to run, noise of each sensor.
Fisher scoring on innovations and their variances (Ljung 1999, System Identification, chapter 7; Åström 1980, Automatica
16:551), damped; differences of all parameters and all trial steps are filtered together.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy import special

from automarine_cli.dofs import Dof
from automarine_cli.errors import FitError
from automarine_cli.fits import linear_mixed
from automarine_cli.fits.innovations_problem import DrivenProblem, Slopes
from automarine_cli.fits.mixed_problem import SWITCH
from automarine_cli.fits.outcome import Outcome
from automarine_cli.fits.run_effects import GAIN
from automarine_cli.quantities import Floats
from automarine_cli.results.estimate import Estimate

SETTLED = 0.02
"""Gain in log likelihood still to be expected below which a fit has converged."""
ITERATIONS = 60
FEW_RUNS = 6
"""Up to so many runs a fit without one of them is made anew, as one step from the fit to all may miss it by far."""
LOOK, WAYS = 6, 3
"""Iterations from each of so many starting inertias, before the best goes on to the end: filters have wrong summits."""
SIZES = {GAIN: "gain-scatter"}
"""What run effects are called whose sizes are parameters."""
LEAST_DAMPING, MOST_DAMPING, SHARES = 1e-4, 1e3, (1.0, 30.0)
"""Share of the curvature that is added to it, and multiples of that which are tried together."""
NO_START = "no starting point of the fit has a finite likelihood; check the units of command, position and time"


@dataclass(frozen=True)
class InnovationsFit(Outcome):
    """Outcome of a fit by innovations: `theta` ends with the parameters of what is random; `density` (R,) the runs'
    own log densities, `gains` (R,) their log gains as filtered, `read_of` the channels with
    the numbers of their readings,
    `parameters` how many of theta are the model's, `by_run` (R, p, p) what each run says of phi."""

    density: Floats
    gains: Floats
    read_of: tuple[tuple[str, int], ...]
    parameters: int
    by_run: Floats = field(repr=False)

    @property
    def of_model(self) -> Floats:
        """The model's own entries of theta."""
        return self.theta[: self.parameters]

    @property
    def read(self) -> dict[str, int]:
        """How many readings each channel has."""
        return dict(self.read_of)

    @property
    def information(self) -> Floats:
        """What each run says of phi, (R, p, p)."""
        return self.by_run

    @property
    def of_chance(self) -> dict[str, float]:
        """The parameters of what is random, by name."""
        return dict(zip(self.names[self.parameters :], self.theta[self.parameters :].tolist()))

    @property
    def noise_of(self) -> dict[str, float]:
        """Noise of each channel by its quantity [its unit]."""
        return {quantity: self.value(f"noise.{quantity}") for quantity in self.read}

    def factor(self, block: str) -> float:
        """Size of what differs from run to run: of the gain, or of what an effect lets vary."""
        return self.value(SIZES.get(block, f"{block}.spread"))

    def factor_interval(self, block: str) -> tuple[float, float]:
        """95 % interval of one of these sizes."""
        place = self.names.index(SIZES.get(block, f"{block}.spread"))
        half = float(special.ndtri(0.975) * np.sqrt(max(self.covariance[place, place], 0.0)))
        middle = float(self.theta[place])
        return middle * float(np.exp(-half)), middle * float(np.exp(half))

    def own(self, block: str) -> Floats:
        """Each run's own effects (R, k) of one block, of which the filter keeps the gains."""
        return self.gains[:, None] if block == GAIN else np.zeros((len(self.gains), 1))


def fit_innovations(
    problem: DrivenProblem, starts: Floats, iterations: int = ITERATIONS, brief: bool = False
) -> InnovationsFit:
    """Fit from the best of `starts` (S, p) in theta; a `brief` one leaves no run out, and predicts none.

    Raises FitError where no start leads anywhere.
    """
    phis = np.clip(problem.search(starts), problem.limits[:, 0], problem.limits[:, 1])
    if len(phis) > 1:
        values = problem.value(phis)
        if not np.isfinite(values).any():
            raise FitError(NO_START)
        firsts = dict.fromkeys(phis[np.argsort(-values, kind="stable"), 0])  # distinct inertias, the best one first
        best = [int(np.argmax(np.where(phis[:, 0] == first, values, -np.inf))) for first in firsts]
        tried = [_climb(problem, phis[k], LOOK) for k in best[:WAYS] if np.isfinite(values[k])]
        phis = max(tried, key=lambda climb: climb.value).phi[None]
    reached = _climb(problem, phis[0], iterations)
    if not np.isfinite(reached.value):
        raise FitError(NO_START)
    return _report(problem, reached, brief)


@dataclass(frozen=True)
class _Climb:
    """Where a search got to."""

    phi: Floats
    value: float
    slopes: Slopes
    iterations: int
    converged: bool


def _climb(problem: DrivenProblem, phi: Floats, iterations: int) -> _Climb:
    """Fisher scoring from phi (p,), damped where the likelihood is no parabola."""
    (slopes,) = problem.slopes(phi[None])
    value = slopes.value(problem, phi)
    free, limits = problem.free, problem.limits
    converged, done, damping = False, 0, LEAST_DAMPING
    rounds = len(SHARES) if problem.course.motion.turns else 1  # of three motions arrays are long as they are
    while done < iterations and np.isfinite(value):
        done += 1
        gradient = slopes.gradient.sum(axis=0) + problem.prior_gradient(phi)
        hessian = slopes.information.sum(axis=0) + problem.prior_information
        if not (np.isfinite(gradient).all() and np.isfinite(hessian).all()):
            break
        trials = np.tile(phi, (len(SHARES), 1))
        for trial, share in zip(trials, SHARES):
            damped = hessian + share * damping * np.diag(np.diagonal(hessian) + 1e-12)
            pull = gradient + damped @ phi[free]
            trial[free] = linear_mixed.bounded_solution(damped, pull, phi[free], limits[free])
        step = trials[0, free] - phi[free]
        expected = float(gradient @ step - 0.5 * step @ hessian @ step)
        if expected < SETTLED:
            converged = True
            break
        tried: list[Slopes] = []
        reached: list[float] = []
        for part in np.split(trials, rounds):
            tried += problem.slopes(part)
            reached += [one.value(problem, trial) for one, trial in zip(tried[-len(part) :], part)]
            if max(reached) > value + 0.1 * SETTLED:
                break
        best = int(np.argmax(reached))
        if reached[best] > value + 0.1 * SETTLED:
            phi, value, slopes = trials[best], reached[best], tried[best]
            damping = max(damping * (0.1 if best == 0 else SHARES[best]), LEAST_DAMPING)
        elif damping < MOST_DAMPING:
            damping *= SHARES[-1] * 10.0
        else:
            converged = expected < 1.0
            break
    return _Climb(phi, value, slopes, done, converged)


def _climb_without_each(problem: DrivenProblem, phi: Floats) -> Floats:
    """LOOK steps of Fisher scoring from phi (R, p), each without its own run; all are filtered together."""
    free, limits, others = problem.free, problem.limits[problem.free], ~np.eye(len(phi), dtype=bool)
    slopes = problem.slopes(phi)

    def value(at: Floats, reached: list[Slopes]) -> Floats:
        each = zip(at, reached, others)
        return np.array([float(s.density[rest].sum()) + float(problem.prior(x)) for x, s, rest in each])

    best, damping = value(phi, slopes), np.full(len(phi), LEAST_DAMPING)
    for _ in range(LOOK):
        trials = phi.copy()
        for r, (x, slope, rest) in enumerate(zip(phi, slopes, others)):
            gradient = slope.gradient[rest].sum(axis=0) + problem.prior_gradient(x)
            hessian = slope.information[rest].sum(axis=0) + problem.prior_information
            if np.isfinite(gradient).all() and np.isfinite(hessian).all():
                damped = hessian + damping[r] * np.diag(np.diagonal(hessian) + 1e-12)
                trials[r, free] = linear_mixed.bounded_solution(damped, gradient + damped @ x[free], x[free], limits)
        tried = problem.slopes(trials)
        reached = value(trials, tried)
        better = reached > best + 0.1 * SETTLED
        phi, best = np.where(better[:, None], trials, phi), np.where(better, reached, best)
        slopes = [new if took else old for new, old, took in zip(tried, slopes, better)]
        damping = np.where(better, np.maximum(0.1 * damping, LEAST_DAMPING), 100.0 * damping)
        if not better.any():
            break
    return phi


def _report(problem: DrivenProblem, reached: _Climb, brief: bool) -> InnovationsFit:
    phi, slopes = reached.phi, reached.slopes
    free, limits, count = problem.free, problem.limits, len(problem.names)
    at_bound = (phi - limits[:, 0] < 1e-9) | (limits[:, 1] - phi < 1e-9)
    inside = ~at_bound[free]
    hessian = (slopes.information.sum(axis=0) + problem.prior_information)[np.ix_(inside, inside)]
    open_to = free[inside]
    covariance = np.zeros((count, count))
    covariance[np.ix_(open_to, open_to)] = linear_mixed.covariance_of(hessian)
    runs = len(problem.course.names)
    left_out = np.tile(phi, (runs, 1))
    if runs > 1:
        rest = hessian - slopes.information[:, inside][:, :, inside]
        moved = linear_mixed.solve_scaled(rest, -slopes.gradient[:, inside])
        spread = np.sqrt(np.maximum(np.diagonal(covariance)[open_to], 0.0))
        left_out[:, open_to] += np.clip(moved, -5.0 * spread, 5.0 * spread)
        left_out = np.clip(left_out, limits[:, 0], limits[:, 1])
    if 1 < runs <= FEW_RUNS and not brief and len(problem.course.motion.dofs) == 1:
        left_out = _climb_without_each(problem, left_out)
    information = np.zeros((runs, count, count))
    information[:, free[:, None], free] = slopes.information
    information += 0.0 if problem.smooth is None else problem.smooth / runs
    every = problem.follow(phi[None] if brief else np.concatenate([phi[None], left_out]), keep=True)
    density = every.log_density
    assert every.states is not None
    theta = problem.natural(phi)
    return InnovationsFit(
        names=problem.names,
        theta=theta,
        phi=phi,
        positive=problem.positive,
        covariance=covariance,
        left_out=left_out,
        log_likelihood=float(density[0].sum()),
        predictive=density[0] if brief else _finite(density[1:])[np.arange(runs), np.arange(runs)],
        at_bound=tuple(int(i) for i in np.flatnonzero(at_bound)),
        iterations=reached.iterations,
        converged=reached.converged,
        density=density[0],
        gains=every.states[every.places.gain, 0, :, -1],
        read_of=tuple((one.quantity, int(one.seen.sum())) for one in problem.course.channels),
        parameters=count - len(problem.random),
        by_run=information,
        known=problem.known,
    )


def _finite(density: Floats) -> Floats:
    """Log densities, next to nothing where a filter ran away."""
    return np.where(np.isfinite(density), density, -1e9)


def random_estimates(found: InnovationsFit, covariance: Floats, dof: Dof) -> dict[str, dict[str, object]]:
    """What is random in a fit, for a result file: sizes with their intervals, in the units of the arithmetic."""
    base = dof.units.base
    units = {"disturbance": f"{base}/s²", "disturbance-time": "s", "thrust-noise": "s^1/2", "gain-scatter": "1"}
    stored: dict[str, dict[str, object]] = {}
    for i, name in enumerate(found.names[found.parameters :], found.parameters):
        kind, bound = name.rpartition(".")[2], i in found.at_bound
        if name == SWITCH:
            half = 1.96 * float(np.sqrt(max(covariance[i, i], 0.0)))
            value = float(found.theta[i])
            ends = (value - half, value + half)
            stored[name] = Estimate(value, half / 1.96, ends, "sample interval", at_bound=bound).to_json()
            continue
        unit = units.get(kind, f"{base}/s" if kind == dof.velocity else base)
        stderr = float(np.sqrt(max(covariance[i, i], 0.0)))
        one = Estimate.from_log(float(found.theta[i]), stderr, max(len(found.left_out) - 1.0, 1.0), unit)
        stored[name] = replace(one, at_bound=bound).to_json()
    return stored
