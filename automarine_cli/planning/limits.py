"""What a day at the pool allows: frozen settings, from TOML (schema automarine/plan-limits/1), and a file to begin
with.

An unknown key and a value that makes no sense are refused with the key's path.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from automarine_cli.errors import SettingError
from automarine_cli.pipeline.records import from_mapping, read_mapping
from automarine_cli.simulation.checks import at_least_zero, between, positive

SCHEMA = "automarine/plan-limits/1"
KINDS = ("step", "coast-down", "reversal", "slow-ramp", "long-turn", "rest", "other-voltage")
LEAST_TURN = 30.0
MOST_LEVELS, MOST_RUNS = 20, 500

EXAMPLE = """\
# What the next campaign may cost, for `automarine plan MODEL.json --limits limits.toml -o DIR`.
# Every line may be left out; the values here are the defaults, those behind a # are off.

schema = "automarine/plan-limits/1"

[pool]
minutes = 60                 # from the first run to the end of the last, waits included
runs = 24                    # at most
# motion_s = 100             # of the vehicle in motion, over all runs
wait_s = 60                  # between runs, until the water is still
wait_after_long_turn_s = 180 # after a run that turns further than turn_deg
turn_deg = 180               # how far steps may turn: beyond it the vehicle meets its own wake, tether and walls
start_headings_deg = [0, 90, 180, 270]

[moments]
# largest = 1.0              # in the model's unit; needed where that is N m and no thruster map is given
levels = 6                   # how many sizes of moment are tried

[runs]
kinds = ["step", "coast-down", "reversal", "slow-ramp", "long-turn", "rest", "other-voltage"]
rest_before_s = 3            # at rest at the start of each log
most_alike = 4               # how often one run may be repeated: who makes only one kind learns nothing of the others
of_one_size_percent = 50     # of the runs at most at one size of moment: how drag grows is told by several sizes
repeat_first_last = true     # shows a sag of the battery over the campaign
voltages_V = []              # other supply voltages that can be set, for repeats of the largest step
fit = "whole-runs"           # what the runs will be fitted to: "whole-runs" or "half-turns" (steps only)

[logger]
rate_hz = 10
# noise_deg = 1.0            # of the heading; otherwise as the model's fit found it, or 1
# rate_noise_deg_s = 0.3     # of a gyro, where the vehicle logs one; otherwise as the model's fit found it, or no gyro
# gain_scatter = 0.03        # of the thrust from run to run; otherwise as the model's fit found it, or 0.03

[battery]
volts = 24                   # the paper's: lead-acid cells of 24 V and 2.9 Ah
charge_Ah = 2.9
idle_A = 0.3                 # electronics and lights, all the time
full_A = 6.0                 # more at the largest moment; thruster tests with a current or power column replace it
reserve_percent = 20         # that must be left at the end

[thrusters]                  # with --thrusters MAP.json and --arm METRES
# largest_command = 150      # control signal that the thrusters may be given
pairing = "equal-thrust"     # no push ahead; or "equal-command", as the paper drove: a larger moment, and a push ahead
# nu_in_Nm = 0.36            # one unit of a normalised moment, where the model is in nu

[goal]
# half_width_percent = 1.0   # stop when the 95 % intervals of the parameters are that narrow
evidence = 20                # difference in evidence from which two explanations count as split
use_earlier_runs = true      # the model's own runs are fitted together with the new ones
"""


@dataclass(frozen=True)
class Pool:
    """Time, runs and room."""

    minutes: float = 60.0
    runs: int = 24
    motion_s: float | None = None
    wait_s: float = 60.0
    wait_after_long_turn_s: float = 180.0
    turn_deg: float = 180.0
    start_headings_deg: tuple[float, ...] = (0.0, 90.0, 180.0, 270.0)

    def __post_init__(self) -> None:
        positive(self, "minutes", "motion_s")
        between(self, 2, MOST_RUNS, "runs")
        at_least_zero(self, "wait_s", "wait_after_long_turn_s")
        between(self, LEAST_TURN, 3600.0, "turn_deg")
        if not self.start_headings_deg:
            raise SettingError("start_headings_deg is an empty list; expected at least one heading")


@dataclass(frozen=True)
class Moments:
    """The moments that may be commanded, in the model's unit."""

    largest: float | None = None
    levels: int = 6

    def __post_init__(self) -> None:
        positive(self, "largest")
        between(self, 2, MOST_LEVELS, "levels")


@dataclass(frozen=True)
class Runs:
    """Which kinds of runs, and what every log begins with."""

    kinds: tuple[str, ...] = KINDS
    rest_before_s: float = 3.0
    most_alike: int = 4
    of_one_size_percent: float = 50.0
    repeat_first_last: bool = True
    voltages_V: tuple[float, ...] = ()
    fit: Literal["whole-runs", "half-turns"] = "whole-runs"

    def __post_init__(self) -> None:
        between(self, 1.0, 60.0, "rest_before_s")
        between(self, 2, MOST_RUNS, "most_alike")
        between(self, 1.0, 100.0, "of_one_size_percent")
        for kind in self.kinds:
            if kind not in KINDS:
                raise SettingError(f"kinds names {kind!r}; expected some of {', '.join(KINDS)}")
        if "step" not in self.kinds:
            raise SettingError(f"kinds is {list(self.kinds)}; expected 'step' among them, every campaign needs steps")
        for volts in self.voltages_V:
            if volts <= 0:
                raise SettingError(f"voltages_V holds {volts:g}; expected voltages above 0")


@dataclass(frozen=True)
class Logger:
    """The log of a run; None where the model's file knows better."""

    rate_hz: float = 10.0
    noise_deg: float | None = None
    rate_noise_deg_s: float | None = None
    gain_scatter: float | None = None

    def __post_init__(self) -> None:
        between(self, 0.5, 1000.0, "rate_hz")
        positive(self, "noise_deg", "rate_noise_deg_s")
        at_least_zero(self, "gain_scatter")


@dataclass(frozen=True)
class Battery:
    """The supply: what it holds, and what is drawn from it."""

    volts: float = 24.0
    charge_Ah: float = 2.9
    idle_A: float = 0.3
    full_A: float = 6.0
    reserve_percent: float = 20.0

    def __post_init__(self) -> None:
        positive(self, "volts", "charge_Ah")
        at_least_zero(self, "idle_A", "full_A")
        between(self, 0.0, 95.0, "reserve_percent")


@dataclass(frozen=True)
class Thrusters:
    """How two thrusters share a moment."""

    largest_command: float | None = None
    pairing: Literal["equal-thrust", "equal-command"] = "equal-thrust"
    nu_in_Nm: float | None = None

    def __post_init__(self) -> None:
        positive(self, "largest_command", "nu_in_Nm")


@dataclass(frozen=True)
class Goal:
    """When it is enough."""

    half_width_percent: float | None = None
    evidence: float = 20.0
    use_earlier_runs: bool = True

    def __post_init__(self) -> None:
        positive(self, "half_width_percent", "evidence")


@dataclass(frozen=True)
class Limits:
    """All of it."""

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


def read_limits(path: Path) -> Limits:
    """The limits in a TOML (or JSON) file. Raises SettingError with file and key."""
    return from_mapping(Limits, read_mapping(path), path.name)
