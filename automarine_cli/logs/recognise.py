"""What the columns of a log may be: by their names and by their values, and how sure that is.

Nothing is ever read by a guess: `automarine init` writes it into a campaign file, with the range that was seen,
and asks where name and range do not settle it.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from automarine_cli.dofs import DOFS
from automarine_cli.logs.canonical import CANONICAL, NORMALISED, ROTATIONS, TIMESTAMP, UNITS, likely_column, names_of
from automarine_cli.logs.mixing import WISHES
from automarine_cli.logs.table import LogTable
from automarine_cli.quantities import Floats

SLOWEST, FASTEST = 2.0, 2e-3  # s between the samples of an ordinary logger
SLOWEST_OF_ALL, FASTEST_OF_ALL = 5.0, 2e-4
DEGREES, RADIANS = 360.0, 2 * np.pi
HARDLY = 20.0  # an angle that stays within as many degrees in all logs may be radians
FAR = 100.0  # radians that nothing turns through in a pool test without wrapping
PULSES = (800, 1500, 2200)  # us: shortest, neutral, longest pulse of a hobby servo or thruster
FORCE = {"kgf": "kgf", "lbf": "lbf", "gf": "gf", "n": "N", "newton": "N", "newtons": "N"}
EXACT = {
    "time": ("t", "time", "timestamp", "seconds", "clock", "stamp", "millis"),
    "n": ("n", "cmd", "command", "rpm", "pwm", "n_rev_s", "throttle", "thruster_input"),
    "force": ("force", "thrust", "load", "pull", "newtons"),
    "voltage": ("voltage", "volts", "vbat", "battery_voltage"),
    **{quantity: names for dof in DOFS.values() for quantity, names in dof.plain_names.items()},
}
UNIT_WORDS = {"deg", "rad", "s", "ms", "us", "sec", "v", "mv", "nm", *FORCE}


@dataclass(frozen=True)
class Span:
    """What the values of one column do, over one log or many: ends, and steps from one row to the next."""

    low: float
    high: float
    median_step: float
    largest_step: float
    made_from: str = ""  # of which outputs it was worked back, where no file holds it

    def __add__(self, other: "Span") -> "Span":
        return Span(
            min(self.low, other.low), max(self.high, other.high),
            float(np.median([self.median_step, other.median_step])), max(self.largest_step, other.largest_step),
            self.made_from or other.made_from,
        )  # fmt: skip


@dataclass(frozen=True)
class Recognised:
    """What one column is taken for. `unit` None: the key's own; `open`: what must be asked, "" where it is sure.

    `key` is a canonical name, `unit_open` whether the question is which unit (else: which column, or whether).
    """

    key: str
    source: str
    seen: str
    unit: str | None = None
    open: str = ""
    unit_open: bool = False

    @property
    def as_named(self) -> bool:
        """Whether the file's own name says it all."""
        return self.source == self.key and self.unit is None and not self.open


def pulses(seen: Mapping[str, Span]) -> tuple[str, ...]:
    """Columns that may be what is sent to thrusters' drivers: pulse lengths [us] that change, about neutral."""
    low, neutral, high = PULSES
    return tuple(
        name
        for name, one in seen.items()
        if name not in CANONICAL and low <= one.low <= neutral <= one.high <= high and one.largest_step > 0
    )


def spans(table: LogTable) -> dict[str, Span]:
    """What every numeric column of a log does, in the units of the file."""
    found = {}
    for name, values in _raw(table).items():
        good = values[np.isfinite(values)]
        if len(good):
            steps = np.abs(np.diff(good))
            moved = steps[steps > 0]
            median = float(np.median(moved)) if len(moved) else 0.0
            made = table.origin.made_from if name in WISHES else ""
            found[name] = Span(float(good.min()), float(good.max()), median, float(steps.max(initial=0.0)), made)
    return found


