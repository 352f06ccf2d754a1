"""Which of the sensors in the logs count as evidence: those that agree, unless somebody says otherwise."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from automarine_cli.dofs import Dof
from automarine_cli.errors import SettingError
from automarine_cli.logs.canonical import names_of
from automarine_cli.pipeline.words import listed
from automarine_cli.runs.agreement import Agreement, agreement
from automarine_cli.runs.run import Run

AUTO, POSITION, ALL = "auto", "position", "all"

FOLLOWS = 0.3
"""Share of a velocity's noise that comes from the position's from which on it counts as computed from that."""
RELATED = 0.7
"""Correlation, of either sign, of velocity and position below which they are of different motions."""
SURELY_RELATED = 0.9
"""The same where the vehicle hardly changed its velocity, and the sensor's bias may hide in it."""
LEAST_SCALE = 0.03
"""Error of scale that is none: what tilt, deviation and the sums of slow loggers make of it."""
LEAST_LATE = 1.5
"""Delay that is none, in times between readings."""
SURE = 5.0
"""Standard errors."""
NEAR = 1.25
"""A scale this near to that of a mistaken unit, as a factor, is that."""


@dataclass(frozen=True)
class ChannelVerdict:
    """One sensor: whether it is `used`, and a sentence why not, or what is odd about it (else empty)."""

    quantity: str
    used: bool
    why: str = ""


@dataclass(frozen=True)
class ChannelChoice:
    """The sensors of a campaign. `names` are those that count, None where only positions are logged and nothing was
    to be chosen; `stuck` are the runs whose velocity is left out."""

    verdicts: tuple[ChannelVerdict, ...] = ()
    names: tuple[str, ...] | None = None
    stuck: frozenset[str] = frozenset()

    def cleaned(self, run: Run) -> Run:
        """The run without readings of a sensor that is stuck in it."""
        if run.name not in self.stuck:
            return run
        extras = {name: column for name, column in run.extras.items() if name != run.dof.velocity}
        return replace(run, extras=extras)

    def believed(self, run: Run) -> Run:
        """The run without a velocity that does not count, if only some sensors do."""
        if self.names is None or (run.dof.velocity in self.names and run.name not in self.stuck):
            return run
        extras = {name: column for name, column in run.extras.items() if name != run.dof.velocity}
        return replace(run, extras=extras)


NOTHING_TO_CHOOSE = ChannelChoice()


def wanted_channels(text: str, dof: Dof, key: str = "channels") -> tuple[str, ...] | None:
    """The quantities that the setting `key` names; None for "auto" and "all". Raises SettingError for what is none of
    them."""
    if text in (AUTO, ALL):
        return None
    if text == POSITION:
        return (dof.position,)
    names = tuple(name.strip() for name in text.split(",") if name.strip())
    unknown = [name for name in names if name not in dof.channels]
    if unknown or not names:
        raise SettingError(
            f"{key} is {text!r}; expected {AUTO}, {POSITION}, {ALL}, or some of {', '.join(dof.channels)} with "
            "commas between"
        )
    return names


def choose_channels(runs: Sequence[Run], dof: Dof, wanted: str = AUTO, *, late_position: bool = False) -> ChannelChoice:
    """Judge the sensors of all runs and choose, as `wanted` says.

    "auto" takes every sensor that does not contradict the position and tells something of its own, "position" that
    alone, "all" every one; else they are named, with commas between. With `late_position` a position that is read late
    is no contradiction: who asks has a name for that. Raises SettingError for a sensor that no log holds.
    """
    named = wanted_channels(wanted, dof)
    read = any((column := run.channel(dof.velocity)) is not None and np.isfinite(column).any() for run in runs)
    logged = any(not run.summed_up for run in runs)
    lacking = [name for name, there in zip(dof.channels, (logged, read)) if named and name in named and not there]
    if lacking and runs:
        what, columns = lacking[0].replace("_", " "), ", ".join(names_of(lacking[0]))
        raise SettingError(f"channels is {wanted!r}, and no log holds {what}; name its column {columns} with --columns")
    if not read:
        return NOTHING_TO_CHOOSE
    found = agreement(runs, dof.velocity)
    trouble = trouble_of(found, dof, late_position) if logged else ""
    velocity = dof.velocity in named if named else wanted == ALL or not trouble
    position = logged and (named is None or dof.position in named)
    why = trouble or (_stuck_in(found, dof) if velocity else "") if velocity or named is None else _not_asked()
    of_position = "" if position else _not_asked() if logged else _summed_up(dof)
    verdicts = (ChannelVerdict(dof.position, position, of_position), ChannelVerdict(dof.velocity, velocity, why))
    names = tuple(one.quantity for one in verdicts if one.used)
    return ChannelChoice(verdicts, names, frozenset(found.stuck))


