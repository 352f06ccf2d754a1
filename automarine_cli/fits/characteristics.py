"""What follows from a fit: the ballast of a vehicle that rises or sinks, the swing of one that weight and buoyancy turn
back, the answer of one to its rudder, what is left of the readings.

A swing I p' = -k p - k2 |p| p - G sin(phi) + b has the natural frequency omega_n = sqrt(G/I), the damping ratio
zeta = k/(2 sqrt(G I)), and over a swing of amplitude A the linear damping that takes as much energy,
zeta + 4 A k2/(3 pi I). G is m g GM, GM the metacentric height. Sources: Fossen (2021), Handbook of Marine Craft
Hydrodynamics and Motion Control, chapter 4; ITTC Recommended Procedure 7.5-02-07-04.5 (roll damping).

Nomoto et al. (1957), International Shipbuilding Progress 4:354: T r' + r = K delta. Norrbin (1963), Swedish State
Shipbuilding Experimental Tank 55: T r' + n1 r + n3 r³ = K delta, where n1 is -1 of a hull that is unstable on its
course. In the prime system, with the length L and the speed U, K' = K L/U and T' = T U/L (SNAME 1950).
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from automarine_cli import effects
from automarine_cli.estimate import Estimate
from automarine_cli.fits.driven import Judgement
from automarine_cli.fits.innovations import DrivenProblem, InnovationsFit
from automarine_cli.fits.steps import StepData
from automarine_cli.fits.whole_runs import OutputErrorFit, run_dof
from automarine_cli.models.model import COMMAND_DELAY, Model, steady_rate
from automarine_cli.quantities import Floats
from automarine_cli.runs.channels import unbiased_velocity
from automarine_cli.runs.load import TO_PORT
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import make_batch
from automarine_cli.simulation.rollout import Start, Trajectory, simulate

PARAMETER_STEP = 1e-4  # by which a parameter is moved, as a share of itself


def derived(fit: OutputErrorFit, of: Callable[[Model], float], unit: str, log: bool = True) -> Estimate:
    """Estimate what a model's parameters give, by its slopes (delta method); if `log`, on the logarithm of its size."""
    mixed, count = fit.mixed, len(fit.model.theta)
    value, slope = of(fit.model), np.zeros(len(mixed.phi))
    for i in np.flatnonzero(np.diagonal(fit.covariance)[:count] > 0):
        step = PARAMETER_STEP * (1.0 if mixed.parameters.log[i] else max(abs(mixed.phi[i]), 1e-6))
        moved = mixed.phi + np.outer([step, -step], np.arange(len(mixed.phi)) == i)
        ahead, behind = (of(fit.model.with_theta(theta[:count])) for theta in mixed.parameters.natural(moved))
        slope[i] = (ahead - behind) / (2.0 * step)
    error = float(np.sqrt(max(float(slope @ fit.covariance @ slope), 0.0)))
    if not log:
        return Estimate.from_stderr(value, error, run_dof(mixed, slope), unit)
    size = max(abs(value), 1e-12)
    return Estimate.from_log(size, error / size, run_dof(mixed, slope), unit).scaled(math.copysign(1.0, value), unit)


GRAVITY = 9.81  # m/s²; within 0.3 % of what it is anywhere
AMPLITUDE_DEG = 10.0  # at which linear and quadratic damping are summed up
AT_AMPLITUDE = f"damping_ratio_at_{AMPLITUDE_DEG:g}_deg"
MAX_DAMPING_RATIO = 0.99  # damping ratio from which on nothing swings


@dataclass(frozen=True)
class Buoyancy:
    """The constant force of a model, positive down, told as what a diver would do about it."""

    force: Estimate

    @property
    def ballast(self) -> Estimate | None:
        """Mass [kg], weighed in water, that balances the vehicle; None for a normalised force."""
        return self.force.scaled(-1.0 / GRAVITY, "kg") if self.force.unit == "N" else None

    @property
    def says(self) -> str:
        low, high = self.force.ci95
        if low < 0 < high:
            return f"Buoyancy: not significant; the force is {low:.2g} to {high:.2g} {self.force.unit} down."

        def size(of: Estimate) -> str:
            low, high = sorted(map(abs, of.ci95))
            return f"{abs(of.value):.3g} {of.unit} [{low:.3g}, {high:.3g}]"

        way, action = ("up", "add") if self.force.value < 0 else ("down", "take off")
        text = f"Buoyancy: a constant force of {size(self.force)} {way}"
        if self.ballast is None:
            return f"{text}, in the unit of the command."
        return f"{text}: to balance it {action} {size(self.ballast)} of ballast, weighed in water."

    def to_json(self) -> dict[str, object]:
        ballast = self.ballast and self.ballast.to_json()
        return {"constant_force": self.force.to_json(), "ballast_in_water": ballast, "says": self.says}


