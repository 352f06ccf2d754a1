"""A specification becomes runs with known truth: their plans, what is drawn for each, its motion, and its log."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby, islice
from math import exp, floor, log2
from string import ascii_lowercase

import numpy as np

from automarine_cli import effects
from automarine_cli.dofs import SURGE, SWAY, YAW, Dof
from automarine_cli.dofs.motion import PLANAR
from automarine_cli.errors import SettingError
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.pipeline.parallel import ordered_map
from automarine_cli.pipeline.progress import Progress, silent
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import WINDOW, make_batch
from automarine_cli.simulation.rollout import Start, simulate, step_for
from automarine_cli.simulation.run_groups import Commands, Resistance, RunGroup
from automarine_cli.simulation.specification import Logger, PlanarRuns, PlanarSpecification, Specification
from automarine_cli.simulation.streams import normal, uniform

FINER = 8.0  # steps are this much shorter than a fit needs: the error stays below the last digit logged
PLANAR_STEP = 0.02  # s: the error stays far below the last digit logged
AROUND = 1e-7  # s: the command changes in the middle of an interval of twice this length
CHUNK = 64  # runs that are simulated together
MOST_REDRAWS = 10_000
MOST_SAMPLES, MOST_RUNS = 500_000_000, 1_000_000
DECIMALS = 3  # of seconds, degrees and metres in every log
MOMENT_DECIMALS = 6
EARLY_END = 40.0 / 60.0  # of the least way: where a run that ends early ends
STUCK_AFTER = 5  # samples of the step before the sensor sticks


@dataclass(frozen=True)
class Plan:
    """One run to be made: `key` names its random streams; `name` its run, `file` its log.

    `samples` are logged; from sample `changes[j]` on `moments[j]` shows in the log, before the first `moments`
    nothing is commanded. `turn` counts the runs of the specification; `start` [s] is the campaign's clock at the
    first sample.
    """

    key: str
    name: str
    file: str
    group: RunGroup
    turn: int
    samples: int
    changes: tuple[int, ...]
    moments: tuple[float, ...]
    start: float = 0.0


@dataclass(frozen=True)
class Log:
    """What is in one run's log: `time_s`, `position`, `moment` (of a translation the force) and perhaps `rate`, shape
    (N,), in the unit of logs, rounded.

    `lost` samples were dropped, `glitches` left in.
    """

    time_s: Floats
    position: Floats
    moment: Floats
    rate: Floats | None
    lost: int
    glitches: int


@dataclass(frozen=True)
class Drawn:
    """What was drawn for one run: start position and sensor's zero [rad or m], the factor on the command delivered,
    the constant moment or force added, the instants [s since the first sample] at which commands changed, and
    the bias of the rate logged [rad/s or m/s].
    """

    start: float
    zero: float
    log_gain: float
    added_moment: float
    switches: Floats
    rate_bias: float = 0.0

    @property
    def gain(self) -> float:
        """Moment or force delivered over the one commanded."""
        return exp(self.log_gain)


@dataclass(frozen=True)
class SimulatedRun:
    """One run: its plan, what was drawn for it, and its log."""

    plan: Plan
    drawn: Drawn
    log: Log


def make_campaign(
    specification: Specification, seed: int | None = None, *, jobs: int = 1, progress: Progress = silent
) -> tuple[SimulatedRun, ...]:
    """Make all runs, in the order in which they are made; the same for any `jobs`. Raises SettingError."""
    seed = specification.seed if seed is None else seed
    plans = make_plans(specification, seed)
    steps = [_step(plan, specification) for plan in plans]
    chunks = _chunks(plans, steps, whole=bool(specification.effects))
    work = [(tuple(plans[i] for i in chunk), min(steps[i] for i in chunk)) for chunk in chunks]
    make = partial(_make, specification=specification, seed=seed)
    found = ordered_map(make, work, jobs, progress=progress, stage="simulating")
    made = dict(zip((i for chunk in chunks for i in chunk), (run for runs in found for run in runs)))
    return tuple(made[i] for i in range(len(plans)))


def _chunks(plans: Sequence[Plan], steps: Sequence[float], whole: bool) -> list[list[int]]:
    """Indices of the runs that are simulated together: runs of one step, so that no run's numbers depend on
    the others.

    The `whole` campaign where there are effects, since an effect may look at all of it.
    """
    if whole:
        return [list(range(len(plans)))] if plans else []
    order = sorted(range(len(plans)), key=lambda i: (steps[i], plans[i].samples, i))
    alike = [list(same) for _, same in groupby(order, key=lambda i: steps[i])]
    return [same[i : i + CHUNK] for same in alike for i in range(0, len(same), CHUNK)]


def _step(plan: Plan, specification: Specification) -> float:
    """Step [s] for one run, a power of two: few different ones, and none depends on the other runs."""
    largest = max((abs(moment) for moment in plan.moments), default=0.0)
    wanted = step_for(specification.model(), largest) / FINER
    return float(2.0 ** floor(log2(wanted)))


def _make(work: tuple[Sequence[Plan], float], specification: Specification, seed: int) -> list[SimulatedRun]:
    plans, step = work
    logger = specification.logger
    drawn = [_draw(plan, specification, seed) for plan in plans]
    times = [sample_times(plan, logger, seed) for plan in plans]
    truth = _truth(plans, specification, drawn, times, step, seed)
    made = []
    for plan, draw, time, (position, rate) in zip(plans, drawn, times, truth):
        readings = position + draw.zero, rate + draw.rate_bias
        log = log_run(plan, logger, seed, time, *readings, draw.switches, specification.vehicle.dof)
        made.append(SimulatedRun(plan, draw, log))
    return made


def _draw(plan: Plan, specification: Specification, seed: int) -> Drawn:
    scatter, key = specification.scatter, plan.key
    if scatter.start == "random":
        start = 360.0 * float(uniform(1, seed, key, "start heading")[0])
    elif isinstance(scatter.start, tuple):
        start = scatter.start[plan.turn % len(scatter.start)]
    else:
        start = float(scatter.start)
    dof, bias = specification.vehicle.dof, specification.logger.rate_bias or 0.0
    return Drawn(
        start=float(dof.inner(start)),
        zero=float(dof.inner(scatter.zero) * normal(1, seed, key, "heading zero")[0]),
        log_gain=scatter.gain * float(normal(1, seed, key, "gain")[0]),
        added_moment=_added_moment(plan, specification, seed),
        switches=switch_times(plan, specification.logger, seed),
        rate_bias=float(dof.inner(bias) * normal(1, seed, key, "rate bias")[0]),
    )


def _added_moment(plan: Plan, specification: Specification, seed: int) -> float:
    scatter = specification.scatter
    if scatter.force == 0:
        return 0.0
    smallest = min((abs(moment) for moment in plan.moments if moment), default=np.inf)
    most = np.inf if scatter.force_most is None else scatter.force_most * smallest
    for draw in range(MOST_REDRAWS):
        moment = scatter.force * float(normal(1, seed, plan.key, "moment", str(draw))[0])
        if abs(moment) <= most:
            return moment
    force = specification.vehicle.dof.words.force
    raise SettingError(
        f"{specification.source}: scatter.{force} is {scatter.force:g}, far above {force}_most of the {force} "
        f"{smallest:g} of run {plan.name!r}; expected less scatter, or a larger {force}_most"
    )


def _truth(
    plans: Sequence[Plan], specification: Specification, drawn: Sequence[Drawn], times: Sequence[Floats], step: float,
    seed: int,
) -> list[tuple[Floats, Floats]]:  # fmt: skip
    """True reading [rad or m] and rate [rad/s or m/s] of each run at its samples."""
    model = specification.model()
    held = specification.campaign.held
    clocks = [_knots(time, draw.switches, held) for time, draw in zip(times, drawn)]
    runs = [
        Run(
            plan.name, plan.file, plan.start + clock, np.zeros_like(clock),
            commanded(clock, draw.switches, plan.moments), model.moment_unit, dof=model.dof,
        )
        for plan, draw, clock in zip(plans, drawn, clocks)
    ]  # fmt: skip
    batch = make_batch(runs, step, hold=False)
    added = np.array([draw.added_moment for draw in drawn])
    start = Start(
        position=np.array([[draw.start for draw in drawn]]),
        log_gain=np.array([[draw.log_gain for draw in drawn]]),
        own=_own_phases(model, plans, seed),
        disturbance=np.broadcast_to(added[None, :, None], (1, len(plans), batch.windows)),
    )
    found = simulate(model, batch, start=start)
    truth = []
    for i, (plan, clock, time) in enumerate(zip(plans, clocks, times)):
        node = np.searchsorted(clock, np.maximum(time, clock[0]))  # held still before the clock begins
        if plan.group.fault == "never-moves":
            node = np.zeros_like(node)
        truth.append((found.position[0, i, node], found.velocity[0, i, node]))
    return truth


def _own_phases(model: YawModel, plans: Sequence[Plan], seed: int) -> dict[str, Floats]:
    """Sine and cosine (1, R, 2) of each run's own wave, for effects that vary from run to run: any phase is as
    likely."""
    own = {}
    for term in model.terms:
        if effects.get(term.name).varies(term.values):
            phase = np.array([2.0 * np.pi * uniform(1, seed, plan.key, term.name)[0] for plan in plans])
            own[term.name] = term.values[0] * np.stack([np.cos(phase), np.sin(phase)], axis=1)[None]
    return own


def _knots(time: Floats, switches: Floats, held: bool) -> Floats:
    """Instants at which a run is simulated [s]: its samples, and close to both sides of each change of command.

    They begin with the first sample; with the first change where that comes earlier or the vehicle is `held`.
    """
    first = time[0]
    if len(switches) and (held or switches[0] < first):
        first = switches[0]
    knots = np.unique(np.concatenate([[first], time, switches - AROUND, switches + AROUND]))
    return np.asarray(knots[knots >= first])


def make_plans(specification: Specification, seed: int) -> tuple[Plan, ...]:
    """Plan all runs in the order in which they are made.

    Raises SettingError for two runs of one name in one file, two groups that write one file, and a campaign of
    more than half a thousand million samples.
    """
    asked = sum(group.repeats for group in specification.runs)  # before any is made: it may be a thousand million
    plans = [] if asked > MOST_RUNS else list(islice(_listed(specification), MOST_RUNS + 1))
    if max(asked, len(plans)) > MOST_RUNS:
        raise SettingError(f"{specification.source}: more than {MOST_RUNS} runs would be made; ask for fewer")
    _refuse_clashes(plans, specification)
    total = sum(plan.samples for plan in plans)
    if total > MOST_SAMPLES:
        raise SettingError(
            f"{specification.source}: {total:.3g} samples would be made; expected at most {MOST_SAMPLES:.0g}. "
            "Ask for fewer or shorter runs, or a lower rate_hz"
        )
    if specification.campaign.order == "random":
        plans.sort(key=lambda plan: float(uniform(1, seed, plan.key, "order")[0]))
    placed, clock = [], 0.0
    for plan in plans:
        placed.append(replace(plan, start=round(clock, 6)))
        wait = specification.campaign.wait_between_s if plan.group.wait_after_s is None else plan.group.wait_after_s
        clock += plan.samples * specification.logger.period + wait
    return tuple(placed)


def _listed(specification: Specification) -> Iterator[Plan]:
    """Plans in the order of the specification, repeats of a run one after the other."""
    vehicle = specification.vehicle
    drag = Resistance(vehicle.inertia, vehicle.linear, vehicle.quadratic, vehicle.dof, vehicle.constant)
    turn = 0
    for group in specification.runs:
        for label, commands in group.cases(drag):
            for repeat in range(group.repeats):
                name = f"{label}_{_letter(group, repeat)}".rstrip("_")
                stem = name if group.together is None else group.together
                samples, changes, moments = _on_the_grid(commands, specification)
                key, file = f"{group.folder}/{label}#{group.suffix or repeat}", f"{group.folder}/{stem}.{group.format}"
                yield Plan(key, name, file, group, turn, samples, changes, moments)
                turn += 1


def _letter(group: RunGroup, repeat: int) -> str:
    if group.suffix is not None or group.repeats == 1:
        return group.suffix or ""
    return ascii_lowercase[repeat] if group.repeats <= len(ascii_lowercase) else str(repeat + 1)


def _on_the_grid(commands: Commands, specification: Specification) -> tuple[int, tuple[int, ...], tuple[float, ...]]:
    """Number of samples, first sample of each command, the commands: rests included, zeros at the start left
    out.
    """
    schedule, rate = specification.campaign, specification.logger.rate_hz
    whole = ((0.0, schedule.rest_before_s), *commands, (0.0, schedule.rest_after_s))
    ends = np.round(np.cumsum([seconds for _, seconds in whole]) * rate)
    begins, held = np.concatenate([[0.0], ends[:-1]]), 0.0
    changes, moments = [], []
    for (moment, _), begin, end in zip(whole, begins, ends):
        if moment != held and end > begin:
            changes.append(int(begin))
            moments.append(moment)
            held = moment
    return int(ends[-1]), tuple(changes), tuple(moments)


def _refuse_clashes(plans: list[Plan], specification: Specification) -> None:
    runs: set[tuple[str, str]] = set()
    owners: dict[str, tuple[str, int]] = {}
    if specification.bollard is not None:
        owners[specification.bollard.file.lower()] = ("the bollard test", -1)
    for plan in plans:
        if plan.samples < 2:
            raise SettingError(
                f"{specification.source}: run {plan.name!r} has {plan.samples} samples; expected at least 2"
            )
        file = plan.file.lower()  # some file systems do not tell A from a
        several = plan.group.together is not None
        owner = ("one file together", 0) if several else (plan.name, plan.turn)
        if (file, plan.name) in runs or owners.setdefault(file, owner) != owner:
            raise SettingError(
                f"{specification.source}: two runs would be written as {plan.name!r} in {plan.file}; "
                "give one of their groups another name, folder or suffix"
            )
        runs.add((file, plan.name))


def sample_times(plan: Plan, logger: Logger, seed: int) -> Floats:
    """Draw the instants of the samples since the run's nominal first one [s], shape (N,); never falling."""
    even = np.asarray(np.arange(plan.samples) * logger.period, dtype=np.float64)
    if logger.clock_jitter_s == 0:
        return even
    off = logger.clock_jitter_s * normal(plan.samples, seed, plan.key, "clock")
    return np.asarray(even + np.clip(off, -0.45 * logger.period, 0.45 * logger.period))


