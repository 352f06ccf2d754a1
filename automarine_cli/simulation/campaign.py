"""A specification becomes runs with known truth: their plans, what is drawn for each, its motion, and its log, as CSV
(the same bytes on every machine), CSV in gzip or Parquet."""

import gzip
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain, groupby, islice
from math import exp, floor, log2
from typing import Any, TypeAlias

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from automarine_cli import effects
from automarine_cli.dofs import DOFS, SURGE, SWAY
from automarine_cli.dofs.motion import PLANAR
from automarine_cli.errors import SettingError
from automarine_cli.models.allocation import Vehicle
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.pipeline.parallel import Progress, ordered_map, silent
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import Run
from automarine_cli.simulation import specification as spec
from automarine_cli.simulation.batch import WINDOW, make_batch
from automarine_cli.simulation.rollout import Start, simulate, step_for
from automarine_cli.simulation.specification import (
    AnySpecification,
    PlanarSpecification,
    Specification,
    normal,
    uniform,
)

FINER = 8.0  # steps are this much shorter than a fit needs: the error stays below the last digit logged
PLANAR_STEP = 0.02  # s: the error stays far below the last digit logged
AROUND = 1e-7  # s: the command changes in the middle of an interval of twice this length
CHUNK = 64  # runs that are simulated together
MOST_REDRAWS = 10_000
MOST_SAMPLES, MOST_RUNS = 500_000_000, 1_000_000
DECIMALS = 3  # of seconds, degrees and metres in every log
MOMENT_DECIMALS = 6


@dataclass(frozen=True)
class Plan:
    """One run to be made: `key` names its random streams; `name` its run, `file` its log.

    `samples` are logged; from sample `changes[j]` on `moments[j]` (in the plane X, Y and N) shows in the log, before
    the first nothing is commanded. `turn` counts the runs of the specification; `start` [s] is the campaign's clock at
    the first sample."""

    key: str
    name: str
    file: str
    group: spec.RunGroup | spec.PlanarRuns
    turn: int
    samples: int
    changes: tuple[int, ...]
    moments: tuple[Any, ...]
    start: float = 0.0


@dataclass(frozen=True)
class SimulatedRun:
    """One run: its plan, what was drawn for it, and its log.

    Drawn are start position (in the plane heading) and sensor's zero [rad or m], the logarithm of the factor on the
    command delivered, the instants [s since the first sample] at which commands changed, the constant moment or force
    added, the bias of the rate logged [rad/s or m/s], and the `disturbance` (D, windows), held over windows of two
    seconds. `columns` (N,) are in the units of logs, rounded; `lost` samples were dropped, `glitches` left in."""

    plan: Plan
    start: float
    log_gain: float
    switches: Floats
    zero: float = 0.0
    added_moment: float = 0.0
    rate_bias: float = 0.0
    disturbance: Floats | None = None
    columns: Mapping[str, Floats] = field(default_factory=dict)
    lost: int = 0
    glitches: int = 0

    @property
    def gain(self) -> float:
        return exp(self.log_gain)


def make_campaign(
    specification: AnySpecification, seed: int | None = None, *, jobs: int = 1, progress: Progress = silent
) -> tuple[SimulatedRun, ...]:
    """Make all runs, in the order in which they are made; the same for any `jobs`. Raises SettingError."""
    seed = specification.seed if seed is None else seed
    plans = make_plans(specification, seed)
    model = specification.model()
    steps = [_step(plan, model) for plan in plans]
    chunks = _chunks(plans, steps, specification)
    work = [(tuple(plans[i] for i in chunk), min(steps[i] for i in chunk)) for chunk in chunks]
    make = partial(_make, specification=specification, seed=seed)
    results = ordered_map(make, work, jobs, progress=progress, stage="simulating")
    runs = dict(zip((i for chunk in chunks for i in chunk), (run for part in results for run in part)))
    return tuple(runs[i] for i in range(len(plans)))


def _chunks(plans: Sequence[Plan], steps: Sequence[float], specification: AnySpecification) -> list[list[int]]:
    """Indices of the runs that are simulated together: runs of one step, so that no run's numbers depend on
    the others; in the plane each by itself.

    The whole campaign where there are effects, since an effect may look at all of it."""
    if specification.effects:
        return [list(range(len(plans)))] if plans else []
    chunk = 1 if specification.motion.turns else CHUNK
    order = sorted(range(len(plans)), key=lambda i: (steps[i], plans[i].samples, i))
    alike = [list(same) for _, same in groupby(order, key=lambda i: steps[i])]
    return [same[i : i + chunk] for same in alike for i in range(0, len(same), chunk)]