def _raw(table: LogTable) -> dict[str, Floats]:
    """Numeric columns by the file's own name, as the file has them."""
    own = {
        name: table.columns[CANONICAL[name].quantity] / CANONICAL[name].factor()
        for name in table.names
        if name in CANONICAL and CANONICAL[name].unit != TIMESTAMP and CANONICAL[name].quantity in table.columns
    }
    return {**table.extras, **own}


def recognise(quantity: str, names: Sequence[str], seen: Mapping[str, Span]) -> Recognised | None:
    """The column of a log that holds a quantity (as in `CANONICAL`), or None where none looks like it."""
    own = next((name for name in names_of(quantity) if name in names), None)
    free = [name for name in names if name and name not in CANONICAL]
    if own == "time" and own in seen:  # plain numbers: no timestamps
        own, free = None, [*free, "time"]
    named = next((name for name in free if name in seen and _named_exactly(quantity, name)), None)
    source = own or named or likely_column(quantity, free)
    if source is None:
        return None
    if source not in seen:
        return Recognised("time", source, "timestamps") if quantity == "time" else None
    span = seen[source]
    found = _JUDGES.get(quantity, _plain)(quantity, source, span)
    if own is None and not found.open and not _named_exactly(quantity, source):
        why = f'is this the {_in_words(quantity)}? Then write "{source}"'
        return Recognised(found.key, source, found.seen, found.unit, why)
    return found


def _in_words(quantity: str) -> str:
    mounts = {name: f"{mount} command" for dof in DOFS.values() for name, mount in zip(dof.thrusters, dof.mounts)}
    return {"n": "control signal", **mounts}.get(quantity, quantity.replace("_", " "))


def words_of(name: str) -> list[str]:
    """`Force (Kg f)` -> force, kgf: lower case, brackets and underscores apart."""
    plain = re.sub(r"kg\s*f\b", "kgf", re.sub(r"lb\s*f\b", "lbf", name.lower()))
    return [word for word in re.split(r"[^a-z0-9]+", plain) if word]


def _named_exactly(quantity: str, source: str) -> bool:
    """Whether the name, without its unit, is a word for the quantity."""
    words = words_of(source)
    bare = "_".join(word for word in words if word not in UNIT_WORDS or len(words) == 1)
    whole = "_".join(words)
    return bool({bare, whole} & {*EXACT.get(quantity, ()), *(name.lower() for name in names_of(quantity))})


def _range(span: Span) -> str:
    made = f", worked back from {span.made_from}" if span.made_from else ""
    return f"{span.low:.5g} to {span.high:.5g}{made}"


def _time(quantity: str, source: str, span: Span) -> Recognised:
    """The unit in which the samples are a sensible time apart."""
    step, seen = span.median_step, f"{_range(span)}, {span.median_step:.4g} from sample to sample"
    fits = [u for u in ("s", "ms", "us") if FASTEST <= step * UNITS["time"][u] <= SLOWEST]
    fits = fits or [u for u in ("s", "ms", "us") if FASTEST_OF_ALL <= step * UNITS["time"][u] <= SLOWEST_OF_ALL]
    told = _told(source, {"s": "s", "sec": "s", "seconds": "s", "ms": "ms", "millis": "ms", "us": "us"})
    unit = told if told in fits or not fits else fits[0]
    key = f"time_{unit or 's'}"
    if len(fits) == 1 and told in (None, fits[0]):
        return Recognised(key, source, seen)
    if told in fits:
        return Recognised(key, source, seen)
    if told is not None and fits:
        why = f"the name says {told}, the samples say {' or '.join(fits)}"
    else:
        why = f"{' or '.join(fits)}?" if fits else "no unit makes these a clock; is this the time?"
    return Recognised("time_s", source, seen, fits[0] if fits else None, why, unit_open=True)