Swing = dict[str, Estimate | None]


def swing_of(fit: OutputErrorFit, mass: float | None) -> Swing:
    """Return how the vehicle swings, by the keys of files; `mass` [kg] if it is known and the fit is in newton metres.

    The damping ratio is that of linear drag, quadratic damping is drag over inertia, each None of a model without; the
    damped period is None where it does not swing. The angle of rest is the list or trim; the radius of gyration is that
    with added inertia; the metacentric height GM is None without the mass.
    """

    def damping(model: Model) -> float:
        return model.drag()[0] / (2.0 * math.sqrt(model.inertia * model.restoring))

    def period(model: Model) -> float:
        return 2.0 * math.pi * math.sqrt(model.inertia / model.restoring)

    def damping_at_amplitude(model: Model) -> float:
        amplitude = math.radians(AMPLITUDE_DEG)
        return damping(model) + 4.0 * amplitude * model.drag()[1] / (3.0 * math.pi * model.inertia)

    def rest_angle(model: Model) -> float:
        return math.degrees(math.asin(min(max(model.coefficient("constant") / model.restoring, -1.0), 1.0)))

    return {
        "natural_period_s": derived(fit, period, "s"),
        "damped_period_s": derived(fit, lambda m: period(m) / math.sqrt(1.0 - damping(m) ** 2), "s")
        if abs(damping(fit.model)) < MAX_DAMPING_RATIO else None,
        "damping_ratio": derived(fit, damping, "1", log=False) if "linear" in fit.roles else None,
        "quadratic_damping_per_rad": derived(fit, lambda m: m.drag()[1] / m.inertia, "1/rad")
        if "quadratic" in fit.roles else None,
        AT_AMPLITUDE: derived(fit, damping_at_amplitude, "1", log=False),
        "rest_angle_deg": derived(fit, rest_angle, "deg", log=False),
        "GM_over_radius_of_gyration_squared_per_m": derived(fit, lambda m: m.restoring / m.inertia / GRAVITY, "1/m"),
        "GM_m": None if mass is None else derived(fit, lambda m: m.restoring / (mass * GRAVITY), "m"),
    }  # fmt: skip


HELD_SHARE = 0.9  # of the largest rudder angle, from which on it counts as put over
RATE_WINDOW_S = 1.0  # over which a rate is told from headings
STEP_S = 0.1  # of the simulation of overshoots


@dataclass(frozen=True)
class Nomoto:
    """The answer to the rudder at a `speed` [m/s] (None: not logged), as positive rudder was logged (`side`, -1 where
    that turns to port): `gain` [1/s] and `time` [s] of first order, the same of `cubic` with `n1` and `n3` [s²] where
    it was fitted; the `effect` N_delta/I_r [1/s²] at that speed; the rate [rad/s] to which a rudder of `full` [rad]
    leads, and the `fastest` of the logs; overshoot angles [rad] of zigzags, of logs and model from each execute on;
    `length` [m] of the vehicle or None."""

    side: int
    speed: float | None
    gain: Estimate
    time: Estimate
    cubic: dict[str, Estimate]
    n1: int
    effect: Estimate
    full: float
    turning: float
    fastest: float
    overshoots: tuple[tuple[float, float], ...]
    length: float | None = None

    @property
    def prime(self) -> dict[str, Estimate]:
        """Gain and time constant in the prime system; empty without length or speed."""
        if not self.length or not self.speed:
            return {}
        ratio = self.length / self.speed
        return {"K'": self.gain.scaled(ratio, "1"), "T'": self.time.scaled(1.0 / ratio, "1")}

    def to_json(self) -> dict[str, object]:
        return {
            **steering_json(self.side, self.speed),
            "first_order": {"K": self.gain.to_json(), "T": self.time.to_json()},
            "norrbin": {name: e.to_json() for name, e in self.cubic.items()} | {"n1": self.n1} if self.cubic else None,
            "N_delta_over_I_r": self.effect.to_json(),
            "prime": {name: e.to_json() for name, e in self.prime.items()} or None,
            "length_m": self.length,
            "turning": {
                "rudder_deg": float(np.rad2deg(self.full)),
                "model_deg_s": float(np.rad2deg(self.turning)) if np.isfinite(self.turning) else None,
                "logs_deg_s": float(np.rad2deg(self.fastest)),
            },
            "overshoot_deg": overshoots_json(self.overshoots),
        }


