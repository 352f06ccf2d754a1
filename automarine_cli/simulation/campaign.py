"""A specification becomes runs with known truth: their plans, what is drawn for each, its motion, and its log, as CSV
(the same bytes on every machine), CSV in gzip or Parquet."""

import gzip
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import groupby, islice
from math import exp, floor, log2, radians
from typing import TypeAlias

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from automarine_cli import effects
from automarine_cli.dofs import DOFS, SURGE, SWAY
from automarine_cli.errors import SettingError
from automarine_cli.logs.table import csv_text
from automarine_cli.models.model import Model
from automarine_cli.pipeline.parallel import Progress, ordered_map, silent
from automarine_cli.quantities import RUDDER_COLUMN, Floats
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import WINDOW_S, make_batch
from automarine_cli.simulation.rollout import Start, simulate, step_for
from automarine_cli.simulation.specification import Commands, RunGroup, Specification, normal, uniform

STEP_REFINEMENT = 8.0  # steps are this much shorter than a fit needs: the error stays below the last digit logged
PLANAR_STEP_S = 0.02  # s: the error stays far below the last digit logged
SWITCH_HALF_WIDTH_S = 1e-7  # s: the command changes in the middle of an interval of twice this length
CHUNK_RUNS = 64  # runs that are simulated together
MAX_REDRAWS = 10_000
MAX_SAMPLES, MAX_SIMULATED_RUNS = 500_000_000, 1_000_000
LOG_DECIMALS = 3  # of seconds, degrees and metres in every log
MOMENT_DECIMALS = 6


@dataclass(frozen=True)
class Plan:
    """One run to be made: `key` names its random streams; `name` its run, `file` its log. `samples` are logged; from
    sample `changes[j]` on `moments[j]` (of each degree of freedom) shows in the log, before the first nothing is
    commanded. `turn` counts the runs of the specification; `start` [s] is the campaign's clock at the first sample."""

    key: str
    name: str
    file: str
    group: RunGroup
    turn: int
    samples: int
    changes: tuple[int, ...]
    moments: tuple[tuple[float, ...], ...]
    start: float = 0.0


@dataclass(frozen=True)
class SimulatedRun:
    """One run: its plan, what was drawn for it, and its log. Drawn are start position (in the plane heading) [rad or
    m], the logarithm of the factor on the command delivered, the instants [s since the first sample] at which commands
    changed, the constant moment or force added, the `biases` of the sensors by column [units of logs], and the
    `disturbance` (D, windows), held over windows of two seconds. `columns` (N,) are in the units of logs, rounded."""

    plan: Plan
    start: float
    log_gain: float
    switches: Floats
    biases: Mapping[str, float]
    added_moment: float
    disturbance: Floats
    columns: Mapping[str, Floats] = field(default_factory=dict)

    @property
    def gain(self) -> float:
        return exp(self.log_gain)


