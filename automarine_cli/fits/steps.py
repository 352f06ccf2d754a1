"""The likelihood of step runs, whole or trimmed to their first half-turn: the closed-form response of models 1 to 3.

    y_ij = psi0_i + G(t_ij - t_mid,i - d - s_i; I, k_r, k_rr, tau_i exp(u_i)) + noise
    psi0_i flat,  u_i ~ N(0, g²),  s_i ~ N(0, f² h_i²/12)

t_mid,i is the middle of the sample interval h_i in which the command switched, d the command delay [s], one for all
runs; s_i is where in its interval the switch of run i was, u_i the logarithm of its gain. The scatters g and f are
estimated by restricted likelihood (see mixed_model.py).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from automarine_cli.dofs import Dof
from automarine_cli.fits.linear_mixed import GAIN, START_POSITION, SWITCHES, Block, RunEffects, bias_of
from automarine_cli.fits.mixed_model import Problem, slots_of
from automarine_cli.models.model import COMMAND_DELAY, MAX_DELAY_S, Model, base_roles, main_drag, response_slopes
from automarine_cli.models.parameter import NOTHING_KNOWN, NUISANCE, Parameter, Parameters, Priors
from automarine_cli.quantities import Floats
from automarine_cli.runs.half_turn import MAX_REST_SAMPLES, HalfTurn
from automarine_cli.simulation.batch import Channel, padded


@dataclass(frozen=True)
class StepData:
    """R steps padded to N samples, rest before the step included.

    `time` (R, N) [s] since the middle of the interval in which the command switched, `observed` (R, N), `moment` (R,)
    [`unit`], `interval` (R,) [s] width of the interval of the switch. `channels` are the readings that are fitted,
    first the position [rad or m] less the start position's first guess.
    """

    names: tuple[str, ...]
    time: Floats
    observed: NDArray[np.bool_]
    moment: Floats
    interval: Floats
    dof: Dof
    unit: str
    channels: tuple[Channel, ...]

    @property
    def heading(self) -> Floats:
        """Positions (R, N), zero in the padding."""
        return self.channels[0].values

    @property
    def half_interval(self) -> float:
        """Half the usual sample interval [s]: what a command delay may be by the logger's convention alone."""
        return 0.5 * float(np.median(self.interval))

    def some(self, runs: NDArray[np.int64]) -> "StepData":
        """The same of some of the runs."""
        rows = {name: getattr(self, name)[runs] for name in ("time", "observed", "moment", "interval")}
        channels = tuple(replace(c, values=c.values[runs], seen=c.seen[runs]) for c in self.channels)
        return replace(self, names=tuple(self.names[i] for i in runs), channels=channels, **rows)


def data_of_steps(turns: Sequence[HalfTurn], channels: Sequence[str] | None = None, *, whole: bool = False) -> StepData:
    """Lay steps out with the rest before them, of the `channels` named (None: the position alone): their first
    half-turns, or `whole` ones, until the command changes.

    The command of a log that begins with the moment already on is taken to have switched at its first sample, any
    other in the middle of the interval in which it did. Along a line a step ends where its trim ends. Of runs whose
    position does not count it stands in for a sensor that their logs lack.
    """
    dof, columns = turns[0].step.run.dof, list[list[Floats]]()
    for turn in turns:
        run, step = turn.step.run, turn.step
        before = step.rest or slice(step.first, step.first)
        zero = step.switch_to if step.begins_log else step.switch_mid
        fitted = slice(step.first, step.stop) if whole and dof.wraps else turn.kept
        parts = slice(max(before.start, before.stop - MAX_REST_SAMPLES), before.stop), fitted
        velocity = run.channel(dof.velocity)
        velocity = np.full(len(run), np.nan) if velocity is None else velocity
        of_run = run.time - zero, run.position - turn.start_position, velocity
        columns.append([np.concatenate([column[part] for part in parts]) for column in of_run])
    times, headings, velocities = zip(*columns)
    intervals = [turn.step.switch_to - turn.step.switch_from for turn in turns]
    names, moments, unit = [turn.name for turn in turns], [turn.moment for turn in turns], turns[0].step.run.moment_unit
    data = step_data(names, times, headings, moments, intervals, dof, unit)
    if channels is None or dof.velocity not in channels:
        return data
    counts = np.array([dof.position in channels and not turn.step.run.summed_up for turn in turns])
    (position,), width = data.channels, data.time.shape[1]
    seen = position.seen & counts[:, None] if counts.any() else position.seen
    rates, finite = ([form(velocity) for velocity in velocities] for form in (np.nan_to_num, np.isfinite))
    rate = Channel(dof.velocity, 0, True, padded(rates, width), padded(finite, width))
    return replace(data, channels=(replace(position, seen=seen, counts=bool(counts.any())), rate))