def steering_of(runs: Sequence[Run]) -> tuple[int, float | None]:
    """Give the side to which positive rudder turned as logged (-1: port) and the mean speed [m/s], None without."""
    speeds = [run.extras["surge"] for run in runs if "surge" in run.extras]
    speed = float(np.nanmean(np.concatenate(speeds))) if len(speeds) == len(runs) else None
    return -1 if TO_PORT in runs[0].reading else 1, speed


def steering_json(side: int, speed: float | None) -> dict[str, object]:
    return {"positive_rudder_turns_to": "starboard" if side > 0 else "port", "speed_m_s": speed}


def answer_to_rudder(
    runs: Sequence[Run], first: OutputErrorFit, cubic: OutputErrorFit | None, best: Model, fastest: float,
    length: float | None = None,
) -> Nomoto:  # fmt: skip
    """Give the answer to the rudder by a model of linear drag, one of linear and `cubic` drag if it could be fitted,
    and overshoots and turning by the `best` one."""
    side, speed = steering_of(runs)
    speed = next((term.values[1] for term in first.model.terms if term.name == "rudder-inflow"), speed)

    def coefficient(model: Model, name: str) -> float:
        return sum(term.values[0] for term in model.terms if term.name == name)

    def damping(model: Model) -> float:
        return model.drag()[0] - coefficient(model, "cross-coupling") * (speed or 0.0)

    def slow_inertia(model: Model) -> float:
        """Give the inertia that slow turns feel: water that remembers for T adds h T (effects/history_force.py)."""
        fading = [term.values for term in model.terms if term.name == "history-force" and not term.values[2]]
        return model.inertia + sum(h * seconds for h, seconds, _ in fading)

    gain = derived(first, lambda model: side / damping(model), "1/s")
    time = derived(first, lambda model: slow_inertia(model) / damping(model), "s")
    third, n1 = dict[str, Estimate](), 1
    if cubic is not None:
        n1 = 1 if damping(cubic.model) >= 0 else -1
        third = {
            "K": derived(cubic, lambda model: side / abs(damping(model)), "1/s"),
            "T": derived(cubic, lambda model: slow_inertia(model) / abs(damping(model)), "s"),
            "n3": derived(cubic, lambda model: coefficient(model, "cubic-drag") / abs(damping(model)), "s²", log=False),
        }
    full = max(float(np.abs(run.command).max()) for run in runs)
    turning = float(steady_rate(full, damping(best), best.drag()[1]))
    pairs = tuple(pair for run in runs for pair in overshoots(best, run))
    effect = derived(first, lambda model: side / model.inertia, "1/s²")
    return Nomoto(side, speed, gain, time, third, n1, effect, full, turning, fastest, pairs, length)


def executes(rudder: Floats) -> list[tuple[int, int]]:
    """First and last samples of the swings of a zigzag: from where the rudder (N,) begins to go over to the other side
    to where it does so again. Empty for a run that is none."""
    most = float(np.abs(rudder).max())
    over = np.flatnonzero(np.abs(rudder) >= HELD_SHARE * most)
    ways = np.sign(rudder[over])
    at = over[np.flatnonzero(np.diff(ways) != 0)] if most > 0 else over[:0]
    return list(zip(at.tolist(), [*at[1:].tolist(), len(rudder) - 1])) if len(at) > 1 else []


class Execute(NamedTuple):
    """A swing of a zigzag from one execute to the next: its first and last sample, the way of the rudder before, and
    how far the heading went on [rad]."""

    first: int
    last: int
    way: float
    logged: float

    def beside(self, heading: Floats, logged: Floats) -> tuple[float, float]:
        """Overshoot angles [rad], of the log and of a simulated heading from the swing's first sample on."""
        return self.logged, float((self.way * (heading - logged[self.first])).max())


def swings_back(rudder: Floats, heading: Floats) -> Iterator[Execute]:
    """Give the swings of a zigzag after which the heading comes back in the log."""
    for first, last in executes(rudder):
        way = float(np.sign(rudder[first]))
        logged = way * (heading[first : last + 1] - heading[first])
        if last - first > 2 and logged[-1] < 0.9 * logged.max():
            yield Execute(first, last, way, float(logged.max()))


def overshoots(model: Model, run: Run) -> list[tuple[float, float]]:
    """Give overshoot angles [rad] of a run, of its log and of the model from the logged state at each execute on: how
    far the heading goes on after the rudder began to go back. What the model remembers then is of the logged rates.
    Swings that do not come back in the log are left out."""
    pairs, water, now = [], np.zeros((1, 1, 1)), 0
    every = max(1, round(RATE_WINDOW_S / run.sample_period))
    remembers = any(effects.get(term.name).states for term in model.terms)
    for swing in swings_back(run.command, run.position):
        for first in range(now, swing.first, every) if remembers else ():
            now = min(first + every, swing.first)
            water = _from_log(model, run, first, now, water).water[0, 0, now - first, :, None, None]
        path = _from_log(model, run, swing.first, swing.last, water).position[0, 0, : swing.last + 1 - swing.first]
        pairs.append(swing.beside(path, run.position))
    return pairs


