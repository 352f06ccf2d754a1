"""What a day at the pool allows, from TOML (schema automarine/plan-limits/1), the runs that a campaign may be made of,
what each costs, and their order at the pool."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.resources import files
from math import radians
from pathlib import Path
from typing import Annotated, Literal

import numpy as np

from automarine_cli.dofs import YAW
from automarine_cli.errors import SettingError
from automarine_cli.models.yaw_model import YawModel, steady_rate
from automarine_cli.pipeline.records import Codec, keyed, read_mapping
from automarine_cli.pipeline.result_files import ResultKind, ResultRecord
from automarine_cli.quantities import Floats
from automarine_cli.simulation.specification import (
    AboveZero,
    Commands,
    Limit,
    Settings,
    ZeroOrMore,
    moment_text,
    time_to_turn,
)

SCHEMA = "automarine/plan-limits/1"
KINDS = ("step", "coast-down", "reversal", "slow-ramp", "long-turn", "rest", "other-voltage")
LEAST_TURN = 30.0
MOST_LEVELS, MOST_RUNS = 20, 500


@dataclass(frozen=True)
class Pool(Settings):
    minutes: AboveZero = 60.0
    runs: Annotated[int, Limit(2, MOST_RUNS)] = 24
    motion_s: AboveZero | None = None
    wait_s: ZeroOrMore = 60.0
    wait_after_long_turn_s: ZeroOrMore = 180.0
    turn_deg: Annotated[float, Limit(LEAST_TURN, 3600.0)] = 180.0
    start_headings_deg: tuple[float, ...] = (0.0, 90.0, 180.0, 270.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.start_headings_deg:
            raise SettingError("start_headings_deg is an empty list; expected at least one heading")


@dataclass(frozen=True)
class Moments(Settings):
    largest: AboveZero | None = None
    levels: Annotated[int, Limit(2, MOST_LEVELS)] = 6


@dataclass(frozen=True)
class Runs(Settings):
    kinds: tuple[str, ...] = KINDS
    rest_before_s: Annotated[float, Limit(1.0, 60.0)] = 3.0
    most_alike: Annotated[int, Limit(2, MOST_RUNS)] = 4
    of_one_size_percent: Annotated[float, Limit(1.0, 100.0)] = 50.0
    repeat_first_last: bool = True
    voltages_V: tuple[float, ...] = ()
    fit: Literal["whole-runs", "half-turns"] = "whole-runs"

    def __post_init__(self) -> None:
        super().__post_init__()
        if unknown := next((kind for kind in self.kinds if kind not in KINDS), None):
            raise SettingError(f"kinds names {unknown!r}; expected some of {', '.join(KINDS)}")
        if "step" not in self.kinds:
            raise SettingError(f"kinds is {list(self.kinds)}; expected 'step' among them, every campaign needs steps")
        if min(self.voltages_V, default=1.0) <= 0:
            raise SettingError(f"voltages_V holds {min(self.voltages_V):g}; expected voltages above 0")


@dataclass(frozen=True)
class Logger(Settings):
    rate_hz: Annotated[float, Limit(0.5, 1000.0)] = 10.0
    noise_deg: AboveZero | None = None
    rate_noise_deg_s: AboveZero | None = None
    gain_scatter: ZeroOrMore | None = None


@dataclass(frozen=True)
class Battery(Settings):
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
    schema: str = SCHEMA
    pool: Pool = field(default_factory=Pool)
    moments: Moments = field(default_factory=Moments)
    runs: Runs = field(default_factory=Runs)
    logger: Logger = field(default_factory=Logger)
    battery: Battery = field(default_factory=Battery)
    thrusters: Thrusters = field(default_factory=Thrusters)
    goal: Goal = field(default_factory=Goal)

    def __post_init__(self) -> None:
        if self.schema != SCHEMA:
            raise SettingError(f'schema is {self.schema!r}; expected the line schema = "{SCHEMA}"')


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


def read_limits(path: Path) -> Limits:
    return Codec(path.name).read(Limits, read_mapping(path))


POWER_LAW = 1.5
"""Power against thrust of a propeller at rest in the water: P = F^1.5/sqrt(2 rho A) by momentum theory (Rankine)."""
TURNS = (1 / 3, 1 / 2, 2 / 3, 1.0)  # lengths of steps that are tried, as shares of how far they may turn
LOW = 0.1  # smallest moment that is tried, as a share of the largest; levels between go by the root, as yaw rates do
RAMP_S, REST_S, STAIRS = 40.0, 60.0, 20
COAST_CONSTANTS, COAST_S = 6.0, (5.0, 20.0)
"""A coast-down lasts so many of the vehicle's time constants at full moment, within these bounds [s]."""
LONGEST_S = 120.0  # no run is driven for longer: who would wait for it can repeat it
HALF_TURN_MARGIN = 1.1
"""A step meant for a fit to half-turns passes them by this factor, so that less thrust than usual does too."""