def _step(plan: Plan, model: Vehicle) -> float:
    """A power of two [s]: few different ones, and none depends on the other runs."""
    if not isinstance(model, YawModel):
        return PLANAR_STEP
    largest = max((abs(moment) for moment in plan.moments), default=0.0)
    return float(2.0 ** floor(log2(step_for(model, largest) / FINER)))


def _make(work: tuple[Sequence[Plan], float], specification: AnySpecification, seed: int) -> list[SimulatedRun]:
    plans, step = work
    times = [sample_times(plan, specification.logger, seed) for plan in plans]
    drawn = [_draw(plan, specification, seed, time) for plan, time in zip(plans, times)]
    truth = _truth(drawn, specification, times, step, seed)
    log = _log_in_plane if isinstance(specification, PlanarSpecification) else _log
    return [log(*run, specification, seed) for run in zip(drawn, times, truth)]  # type: ignore[arg-type]


def _draw(plan: Plan, specification: AnySpecification, seed: int, time: Floats) -> SimulatedRun:
    scatter, key, start = specification.scatter, plan.key, specification.scatter.start
    if start == "random":
        start = 360.0 * float(uniform(1, seed, key, "start heading")[0])
    elif isinstance(start, tuple):
        start = start[plan.turn % len(start)]
    inner = scatter.dof.inner
    gain = scatter.gain * float(normal(1, seed, key, "gain")[0])
    share = uniform(len(plan.changes), seed, key, "switch")  # of the sample interval before a change shows
    switches = np.asarray((np.array(plan.changes, dtype=float) - share) * specification.logger.period)
    run = SimulatedRun(plan, float(inner(start)), gain, switches)
    if isinstance(specification, PlanarSpecification):
        disturbance, windows = specification.disturbance, int(time[-1] / WINDOW) + 2
        share = np.exp(-WINDOW / disturbance.time_s)
        sizes = (disturbance.surge_N, disturbance.sway_N, disturbance.yaw_Nm)
        pushed = [size * lasting(normal(windows, seed, key, dof.name), share) for size, dof in zip(sizes, PLANAR.dofs)]
        return replace(run, disturbance=np.stack(pushed))
    bias = specification.logger.rate_bias or 0.0
    return replace(
        run,
        zero=float(inner(specification.scatter.zero) * normal(1, seed, key, "heading zero")[0]),
        added_moment=_added_moment(plan, specification, seed),
        rate_bias=float(inner(bias) * normal(1, seed, key, "rate bias")[0]),
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
    drawn: Sequence[SimulatedRun], specification: AnySpecification, times: Sequence[Floats], step: float, seed: int
) -> list[Floats]:
    """Positions and velocities of each run at its samples, (N, 2 D) in base units; the position of the one degree of
    freedom, in the plane the heading, as its sensor reads it."""
    model, motion, plans = specification.model(), specification.motion, [run.plan for run in drawn]
    clocks = [_knots(time, run.switches, specification.campaign.held) for time, run in zip(times, drawn)]
    runs = []
    for plan, run, clock in zip(plans, drawn, clocks):
        commands = commanded(clock, run)
        extras = {SURGE.command: commands[:, 0], SWAY.command: commands[:, 1]} if motion.turns else {}
        unit = model.moment_unit if isinstance(model, YawModel) else "N m"
        time, zeros = plan.start + clock, np.zeros_like(clock)
        runs.append(Run(plan.name, plan.file, time, zeros, commands[:, -1], unit, extras, dof=motion.dofs[-1]))
    batch = make_batch(runs, step, hold=False, motion=motion)
    size, last = len(motion.dofs), len(motion.dofs) - 1
    position = np.zeros((size, 1, len(plans)))
    position[last, 0] = [run.start for run in drawn]
    pushed = [
        np.full((size, batch.windows), run.added_moment) if run.disturbance is None
        else run.disturbance[:, : batch.windows]
        for run in drawn
    ]  # fmt: skip
    start = Start(
        position,
        log_gain=np.array([[run.log_gain for run in drawn]]),
        own=_own_phases(model, plans, seed) if isinstance(model, YawModel) else {},
        disturbance=np.stack(pushed, axis=1)[:, None],
    )
    result = simulate(model, batch, start=start)
    truth = np.concatenate([result.positions[0], result.velocities[0]], axis=2)
    truth[:, :, last] = result.reading(batch.channels[-1])[0]
    at_samples = []
    for states, plan, clock, time in zip(truth, plans, clocks, times):
        node = np.searchsorted(clock, np.maximum(time, clock[0]))  # held still before the clock begins
        at_samples.append(states[np.zeros_like(node) if plan.group.fault == "never-moves" else node])
    return at_samples


