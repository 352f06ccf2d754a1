"""Settings of a simulated campaign beside its vehicle and runs: the logger, what scatters, the schedule, bollard tests.

Keys that a motion calls its own way are templates, filled from its record.
"""

from dataclasses import dataclass, field
from typing import Literal

from automarine_cli.dofs import Dof
from automarine_cli.errors import SettingError
from automarine_cli.pipeline.records import FILLER, key_of, keyed
from automarine_cli.simulation.checks import at_least_zero, between, positive, safe_path
from automarine_cli.simulation.run_groups import Format, Levels, levels_of

MOST_JITTER = 0.3  # of a sample period: the clock must keep rising


@dataclass(frozen=True)
class Logger:
    """What the logger does to the truth; positions in the unit of the logs, which ends their keys (`noise_deg`).

    `rate_hz` samples a second; `noise` white noise of the position and `quantisation` its resolution;
    `dropout` share of the samples lost; `clock_jitter_s` standard deviation of the sampling instants around
    an even clock (the stamps are right); `glitch` share of the samples that are off by `glitch_size` to either side;
    `wrap` of the position; `rate_noise` adds a column with the velocity, as a gyro reads it, and that noise;
    `rate_bias` is the standard deviation of what it reads at standstill, drawn for each run.
    """

    rate_hz: float = 10.0
    noise: float = field(default=0.0, metadata=keyed("noise_{log_unit}"))
    quantisation: float = field(default=0.0, metadata=keyed("quantisation_{log_unit}"))
    dropout: float = 0.0
    clock_jitter_s: float = 0.0
    glitch: float = 0.0
    glitch_size: float = field(default=0.0, metadata=keyed("glitch_{log_unit}"))
    wrap: Literal["0..360", "-180..180", "none"] = "none"
    rate_noise: float | None = field(default=None, metadata=keyed("{speed}_noise_{log_unit}_s"))
    rate_bias: float | None = field(default=None, metadata=keyed("{speed}_bias_{log_unit}_s"))
    dof: Dof = field(kw_only=True, repr=False, metadata=FILLER)

    def __post_init__(self) -> None:
        positive(self, "rate_hz")
        at_least_zero(self, "noise", "quantisation", "clock_jitter_s", "glitch_size", "rate_noise", "rate_bias")
        between(self, 0.0, 0.9, "dropout", "glitch")
        if self.rate_noise is None and self.rate_bias is not None:
            raise SettingError(
                f"{key_of(self, 'rate_bias')} is of the {self.dof.words.speed}s logged; expected "
                f"{key_of(self, 'rate_noise')} with it (0 for none)"
            )
        if self.clock_jitter_s > MOST_JITTER * self.period:
            raise SettingError(
                f"clock_jitter_s is {self.clock_jitter_s:g}; expected at most {MOST_JITTER:g} of the sample "
                f"period, {MOST_JITTER * self.period:g} s"
            )

    @property
    def period(self) -> float:
        """Time between samples [s]."""
        return 1.0 / self.rate_hz


@dataclass(frozen=True)
class Scatter:
    """What differs from run to run, drawn anew for each.

    `gain` is the standard deviation of the logarithm of the moment or force delivered over the one commanded;
    `force` that of a constant moment or force added in each run, redrawn until it is at most
    `force_most` of the run's smallest command (who sees his vehicle go the wrong way makes the run
    again); `zero` [unit of logs] that of the sensor's zero; `start` one position, a list that the
    runs take in turn, or "random". In a file of yaw they are `moment`, `moment_most`, `heading_zero_deg` and
    `start_heading_deg`.
    """

    gain: float = 0.0
    force: float = field(default=0.0, metadata=keyed("{force}"))
    force_most: float | None = field(default=None, metadata=keyed("{force}_most"))
    zero: float = field(default=0.0, metadata=keyed("{position}_zero_{log_unit}"))
    start: float | tuple[float, ...] | Literal["random"] = field(
        default=0.0, metadata=keyed("start_{position}_{log_unit}")
    )
    dof: Dof = field(kw_only=True, repr=False, metadata=FILLER)

    def __post_init__(self) -> None:
        at_least_zero(self, "gain", "force", "zero")
        if self.force_most is not None:
            positive(self, "force_most")
        if self.start == ():
            raise SettingError(f"{key_of(self, 'start')} is an empty list; expected at least one {self.dof.position}")


@dataclass(frozen=True)
class Schedule:
    """How the campaign is run: one clock over all runs, which follow each other after `wait_between_s`.

    Each run has `rest_before_s` and `rest_after_s` without a command in its log. `held`: someone holds the vehicle
    still until the first change of its command.
    """

    order: Literal["listed", "random"] = "listed"
    rest_before_s: float = 3.0
    rest_after_s: float = 0.0
    wait_between_s: float = 60.0
    held: bool = False

    def __post_init__(self) -> None:
        at_least_zero(self, "rest_before_s", "rest_after_s", "wait_between_s")


@dataclass(frozen=True)
class Bollard:
    """A bollard test: `thrusters_per_test` equal thrusters pull together, thrust a_f n² and -a_b n² each [N].

    `levels` of the control signal, each measured `repeats` times with noise of `noise_N`, in random order.
    """

    a_f: float
    a_b: float
    levels: Levels
    thrusters_per_test: int = 1
    repeats: int = 1
    noise_N: float = 0.0
    folder: str = "thrusters"
    name: str = "bollard"
    format: Format = "csv"

    def __post_init__(self) -> None:
        positive(self, "a_f", "a_b", "thrusters_per_test", "repeats")
        at_least_zero(self, "noise_N")
        safe_path(self, "folder", "name")
        levels_of(self.levels)

    @property
    def file(self) -> str:
        """Where the log is, from the campaign's folder."""
        return f"{self.folder}/{self.name}.{self.format}"