def make_campaign(
    specification: Specification, seed: int | None = None, *, jobs: int = 1, progress: Progress = silent
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


def _chunks(plans: Sequence[Plan], steps: Sequence[float], specification: Specification) -> list[list[int]]:
    """Indices of the runs that are simulated together: runs of one step, so that no run's numbers depend on the others;
    in the plane each by itself. The whole campaign where there are effects, since an effect may look at all of it."""
    if specification.effects:
        return [list(range(len(plans)))] if plans else []
    chunk = 1 if specification.motion.turns else CHUNK_RUNS
    order = sorted(range(len(plans)), key=lambda i: (steps[i], plans[i].samples, i))
    alike = [list(same) for _, same in groupby(order, key=lambda i: steps[i])]
    return [same[i : i + chunk] for same in alike for i in range(0, len(same), chunk)]


def _step(plan: Plan, model: Model) -> float:
    """A power of two [s]: few different ones, and none depends on the other runs."""
    if model.motion.turns:
        return PLANAR_STEP_S
    largest = max((abs(moment) for (moment,) in plan.moments), default=0.0)
    return float(2.0 ** floor(log2(step_for(model, largest) / STEP_REFINEMENT)))


def _make(work: tuple[Sequence[Plan], float], specification: Specification, seed: int) -> list[SimulatedRun]:
    plans, step = work
    times: list[Floats] = [np.arange(float(plan.samples)) * specification.logger.period for plan in plans]
    windows = max(int(time[-1] / WINDOW_S) + 2 for time in times)
    drawn = [_draw(plan, specification, seed, windows) for plan in plans]
    truth = _truth(drawn, specification, times, step, seed)
    return [_log(*run, specification, seed) for run in zip(drawn, times, truth)]


def _draw(plan: Plan, specification: Specification, seed: int, windows: int) -> SimulatedRun:
    scatter, key, start = specification.scatter, plan.key, specification.scatter.start
    if start == "random":
        start = 360.0 * float(uniform(1, seed, key, "start heading")[0])
    elif isinstance(start, tuple):
        start = start[plan.turn % len(start)]
    share = uniform(len(plan.changes), seed, key, "switch")  # of the sample interval before a change shows
    pushed, added = np.zeros((len(specification.motion.dofs), windows)), _added_moment(plan, specification, seed)
    if (disturbance := specification.disturbance) is not None:
        left = np.exp(-WINDOW_S / disturbance.time_s)
        sizes = (disturbance.surge_N, disturbance.sway_N, disturbance.yaw_Nm)
        for row, size, dof in zip(pushed, sizes, specification.motion.dofs):
            row[:] = size * lasting(normal(windows, seed, key, dof.name), left)
    pushed[-1] += added
    return SimulatedRun(
        plan, start=float(scatter.dof.inner(start)), log_gain=scatter.gain * float(normal(1, seed, key, "gain")[0]),
        switches=np.asarray((np.array(plan.changes, dtype=float) - share) * specification.logger.period),
        biases={
            name: float(sensor.bias * normal(1, seed, key, *words)[0])
            for name, (sensor, _, words) in specification.sensed.items()
        },
        added_moment=added, disturbance=pushed,
    )  # fmt: skip


def _added_moment(plan: Plan, specification: Specification, seed: int) -> float:
    scatter = specification.scatter
    if scatter.force == 0:
        return 0.0
    smallest = min((abs(forces[-1]) for forces in plan.moments if forces[-1]), default=np.inf)
    most = np.inf if scatter.force_most is None else scatter.force_most * smallest
    for draw in range(MAX_REDRAWS):
        moment = scatter.force * float(normal(1, seed, plan.key, "moment", str(draw))[0])
        if abs(moment) <= most:
            return moment
    force = scatter.dof.words.force
    raise SettingError(
        f"{specification.source}: scatter.{force} is {scatter.force:g}, far above {force}_most of the {force} "
        f"{smallest:g} of run {plan.name!r}; expected less scatter, or a larger {force}_most"
    )


def _truth(
    drawn: Sequence[SimulatedRun], specification: Specification, times: Sequence[Floats], step: float, seed: int
) -> list[Floats]:
    """Positions and velocities of each run at its samples, (N, 2 D) in base units; the position of the one degree of
    freedom, in the plane the heading, as its sensor reads it."""
    model, motion, plans = specification.model(), specification.motion, [run.plan for run in drawn]
    clocks = [_knots(time, run.switches, specification.campaign.held) for time, run in zip(times, drawn)]
    runs = []
    for plan, run, clock in zip(plans, drawn, clocks):
        commands = commanded(clock, run)
        extras = {SURGE.command: commands[:, 0], SWAY.command: commands[:, 1]} if motion.turns else {}
        if specification.steered:
            extras = {"rudder": commands[:, 0], "surge": np.full(len(clock), plan.group.surge_m_s or 0.0)}
        time, zeros = plan.start + clock, np.zeros_like(clock)
        runs.append(Run(plan.name, plan.file, time, zeros, commands[:, -1], model.moment_unit, extras, dof=model.dof))
    batch = make_batch(runs, step, () if motion.turns else model.signals, hold=False, motion=motion)
    size, last = len(motion.dofs), len(motion.dofs) - 1
    position = np.zeros((size, 1, len(plans)))
    position[last, 0] = [run.start for run in drawn]
    start = Start(
        position, log_gain=np.array([[run.log_gain for run in drawn]]),
        own={} if motion.turns else _own_phases(model, plans, seed),
        disturbance=np.stack([run.disturbance for run in drawn], axis=1)[:, None],
    )  # fmt: skip
    result = simulate(model, batch, start=start)
    truth = np.concatenate([result.positions[0], result.velocities[0]], axis=2)
    truth[:, :, last] = result.reading(batch.channels[-1])[0]
    at_samples = []
    for states, plan, clock, time in zip(truth, plans, clocks, times):
        node = np.searchsorted(clock, np.maximum(time, clock[0]))  # held still before the clock begins
        at_samples.append(states[np.zeros_like(node) if plan.group.fault == "never-moves" else node])
    return at_samples


def _own_phases(model: Model, plans: Sequence[Plan], seed: int) -> dict[str, Floats]:
    """Sine and cosine (1, R, 2) of each run's own wave, for effects that vary from run to run, at any phase."""
    phases = {}
    for term in model.terms:
        if effects.get(term.name).varies(term.values):
            phase = np.array([2.0 * np.pi * uniform(1, seed, plan.key, term.name)[0] for plan in plans])
            phases[term.name] = term.values[0] * np.stack([np.cos(phase), np.sin(phase)], axis=1)[None]
    return phases


def _knots(time: Floats, switches: Floats, is_held: bool) -> Floats:
    """Instants at which a run is simulated [s]: its samples, and close to both sides of each change of command. They
    begin with the first sample; with the first change where that comes earlier, or where the vehicle `is_held`."""
    first = time[0]
    if len(switches) and (is_held or switches[0] < first):
        first = switches[0]
    knots = np.unique(np.concatenate([[first], time, switches - SWITCH_HALF_WIDTH_S, switches + SWITCH_HALF_WIDTH_S]))
    return np.asarray(knots[knots >= first])


def make_plans(specification: Specification, seed: int) -> tuple[Plan, ...]:
    """Plan all runs in the order in which they are made. Raises SettingError for two runs of one name in one file, two
    groups that write one file, and a campaign of more than half a thousand million samples."""
    base = specification.model() if specification.steered else getattr(specification.vehicle, "model", None)
    listed = ((group, run) for group in specification.runs for run in group.runs(base, seed))
    plans = []
    for turn, (group, (name, key, commands)) in enumerate(islice(listed, MAX_SIMULATED_RUNS + 1)):
        file = f"{group.folder}/{name if group.together is None else group.together}.{group.format}"
        plans.append(Plan(key, name, file, group, turn, *_on_the_grid(commands, specification)))
    if len(plans) > MAX_SIMULATED_RUNS:
        raise SettingError(f"{specification.source}: more than {MAX_SIMULATED_RUNS} runs would be made; ask for fewer")
    _refuse_clashes(plans, specification)
    total = sum(plan.samples for plan in plans)
    if total > MAX_SAMPLES:
        raise SettingError(
            f"{specification.source}: {total:.3g} samples would be made; expected at most {MAX_SAMPLES:.0g}. Ask for "
            "fewer or shorter runs, or a lower rate_hz"
        )
    if specification.campaign.order == "random":
        plans.sort(key=lambda plan: float(uniform(1, seed, plan.key, "order")[0]))
    placed, clock = [], 0.0
    for plan in plans:
        placed.append(replace(plan, start=round(clock, 6)))
        wait = specification.campaign.wait_between_s if plan.group.wait_after_s is None else plan.group.wait_after_s
        clock += (plan.samples - specification.motion.turns) * specification.logger.period + wait
    return tuple(placed)


def _on_the_grid(
    commands: Commands, specification: Specification
) -> tuple[int, tuple[int, ...], tuple[tuple[float, ...], ...]]:
    """Number of samples (in the plane the end is one), first sample of each command, the commands, of a rudder [rad];
    rests included."""
    schedule, motion = specification.campaign, specification.motion
    nothing = (0.0,) * len(motion.dofs)
    padded = ((*nothing, schedule.rest_before_s), *commands, (*nothing, schedule.rest_after_s))
    ends = np.round(np.cumsum([row[-1] for row in padded]) * specification.logger.rate_hz)
    begins, current = np.concatenate([[0.0], ends[:-1]]), nothing
    changes, moments = [], []
    for (*forces, _), begin, end in zip(padded, begins, ends):
        if tuple(forces) != current and end > begin:
            changes.append(int(begin))
            current = tuple(forces)
            moments.append(tuple(map(radians, current)) if specification.steered else current)
    return int(ends[-1]) + motion.turns, tuple(changes), tuple(moments)


def _refuse_clashes(plans: list[Plan], specification: Specification) -> None:
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


def commanded(time: Floats, run: SimulatedRun) -> Floats:
    """Return the command in force at each `time` [s], (N, D): nothing before the first switch."""
    values = np.array([np.zeros(len(run.disturbance)), *run.plan.moments])
    return values[np.searchsorted(run.switches, time, side="right")]


def _log(run: SimulatedRun, time: Floats, truth: Floats, specification: Specification, seed: int) -> SimulatedRun:
    """Log a run, positions and velocities `truth` (N, 2 D) at `time` (N,) [s since its start]; the position of the last
    degree of freedom, in the plane the heading, is wrapped."""
    plan, motion, count = run.plan, specification.motion, len(time)
    low = {"0..360": 0.0, "-180..180": -180.0}.get(specification.logger.wrap)
    true = {name: dof.logged(x) for (name, dof), x in zip(specification.columns.items(), truth.T)}
    last = [*true][len(motion.dofs) - 1]
    readings = {}
    for name, (sensor, words, _) in specification.sensed.items():
        reading = true[name] + (sensor.noise * normal(count, seed, plan.key, *words) + run.biases[name])
        if sensor.every_s is not None:  # held between its readings
            rows = np.flatnonzero(np.diff(np.floor((time + 1e-9) / sensor.every_s), prepend=-1.0) > 0)
            reading = reading[rows[np.searchsorted(rows, np.arange(count), side="right") - 1]]
        readings[name] = _rounded(reading) if low is None or name != last else _turned(reading, low)
    units = [specification.force_unit or dof.units.forces[1] for dof in motion.dofs]
    commands = commanded(time, run).T
    if specification.steered:
        names, commands = [RUDDER_COLUMN], np.rad2deg(commands)
    else:
        names = [dof.column(dof.command, unit) for dof, unit in zip(motion.dofs, units)]
    forces = zip(names, (_rounded(column, MOMENT_DECIMALS) for column in commands))
    before = [*readings.items()][: None if motion.turns else 1]  # a rate comes after the command
    ahead = {} if plan.group.surge_m_s is None else {"surge_m_s": np.full(count, plan.group.surge_m_s)}
    return replace(run, columns={"time_s": _rounded(plan.start + time)} | dict([*before, *forces]) | readings | ahead)


def _turned(reading: Floats, low: float) -> Floats:
    """Headings [degrees] from `low` on, below `low` + 360, rounded."""
    wrapped = _rounded((reading - low) % 360.0)
    return _rounded(np.where(wrapped >= 360.0, 0.0, wrapped) + low)


def _rounded(values: Floats, decimals: int = LOG_DECIMALS) -> Floats:
    return np.asarray(np.round(values, decimals) + 0.0)


def lasting(drawn: Floats, share: float) -> Floats:
    """Ornstein-Uhlenbeck processes of unit size on even instants (..., N); a `share` is left from one to the next."""
    process = drawn.copy()
    for i in range(1, drawn.shape[-1]):
        process[..., i] = share * process[..., i - 1] + np.sqrt(1.0 - share**2) * drawn[..., i]
    return process


Column: TypeAlias = Floats | Sequence[str]
COMMAND_COLUMNS = {"n", RUDDER_COLUMN, *(name for dof in DOFS.values() for name, _ in dof.columns[dof.command])}
"""Columns of CSV that have as many decimals as the number; every other one has `LOG_DECIMALS`."""


def label(specification: Specification, seed: int) -> str:
    return f"Simulated by automarine from {specification.source}, seed {seed}: no measurement."


def runs_by_file(runs: Sequence[SimulatedRun]) -> dict[str, list[SimulatedRun]]:
    """Sort the runs by the name of the log that they are in, in the order of the specification."""
    files: dict[str, list[SimulatedRun]] = {}
    for run in sorted(runs, key=lambda run: run.plan.turn):
        files.setdefault(run.plan.file, []).append(run)
    return files


def log_of(runs: Sequence[SimulatedRun], specification: Specification, seed: int) -> bytes:
    group, columns = runs[0].plan.group, dict[str, Column]()
    if group.together is not None:
        columns["run"] = [run.plan.name for run in runs for _ in run.columns["time_s"]]
    columns |= {name: np.concatenate([run.columns[name] for run in runs]) for name in runs[0].columns}
    return log_bytes(columns, group.format, label(specification, seed))


def log_bytes(columns: Mapping[str, Column], format: str, comment: str) -> bytes:
    """One log in the format "csv", "csv.gz" or "parquet"; `comment` goes first, or into Parquet's metadata."""
    if format != "parquet":
        columns = {name: _cells(name, column) for name, column in columns.items()}
    return file_bytes(columns, format, comment)


def _cells(name: str, column: Column) -> Sequence[str]:
    if not isinstance(column, np.ndarray):
        return column
    if name in COMMAND_COLUMNS:
        return [f"{value:.{MOMENT_DECIMALS}f}".rstrip("0").rstrip(".") for value in column.tolist()]
    return [f"{value:.{LOG_DECIMALS}f}" for value in column.tolist()]


def file_bytes(columns: Mapping[str, Column], format: str, comment: str) -> bytes:
    """A table as a file of one of the three formats, numbers with every digit."""
    if format == "parquet":
        sink = pa.BufferOutputStream()
        pq.write_table(pa.table(dict(columns), metadata={"comment": comment}), sink)
        return bytes(sink.getvalue().to_pybytes())
    text = csv_text(columns, comment).encode()
    return text if format == "csv" else gzip_bytes(text)


def gzip_bytes(data: bytes) -> bytes:
    """A gzip file that holds the data as they are: what a compressor makes of them changes with its version."""
    head = b"\x1f\x8b\x08\0\0\0\0\0\0\xff"  # deflate, no time, no operating system
    return head + gzip.compress(data, 0, mtime=0)[len(head) :]