def _own_phases(model: YawModel, plans: Sequence[Plan], seed: int) -> dict[str, Floats]:
    """Sine and cosine (1, R, 2) of each run's own wave, for effects that vary from run to run, at any phase."""
    phases = {}
    for term in model.terms:
        if effects.get(term.name).varies(term.values):
            phase = np.array([2.0 * np.pi * uniform(1, seed, plan.key, term.name)[0] for plan in plans])
            phases[term.name] = term.values[0] * np.stack([np.cos(phase), np.sin(phase)], axis=1)[None]
    return phases


def _knots(time: Floats, switches: Floats, is_held: bool) -> Floats:
    """Instants at which a run is simulated [s]: its samples, and close to both sides of each change of command.

    They begin with the first sample; with the first change where that comes earlier, or where the vehicle `is_held`."""
    first = time[0]
    if len(switches) and (is_held or switches[0] < first):
        first = switches[0]
    knots = np.unique(np.concatenate([[first], time, switches - AROUND, switches + AROUND]))
    return np.asarray(knots[knots >= first])


def make_plans(specification: AnySpecification, seed: int) -> tuple[Plan, ...]:
    """Plan all runs in the order in which they are made.

    Raises SettingError for two runs of one name in one file, two groups that write one file, and a campaign of
    more than half a thousand million samples."""
    plans = list(islice(_listed(specification, seed), MOST_RUNS + 1))
    if len(plans) > MOST_RUNS:
        raise SettingError(f"{specification.source}: more than {MOST_RUNS} runs would be made; ask for fewer")
    _refuse_clashes(plans, specification)
    total = sum(plan.samples for plan in plans)
    if total > MOST_SAMPLES:
        raise SettingError(f"{specification.source}: {spec.TOO_MANY_SAMPLES.format(total, MOST_SAMPLES)}")
    if specification.campaign.order == "random":
        plans.sort(key=lambda plan: float(uniform(1, seed, plan.key, "order")[0]))
    placed, clock = [], 0.0
    for plan in plans:
        placed.append(replace(plan, start=round(clock, 6)))
        wait = specification.campaign.wait_between_s if plan.group.wait_after_s is None else plan.group.wait_after_s
        clock += (plan.samples - specification.motion.turns) * specification.logger.period + wait
    return tuple(placed)


def _listed(specification: AnySpecification, seed: int) -> Iterator[Plan]:
    turn, vehicle = 0, specification.vehicle.model
    for group in specification.runs:
        for name, key, commands in group.runs(vehicle, seed):
            file = f"{group.folder}/{name if group.together is None else group.together}.{group.format}"
            yield Plan(key, name, file, group, turn, *_on_the_grid(commands, specification))
            turn += 1


def _on_the_grid(
    commands: Sequence[tuple[Any, float]], specification: AnySpecification
) -> tuple[int, tuple[int, ...], tuple[Any, ...]]:
    """Number of samples (in the plane the end is one), first sample of each command, the commands; rests included."""
    schedule, turns = specification.campaign, specification.motion.turns
    nothing = (0.0, 0.0, 0.0) if turns else 0.0
    padded = ((nothing, schedule.rest_before_s), *commands, (nothing, schedule.rest_after_s))
    ends = np.round(np.cumsum([seconds for _, seconds in padded]) * specification.logger.rate_hz)
    begins, current = np.concatenate([[0.0], ends[:-1]]), nothing
    changes, moments = [], []
    for (moment, _), begin, end in zip(padded, begins, ends):
        if moment != current and end > begin:
            changes.append(int(begin))
            moments.append(moment)
            current = moment
    return int(ends[-1]) + turns, tuple(changes), tuple(moments)