@dataclass(frozen=True)
class Candidate:
    """One run on paper: `commands` (moment, seconds) follow the rest at the log's start; `label` names it.

    `turns` whether it turns further than steps may, so that the water needs longer; `voltage` [V] None for the usual.
    """

    kind: str
    label: str
    commands: Commands
    turns: bool = False
    voltage: float | None = None
    start_heading: float = 0.0
    clock: float = 0.0

    @property
    def motion(self) -> float:
        return 0.0 if self.kind == "rest" else self.driven

    @property
    def driven(self) -> float:
        return float(sum(seconds for _, seconds in self.commands))


def levels(limits: Limits, largest: float) -> tuple[float, ...]:
    """Return sizes of moment, smallest first: even in the root, hence in the yaw rate under quadratic drag."""
    low, most = LOW**0.5, limits.moments.levels - 1
    return *(float(f"{largest * (low + (1.0 - low) * i / most) ** 2:.3g}") for i in range(most)), largest


def candidates(model: YawModel, limits: Limits, largest: float) -> tuple[Candidate, ...]:
    """List every run that the limits allow, in a fixed order, both sides of each."""
    kinds = [kind for kind in MAKERS if kind in limits.runs.kinds]
    makers = [MAKERS[kind] for kind in kinds if kind == "step" or limits.runs.fit != "half-turns"]
    every = (candidate for make in makers for candidate in make(model, limits, largest))
    unique = {candidate.label: candidate for candidate in every if candidate.driven <= LONGEST_S}
    return tuple(unique.values())


def mirrors(found: Sequence[Candidate]) -> list[int]:
    """Return the place of the same run to the other side, of each candidate; its own where it has no sides."""
    places = {(one.kind, one.commands, one.voltage): i for i, one in enumerate(found)}
    turned = (tuple((-moment, seconds) for moment, seconds in one.commands) for one in found)
    return [places.get((one.kind, other, one.voltage), i) for i, (one, other) in enumerate(zip(found, turned))]


def full_step(model: YawModel, limits: Limits, moment: float) -> Candidate:
    return _step(model, moment, _furthest(limits))


def paper_grid(model: YawModel, largest: float) -> tuple[Candidate, ...]:
    """Make the paper's own campaign, scaled to the largest moment: twelve sizes, both sides, twice, half turns."""
    sizes = [largest * i / 12.0 for i in range(1, 13)]
    return tuple(_step(model, side * size, 180.0) for _ in range(2) for size in sizes for side in (1, -1))


def _furthest(limits: Limits) -> float:
    """How far a step turns at most [degrees]."""
    return limits.pool.turn_deg * (HALF_TURN_MARGIN if limits.runs.fit == "half-turns" else 1.0)


def _seconds(model: YawModel, moment: float, degrees: float) -> float:
    """Time to turn so far from rest, by inertia and drag, on a tenth of a second."""
    return max(round(time_to_turn(radians(degrees), moment, model), 1), 0.5)


def _step(model: YawModel, moment: float, degrees: float) -> Candidate:
    label = f"step_{moment_text(moment)}_{degrees:.0f}deg"
    return Candidate("step", label, ((moment, _seconds(model, moment, degrees)),))


def _steps(model: YawModel, limits: Limits, largest: float) -> Iterator[Candidate]:
    shares = (1.0,) if limits.runs.fit == "half-turns" else TURNS
    for size in levels(limits, largest):
        for share in shares:
            for side in (1, -1):
                yield _step(model, side * size, share * _furthest(limits))


def _first_parts(model: YawModel, limits: Limits, largest: float) -> Iterator[tuple[float, float, str]]:
    """Moment, seconds and label of the steps after which a run goes on."""
    for size in levels(limits, largest)[1::2]:
        for share in (1 / 3, 2 / 3):
            degrees = share * limits.pool.turn_deg
            for side in (1, -1):
                label = f"{moment_text(side * size)}_{degrees:.0f}deg"
                yield side * size, _seconds(model, size, degrees), label


def _coast_downs(model: YawModel, limits: Limits, largest: float) -> Iterator[Candidate]:
    constant = model.inertia / max(largest, 1e-12) * float(steady_rate(largest, *model.drag()))
    coast = round(min(max(COAST_CONSTANTS * constant, COAST_S[0]), COAST_S[1]), 1)
    for moment, hold, label in _first_parts(model, limits, largest):
        yield Candidate("coast-down", f"coast_{label}", ((moment, hold), (0.0, coast)))


def _reversals(model: YawModel, limits: Limits, largest: float) -> Iterator[Candidate]:
    for moment, hold, label in _first_parts(model, limits, largest):
        back = round(1.5 * hold, 1)
        yield Candidate("reversal", f"reversal_{label}", ((moment, hold), (-moment, back)))