def switch_times(plan: Plan, logger: Logger, seed: int) -> Floats:
    """Draw the instants at which the commands change [s], each anywhere within the sample interval before it shows."""
    share = uniform(len(plan.changes), seed, plan.key, "switch")
    return np.asarray((np.array(plan.changes, dtype=float) - share) * logger.period)


def commanded(time: Floats, switches: Floats, levels: Floats | tuple[float, ...]) -> Floats:
    """Return the command in force at each `time` [s], (N, ...) of levels (K, ...): nothing before the first switch."""
    values = np.asarray(levels, dtype=np.float64)
    return np.concatenate([np.zeros((1, *values.shape[1:])), values])[np.searchsorted(switches, time, side="right")]


def log_run(
    plan: Plan, logger: Logger, seed: int, time: Floats, position: Floats, rate: Floats, switches: Floats, dof: Dof
) -> Log:
    """Log a run whose sensors would read `position` [rad or m] and `rate` [rad/s or m/s] at `time` [s since
    its first sample] without noise, all of shape (N,).
    """
    count = len(time)
    reading = dof.logged(position) + logger.noise * normal(count, seed, plan.key, "noise")
    glitch = uniform(count, seed, plan.key, "glitch") < logger.glitch
    side = np.where(uniform(count, seed, plan.key, "glitch side") < 0.5, -1.0, 1.0)
    reading = reading + np.where(glitch, side * logger.glitch_size, 0.0)
    moment = commanded(time, switches, plan.moments)
    logged = uniform(count, seed, plan.key, "lost") >= logger.dropout
    lost = int(np.count_nonzero(~logged))
    if plan.group.fault == "stuck-compass" and plan.changes:
        stuck = min(plan.changes[0] + STUCK_AFTER, count - 1)
        reading[stuck:] = reading[stuck]
    if plan.group.fault == "ends-early":
        beyond = np.abs(position - position[0]) > EARLY_END * dof.limits.least
        logged[int(np.argmax(beyond)) if beyond.any() else count // 2 :] = False
    sensed = None
    if logger.rate_noise is not None:
        noise = logger.rate_noise * normal(count, seed, plan.key, "rate noise")
        sensed = _rounded(dof.logged(rate) + noise)[logged]
    return Log(
        time_s=_rounded(plan.start + time)[logged],
        position=_wrapped(reading, logger)[logged],
        moment=_rounded(moment, MOMENT_DECIMALS)[logged],
        rate=sensed,
        lost=lost,
        glitches=int(np.count_nonzero(glitch & logged)),
    )


def _wrapped(reading: Floats, logger: Logger) -> Floats:
    """Quantised, wrapped and rounded as the sensor says it."""
    if logger.quantisation > 0:
        reading = np.round(reading / logger.quantisation) * logger.quantisation
    return _rounded(reading) if logger.wrap == "none" else _turned(reading, 0.0 if logger.wrap == "0..360" else -180.0)


def _turned(reading: Floats, low: float) -> Floats:
    """Headings [degrees] from `low` on, below `low` + 360, rounded."""
    wrapped = _rounded((reading - low) % 360.0)
    return _rounded(np.where(wrapped >= 360.0, 0.0, wrapped) + low)


def _rounded(values: Floats, decimals: int = DECIMALS) -> Floats:
    """Rounded, and no negative zeros."""
    return np.asarray(np.round(values, decimals) + 0.0)


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
    """Make all runs of a campaign in the plane, in the order of the specification."""
    made, begin = [], 0.0
    for group in asked.runs:
        for repeat in range(group.repeats):
            letter = f"_{ascii_lowercase[repeat]}" if repeat < 26 else f"_{repeat + 1}"
            name = group.name + letter * (group.repeats > 1)
            made.append(_planar_run(asked, seed, group, name, begin))
            begin += float(np.ptp(made[-1].columns["time_s"][[0, -1]])) + asked.logger.wait_between_s
    return tuple(made)


def _planar_run(asked: PlanarSpecification, seed: int, group: PlanarRuns, name: str, begin: float) -> PlanarMade:
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
    held = commanded(knots, switches, commands)
    extras = {SURGE.command: held[:, 0], SWAY.command: held[:, 1]}
    run = Run(name, key, knots, np.zeros(len(knots)), held[:, 2], "N m", extras, dof=YAW)
    batch = make_batch([run], PLANAR_STEP, motion=PLANAR)
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
    shown = commanded(time, switches, commands)
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
    for share in drawn:
        left = group.duration_s - sum(holds)
        if left < least:
            break
        hold = least + (most - least) * float(share)
        holds.append(left if left - hold < least else hold)
    draw = np.stack([uniform(len(holds), seed, key, "command", dof.name) for dof in PLANAR.dofs], axis=1)
    return _rounded((2.0 * draw - 1.0) * group.largest), holds


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
    return _turned(read, 0.0) if name == "heading_deg" else _rounded(read)