def _refuse_clashes(plans: list[Plan], specification: AnySpecification) -> None:
    files = Counter(plan.file.lower() for plan in plans)  # some file systems do not tell A from a
    runs = Counter((plan.file.lower(), plan.name) for plan in plans)
    bollard = "" if specification.bollard is None else specification.bollard.file.lower()
    for plan in plans:
        if plan.samples < 2:
            wrong = f"run {plan.name!r} has {plan.samples} samples; expected at least 2"
            raise SettingError(f"{specification.source}: {wrong}")
        file, alone = plan.file.lower(), plan.group.together is None
        if runs[file, plan.name] > 1 or (alone and files[file] > 1) or file == bollard:
            raise SettingError(
                f"{specification.source}: two runs would be written as {plan.name!r} in {plan.file}; "
                "give one of their groups another name, folder or suffix"
            )


def sample_times(plan: Plan, logger: spec.Logger | spec.PlanarLogger, seed: int) -> Floats:
    """Draw the instants of the samples since the run's nominal first one [s], shape (N,); never falling."""
    even = np.asarray(np.arange(plan.samples) * logger.period, dtype=np.float64)
    if logger.clock_jitter_s == 0:
        return even
    off = logger.clock_jitter_s * normal(plan.samples, seed, plan.key, "clock")
    return np.asarray(even + np.clip(off, -0.45 * logger.period, 0.45 * logger.period))


def commanded(time: Floats, run: SimulatedRun) -> Floats:
    """Return the command in force at each `time` [s], (N, D): nothing before the first switch."""
    size = 3 if isinstance(run.plan.group, spec.PlanarRuns) else 1
    values = np.concatenate([np.zeros(size), np.ravel(run.plan.moments)]).reshape(-1, size)
    return values[np.searchsorted(run.switches, time, side="right")]


def _log(run: SimulatedRun, time: Floats, truth: Floats, specification: Specification, seed: int) -> SimulatedRun:
    """Log a run of one degree of freedom, position and velocity `truth` (N, 2) at `time` (N,) [s since its start]."""
    plan, logger, dof, count = run.plan, specification.logger, specification.vehicle.dof, len(time)
    position, rate = truth[:, 0] + run.zero, truth[:, 1] + run.rate_bias
    reading = dof.logged(position) + logger.noise * normal(count, seed, plan.key, "noise")
    glitch = uniform(count, seed, plan.key, "glitch") < logger.glitch
    side = np.where(uniform(count, seed, plan.key, "glitch side") < 0.5, -1.0, 1.0)
    reading = reading + np.where(glitch, side * logger.glitch_size, 0.0)
    logged = uniform(count, seed, plan.key, "lost") >= logger.dropout
    lost = int(np.count_nonzero(~logged))
    if logger.quantisation > 0:
        reading = np.round(reading / logger.quantisation) * logger.quantisation
    low, force = {"0..360": 0.0, "-180..180": -180.0}.get(logger.wrap), commanded(time, run)[:, 0]
    columns = {
        "time_s": _rounded(plan.start + time),
        dof.column(dof.position, dof.units.log): _rounded(reading) if low is None else _turned(reading, low),
        dof.column(dof.command, specification.vehicle.force_unit): _rounded(force, MOMENT_DECIMALS),
    }
    if logger.rate_noise is not None:
        noise = logger.rate_noise * normal(count, seed, plan.key, "rate noise")
        columns[dof.column(dof.velocity, f"{dof.units.log}/s")] = _rounded(dof.logged(rate) + noise)
    columns = {name: column[logged] for name, column in columns.items()}
    return replace(run, columns=columns, lost=lost, glitches=int(np.count_nonzero(glitch & logged)))


def _log_in_plane(
    run: SimulatedRun, time: Floats, truth: Floats, specification: PlanarSpecification, seed: int
) -> SimulatedRun:
    names = ("north_m", "east_m", "heading_deg", "surge_m_s", "sway_m_s", "yaw_rate_deg_s")
    true = {name: np.rad2deg(x) if "_deg" in name else x for name, x in zip(names, truth.T)}
    forces = zip(("force_X_N", "force_Y_N", "tau_Nm"), commanded(time, run).T)
    columns = {
        "time_s": _rounded(run.plan.start + time),
        **{name: _sensed(s, time, true[name], seed, run.plan.key, name) for name, s in specification.sensors.items()},
        **{name: _rounded(force) for name, force in forces},
    }
    return replace(run, columns=columns)


