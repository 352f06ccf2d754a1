"""What a day at the pool allows, from TOML (schema automarine/plan-limits/1), the runs that a campaign may be made of,
what each costs, and their order at the pool; what two thrusters can give and draw (a moment by the inverse of their
map), and the files that the vehicle's computer plays."""

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.resources import files
from math import radians
from typing import Annotated, Literal

import numpy as np
from scipy import optimize

from automarine_cli.dofs import YAW
from automarine_cli.errors import RunError, SettingError
from automarine_cli.logs import ColumnMap, ColumnRule
from automarine_cli.logs.columns import CANONICAL
from automarine_cli.models.model import Model, steady_rate
from automarine_cli.pipeline.records import ResultKind, ResultRecord, keyed
from automarine_cli.quantities import RUDDER_COLUMN, STEERED, Floats
from automarine_cli.runs.run import IMPOSSIBLE_EXTRAPOLATION
from automarine_cli.simulation import specification
from automarine_cli.simulation.specification import (
    MAX_DRIVEN_S,
    AboveZero,
    Commands,
    Limit,
    Settings,
    ZeroOrMore,
    moment_text,
)
from automarine_cli.thrusters.bollard_data import Series
from automarine_cli.thrusters.map import ThrusterMap, TwinThrusters

LIMITS_SCHEMA = "automarine/plan-limits/1"
CANDIDATE_KINDS = ("step", "coast-down", "reversal", "slow-ramp", "long-turn", "rest", "other-voltage")
MIN_TURN_DEG = 30.0
MAX_PLAN_LEVELS, MAX_PLAN_RUNS = 20, 500


@dataclass(frozen=True)
class Pool(Settings):
    minutes: AboveZero = 60.0
    runs: Annotated[int, Limit(2, MAX_PLAN_RUNS)] = 24
    motion_s: AboveZero | None = None
    wait_s: ZeroOrMore = 60.0
    wait_after_long_turn_s: ZeroOrMore = 180.0
    turn_deg: Annotated[float, Limit(MIN_TURN_DEG, 3600.0)] = 180.0
    start_headings_deg: tuple[float, ...] = (0.0, 90.0, 180.0, 270.0)
    half_turn_s: AboveZero = 4.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.start_headings_deg:
            raise SettingError("start_headings_deg is an empty list; expected at least one heading")


@dataclass(frozen=True)
class Moments(Settings):
    largest: AboveZero | None = None
    levels: Annotated[int, Limit(2, MAX_PLAN_LEVELS)] = 6


@dataclass(frozen=True)
class Runs(Settings):
    kinds: tuple[str, ...] = CANDIDATE_KINDS
    rest_before_s: Annotated[float, Limit(1.0, 60.0)] = 3.0
    most_alike: Annotated[int, Limit(2, MAX_PLAN_RUNS)] = 4
    of_one_size_percent: Annotated[float, Limit(1.0, 100.0)] = 50.0
    repeat_first_last: bool = True
    voltages_V: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        if unknown := next((kind for kind in self.kinds if kind not in CANDIDATE_KINDS), None):
            raise SettingError(f"kinds names {unknown!r}; expected some of {', '.join(CANDIDATE_KINDS)}")
        if "step" not in self.kinds:
            raise SettingError(f"kinds is {list(self.kinds)}; expected 'step' among them, every campaign needs steps")
        if min(self.voltages_V, default=1.0) <= 0:
            raise SettingError(f"voltages_V holds {min(self.voltages_V):g}; expected voltages above 0")


@dataclass(frozen=True)
class LoggerLimits(Settings):
    rate_hz: Annotated[float, Limit(0.5, 1000.0)] = 10.0
    noise_deg: AboveZero | None = None
    rate_noise_deg_s: AboveZero | None = None
    gain_scatter: ZeroOrMore | None = None


@dataclass(frozen=True)
class BatteryLimits(Settings):
    volts: AboveZero = 24.0
    charge_Ah: AboveZero = 2.9
    idle_A: ZeroOrMore = 0.3
    full_A: ZeroOrMore = 6.0
    reserve_percent: Annotated[float, Limit(0.0, 95.0)] = 20.0


@dataclass(frozen=True)
class Thrusters(Settings):
    largest_command: AboveZero | None = None
    pairing: Literal["equal-thrust", "equal-command"] = "equal-thrust"
    nu_in_Nm: AboveZero | None = None


