"""What can be said of one run or one thruster test without fitting anything: what `check` and `init` show."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from automarine_cli.dofs import Dof
from automarine_cli.errors import LogError
from automarine_cli.logs import ColumnMap, LogFile, LogTable, is_thruster_test, read_log, require_thruster
from automarine_cli.logs.find import stem_of
from automarine_cli.runs.allocation_limits import AllocationLimit, Commanded, commanded, law_of, limit_of
from automarine_cli.runs.command_range import undirected
from automarine_cli.runs.half_turn import HalfTurn, all_half_turns, why_none
from automarine_cli.runs.load import runs_of_table, unreadable
from automarine_cli.runs.noise import position_noise
from automarine_cli.runs.run import Run, SetAside
from automarine_cli.runs.steps import find_steps, segments

Kind = Literal["step", "manoeuvre", "idle"]


@dataclass(frozen=True)
class RunKind:
    """One run: a `step` has one constant command, whether or not it serves; `idle` none at all; else a manoeuvre.

    `with_moment` and `against` count the stretches from rest that went with and against the sign of their
    command; `low` and `high` are the smallest and the largest one [`unit`].
    """

    name: str
    kind: Kind
    unit: str
    low: float
    high: float
    with_moment: int
    against: int


def kind_of(run: Run) -> RunKind:
    """The kind of one run. Thruster commands without a moment count as they add up."""
    driven = run.as_commanded()
    levels = {moment for _, _, moment in segments(driven.command) if moment != 0}
    steps = [step for step in find_steps(driven) if step.from_rest]
    ways = [(step.moment, driven.position[step.stop - 1] - driven.position[step.first]) for step in steps]
    moved = [float(moment * way) for moment, way in ways if abs(way) > run.dof.limits.still]
    return RunKind(
        name=run.name,
        kind=("idle", "step")[len(levels)] if len(levels) < 2 else "manoeuvre",
        unit=driven.moment_unit,
        low=float(driven.command.min()),
        high=float(driven.command.max()),
        with_moment=sum(one > 0 for one in moved),
        against=sum(one < 0 for one in moved),
    )


Indices = NDArray[np.int64]
MOST_LEVELS = 64  # more different values than this are a signal, not levels


@dataclass(frozen=True)
class RunSeen:
    """One run of a log. `noise` of its position is as people see it, `extent` how far it went in all [turns, or m];
    `levels` are its moments or forces (None: they never stay), `steps` and the `half_turn` that serves as in
    check.json, `why` says why no step serves.
    """

    dof: Dof
    file: str
    run: str
    samples: int
    begins_s: float
    duration_s: float
    rate_hz: float
    jitter_ms: float
    longest_step_s: float
    counts: Mapping[str, int]
    noise: float
    extent: float
    moment_unit: str
    levels: list[float] | None
    steps: list[dict[str, Any]]
    half_turn: dict[str, Any] | None
    why: str | None
    columns: list[str]
    notes: list[str]
    commanded: list[Commanded] = field(default_factory=list, repr=False)
    limits: list[AllocationLimit] = field(default_factory=list)

    def to_json(self) -> dict[str, object]:
        """Return its form in check.json."""
        words, dof = self.dof.words, self.dof
        noise, unit = f"{words.position}_noise_{dof.units.key}", f"{words.force}_unit"
        keys = {"noise": noise, "extent": words.range_key, "moment_unit": unit, "half_turn": dof.step_key}
        limits = {"allocation_limits": [limit.to_json() for limit in self.limits]} if self.limits else {}
        plain = {name: value for name, value in vars(self).items() if name not in ("dof", "commanded", "limits")}
        return {keys.get(name, name): value for name, value in plain.items()} | {"counts": dict(self.counts), **limits}


@dataclass(frozen=True)
class ThrusterTestSeen:
    """One run of a thruster test: how many rows and levels of the control signal, and the forces."""

    file: str
    run: str
    points: int
    missing: int
    levels: int
    lowest_n: float
    highest_n: float
    lowest_force_N: float
    highest_force_N: float
    voltages: list[float]
    columns: list[str]
    notes: list[str]


LogContents: TypeAlias = tuple[list[RunSeen], list[ThrusterTestSeen], list[SetAside]]


def look_at_log(file: LogFile, columns: ColumnMap) -> LogContents:
    """Describe the runs and thruster tests of a file, and what is set aside; samples are dropped."""
    try:
        table = read_log(file, columns, dof=None)
        if is_thruster_test(table):
            require_thruster(table)
            return [], *look_at_tests(table)
        runs, set_aside = runs_of_table(file, table)
    except LogError as error:
        if file.named:
            raise
        return [], [], [unreadable(file, error)]
    return [look_at_run(run) for run in runs], [], set_aside


def look_at_run(run: Run) -> RunSeen:
    """Describe a run. Thruster commands without a moment or force are seen as they add up: in yaw port less
    starboard."""
    driven = run.as_commanded()
    turns = all_half_turns(driven)
    spans = np.diff(run.time)
    best = next((turn for turn in turns if turn.serves), None)
    levels = sorted({moment for _, _, moment in segments(driven.command)})
    return RunSeen(
        dof=run.dof,
        file=run.source,
        run=run.name,
        samples=len(run),
        begins_s=float(run.time[0]),
        duration_s=float(run.time[-1] - run.time[0]),
        rate_hz=1 / run.sample_period,
        jitter_ms=round(
            1000 * float(np.percentile(np.abs(spans - run.sample_period), 95)), 6
        ),  # not the clock's rounding
        longest_step_s=float(spans.max()),
        counts=dict(run.counts),
        noise=float(run.dof.shown(position_noise(run.time, run.position))),
        extent=float(np.ptp(run.position) / (run.dof.turn if run.dof.wraps else 1.0)),
        moment_unit=driven.moment_unit,
        levels=levels if len(levels) <= min(MOST_LEVELS, len(run) // 4) else None,
        steps=[_step_seen(turn) for turn in turns],
        half_turn=None if best is None else _step_seen(best),
        why=None if best is not None else why_none(driven, turns),
        columns=sorted(run.extras),
        notes=[*run.notes, *(note for turn in turns for note in turn.step.notes)],
        commanded=commanded(run),
    )


def with_limits(runs: Sequence[RunSeen]) -> list[RunSeen]:
    """Tell of each run of a campaign what it asks of its thrusters beyond their limits, as all runs show these."""
    runs = list(runs)
    for run_dof, dof in {(run.dof, one.dof): None for run in runs for one in run.commanded}:
        asked = {i: one for i, run in enumerate(runs) if run.dof is run_dof for one in run.commanded if one.dof is dof}
        unit = runs[next(iter(asked))].moment_unit if dof is run_dof else dof.units.forces[1]
        law = law_of([*asked.values()])
        for i, one in asked.items():
            limit = None if law is None else limit_of(law, [one], unit)
            if limit is not None:
                notes = [*runs[i].notes, limit.sentence]
                runs[i] = replace(runs[i], limits=[*runs[i].limits, limit], notes=notes)
    return runs


def _step_seen(turn: HalfTurn) -> dict[str, Any]:
    """A step as in check.json: its start in the unit of logs, how far it went as people see it, times on the campaign's
    clock."""
    step, dof = turn.step, turn.step.run.dof
    return {
        dof.words.force: step.moment,
        "switch_from_s": step.switch_from,
        "switch_to_s": step.switch_to,
        "ends_s": float(step.run.time[step.stop - 1]),
        "from_rest": step.from_rest,
        f"start_{dof.words.position}_{dof.units.log}": float(dof.logged(turn.start_position)),
        "kept_samples": len(turn.time),
        "kept_s": float(turn.time[-1] - turn.time[0]),
        f"{dof.words.gone_key}_{dof.units.key}": float(dof.shown(turn.turned)),
        "cut_by": turn.cut_by,
        "steady": turn.steady,
        "why": turn.why or None,
    }


def look_at_tests(table: LogTable) -> tuple[list[ThrusterTestSeen], list[SetAside]]:
    """The runs of a thruster test, and those without a single point."""
    names = np.full(len(table), stem_of(table.source.rsplit("/", 1)[-1])) if table.run is None else table.run
    good = ~(np.isnan(table.columns["n"]) | np.isnan(table.columns["force"]))
    seen, aside = [], []
    for name in dict.fromkeys(names.tolist()):
        rows = names == name
        if (rows & good).any():
            seen.append(_test(table, name, np.flatnonzero(rows & good), int((rows & ~good).sum())))
        else:
            aside.append(SetAside(table.source, name, "no row has both a control signal and a force"))
    return seen, aside


def _test(table: LogTable, name: str, rows: Indices, missing: int) -> ThrusterTestSeen:
    n, force, voltage = table.columns["n"][rows], table.columns["force"][rows], table.columns.get("voltage")
    volts = [] if voltage is None else np.unique(voltage[rows][~np.isnan(voltage[rows])]).tolist()
    return ThrusterTestSeen(
        file=table.source,
        run=name,
        points=len(n),
        missing=missing,
        levels=len(np.unique(n)),
        lowest_n=float(n.min()),
        highest_n=float(n.max()),
        lowest_force_N=float(force.min()),
        highest_force_N=float(force.max()),
        voltages=volts if len(volts) <= MOST_LEVELS else [],
        columns=sorted(table.extras),
        notes=[*table.notes, *filter(None, [undirected(n, force)])],
    )
