"""What a model makes of commands, with the 95 % band that its file leaves open.

The band is that of vehicles drawn from the file: parameters by their covariance, thrust by its scatter from run to run
(the scatter by its own error), and where the fit found them the disturbing acceleration and unsteady thrust, as the
filter has them; a start that was read from a log by the noise of the readings. It holds nothing of what the fit does
not know: an effect that the model lacks, another trim or battery, and the noise of the sensor that reads the result.

A disturbing acceleration (Ornstein and Uhlenbeck's process) acts as its exact means over the windows of a batch:
Gillespie (1996), Physical Review E 54:2084, equations 2.12.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from automarine_cli.comparison.simulated_runs import (
    FREE_RUN_STEP_S,
    MAX_WAY,
    START_WINDOW_S,
    StartState,
    planar_start,
    start_states,
    step_of,
)
from automarine_cli.comparison.validation import load_usable
from automarine_cli.dofs import PLANAR, YAW, Dof
from automarine_cli.errors import ModelError, RunError
from automarine_cli.fits.planar_structure import CHANNELS
from automarine_cli.logs import ColumnMap, LogFile, Logs, LogTable, find_logs, read_log, require
from automarine_cli.logs.find import as_logs
from automarine_cli.logs.table import columns_of
from automarine_cli.models.model import DELAY, Model
from automarine_cli.models.store import PLANAR_MODEL, ROLES, StoredModels, file_and_models, models_of
from automarine_cli.pipeline.parallel import Progress, counted, silent
from automarine_cli.pipeline.records import ResultKind, ResultRecord, Shown, Source, read_plain
from automarine_cli.quantities import RUDDER_COLUMN, STEERED, Floats
from automarine_cli.runs.half_turn import released
from automarine_cli.runs.load import TO_PORT, LoadedRuns, rows_of_runs
from automarine_cli.runs.run import ExcludedRun, Run, named_apart, position_noise, runs_json
from automarine_cli.simulation.batch import WINDOW_S, Batch, make_batch
from automarine_cli.simulation.rollout import Start, simulate
from automarine_cli.text import format_value, printable
from automarine_cli.thrusters.map import load_planar

BAND_DRAWS, MIN_DRAWS = 1000, 200  # vehicles drawn for a band, fewer for runs of many samples
DRAWN_SAMPLES = 4e6  # samples times draws of one run that are held in memory
SIMULATED_STEPS = 1e6  # steps times draws that are simulated together
BAND_LEVEL = 0.95
MAX_ROW_GAP_S, ROW_S = 0.5, 0.1  # rows of commands that are further apart get rows between them, so far apart
AT_ONCE_S = 1e-3  # within which a command changes at its row
MAX_COMMANDS_S = 86_400.0  # a day: longer commands are a clock in another unit


@dataclass(frozen=True)
class Doubt:
    """What a model's file leaves open: the `covariance` (p, p) of theta; the `scatter` of the runs' log gain and the
    standard error of its logarithm; of each degree of freedom (D,) the disturbing acceleration's `size` [per s²] and
    `time` [s], and the noise of `thrust` as a share of it [s^1/2]. `says` is why the fit warns of its use."""

    covariance: Floats
    scatter: float = 0.0
    scatter_error: float = 0.0
    size: Floats = field(default_factory=lambda: np.zeros(1))
    time: Floats = field(default_factory=lambda: np.ones(1))
    thrust: Floats = field(default_factory=lambda: np.zeros(1))
    force_range: tuple[float, float] | None = None
    to_port: bool = False
    says: str = ""

    @property
    def disturbed(self) -> bool:
        return bool(np.any(self.size > 0) or np.any(self.thrust > 0))


def read_doubt(source: Source) -> tuple[StoredModels, Doubt]:
    """Read the models of a file and what it leaves open of the preferred one. Raises ModelError."""
    data, name = read_plain(source, "JSON", ModelError), printable(source.name)
    force_range, scatter, to_port = None, None, False
    if data.get("schema") == PLANAR_MODEL.schema:
        planar, stored = PLANAR_MODEL.of(data, name), models_of(data, name)
        model, random, delay, use = stored.model, planar.random, planar.command_delay_s, planar.prediction
        names, covariance, estimates = model.parameter_names, planar.covariance, dict(planar.parameters)
    else:
        file, stored = file_and_models(data, name)
        model, random, entry, use = stored.model, stored.random, file.chosen, file.prediction
        names, covariance, delay = model.short_names, entry.covariance, file.command_delay_s
        estimates = {file.dof.parameters.get(role, ""): getattr(entry, role) for role in ROLES}
        for effect in file.effects if entry.effects is None else entry.effects:
            estimates |= effect.parameters
        scatter, force_range = file.gain_scatter, file.force_range
        to_port = file.nomoto.get("positive_rudder_turns_to") == "port"
    errors = [getattr(estimates.get(name), "stderr", None) or 0.0 for name in names]
    matrix = np.diag(np.square(errors))
    if covariance is not None:
        there = [k for k, name in enumerate(names) if name in covariance.parameters]
        rows = [covariance.parameters.index(names[k]) for k in there]
        matrix[np.ix_(there, there)] = np.array(covariance.matrix)[np.ix_(rows, rows)]
    late = np.array([f".{name}".endswith(f".{DELAY}.t_d") for name in model.parameter_names], dtype=float)
    if stored.command_delay and delay is not None and delay.stderr:
        matrix = matrix + delay.stderr**2 * np.outer(late, late)  # of all commands together
    size, time, thrust = (
        np.array([random.get(f"{dof.name}.{kind}", usual) for dof in model.motion.dofs])
        for kind, usual in (("disturbance", 0.0), ("disturbance-time", 1.0), ("thrust-noise", 0.0))
    )
    gain = (scatter.value if scatter else None) or random.get("gain-scatter", 0.0)
    error = scatter.stderr / gain if scatter is not None and scatter.stderr and gain else 0.0
    doubt = Doubt(matrix, gain, error, size, time, thrust, force_range, to_port, use.refusal)
    return stored, doubt


@dataclass(frozen=True)
class PredictedRun:
    """The commands of one `run` and what the model makes of them from its `start`: by quantity the prediction and the
    ends of its band, (3, N) [base units], positions as sensors show them; `lost` is how many draws ran away. A command
    of which only samples are known may have changed anywhere between two of them: `sampled`."""

    run: Run
    start: StartState
    bands: Mapping[str, Floats]
    lost: int = 0
    sampled: bool = False


class Column(NamedTuple):
    """The column of a quantity, its unit, and what one in base units is in it."""

    name: str
    unit: str
    factor: float


@dataclass(frozen=True, kw_only=True)
class PredictionFile(ResultRecord):
    model: Mapping[str, object]


PREDICTION = ResultKind("prediction.json", "prediction", PredictionFile, "predict", YAW)


@dataclass(frozen=True, repr=False)
class Prediction(Shown):
    """Where commands take a vehicle, with 95 % bands, by the preferred one of the `stored` models of motion `dof`.

    `predicted` has each run with its `start` and `bands`, `set_aside` those that could not be predicted. `doubt` is
    what the model leaves open: covariance, thrust scatter, disturbance; `seed` that of its draws. `shown` has the
    column of each quantity, `columns()` the whole table, `end(of_run)` the last values and the ends of their bands;
    `parquet` says the table's form. `to_json()` is prediction.json.

    Frame, a row per time: `time_s`, commands, and each quantity with its band, such as `heading_deg`,
    `heading_deg_low`, `heading_deg_high`; several runs have `run` too.

    Keys: `schema`, `motion`, `model`, `band`, `predicted`, `runs`.
    """

    stored: StoredModels
    doubt: Doubt
    predicted: tuple[PredictedRun, ...]
    set_aside: tuple[ExcludedRun, ...] = ()
    seed: int = 0
    parquet: bool = False

    @property
    def dof(self) -> Dof:
        return self.stored.dof

    @property
    def shown(self) -> dict[str, Column]:
        """The column of each predicted quantity."""
        motion, columns = self.stored.model.motion, dict[str, Column]()
        for dof, position in zip(motion.dofs, motion.positions):
            for quantity in (position, dof.velocity):
                name = dof.columns[quantity][0][0] if quantity in dof.columns else f"{quantity}_m"
                unit = name.removeprefix(f"{quantity}_").replace("_", "/")
                columns[quantity] = Column(name, unit, float(dof.logged(1.0)) if dof.angular else 1.0)
        return columns

    def columns(self) -> dict[str, Any]:
        """Lay out all runs below each other: run where there are several, time [s], commands, and each quantity with
        the ends of its band."""
        parts = list[dict[str, Any]]()
        for of_run in self.predicted:
            run = of_run.run
            part: dict[str, Any] = {"run": np.full(len(run), run.name, dtype=object)} if len(self.predicted) > 1 else {}
            part["time_s"] = run.time
            for dof in self.stored.model.motion.dofs:
                unit = run.moment_unit if dof is run.dof else dof.units.forces[1]
                steered = unit == STEERED
                name = RUDDER_COLUMN if steered else dof.column(dof.command, unit)
                part[name] = np.rad2deg(run.command_of(dof)) if steered else run.command_of(dof)
            for quantity, (name, _, factor) in self.shown.items():
                for label, values in zip(("", "_low", "_high"), of_run.bands[quantity]):
                    part[name + label] = np.round(factor * values, 6)
            parts.append(part)
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}

    def end(self, of_run: PredictedRun) -> dict[str, tuple[float, ...]]:
        """Give what is predicted for the end of a run and the ends of its band, by quantity, as the columns have it."""
        return {
            quantity: tuple((column.factor * of_run.bands[quantity][:, -1]).tolist())
            for quantity, column in self.shown.items()
        }

    def to_json(self) -> dict[str, object]:
        stored, doubt, runs = self.stored, self.doubt, [of_run.run for of_run in self.predicted]
        names = stored.model.parameter_names
        return {
            "schema": PREDICTION.schema,
            "motion": stored.model.motion.name,
            "model": {"file": stored.source, "number": stored.preferred, "effects": list(stored.effects)},
            "band": {
                "level": BAND_LEVEL,
                "draws": max(draws_of(run) for run in runs),
                "parameters": [name for name, error in zip(names, np.diagonal(doubt.covariance)) if error > 0],
                "gain_scatter": doubt.scatter,
                "disturbed": doubt.disturbed,
            },
            "predicted": {
                of_run.run.name: {
                    "file": of_run.run.source, "samples": len(of_run.run),
                    "duration_s": float(np.ptp(of_run.run.time)), "start": of_run.start.how,
                    "end": {
                        self.shown[quantity].name: {"value": value, "ci95": ends}
                        for quantity, (value, *ends) in self.end(of_run).items()
                    },
                    **({"lost_draws": of_run.lost} if of_run.lost else {}),
                }
                for of_run in self.predicted
            },
            "runs": runs_json(len(runs), self.set_aside, runs),
        }  # fmt: skip


def draws_of(run: Run) -> int:
    return int(np.clip(DRAWN_SAMPLES / len(run), MIN_DRAWS, BAND_DRAWS))


def predict_runs(
    stored: StoredModels, doubt: Doubt, loaded: LoadedRuns, *, position: float | None = None,
    rate: float | None = None, seed: int = 0, progress: Progress = silent,
) -> tuple[PredictedRun, ...]:  # fmt: skip
    """Predict every run from the state with which its log begins, from zero where that is not logged, or from the
    `position` [rad or m] and `rate` given. Raises RunError where the model runs away, or as `make_batch`."""
    model = stored.model
    return tuple(
        _predicted(model, doubt, run, *_start(model, run, position, rate), np.random.default_rng([seed, i]))
        for i, run in counted(progress, "predicting", enumerate(loaded.runs), len(loaded.runs))
    )


NOT_IN_COMMANDS = "no {position} in the commands"


def _start(model: Model, run: Run, position: float | None, rate: float | None) -> tuple[StartState, Floats]:
    """The state in which a run begins, and standard deviations (2,) of its position and rate as far as they are read,
    those of a straight line through the first second where it is under way."""
    turns = model.motion.turns
    logged = not run.summed_up or bool(np.any(run.extras[run.dof.velocity]))  # of commands alone all are zero
    sure = np.array([0.0, 0.0])
    if logged:
        at_rest = released(run)
        noise, window = position_noise(run.time, run.position), run.time <= run.time[0] + START_WINDOW_S
        count = at_rest or max(int(np.count_nonzero(window)), 2)
        length = max(float(run.time[count - 1] - run.time[0]), run.sample_period)
        sure = noise / np.sqrt(count) * (np.array([1.0, 0.0]) if at_rest else np.array([2.0, 12.0**0.5 / length]))
    how = list[str]()
    if turns:
        start = planar_start(run, model) if logged else np.zeros(6)
        state = StartState(start[:3].copy(), start[3:].copy(), "read" if logged else "")
    else:
        state = start_states(model, [run])[0] if logged else StartState(0.0, 0.0)
    how.append(state.how if logged else run.dof.fill(f"{NOT_IN_COMMANDS}: it starts at 0"))
    for k, (value, name) in enumerate(((position, "position"), (rate, "rate"))):
        if value is not None:
            sure[k] = 0.0
            before = getattr(state, name)
            changed: Any = {name: np.append(before[:-1], value) if turns else value}
            state = replace(state, **changed)
            how.append(f"{run.dof.words.position if k == 0 else run.dof.words.speed} given")
    return replace(state, how="; ".join(filter(None, how))), sure


def _predicted(
    model: Model, doubt: Doubt, run: Run, start: StartState, sure: Floats, rng: np.random.Generator
) -> PredictedRun:
    """Simulate the model itself and vehicles drawn about it."""
    motion, count = model.motion, draws_of(run)
    step = FREE_RUN_STEP_S if motion.turns else step_of(model, [run]) / 2
    channels = CHANNELS if motion.turns else run.dof.channels
    batch = make_batch([run], step, model.signals, motion=motion, channels=channels)
    theta = model.drawn(doubt.covariance, count, rng)
    theta[np.linalg.eigvalsh(model.inertia_matrix(theta))[:, 0] <= 0] = model.theta
    scatter = doubt.scatter * np.exp(doubt.scatter_error * rng.standard_normal(count))
    log_gain = (scatter * rng.standard_normal(count))[:, None]
    of_line = np.array([[1.0, 0.0], [-(0.75**0.5), 0.5]])  # how position and rate at the end of a line go together
    off = sure[:, None] * (of_line @ rng.standard_normal((2, count)))
    log_gain[0], off[:, 0] = 0.0, 0.0
    sampled = not doubt.disturbed and run.dof.fill(NOT_IN_COMMANDS) not in start.how
    pushed = _pushes(model, doubt, batch, theta, rng) if doubt.disturbed else None
    late = rng.uniform(-0.5, 0.5, (count, *batch.interval.shape)) * batch.interval if sampled else None
    if late is not None:  # a command changed anywhere between two samples; a delay holds the mean
        late[0] = 0.0
    readings = {channel.quantity: np.empty((count, len(run))) for channel in batch.channels}
    together = max(1, int(SIMULATED_STEPS / batch.length.shape[1]))
    axis = (len(motion.dofs), 1, 1) if motion.turns else (1, 1)
    turned = np.eye(len(motion.dofs))[-1][:, None, None]
    for some in (slice(i, i + together) for i in range(0, count, together)):
        position, velocity = (
            np.reshape(x, axis) + (turned * o[some, None] if motion.turns else o[some, None])
            for x, o in zip((start.position, start.rate), off)
        )
        disturbance = None if pushed is None else pushed[:, some, None]
        delay = None if late is None else late[some]
        path = simulate(model, batch, theta[some], Start(position, velocity, log_gain[some], delay, disturbance))
        for channel in batch.channels:
            readings[channel.quantity][some] = path.reading(channel)[:, 0]
    sound = np.all([np.all(np.abs(values) < MAX_WAY, axis=1) for values in readings.values()], axis=0)
    if not sound[0]:
        raise RunError(
            f"{run.source}, run {run.name!r}: the model runs away under these commands; check their unit, or give a "
            "model that was fitted to commands as large"
        )
    tails = 50.0 * (1.0 - BAND_LEVEL), 100.0 - 50.0 * (1.0 - BAND_LEVEL)
    bands = {}
    for quantity, values in readings.items():  # of a hardly known model most vehicles may be on one side of it
        low, high = np.percentile(values[sound], tails, axis=0)
        bands[quantity] = np.stack([values[0], np.minimum(low, values[0]), np.maximum(high, values[0])])
    return PredictedRun(run, start, bands, int(count - np.count_nonzero(sound)), sampled)


def _pushes(model: Model, doubt: Doubt, batch: Batch, theta: Floats, rng: np.random.Generator) -> Floats:
    """Disturbing moments or forces of each window, (D, P, windows), none of the first set: the process's means times
    the inertia, and unsteady thrust in proportion to what is commanded."""
    count, windows = len(theta), batch.windows
    fade = np.exp(-WINDOW_S / doubt.time)[:, None]
    span, size, time = WINDOW_S / doubt.time[:, None], doubt.size[:, None], doubt.time[:, None]
    spread = size * np.sqrt(1.0 - fade**2)
    shared = np.divide(size**2 * time * (1.0 - fade) ** 2, spread, out=np.zeros_like(spread), where=spread > 0)
    way = 2.0 * size**2 * time**2 * (span - 2.0 * (1.0 - fade) + 0.5 * (1.0 - fade**2))
    remaining = np.sqrt(np.maximum(way - shared**2, 0.0))
    now = size * rng.standard_normal((len(doubt.size), count))
    means = np.empty((len(doubt.size), count, windows))
    for k in range(windows):
        first, second = rng.standard_normal((2, len(doubt.size), count))
        means[..., k] = (now * time * (1.0 - fade) + shared * first + remaining * second) / WINDOW_S
        now = now * fade + spread * first
    forces = np.einsum("pij,jpk->ipk", model.inertia_matrix(theta), means)
    seconds = np.bincount(batch.window[0], batch.length[0], windows)
    square = [np.bincount(batch.window[0], batch.length[0] * force[0] ** 2, windows) for force in batch.force]
    level = np.sqrt(np.array(square) / np.maximum(seconds, 1e-9))
    unsteady = doubt.thrust[:, None] / np.sqrt(WINDOW_S) * level
    forces += unsteady[:, None] * rng.standard_normal(forces.shape)
    forces[:, 0] = 0.0
    return np.asarray(forces)


def load_commands(
    logs: Logs, stored: StoredModels, doubt: Doubt, columns: ColumnMap, thrusters: Any, arm: float | None, *,
    strict: bool, jobs: int, progress: Progress,
) -> LoadedRuns:  # fmt: skip
    """Load logs for what they command; a position is not asked for. Raises as `load_usable` and `load_planar`."""
    dof, planar = stored.dof, stored.in_plane
    drive: dict[str, Any] = {"thrusters": thrusters, "arm": arm}
    execution: dict[str, Any] = {"strict": strict, "jobs": jobs, "progress": progress}
    tables = [(file, _bare(file, columns, dof, planar)) for file in find_logs(logs)]
    groups = (
        ([file for file, bare in tables if bare is None], columns),
        ([bare for _, bare in tables if bare is not None], ColumnMap(defaults=columns.defaults)),
    )
    runs, aside, inputs = list[Run](), list[ExcludedRun](), list[LogFile]()
    for files, rules in groups:
        if files:
            also = {**drive, "columns": rules, **execution}
            loaded = load_planar(files, **also) if planar else load_usable(files, stored, **also)
            runs += [_as_given(run, doubt) if rules is not columns else run for run in loaded.runs]
            aside += loaded.set_aside
            inputs += loaded.inputs
    return LoadedRuns(tuple(named_apart(runs)), tuple(aside), tuple(inputs))


def _as_given(run: Run, doubt: Doubt) -> Run:
    """A run of commands alone, without notes on sensors that it lacks; a rudder counts as in the logs of the fit."""
    run = replace(run, notes=(), reading=())
    if doubt.to_port and run.moment_unit == STEERED:
        return run.with_moment(-run.command, STEERED).noted(TO_PORT)
    return run


def _bare(file: LogFile, columns: ColumnMap, dof: Dof, planar: bool) -> LogFile | None:
    """A log that holds no position or velocity as one in memory, of a vehicle of which nothing was read, with rows
    between those that are far apart: each command holds until the next. None for another log."""
    table = read_log(file, columns, dof=dof, motion=PLANAR if planar else None)
    if {dof.position, dof.velocity} & table.columns.keys():
        return None
    free = dof.restoring or {*dof.thrusters} & table.columns.keys()  # of a logged moment
    require(table, ("time", *(() if free else (dof.command,))))
    sources = {*dof.thrusters, *(moved.command for moved in (PLANAR.dofs if planar else (dof,)))}
    names = sorted(sources & table.columns.keys())
    full = np.all([np.isfinite(table.columns[name]) for name in ("time", *names)], axis=0)
    rows, times, runs = list[Any](), list[Floats](), list[str]()
    for name, chosen in rows_of_runs(table):
        chosen = chosen[full[chosen]]
        time = table.columns["time"][chosen]
        _require_clock(table, chosen, time, name)
        steps = np.diff(time)
        count = np.append(np.where(steps > MAX_ROW_GAP_S, np.ceil(steps / ROW_S - 1e-9), 1.0), 1.0).astype(int)
        order = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        rows.append(np.repeat(chosen, count))
        times.append(np.repeat(time, count) + order * np.repeat(np.append(steps, 0.0) / count, count))
        changes = np.any([np.diff(table.columns[name][chosen]) != 0 for name in names] or [steps < 0], axis=0)
        last = np.cumsum(count)[:-1] - 1  # row before each next one: a command changes midway between two rows
        times[-1][last[changes & (count[:-1] > 1)]] = time[1:][changes & (count[:-1] > 1)] - AT_ONCE_S
        runs += [name] * len(order)
    at = np.concatenate(rows)
    constant = {name: values[at] for name, values in table.columns.items()} | {"time": np.concatenate(times)}
    extras = {name: values[at] for name, values in table.extras.items()}
    bare = replace(table, columns={**constant, dof.velocity: np.zeros(len(at))}, extras=extras, rows=at, labels={})
    content: dict[str, Any] = columns_of(bare, 0, len(at))
    if len(set(runs)) > 1:
        content["run"] = runs
    (log,) = find_logs(as_logs(content, file.name))
    return log


def _require_clock(table: LogTable, chosen: Any, time: Floats, name: str) -> None:
    """Raise RunError for commands whose clock does not rise, or lasts longer than any test."""
    where = f"{table.source}, run {name!r}"
    if len(time) < 2 or not np.ptp(time) > 0:
        raise RunError(
            f"{where}: found {len(time)} row with time and command, expected two or more; add the row that ends "
            "the prediction"
        )
    if (np.diff(time) < 0).any():
        at = int(np.argmax(np.diff(time) < 0))
        raise RunError(
            f"{table.source}, row {table.rows[chosen[at + 1]]}, run {name!r}: the clock steps back from {time[at]:.10g}"
            f" s to {time[at + 1]:.10g} s; expected a rising clock. Sort or correct the rows, or tell two runs apart "
            "by a column run"
        )
    if (span := float(np.ptp(time))) > MAX_COMMANDS_S:
        raise RunError(
            f"{where}: found commands over {format_value(span)} s, expected at most a day; if the clock counts "
            "milli- or microseconds, name it time_ms or time_us"
        )