def _angle(quantity: str, source: str, span: Span) -> Recognised:
    """Degrees or radians: by the name, unless the values cannot be that; by the values only where they wrap."""
    width, largest = span.high - span.low, max(abs(span.low), abs(span.high))
    told = _told(source, {"deg": "deg", "degrees": "deg", "rad": "rad", "radians": "rad"})
    smooth = span.median_step < 0.05 * span.largest_step
    certain = None
    if smooth and 1.001 * RADIANS < width <= 1.001 * DEGREES and span.largest_step > 0.75 * DEGREES:
        certain = "deg"
    elif smooth and width <= 1.001 * RADIANS and span.largest_step > 0.75 * RADIANS:
        certain = "rad"
    elif width <= 1.001 * DEGREES and largest > FAR:
        certain = "deg"
    seen = f"{_range(span)}" + (f", wraps at {'360' if certain == 'deg' else '2 pi'}" if certain and smooth else "")
    if told is not None and certain is not None and told != certain:
        why = f"the name says {told}, the range says {certain}"
        return Recognised(_name(quantity, told), source, seen, certain, why, unit_open=True)
    if told == "deg" and certain is None and width < HARDLY:
        why = f"degrees would mean that no log turns {width:.2g} degrees; deg or rad?"
        return Recognised(_name(quantity, told), source, seen, "rad", why, unit_open=True)
    if told or certain:
        return Recognised(_name(quantity, told or str(certain)), source, seen)
    likely = "rad" if largest <= 1.1 * RADIANS else "deg"
    why = f"deg or rad? The range looks like {likely}"
    return Recognised(_name(quantity, likely), source, seen, open=why, unit_open=True)


def _moment(quantity: str, source: str, span: Span) -> Recognised:
    words = words_of(source)
    if source in CANONICAL:
        return Recognised(source, source, _range(span))
    if "nm" in words or words[-2:] == ["n", "m"]:
        return Recognised(_name(quantity, "N m"), source, _range(span))
    metres, normalised = _name(quantity, "N m"), _name(quantity, NORMALISED)
    why = f'a {quantity} in newton metres (then {metres} = "{source}") or normalised (then {normalised} = "{source}")?'
    return Recognised(normalised, source, _range(span), open=why)


def _force(quantity: str, source: str, span: Span) -> Recognised:
    told = _told(source, FORCE) if source not in CANONICAL else UNITS_OF_KEYS[source]
    if told is None:
        return Recognised("force_N", source, _range(span), open="N, kgf or lbf?", unit_open=True)
    key = f"force_{told}"
    if key in CANONICAL:
        return Recognised(key, source, _range(span))
    return Recognised("force_N", source, _range(span), told)


def _voltage(quantity: str, source: str, span: Span) -> Recognised:
    if span.low > 1000:
        return Recognised("voltage_V", source, _range(span), "mV")
    sure = source in CANONICAL or _named_exactly(quantity, source)
    return Recognised("voltage_V", source, _range(span), open="" if sure and span.high < 1000 else "is this in volts?")


def _plain(quantity: str, source: str, span: Span) -> Recognised:
    return Recognised(source if source in CANONICAL else names_of(quantity)[0], source, _range(span))


def _name(quantity: str, unit: str) -> str:
    """The canonical name of a quantity in a unit."""
    return next(name for name in names_of(quantity) if CANONICAL[name].unit == unit)


def _told(source: str, words: Mapping[str, str]) -> str | None:
    """The unit that a name says."""
    if source in CANONICAL and CANONICAL[source].unit != TIMESTAMP:
        return CANONICAL[source].unit
    found = words_of(source)
    return next((words[word] for word in reversed(found) if word in words and (len(found) > 1 or len(word) > 3)), None)


UNITS_OF_KEYS = {name: one.unit for name, one in CANONICAL.items()}
_JUDGES = {
    "time": _time,
    "force": _force,
    "voltage": _voltage,
    **dict.fromkeys((dof.position for dof in ROTATIONS), _angle),
    **dict.fromkeys((dof.command for dof in ROTATIONS), _moment),
}