def _from_log(model: Model, run: Run, first: int, last: int, water: Floats) -> Trajectory:
    """Simulate a run from the logged heading and rate of its `first` sample to the `last` one."""
    batch = make_batch([run.cut(first, last + 1)], STEP_S, model.signals)
    start = Start(run.position[None, [first]], np.array([[_rate_at(run, first)]]), water=water)
    return simulate(model, batch, start=start)


def _rate_at(run: Run, sample: int) -> float:
    """Rate at a sample by those logged over RATE_WINDOW_S before it, which no execute has changed yet; without them by
    the headings about it."""
    now, rates = run.time[sample], unbiased_velocity(run)
    if rates is not None:
        before = (run.time > now - RATE_WINDOW_S) & (run.time <= now) & np.isfinite(rates)
        if np.count_nonzero(before) > 2:
            return float(np.polynomial.Polynomial.fit(run.time[before], rates[before], 1)(now))
    ends = np.clip(now + 0.5 * RATE_WINDOW_S * np.array([-1.0, 1.0]), run.time[0], run.time[-1])
    return float(np.diff(np.interp(ends, run.time, run.position))[0] / np.diff(ends)[0])


def overshoots_json(pairs: Sequence[tuple[float, float]]) -> dict[str, list[float]]:
    degrees = np.rad2deg(np.array(pairs).reshape(-1, 2))
    return {"logs": degrees[:, 0].tolist(), "model": degrees[:, 1].tolist()}


def mean_miss(pairs: Sequence[tuple[float, float]]) -> float:
    """Root mean square difference of overshoot angles [rad] of logs and model."""
    logged, modelled = np.array(pairs).T
    return float(np.sqrt(np.mean((logged - modelled) ** 2)))


def standardised_residuals(
    fit: OutputErrorFit, runs: Sequence[Run], data: StepData | None, use: Judgement | None
) -> list[tuple[Floats, Floats]]:
    """Return time [s] and residual over its standard deviation, (n,) each, of every run, of the first sensor that
    counts: innovations of a filter where runs were followed by one, else measured less fitted readings of the steps'
    `data` or of whole `runs`. Empty where neither is to be had."""
    mixed = fit.mixed
    if isinstance(mixed, InnovationsFit):
        if use is None or use.course is None:
            return []
        followed = DrivenProblem(fit.model, use.course, mixed.parameters).follow(mixed.phi[None])
        innovation, variance = followed.innovation[0, 0], followed.variance[0, 0]
        read = variance > 0
        return [(t[at], e[at] / np.sqrt(v[at])) for t, e, v, at in zip(use.course.time, innovation, variance, read)]
    name = mixed.slots[0].name
    noise, fitted = mixed.noise_of[name], mixed.reading(name)
    if data is not None:
        channel = next(channel for channel in data.channels if channel.quantity == name)
        left = (channel.values - fitted) / noise
        return [(time[at], residual[at]) for time, residual, at in zip(data.time, left, channel.seen)]
    residuals = []
    for run, of_run in zip(runs, fitted):
        reading = run.channel(name)
        if reading is not None:
            left = (reading - of_run[: len(run)]) / noise
            at = np.isfinite(left)
            residuals.append((run.time[at] - run.time[0], left[at]))
    return residuals


def autocorrelation(series: Sequence[Floats], lags: int) -> Floats:
    """Return the correlation of values with those 1 to `lags` places later in the same series, pooled over all,
    (lags,); of white noise of N values in all its standard error is 1/sqrt(N)."""
    power = sum(float(values @ values) for values in series)
    products = [sum(float(values[:-lag] @ values[lag:]) for values in series) for lag in range(1, lags + 1)]
    return np.array(products) / max(power, 1e-300)


def correlations(fit: OutputErrorFit) -> tuple[list[str], Floats]:
    """Return the names of the k parameters that were estimated, the command delay among them, and the correlation of
    their errors, (k, k), as the likelihood has it: few runs left out in turn give no good one. Of positive parameters
    it is that of their logarithms."""
    mixed = fit.mixed
    names, deviation = mixed.parameters.names, np.sqrt(np.maximum(np.diagonal(mixed.covariance), 0.0))
    asked = [*range(len(fit.model.theta)), names.index(COMMAND_DELAY)]
    places = [i for i in asked if np.isfinite(deviation[i]) and deviation[i] > 0]
    matrix = mixed.covariance[np.ix_(places, places)] / np.outer(deviation[places], deviation[places])
    return [names[i] for i in places], matrix