@dataclass(frozen=True)
class Goal(Settings):
    half_width_percent: AboveZero | None = None
    evidence: AboveZero = 20.0
    use_earlier_runs: bool = True


@dataclass(frozen=True)
class Limits:
    schema: str = LIMITS_SCHEMA
    pool: Pool = field(default_factory=Pool)
    moments: Moments = field(default_factory=Moments)
    runs: Runs = field(default_factory=Runs)
    logger: LoggerLimits = field(default_factory=LoggerLimits)
    battery: BatteryLimits = field(default_factory=BatteryLimits)
    thrusters: Thrusters = field(default_factory=Thrusters)
    goal: Goal = field(default_factory=Goal)

    def __post_init__(self) -> None:
        if self.schema != LIMITS_SCHEMA:
            raise SettingError(f'schema is {self.schema!r}; expected the line schema = "{LIMITS_SCHEMA}"')


@dataclass(frozen=True, kw_only=True)
class PlanFile(ResultRecord):
    """`plan.json`: what the vehicle plays of it."""

    moment_unit: str
    rate_hz: float = field(metadata=keyed("limits/logger/rate_hz"))
    rest_s: float = field(metadata=keyed("limits/runs/rest_before_s"))
    battery: Mapping[str, object] = field(metadata=keyed("limits/battery"))
    supply: Mapping[str, object]
    planned: tuple[Mapping[str, object], ...]


PLAN = ResultKind("plan.json", "plan", PlanFile, "plan", YAW)


def example_limits() -> str:
    return files("automarine_cli.planning").joinpath("limits.toml").read_text(encoding="utf-8")


POWER_LAW = 1.5
"""Power against thrust of a propeller at rest in the water: P = F^1.5/sqrt(2 rho A) by momentum theory (Rankine)."""
STEP_SHARES = (1 / 3, 1 / 2, 2 / 3, 1.0)  # lengths of steps that are tried, as shares of how far they may turn
MIN_MOMENT_SHARE = 0.1  # of the largest moment; levels between go by the root, as yaw rates do
RAMP_S, REST_S, RAMP_STAIRS = 40.0, 60.0, 20
COAST_CONSTANTS, COAST_S = 6.0, (5.0, 20.0)
"""A coast-down lasts so many of the vehicle's time constants at full moment, within these bounds [s]."""
ZIGZAG, ZIGZAG_DEG, SWINGS = "zigzag", (10.0, 20.0), 5  # angles of rudder and heading: IMO MSC.137(76)
CIRCLE_DEG = 360.0  # of a turning circle
SPEED_SHARES = (2 / 3, 1.0, 4 / 3)  # speeds of what is steered, where its model depends on the speed


@dataclass(frozen=True)
class PaperRun:
    """One run on paper: `commands` (moment, seconds) follow the rest at the log's start; `label` names it.

    `turns`: further than steps may, so that the water needs longer; `voltage` [V] and `speed` [m/s] of what is steered
    None for the usual."""

    kind: str
    label: str
    commands: Commands
    turns: bool = False
    voltage: float | None = None
    speed: float | None = None
    start_heading: float = 0.0
    clock: float = 0.0

    @property
    def motion(self) -> float:
        return 0.0 if self.kind == "rest" else self.driven_s

    @property
    def driven_s(self) -> float:
        return float(sum(seconds for _, seconds in self.commands))