def step_data(
    names: Sequence[str], times: Sequence[Floats], headings: Sequence[Floats], moments: Sequence[float],
    intervals: Sequence[float], dof: Dof, unit: str = "nu",
) -> StepData:  # fmt: skip
    """Pad runs, given as time since the middle of the switch interval [s] and heading less start heading [rad]."""
    width = max(map(len, times))
    observed = padded([np.ones(len(time), dtype=bool) for time in times], width)
    position = Channel(dof.position, 0, False, padded(headings, width), observed)
    moment, interval = np.array(moments, dtype=float), np.array(intervals, dtype=float)
    return StepData(tuple(names), padded(times, width), observed, moment, interval, dof, unit, (position,))


MIN_SHARE = 0.01  # of the drag that is left one way, however much it differs: none would drive the vehicle


def step_problem(
    data: StepData, model: str, priors: Priors = NOTHING_KNOWN, sided: bool = False,
    delays: tuple[float, float] | None = None,
) -> Problem:  # fmt: skip
    """Likelihood of the steps under model "1", "2" or "3"; `sided` with a drag that differs between the ways.

    theta is (the parameters of `base_roles`, the command delay [s] within `delays`, by default from half a sample
    interval before the middle of the one in which the command switched to MAX_DELAY_S after it). Run effects are start
    position, log gain of the moment, where in its interval the run's command switched [s], and the bias of a velocity
    sensor.
    """
    roles, main = base_roles(model, data.dof, sided), main_drag(model)
    start = Model.base(model, 1.0, np.ones(len(roles) - 1), data.unit, data.dof)
    entries = start.parameters(log_drag=True, signed_drag=True)
    blocks = RunEffects(_blocks(data))
    moment, searched = data.moment[:, None], (*roles, COMMAND_DELAY)

    def slopes(theta: Floats, b: Floats) -> tuple[Floats, Floats, Floats]:
        value, delay = dict(zip(roles, theta)), theta[-1]
        gained = moment * np.exp(blocks.of(b, GAIN))
        force = gained + value.get("constant", 0.0)
        drag = {role: np.full_like(force, value.get(role, 0.0)) for role in ("linear", "quadratic")}
        aside = np.sign(force) * value.get("difference", 0.0)
        inside = aside > (MIN_SHARE - 1.0) * drag[main]
        drag[main] = np.where(inside, drag[main] + aside, MIN_SHARE * drag[main])
        time = data.time - delay - blocks.of(b, SWITCHES)
        answers = response_slopes(time, force, value["inertia"], drag["linear"], drag["quadratic"])
        none, rows = np.zeros_like(data.time), []
        for channel in data.channels:
            of = answers[channel.velocity]
            share = {"linear": none + 1.0, "quadratic": none + 1.0, main: np.where(inside, 1.0, MIN_SHARE)}
            by = {
                "inertia": of.log_inertia / value["inertia"],
                "linear": of.linear * share["linear"],
                "quadratic": of.quadratic * share["quadratic"],
                "constant": of.log_force / force,
                "difference": getattr(of, main) * np.sign(force) * inside,
                COMMAND_DELAY: -of.time,
                GAIN: of.log_force * gained / force,
                SWITCHES: -of.time,
                bias_of(channel.quantity) if channel.velocity else START_POSITION: none + 1.0,
            }
            own = blocks.of(b, bias_of(channel.quantity) if channel.velocity else START_POSITION)
            columns = [np.stack([by.get(name, none) for name in part], axis=2) for part in (searched, blocks.names)]
            rows.append((of.value + own, *columns))
        readings, by_theta, by_run = (np.concatenate(part, axis=1) for part in zip(*rows))
        return readings, by_theta, by_run

    def response(theta: Floats, b: Floats) -> Floats:
        return np.stack([slopes(values, effects)[0] for values, effects in zip(theta, b)])

    measured, observed = (np.concatenate(part, axis=1) for part in zip(*((c.values, c.seen) for c in data.channels)))
    earliest, latest = delays or (-data.half_interval, MAX_DELAY_S)
    parameters = Parameters((*entries, Parameter(COMMAND_DELAY, 0.0, earliest, latest, role=NUISANCE, unit="s")))
    return Problem(
        response, measured, observed, blocks, parameters.informed(priors), slots_of(data.channels), slopes=slopes
    )


def _blocks(data: StepData) -> tuple[Block, ...]:
    """What differs from run to run, before the data."""
    ones, limits = np.ones((len(data.moment), 1)), data.dof.limits
    return (
        Block(START_POSITION, limits.position_sd * ones),
        Block(GAIN, ones, (1e-4, 1.0)),
        Block(SWITCHES, data.interval[:, None] / np.sqrt(12.0), (1e-3, 1.0)),
        *(Block(bias_of(c.quantity), limits.bias_sd * ones) for c in data.channels if c.velocity),
    )
