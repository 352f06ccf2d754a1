"""What the thrusters can give and draw, and the files that the vehicle's computer plays.

Two thrusters make a moment by the inverse of their map; tests that logged a current or a power beside the thrust tell
what they draw.
"""

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from math import floor, log10

import numpy as np
from scipy import optimize

from automarine_cli.errors import RunError, SettingError
from automarine_cli.logs import ColumnMap, ColumnRule
from automarine_cli.logs.columns import CANONICAL
from automarine_cli.planning.candidates import POWER_LAW, Candidate
from automarine_cli.runs.run import FAR_BEYOND
from automarine_cli.thrusters.bollard_data import Series
from automarine_cli.thrusters.map import Curve, ThrusterMap

ROUND_DOWN = 1e-6
FEWEST = 6  # rows of thruster tests from which on the current is told
MOMENT_COLUMNS = {"nu": "tau", "N m": "tau_Nm"}
DIGITS = 6


@dataclass(frozen=True)
class Drive:
    """Two equal thrusters `arm` [m] off the centre line, control signals up to `most`.

    With `equal_thrust` one pulls ahead as much as the other astern, so that the vehicle is not pushed ahead; else both
    get the same size of signal. `unit` is one unit of the model's moment in N m."""

    ahead: Curve
    astern: Curve
    arm: float
    most: float
    equal_thrust: bool
    unit: float

    @property
    def largest(self) -> float:
        ahead, astern = self._thrusts(self.most, self.most)
        pull = 2.0 * min(ahead, astern) if self.equal_thrust else ahead + astern
        return self.arm * pull / self.unit * (1.0 - ROUND_DOWN)

    @property
    def largest_rounded(self) -> float:
        """The same, rounded down to three digits."""
        largest = self.largest
        unit = 10.0 ** (floor(log10(largest)) - 2)
        return float(f"{floor(largest / unit) * unit:.3g}")

    def forces(self, moment: float) -> tuple[float, float]:
        """Return the thrust [N] of the thruster that pulls ahead and of the one that pulls astern (a size)."""
        return self._thrusts(*self._signals(moment))

    def commands(self, moment: float) -> tuple[float, float]:
        """Return control signals (n_port, n_stbd) that give the moment; positive turns to starboard."""
        if moment == 0.0:
            return 0.0, 0.0
        ahead, astern = self._signals(moment)
        return (ahead, -astern) if moment > 0 else (-astern, ahead)

    def _signals(self, moment: float) -> tuple[float, float]:
        wanted = abs(moment) * self.unit / self.arm
        if self.equal_thrust:
            return self.ahead.signal(wanted / 2.0), self.astern.signal(wanted / 2.0)
        n = optimize.brentq(lambda n: sum(self._thrusts(n, n)) - wanted, 0.0, self.most, xtol=1e-12 * self.most)
        return float(n), float(n)

    def _thrusts(self, ahead: float, astern: float) -> tuple[float, float]:
        return float(self.ahead.thrust(np.asarray(ahead))), float(self.astern.thrust(np.asarray(astern)))


def drive_of(known: ThrusterMap, arm: float, most: float | None, equal_thrust: bool, unit: float) -> Drive:
    """Make the drive of a map. Raises SettingError for a map of one direction, and for an unknown largest signal."""
    ahead, astern = known.both_ways
    largest = known.largest if most is None else most
    if largest is None:
        raise SettingError(
            "the thruster map does not say how far the control signal goes; give thrusters.largest_command in "
            "the limits"
        )
    if known.n_range is not None and largest > FAR_BEYOND * max(map(abs, known.n_range)):
        measured = "from {:.4g} to {:.4g}".format(*known.n_range) + f" {known.n_unit}".rstrip()
        raise SettingError(
            f"thrusters.largest_command is {largest:g}, but the thruster map was measured {measured}; give it in the "
            "map's own unit"
        )
    return Drive(ahead, astern, arm, largest, equal_thrust, unit)


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
    if count < FEWEST:
        raise RunError(
            f"{count} rows of the thruster tests hold a power or a current, and {FEWEST} are needed; name the column "
            "power_W or current_A, or state the current at full moment with battery.full_A in the limits"
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


def command_table(candidate: Candidate, rest: float, unit: str, drive: Drive | None, names: ColumnMap) -> CommandTable:
    """Tabulate the moment, or `n_port` and `n_stbd` where a `drive` makes it, between a rest [s] and neutral."""
    columns = (MOMENT_COLUMNS[unit],) if drive is None else ("n_port", "n_stbd")
    rules = tuple(names.columns.get(name, ColumnRule(name)) for name in columns)
    rules = tuple(rule if rule.sign_from is None else ColumnRule(name) for name, rule in zip(columns, rules))
    factors = tuple(CANONICAL[name].factor(rule.unit) for name, rule in zip(columns, rules))
    rows, time = [], 0.0
    for moment, seconds in ((0.0, rest), *candidate.commands, (0.0, 0.0)):
        rows.append((time, (moment,) if drive is None else drive.commands(moment)))
        time += seconds
    return CommandTable(columns, rules, factors, tuple(rows))


def command_file(candidate: Candidate, rest: float, unit: str, drive: Drive | None, names: ColumnMap) -> str:
    """Write CSV with `time_s` since the log's start and the commands of `command_table`, under the names and in the
    units of the logs where `names` says what these are (pulses about their neutral, percent)."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    table = command_table(candidate, rest, unit, drive, names)
    writer.writerow(("time_s", *(rule.source for rule in table.rules)))
    for time, values in table.rows:
        writer.writerow((f"{round(time, 3):g}", *(f"{value + 0.0:.{DIGITS}g}" for value in table.held(values))))
    return text.getvalue()


def in_words(candidate: Candidate, unit: str) -> str:
    commands = candidate.commands
    if candidate.kind == "rest":
        return f"nothing for {commands[0][1]:g} s, thrusters idle"
    if candidate.kind == "slow-ramp":
        first, last, total = commands[0][0], commands[-1][0], candidate.driven
        return f"{first:+g} to {last:+g} {unit} in {len(commands)} equal stairs over {total:g} s"
    parts = [
        f"{moment:+g} {unit} for {seconds:g} s" if moment else f"nothing for {seconds:g} s"
        for moment, seconds in commands
    ]
    told = ", then ".join(parts)
    return told if candidate.voltage is None else f"at {candidate.voltage:g} V: {told}"