def candidates(model: Model, limits: Limits, largest: float) -> tuple[PaperRun, ...]:
    """List every run that the limits allow, in a fixed order, both sides of each."""
    # even in the root of the moment, hence in the yaw rate under quadratic drag
    roots, ways, turn = np.linspace(MIN_MOMENT_SHARE**0.5, 1.0, limits.moments.levels), (1, -1), limits.pool.turn_deg
    sizes = (*(float(f"{largest * root**2:.3g}") for root in roots[:-1]), largest)
    first_parts = [  # moment and seconds of the steps after which a run goes on, and their label
        ((side * size, _seconds(model, size, degrees)), f"{moment_text(side * size)}_{degrees:.0f}deg")
        for size in sizes[1::2] for degrees in (turn / 3, 2 * turn / 3) for side in ways
    ]  # fmt: skip
    whole_steps = [step_of(model, side * largest, turn) for side in ways]
    constant = model.inertia / max(largest, 1e-12) * float(steady_rate(largest, *model.drag()))
    coast = round(min(max(COAST_CONSTANTS * constant, COAST_S[0]), COAST_S[1]), 1)
    every: dict[str, Iterable[PaperRun]] = {
        "step": (step_of(model, side * size, share * turn) for size in sizes for share in STEP_SHARES for side in ways),
        "coast-down": (PaperRun("coast-down", f"coast_{label}", (part, (0.0, coast))) for part, label in first_parts),
        "reversal": (
            PaperRun("reversal", f"reversal_{label}", ((moment, hold), (-moment, round(1.5 * hold, 1))))
            for (moment, hold), label in first_parts
        ),
        "slow-ramp": (_ramp(side * size) for size in (sizes[0], sizes[len(sizes) // 2]) for side in ways),
        "long-turn": (
            step_of(model, moment, model.dof.shown(model.dof.limits.long), "long-turn", f"long_{moment_text(moment)}")
            for size in (largest, sizes[limits.moments.levels // 2]) for moment in (size, -size)
        ),
        "rest": (PaperRun("rest", "rest", ((0.0, REST_S),)),),
        "other-voltage": (
            replace(step, kind="other-voltage", label=f"{step.label}_{volts:g}V", voltage=volts)
            for volts in limits.runs.voltages_V for step in whole_steps
        ),
    }  # fmt: skip
    kinds = [kind for kind in CANDIDATE_KINDS if kind in limits.runs.kinds]
    unique = {run.label: run for kind in kinds for run in every[kind] if run.driven_s <= MAX_DRIVEN_S}
    return tuple(unique.values())


def mirrors(candidates: Sequence[PaperRun]) -> list[int]:
    """Return the place of the same run to the other side, of each candidate; its own where it has no sides."""
    places = {(run.kind, run.commands, run.voltage, run.speed): i for i, run in enumerate(candidates)}
    turned = (tuple((-moment, seconds) for moment, seconds in run.commands) for run in candidates)
    remaining = zip(candidates, turned)
    return [places.get((run.kind, other, run.voltage, run.speed), i) for i, (run, other) in enumerate(remaining)]


def paper_grid(model: Model, largest: float) -> tuple[PaperRun, ...]:
    """Make the paper's own runs, scaled to the largest moment: half turns at twelve sizes, to both sides."""
    return tuple(step_of(model, side * largest * i / 12.0, 180.0) for i in range(1, 13) for side in (1, -1))


def _seconds(model: Model, moment: float, degrees: float) -> float:
    """Time to turn so far from rest, by inertia and drag, on a tenth of a second."""
    return max(round(specification.time_to_turn(radians(degrees), moment, model), 1), 0.5)


def step_of(model: Model, moment: float, degrees: float, kind: str = "step", label: str = "") -> PaperRun:
    """Make the run that turns so far from rest."""
    label = label or f"step_{moment_text(moment)}_{degrees:.0f}deg"
    return PaperRun(kind, label, ((moment, _seconds(model, moment, degrees)),))


def _ramp(moment: float) -> PaperRun:
    stairs = [moment * (2.0 * (i + 0.5) / RAMP_STAIRS - 1.0) for i in range(RAMP_STAIRS)]
    commands = tuple((round(stair, 6), RAMP_S / RAMP_STAIRS) for stair in stairs)
    return PaperRun("slow-ramp", f"ramp_{moment_text(moment)}", commands)


@dataclass(frozen=True)
class Supply:
    """What is drawn [A]: `idle` always, `full` more at the `largest` moment, by a `power` of others: 0 under way."""

    idle: float
    full: float
    largest: float
    power: float = POWER_LAW

    def current(self, moment: float) -> float:
        return self.idle + self.full * (abs(moment) / self.largest) ** self.power

    def drawn(self, candidate: PaperRun, at_rest: float) -> float:
        """Charge [Ah] of a run and of `at_rest` seconds without any moment."""
        driven = sum(self.current(moment) * seconds for moment, seconds in candidate.commands)
        return float((driven + self.idle * at_rest) / 3600.0)


def wait_after(candidate: PaperRun, limits: Limits) -> float:
    return limits.pool.wait_after_long_turn_s if candidate.turns else limits.pool.wait_s


def costs(candidates: Sequence[PaperRun], limits: Limits, supply: Supply) -> Floats:
    """Return minutes (wait included), runs, motion [s] and charge [Ah] of each candidate, (K, 4)."""
    at_rest = [limits.runs.rest_before_s + wait_after(run, limits) for run in candidates]
    rows = [((run.driven_s + s) / 60.0, 1.0, run.motion, supply.drawn(run, s)) for run, s in zip(candidates, at_rest)]
    return np.array(rows)


def allowance(limits: Limits) -> Floats:
    """Return what all runs together may cost, (4,), in the units of `costs`; the last run needs no wait."""
    charge = limits.battery.charge_Ah * (1.0 - limits.battery.reserve_percent / 100.0)
    motion = np.inf if limits.pool.motion_s is None else limits.pool.motion_s
    return np.array([limits.pool.minutes + limits.pool.wait_s / 60.0, float(limits.pool.runs), motion, charge])


@dataclass(frozen=True)
class TimedRun:
    """One run of the campaign: `number` from 1, `begins` [s] after the first log's start, `wait` [s] after it (none
    after the last), `left` [Ah] in the battery when its log ends; `why` it is made, how far [degrees] it turns the
    vehicle, and how far to turn to its start heading before."""

    number: int
    candidate: PaperRun
    begins: float
    wait: float
    left: float
    why: str = ""
    turns: float = 0.0
    turn_there: float = 0.0

    @property
    def name(self) -> str:
        return f"{self.number:02d}_{self.candidate.label}"

    def ends(self, rest_s: float) -> float:
        """When its log ends [s after the first log's start]."""
        return self.begins + rest_s + self.candidate.driven_s


def in_order(chosen: Sequence[PaperRun], check: PaperRun | None, seed: int) -> list[PaperRun]:
    """Put the runs in random order, those at another voltage last; with `check`, that run first and last."""
    remaining = list(chosen)
    if check is not None:
        for _ in range(2):
            remaining.remove(check)
    drawn = np.random.default_rng(seed).permutation(len(remaining))
    shuffled = sorted((remaining[int(i)] for i in drawn), key=lambda candidate: candidate.voltage is not None)
    return shuffled if check is None else [check, *shuffled, check]


def scheduled(runs: Sequence[PaperRun], limits: Limits, supply: Supply) -> tuple[TimedRun, ...]:
    """Lay the runs out one after the other, start headings in turn; times to the tenth of a second."""
    headings, rest_s = limits.pool.start_headings_deg, limits.runs.rest_before_s
    clock, charge, slots = 0.0, limits.battery.charge_Ah, list[TimedRun]()
    for i, run in enumerate(runs):
        run = replace(run, start_heading=headings[i % len(headings)], clock=round(clock, 1))
        wait = wait_after(run, limits) if i + 1 < len(runs) else 0.0
        charge -= supply.drawn(run, rest_s)
        slots.append(TimedRun(i + 1, run, run.clock, wait, charge))
        charge -= supply.idle * wait / 3600.0
        clock += rest_s + run.driven_s + wait
    return tuple(slots)


MIN_CURRENT_ROWS = 6  # rows of thruster tests from which on the current is told
MOMENT_COLUMNS = {"nu": "tau", "N m": "tau_Nm", STEERED: RUDDER_COLUMN}
DIGITS = 6


def drive_of(thruster_map: ThrusterMap, arm: float, most: float | None, equal_thrust: bool) -> TwinThrusters:
    """Make the twin thrusters of a map. Raises SettingError for a map of one direction, and for an unknown largest
    signal."""
    ahead, astern = thruster_map.both_ways
    largest = thruster_map.largest if most is None else most
    if largest is None:
        raise SettingError(
            "the thruster map does not say how far the control signal goes; give thrusters.largest_command in "
            "the limits"
        )
    if thruster_map.n_range is not None and largest > IMPOSSIBLE_EXTRAPOLATION * max(map(abs, thruster_map.n_range)):
        measured = "from {:.4g} to {:.4g}".format(*thruster_map.n_range) + f" {thruster_map.n_unit}".rstrip()
        raise SettingError(
            f"thrusters.largest_command is {largest:g}, but the thruster map was measured {measured}; give it in the "
            "map's own unit"
        )
    return TwinThrusters(ahead, astern, arm, largest, equal_thrust)


def consumption(records: Sequence[Series], per_test: int, volts: float) -> tuple[float, float, float]:
    """Return a [W], c ahead and c astern [W/N^1.5] of one thruster's electrical power, a + c |F|^1.5: by least squares
    over all rows with a power or a current, none below zero; `per_test` equal thrusters pulled together, `volts` of
    the supply where a current was logged without a voltage.

    Raises RunError where no test has such a column, or too few rows."""
    force, power = [], []
    for series in records:
        if "power_W" in series.extras:
            drawn = series.extras["power_W"]
        elif "current_A" in series.extras:
            drawn = series.extras["current_A"] * (volts if series.voltage is None else series.voltage)
        else:
            continue
        good = np.isfinite(drawn)
        force.append(series.force[good] / per_test)
        power.append(drawn[good] / per_test)
    count = sum(map(len, force))
    if count < MIN_CURRENT_ROWS:
        raise RunError(
            f"{count} rows of the thruster tests hold a power or a current, and {MIN_CURRENT_ROWS} are needed; name "
            "the column power_W or current_A, or state the current at full moment with battery.full_A in the limits"
        )
    f, p = np.concatenate(force), np.concatenate(power)
    size = np.abs(f) ** POWER_LAW
    design = np.stack([np.ones_like(f), np.where(f > 0, size, 0.0), np.where(f < 0, size, 0.0)], axis=1)
    idle, ahead, astern = map(float, optimize.nnls(design, p)[0])
    return idle, ahead or astern, astern or ahead


@dataclass(frozen=True)
class CommandTable:
    """What is commanded in a run: from each time [s since the log's start] on, a value for each of the `names`, which
    are columns of ours; `rules` say how the vehicle holds them, `factors` are those of their units."""

    names: tuple[str, ...]
    rules: tuple[ColumnRule, ...]
    factors: tuple[float, ...]
    rows: tuple[tuple[float, tuple[float, ...]], ...]

    def held(self, values: Sequence[float]) -> list[float]:
        return [rule.written(value, factor) for rule, value, factor in zip(self.rules, values, self.factors)]


def command_table(
    candidate: PaperRun, rest_s: float, unit: str, drive: TwinThrusters | None, names: ColumnMap
) -> CommandTable:
    """Tabulate the moment, or `n_port` and `n_stbd` where a `drive` makes it, between a rest [s] and neutral."""
    columns = (MOMENT_COLUMNS[unit],) if drive is None else ("n_port", "n_stbd")
    rules = tuple(names.columns.get(name, ColumnRule(name)) for name in columns)
    rules = tuple(rule if rule.of_one else ColumnRule(name) for name, rule in zip(columns, rules))
    factors = tuple(CANONICAL[name].factor(rule.unit) for name, rule in zip(columns, rules))
    rows, time = [], 0.0
    for moment, seconds in ((0.0, rest_s), *candidate.commands, (0.0, 0.0)):
        rows.append((time, (moment,) if drive is None else drive.commands(moment)))
        time += seconds
    return CommandTable(columns, rules, factors, tuple(rows))


def command_file(candidate: PaperRun, rest_s: float, unit: str, drive: TwinThrusters | None, names: ColumnMap) -> str:
    """Write CSV with `time_s` since the log's start and the commands of `command_table`, under the names and in the
    units of the logs where `names` says what these are (pulses about their neutral, percent)."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    table = command_table(candidate, rest_s, unit, drive, names)
    writer.writerow(("time_s", *(rule.source for rule in table.rules)))
    for time, values in table.rows:
        writer.writerow((f"{round(time, 3):g}", *(f"{value + 0.0:.{DIGITS}g}" for value in table.held(values))))
    return text.getvalue()


def in_words(candidate: PaperRun, unit: str) -> str:
    commands = candidate.commands
    if candidate.kind == "rest":
        return f"nothing for {commands[0][1]:g} s, thrusters idle"
    if candidate.kind == "slow-ramp":
        first, last, total = commands[0][0], commands[-1][0], candidate.driven_s
        return f"{first:+g} to {last:+g} {unit} in {len(commands)} equal stairs over {total:g} s"
    if unit == STEERED:
        angle, way = np.rad2deg(abs(commands[0][0])), "starboard" if commands[0][0] > 0 else "port"
        over = f", over to the other side at each {angle:g} degrees off the course" if candidate.kind == ZIGZAG else ""
        until = f"{len(commands)} times" if over else f"until the heading has turned {CIRCLE_DEG:g} degrees"
        speed = "" if candidate.speed is None else f"at {candidate.speed:g} m/s: "
        return f"{speed}rudder {angle:g} degrees to {way}{over}, {until}; about {candidate.driven_s:.0f} s"
    parts = (f"{f'{moment:+g} {unit}' if moment else 'nothing'} for {seconds:g} s" for moment, seconds in commands)
    return ("" if candidate.voltage is None else f"at {candidate.voltage:g} V: ") + ", then ".join(parts)