def _ramps(model: YawModel, limits: Limits, largest: float) -> Iterator[Candidate]:
    sizes = levels(limits, largest)
    for size in (sizes[0], sizes[len(sizes) // 2]):
        for side in (1, -1):
            stairs = [side * size * (2.0 * (i + 0.5) / STAIRS - 1.0) for i in range(STAIRS)]
            commands = tuple((round(stair, 6), RAMP_S / STAIRS) for stair in stairs)
            yield Candidate("slow-ramp", f"ramp_{moment_text(side * size)}", commands)


def _long_turns(model: YawModel, limits: Limits, largest: float) -> Iterator[Candidate]:
    for size in (largest, levels(limits, largest)[limits.moments.levels // 2]):
        for side in (1, -1):
            hold = _seconds(model, size, model.dof.shown(model.dof.limits.long))
            yield Candidate("long-turn", f"long_{moment_text(side * size)}", ((side * size, hold),))


def _rests(model: YawModel, limits: Limits, largest: float) -> Iterator[Candidate]:
    yield Candidate("rest", "rest", ((0.0, REST_S),))


def _other_voltages(model: YawModel, limits: Limits, largest: float) -> Iterator[Candidate]:
    for volts in limits.runs.voltages_V:
        for side in (1, -1):
            step = _step(model, side * largest, _furthest(limits))
            yield replace(step, kind="other-voltage", label=f"{step.label}_{volts:g}V", voltage=volts)


MAKERS = dict(zip(KINDS, (_steps, _coast_downs, _reversals, _ramps, _long_turns, _rests, _other_voltages)))


@dataclass(frozen=True)
class Supply:
    """What is drawn [A]: `idle` always, `full` more at the `largest` moment."""

    idle: float
    full: float
    largest: float

    def current(self, moment: float) -> float:
        return self.idle + self.full * (abs(moment) / self.largest) ** POWER_LAW

    def drawn(self, candidate: Candidate, still: float) -> float:
        """Charge [Ah] of a run and of `still` seconds without any moment."""
        driven = sum(self.current(moment) * seconds for moment, seconds in candidate.commands)
        return float((driven + self.idle * still) / 3600.0)


def wait_after(candidate: Candidate, limits: Limits) -> float:
    return limits.pool.wait_after_long_turn_s if candidate.turns else limits.pool.wait_s


def costs(candidates: Sequence[Candidate], limits: Limits, supply: Supply) -> Floats:
    """Return minutes (wait included), runs, motion [s] and charge [Ah] of each candidate, (K, 4)."""
    still = [limits.runs.rest_before_s + wait_after(one, limits) for one in candidates]
    return np.array(
        [((one.driven + s) / 60.0, 1.0, one.motion, supply.drawn(one, s)) for one, s in zip(candidates, still)]
    )


def allowance(limits: Limits) -> Floats:
    """Return what all runs together may cost, (4,), in the units of `costs`; the last run needs no wait."""
    charge = limits.battery.charge_Ah * (1.0 - limits.battery.reserve_percent / 100.0)
    motion = np.inf if limits.pool.motion_s is None else limits.pool.motion_s
    return np.array([limits.pool.minutes + limits.pool.wait_s / 60.0, float(limits.pool.runs), motion, charge])


@dataclass(frozen=True)
class Slot:
    """One run of the campaign: `number` from 1, `begins` [s] after the first log's start, `wait` [s] after it (none
    after the last), `left` [Ah] in the battery when its log ends; `why` it is made, how far [degrees] it turns the
    vehicle, and how far to turn to its start heading before."""

    number: int
    candidate: Candidate
    begins: float
    wait: float
    left: float
    why: str = ""
    turns: float = 0.0
    turn_there: float = 0.0

    @property
    def name(self) -> str:
        return f"{self.number:02d}_{self.candidate.label}"

    def ends(self, rest: float) -> float:
        """When its log ends [s after the first log's start]."""
        return self.begins + rest + self.candidate.driven


def in_order(chosen: Sequence[Candidate], check: Candidate | None, seed: int) -> list[Candidate]:
    """Put the runs in random order, those at another voltage last; with `check`, that run first and last."""
    rest = list(chosen)
    if check is not None:
        for _ in range(2):
            rest.remove(check)
    drawn = np.random.default_rng(seed).permutation(len(rest))
    shuffled = sorted((rest[int(i)] for i in drawn), key=lambda one: one.voltage is not None)
    return shuffled if check is None else [check, *shuffled, check]


def scheduled(runs: Sequence[Candidate], limits: Limits, supply: Supply) -> tuple[Slot, ...]:
    """Lay the runs out one after the other, start headings in turn; times to the tenth of a second."""
    headings, rest = limits.pool.start_headings_deg, limits.runs.rest_before_s
    clock, left, slots = 0.0, limits.battery.charge_Ah, list[Slot]()
    for i, one in enumerate(runs):
        one = replace(one, start_heading=headings[i % len(headings)], clock=round(clock, 1))
        wait = wait_after(one, limits) if i + 1 < len(runs) else 0.0
        left -= supply.drawn(one, rest)
        slots.append(Slot(i + 1, one, one.clock, wait, left))
        left -= supply.idle * wait / 3600.0
        clock += rest + one.driven + wait
    return tuple(slots)