def trouble_of(found: Agreement, dof: Dof, late_position: bool = False) -> str:
    """A sentence on what speaks against the velocity, with the remedy; empty for nothing."""
    rate, position, column = dof.words.rate, dof.words.position, names_of(dof.velocity)[0]
    if found.follows is not None and found.follows > FOLLOWS:
        return (
            f"The {rate} was computed from the {position}, or both come out of one estimator "
            f"({100 * found.follows:.0f} % of its noise is that of the {position}): it adds no information."
        )
    if not found.moving:
        return _stuck_in(found, dof)
    if abs(found.correlation) < RELATED:
        return (
            f"The {rate} does not follow the {position} (correlation {found.correlation:.2f}): it is of another "
            f"motion or another time; check which column is meant by {column}."
        )
    if abs(found.correlation) < SURELY_RELATED and not np.isfinite(found.scale_error):
        return ""
    size = abs(found.scale)
    units = _mistaken_unit(size, dof)
    if found.scale < 0:
        also = f", and {units[0]}" if units else ""
        more = f" and {units[1]}" if units else ""
        return (
            f"The {rate} has the wrong sign (correlation {found.correlation:.2f} of its sum with the {position})"
            f"{also}; map it with sign = -1{more} in the --columns file."
        )
    if units:
        return f"The {rate} {units[0]}; map it with {units[1]} in the --columns file."
    off = abs(found.scale - 1.0) > max(LEAST_SCALE, SURE * found.scale_error)
    late = abs(found.late) > max(LEAST_LATE * found.period, SURE * found.late_error)
    if late and (found.clock or not off):
        return "" if late_position and found.late < 0 else _clock(found.late, dof)
    if off:
        way = "less" if found.scale > 1 else "more"
        return (
            f"The {rate} reads {100 * abs(1 / found.scale - 1):.1f} % {way} than the {position} moves; if its "
            f"sensor is to blame, map it with scale = {found.scale:.4g} in the --columns file."
        )
    return ""


def _clock(late: float, dof: Dof) -> str:
    rate, position = dof.words.rate, dof.words.position
    if late > 0:
        return (
            f"The {rate} is {late:.2g} s late against the {position}, by its clock or a filter; shift its column by "
            "that in the log."
        )
    return (
        f"The {rate} is {-late:.2g} s ahead of the {position}, by its clock, or because the {position} is read late; "
        "shift its column by that in the log if the clock is to blame."
    )


def _mistaken_unit(size: float, dof: Dof) -> tuple[str, str] | None:
    """What a scale says of the unit, and what to write in the column map."""
    own = names_of(dof.velocity)
    if dof.wraps:
        told = {
            dof.units.per_base: (f"is in {dof.units.base}/s, not in {dof.units.log}/s", f'unit = "{dof.units.base}/s"'),
            1 / dof.units.per_base: (
                f"is in {dof.units.log}/s, not in {dof.units.base}/s", f'unit = "{dof.units.log}/s"'
            ),
        }  # fmt: skip
    else:
        told = {
            0.01: ("is in cm/s", 'unit = "cm/s"'),
            0.001: ("is in mm/s", "scale = 0.001"),
            1 / 3.6: ("is in km/h", "scale = 0.2778"),
            1852 / 3600: ("is in knots", 'unit = "kn"'),
        }
    for factor, said in told.items():
        if abs(np.log(size / factor)) < np.log(NEAR):
            return f"{said[0]} ({own[0]}: {1 / size:.3g} times what the {dof.words.position} moves)", said[1]
    return None


def _stuck_in(found: Agreement, dof: Dof) -> str:
    if not found.stuck:
        return ""
    value = f"{float(dof.logged(found.stuck_at)):.4g} {dof.units.log}/s"
    where = listed(found.stuck) if found.moving else "every run"
    return (
        f"The {dof.words.rate} is stuck at {value} in {where} while the {dof.words.position} moves, and left out "
        "there; check the sensor and its cable."
    )


def _not_asked() -> str:
    return "It was not asked for (--channels)."


def _summed_up(dof: Dof) -> str:
    return (
        f"The logs hold no {dof.words.position}: shown is the sum of the {dof.words.rate}, by which runs are trimmed, "
        "and which is no evidence."
    )
