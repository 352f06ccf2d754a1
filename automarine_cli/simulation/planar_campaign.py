"""`make_planar`: a specification of motion in the plane becomes runs with known truth, and their logs."""

from dataclasses import dataclass
from string import ascii_lowercase

import numpy as np

from automarine_cli.dofs import SURGE, SWAY, YAW
from automarine_cli.dofs.motion import PLANAR
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import WINDOW, make_batch
from automarine_cli.simulation.campaign import AROUND
from automarine_cli.simulation.logging_chain import DECIMALS
from automarine_cli.simulation.planar_specification import PlanarRuns, PlanarSpecification
from automarine_cli.simulation.rollout import Start, simulate
from automarine_cli.simulation.streams import normal, uniform

STEP = 0.02  # s: the error stays far below the last digit logged


@dataclass(frozen=True)
class PlanarMade:
    """One run: its group, name, clock at the first row [s], what was drawn, and the columns of its log, (N,) each.

    `switches` [s since the first row] are when the rows of `commands` (n, 3) begin; `disturbance` (3, windows) is held
    over windows of two seconds.
    """

    group: PlanarRuns
    name: str
    begin: float
    heading: float
    gain: float
    switches: Floats
    commands: Floats
    disturbance: Floats
    columns: dict[str, Floats]

    @property
    def file(self) -> str:
        """Where the log is, from the campaign's folder."""
        return f"{self.group.folder}/{self.name}.{self.group.format}"


def make_planar(asked: PlanarSpecification, seed: int) -> tuple[PlanarMade, ...]:
    """All runs, in the order of the specification."""
    made, begin = [], 0.0
    for group in asked.runs:
        for repeat in range(group.repeats):
            letter = f"_{ascii_lowercase[repeat]}" if repeat < 26 else f"_{repeat + 1}"
            name = group.name + letter * (group.repeats > 1)
            one = _made(asked, seed, group, name, begin)
            begin += float(one.columns["time_s"][-1] - one.columns["time_s"][0]) + asked.logger.wait_between_s
            made.append(one)
    return tuple(made)


def _made(asked: PlanarSpecification, seed: int, group: PlanarRuns, name: str, begin: float) -> PlanarMade:
    """One run: drawn, simulated, logged. The commands change anywhere in the interval before they show."""
    logger, key = asked.logger, f"{group.folder}/{name}"
    period = 1.0 / logger.rate_hz
    commands, seconds = _commands(group, seed, key)
    rows = np.round(np.cumsum([logger.rest_before_s, *seconds]) * logger.rate_hz).astype(int)
    time = np.arange(rows[-1] + round(logger.rest_after_s * logger.rate_hz) + 1) * period
    commands = np.vstack([commands, np.zeros(3)])
    switches = (rows - uniform(len(rows), seed, key, "switch")) * period
    heading = asked.scatter.start_heading_deg
    start = 360.0 * float(uniform(1, seed, key, "start heading")[0]) if heading == "random" else heading
    gain = float(np.exp(asked.scatter.gain * normal(1, seed, key, "gain")[0]))
    sizes, share = asked.disturbance.sizes, np.exp(-WINDOW / asked.disturbance.time_s)
    windows = int(time[-1] / WINDOW) + 2
    pushed = np.stack(
        [size * _process(normal(windows, seed, key, dof.name), share) for size, dof in zip(sizes, PLANAR.dofs)]
    )
    knots = np.unique(np.concatenate([time, switches - AROUND, switches + AROUND]))
    knots = knots[(knots >= 0) & (knots <= time[-1])]
    held = _in_force(knots, switches, commands)
    extras = {SURGE.command: held[:, 0], SWAY.command: held[:, 1]}
    run = Run(name, key, knots, np.zeros(len(knots)), held[:, 2], "N m", extras, dof=YAW)
    batch = make_batch([run], STEP, motion=PLANAR)
    first = np.array([0.0, 0.0, np.deg2rad(float(start))]).reshape(3, 1, 1)
    found = simulate(
        asked.model(), batch,
        start=Start(first, log_gain=np.log(gain), disturbance=pushed[:, None, None, : batch.windows]),
    )  # fmt: skip
    at = np.searchsorted(knots, time)
    truth = np.concatenate([found.positions[0, 0], found.velocities[0, 0]], axis=1)[at]
    truth[:, 2] = found.reading(batch.channels[-1])[0, 0, at]  # the compass has errors of its own
    truth[:, [2, 5]] = np.rad2deg(truth[:, [2, 5]])
    true = dict(zip(("north_m", "east_m", "heading_deg", "surge_m_s", "sway_m_s", "yaw_rate_deg_s"), truth.T))
    shown = _in_force(time, switches, commands)
    columns = {
        "time_s": _rounded(begin + time),
        **{name: _sensed(asked, seed, key, name, time, true[name]) for name in asked.sensors},
        "force_X_N": _rounded(shown[:, 0]),
        "force_Y_N": _rounded(shown[:, 1]),
        "tau_Nm": _rounded(shown[:, 2]),
    }
    return PlanarMade(group, name, begin, float(start), gain, switches, commands, pushed, columns)


def _commands(group: PlanarRuns, seed: int, key: str) -> tuple[Floats, list[float]]:
    """Commands (n, 3) and for how long each is held [s]."""
    if group.largest is None:
        given = np.array(group.commands, dtype=float)
        return given[:, :3], given[:, 3].tolist()
    least, most = group.hold_s
    holds: list[float] = []
    drawn = uniform(int(group.duration_s / least) + 1, seed, key, "hold")
    for one in drawn:
        left = group.duration_s - sum(holds)
        if left < least:
            break
        hold = least + (most - least) * float(one)
        holds.append(left if left - hold < least else hold)
    draw = np.stack([uniform(len(holds), seed, key, "command", dof.name) for dof in PLANAR.dofs], axis=1)
    return _rounded((2.0 * draw - 1.0) * group.largest), holds


def _in_force(time: Floats, switches: Floats, commands: Floats) -> Floats:
    """The commands in force at each `time`, (N, 3): none before the first."""
    return np.vstack([np.zeros(3), commands])[np.searchsorted(switches, time, side="right")]


def _process(drawn: Floats, share: float) -> Floats:
    """An Ornstein-Uhlenbeck process of unit size on even instants; this `share` is left from one to the next."""
    found = np.empty(len(drawn))
    value = found[0] = drawn[0]
    for i, one in enumerate(drawn[1:], 1):
        value = found[i] = share * value + np.sqrt(1.0 - share**2) * one
    return found


def _sensed(asked: PlanarSpecification, seed: int, key: str, name: str, time: Floats, true: Floats) -> Floats:
    """What a sensor logs of the `true` values (N,): held between its readings, noisy, biased, rounded, wrapped."""
    sensor, count = asked.sensors[name], len(time)
    noise = sensor.noise * normal(count, seed, key, name) + sensor.bias * normal(1, seed, key, name, "bias")
    read = true + noise
    if sensor.every_s is not None:
        rows = np.flatnonzero(np.diff(np.floor((time + 1e-9) / sensor.every_s), prepend=-1.0) > 0)
        read = read[rows[np.searchsorted(rows, np.arange(count), side="right") - 1]]
    if name != "heading_deg":
        return _rounded(read)
    wrapped = _rounded(read % 360.0)
    return np.where(wrapped >= 360.0, 0.0, wrapped)


def _rounded(values: Floats) -> Floats:
    """Rounded, and no negative zeros."""
    return np.asarray(np.round(values, DECIMALS) + 0.0)