def _turned(reading: Floats, low: float) -> Floats:
    """Headings [degrees] from `low` on, below `low` + 360, rounded."""
    wrapped = _rounded((reading - low) % 360.0)
    return _rounded(np.where(wrapped >= 360.0, 0.0, wrapped) + low)


def _rounded(values: Floats, decimals: int = DECIMALS) -> Floats:
    return np.asarray(np.round(values, decimals) + 0.0)


def lasting(drawn: Floats, share: float) -> Floats:
    """Ornstein-Uhlenbeck processes of unit size on even instants (..., N); a `share` is left from one to the next."""
    process = drawn.copy()
    for i in range(1, drawn.shape[-1]):
        process[..., i] = share * process[..., i - 1] + np.sqrt(1.0 - share**2) * drawn[..., i]
    return process


def _sensed(sensor: spec.Sensor, time: Floats, true: Floats, seed: int, key: str, name: str) -> Floats:
    """What a sensor logs of the `true` values (N,): held between its readings, noisy, biased, rounded, wrapped."""
    count = len(time)
    reading = true + (sensor.noise * normal(count, seed, key, name) + sensor.bias * normal(1, seed, key, name, "bias"))
    if sensor.every_s is not None:
        rows = np.flatnonzero(np.diff(np.floor((time + 1e-9) / sensor.every_s), prepend=-1.0) > 0)
        reading = reading[rows[np.searchsorted(rows, np.arange(count), side="right") - 1]]
    return _turned(reading, 0.0) if name == "heading_deg" else _rounded(reading)


Column: TypeAlias = Floats | Sequence[str]
COMMANDS = {"n", *(name for dof in DOFS.values() for name, _ in dof.columns[dof.command])}
"""Columns of CSV that have as many decimals as the number; every other one has `DECIMALS`."""


def label(specification: AnySpecification, seed: int) -> str:
    return f"Simulated by automarine from {specification.source}, seed {seed}: no measurement."


def runs_by_file(runs: Sequence[SimulatedRun]) -> dict[str, list[SimulatedRun]]:
    """Sort the runs by the name of the log that they are in, in the order of the specification."""
    files: dict[str, list[SimulatedRun]] = {}
    for run in sorted(runs, key=lambda run: run.plan.turn):
        files.setdefault(run.plan.file, []).append(run)
    return files


def log_of(runs: Sequence[SimulatedRun], specification: AnySpecification, seed: int) -> bytes:
    group, columns = runs[0].plan.group, dict[str, Column]()
    if group.together is not None:
        columns["run"] = [run.plan.name for run in runs for _ in run.columns["time_s"]]
    columns |= {name: np.concatenate([run.columns[name] for run in runs]) for name in runs[0].columns}
    return log_bytes(columns, group.format, label(specification, seed))


def log_bytes(columns: Mapping[str, Column], format: str, comment: str) -> bytes:
    """One log in the format "csv", "csv.gz" or "parquet"; `comment` goes first, or into Parquet's metadata."""
    if format == "parquet":
        return parquet_bytes(columns, comment)
    head = [f"# {comment}", ",".join(columns)]
    rows = map(",".join, zip(*(_cells(name, column) for name, column in columns.items())))
    text = "\n".join(chain(head, rows)) + "\n"
    return text.encode() if format == "csv" else gzip_bytes(text.encode())


def parquet_bytes(columns: Mapping[str, Column], comment: str) -> bytes:
    sink = pa.BufferOutputStream()
    pq.write_table(pa.table(dict(columns), metadata={"comment": comment}), sink)
    return bytes(sink.getvalue().to_pybytes())


def _cells(name: str, column: Column) -> Iterable[str]:
    if not isinstance(column, np.ndarray):
        return column
    if name in COMMANDS:
        return (f"{value:.{MOMENT_DECIMALS}f}".rstrip("0").rstrip(".") for value in column.tolist())
    return (f"{value:.{DECIMALS}f}" for value in column.tolist())


def gzip_bytes(data: bytes) -> bytes:
    """A gzip file that holds the data as they are: what a compressor makes of them changes with its version."""
    head = b"\x1f\x8b\x08\0\0\0\0\0\0\xff"  # deflate, no time, no operating system
    return head + gzip.compress(data, 0, mtime=0)[len(head) :]
