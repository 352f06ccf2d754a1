"""What the columns of logs may be, by names and values, and how sure that is; and the map that fits all logs of a
folder.

Nothing is read by a guess: `automarine init` writes it into a campaign file, and asks where name and range leave it
open. Control signal and force of a bollard test are looked at together: where neutral is, what says the direction."""

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path, PurePosixPath

import numpy as np
import pyarrow as pa

from automarine_cli.dofs import DOFS, YAW, Dof
from automarine_cli.errors import LogError
from automarine_cli.logs import columns as naming
from automarine_cli.logs.columns import CANONICAL, LABELS, PULSES, THRUSTERS, UNITS, ColumnMap, ColumnRule, ColumnsOf
from automarine_cli.logs.find import stem_of, whole_logs
from automarine_cli.logs.formats import LogFile, RawLog, read_stamps
from automarine_cli.logs.mixing import CONTROL_AXES
from automarine_cli.logs.streams import NoHeading
from automarine_cli.logs.table import categorical_columns, means_thruster_test, splitting, whole_log
from automarine_cli.pipeline.parallel import Progress, ordered_map
from automarine_cli.quantities import Floats


@dataclass(frozen=True)
class Span:
    """What a column does over one log or many: ends, steps from row to row, median. `made_from` names the outputs it
    was worked back from; `stamps` says how times are written, `open` that day and month may be exchanged."""

    low: float
    high: float
    median_step: float
    largest_step: float
    middle: float = float("nan")
    stamps: str = ""
    open: bool = False
    made_from: str = ""

    def __str__(self) -> str:
        origin = f", worked back from {self.made_from}" if self.made_from else ""
        return f"{self.low:.5g} to {self.high:.5g}{origin}"

    def __add__(self, other: "Span") -> "Span":
        return Span(
            min(self.low, other.low), max(self.high, other.high),
            float(np.median([self.median_step, other.median_step])), max(self.largest_step, other.largest_step),
            float(np.median([self.middle, other.middle])), self.stamps or other.stamps, self.open and other.open,
            self.made_from or other.made_from,
        )  # fmt: skip


def is_pulses(name: str, span: Span) -> bool:
    """Tell whether values may be changing pulse lengths [us] of thrusters: by name, usual range or symmetry."""
    (low, neutral, high), (shortest, longest) = PULSES, naming.EVERY_PULSE
    usual = low <= span.low <= neutral <= span.high <= high
    centred = abs(span.low + span.high - 2 * neutral) <= NEUTRAL_TOLERANCE_US
    pulse = naming.unit_in(name) == "us" or (not naming.unit_in(name) and (usual or centred))
    return pulse and shortest <= span.low and span.high <= longest and span.largest_step > 0


def pulses(spans: Mapping[str, Span]) -> tuple[str, ...]:
    return tuple(name for name, span in spans.items() if name not in CANONICAL and is_pulses(name, span))


def spans_of(raw: RawLog) -> dict[str, Span]:
    """What every column of numbers or of times of a file does, in the units of the file."""
    spans = {}
    for name, array in zip(raw.names, raw.arrays):
        number = pa.types.is_floating(array.type)
        stamps = None if number else read_stamps(array)
        if not name or not (number or stamps):
            continue
        values = np.asarray(array.to_numpy()) if stamps is None else stamps.seconds
        good = values[np.isfinite(values)]
        if len(good):
            steps = np.abs(np.diff(good))
            spans[name] = Span(
                float(good.min()), float(good.max()), float(np.median(steps[steps > 0])) if steps.any() else 0.0,
                float(steps.max(initial=0.0)), float(np.median(good)),
                stamps.kind if stamps else "", stamps is not None and stamps.open,
                raw.origin.made_from if name in CONTROL_AXES else "",
            )  # fmt: skip
    return spans


def is_share(span: Span) -> bool:
    """Whether values may be a throttle, -1 to 1 or -100 to 100 and the like."""
    largest = max(abs(span.low), abs(span.high))
    return any(abs(largest - full) <= 0.002 * full for full in (1.0, 100.0))


MAX_SAMPLE_S, MIN_SAMPLE_S, MIN_BENCH_S = 2.0, 0.999 * 2e-3, 0.999 * 2e-4  # of a logger; of a fast load cell
TURN_DEG, TURN_RAD = 360.0, 2 * np.pi
SMALL_TURN_DEG = 20.0  # an angle that stays within as many degrees in all logs may be radians
MIN_SUPPLY_V = 3.0  # V
MAX_UNWRAPPED_RAD = 100.0  # radians that nothing turns through in a pool test without wrapping
FORCE_WORDS = {
    "kgf": "kgf", "kg": "kgf", "lbf": "lbf", "lb": "lbf", "lbs": "lbf", "gf": "gf", "g": "gf", "grams": "gf",
    "n": "N", "newton": "N", "newtons": "N",
}  # fmt: skip
SPEED_WORDS = {"mps": "m/s", "m_s": "m/s", "cm_s": "cm/s", "kn": "kn", "kts": "kn", "knots": "kn"}
EXACT = {
    **{
        quantity: {*naming.WORDS[quantity]} - {"battery", "bat"}
        for quantity in ("time", "n", "force", *naming.SIGNALS, naming.ELEVATOR)
    },
    **{quantity: names for dof in DOFS.values() for quantity, names in dof.plain_names.items()},
}
THRUSTER_WORDS = {
    "n", "cmd", "command", "pwm", "rpm", "rps", "us", "esc", "thruster", "motor", "throttle", "thr", "effort", "pct",
    "percent",
}  # fmt: skip
"""Words in names of thruster commands that do not say which thruster it is."""
RATE_UNITS = {"degps": "deg/s", "dps": "deg/s", "deg": "deg/s", "radps": "rad/s", "rad": "rad/s"}
UNIT_WORDS = {"s", "ms", "us", "sec", "v", "mv", "nm", "pct", "percent", *FORCE_WORDS, *RATE_UNITS}


@dataclass(frozen=True)
class Recognised:
    """What a column is taken for: a canonical `key`, with `unit` (None: the key's own) and `more` keys of its rule.
    `open` is what must be asked ("" where it is sure), `ask` the key that is open ("": which column, or whether)."""

    key: str
    source: str
    evidence: str
    unit: str | None = None
    open: str = ""
    more: Mapping[str, object] = field(default_factory=dict)
    ask: str = ""

    @property
    def as_named(self) -> bool:
        return self.rule == {"from": self.key} and not self.open

    @property
    def neutral(self) -> float:
        return self.more.get("subtract", 0)  # type: ignore[return-value]

    @property
    def rule(self) -> dict[str, object]:
        """Its line in a column map as it is taken to be, whatever is open."""
        return {"from": self.source} | ({} if self.unit is None else {"unit": self.unit}) | dict(self.more)


def recognise(quantity: str, names: Sequence[str], spans: Mapping[str, Span]) -> Recognised | None:
    """The column of a log that holds a quantity (as in `CANONICAL`), or None where none looks like it."""
    canonical = next((name for name in naming.names_of(quantity) if name in names), None)
    free = [name for name in names if name in spans and name not in CANONICAL and name not in LABELS]
    free = [name for name in free if quantity == "time" or not spans[name].stamps]
    if canonical == "time" and canonical in spans and not spans[canonical].stamps:  # plain numbers: no timestamps
        canonical, free = None, [*free, "time"]
    exact = [name for name in free if _named_exactly(quantity, name)]
    if quantity == "force":  # a throttle may be called thrust: what tells a unit comes first
        exact.sort(key=lambda name: (_unit_in(name, FORCE_WORDS) is None, is_share(spans[name])))
    elif quantity == "n":  # what is commanded before the speed that was measured
        signals = [name for name in free if naming.unit_in(name) == "us" and is_pulses(name, spans[name])]
        exact.sort(key=lambda name: naming.unit_in(name) in ("rpm", "rev/s"))
        exact = exact or (signals if len(signals) == 1 else [])
    source = canonical or next(iter(exact), None) or naming.likely_column(quantity, free)
    if source is None or source not in spans:
        return None
    column = _JUDGES.get(quantity, _plain)(quantity, source, spans[source])
    if canonical is None and not column.open and not exact:
        return replace(column, open=f'is this the {naming.called(quantity)}? Then write "{source}"')
    return column


def is_called(quantity: str, names: Sequence[str]) -> bool:
    """Whether a column is called by a canonical name or a word for the quantity."""
    return any(name in naming.names_of(quantity) or _named_exactly(quantity, name) for name in names)


def in_newtons(name: str) -> bool:
    """Whether a name ends in that unit: `left_N`, and no `n_left`."""
    return len(words_of(name)) > 1 and FORCE_WORDS.get(words_of(name)[-1]) == "N"


def words_of(name: str) -> list[str]:
    """`Force (Kg f)` -> force, kgf: lower case, brackets and underscores apart."""
    plain = re.sub(r"kg\s*f\b", "kgf", re.sub(r"lb\s*f\b", "lbf", name.lower()))
    return [word for word in re.split(r"[^a-z0-9]+", plain) if word]


def _named_exactly(quantity: str, source: str) -> bool:
    words = words_of(source)
    if quantity == "voltage" and len(words) > 1 and words[-1] in ("v", "mv", "volt", "volts"):
        return True
    aside = UNIT_WORDS | (THRUSTER_WORDS if quantity in THRUSTERS and quantity != "n" else set())
    bare = "_".join(word for word in words if word not in aside or len(words) == 1)
    names = {*EXACT.get(quantity, ()), *(name.lower() for name in naming.names_of(quantity))}
    return bool({bare, "_".join(words)} & names)


def _time(quantity: str, source: str, span: Span) -> Recognised:
    """The unit in which the samples are a sensible time apart; times of the calendar or the day as they are."""
    if span.stamps and span.open:
        why = f"true where the day comes first, false where the month does: {span.stamps} or month first?"
        return Recognised("time", source, "dates", open=why, more={"day_first": True}, ask="day_first")
    if span.stamps:
        return Recognised("time", source, span.stamps)
    step, evidence = span.median_step, f"{span}, {span.median_step:.4g} from sample to sample"
    slow, fast = (
        [u for u in ("s", "ms", "us") if least <= step * UNITS["time"][u] <= MAX_SAMPLE_S]
        for least in (MIN_SAMPLE_S, MIN_BENCH_S)
    )
    fits = slow or fast
    unit = _unit_in(source, {"s": "s", "sec": "s", "seconds": "s", "ms": "ms", "millis": "ms", "us": "us"})
    if unit in fast or (len(fits) == 1 and unit is None):  # a unit that the name tells wins
        return Recognised(f"time_{unit or fits[0]}", source, evidence)
    says = f"the name says {unit}, the samples say " if unit else ""
    why = f"{says}{' or '.join(fits)}?" if fits else "no unit makes these a clock; is this the time?"
    return Recognised("time_s", source, evidence, fits[0] if fits else None, why, ask="unit")


def _angle(quantity: str, source: str, span: Span) -> Recognised:
    """Degrees or radians: by the name, unless the values cannot be that; by the values only where they wrap."""
    width, largest = span.high - span.low, max(abs(span.low), abs(span.high))
    unit = _unit_in(source, {"deg": "deg", "degrees": "deg", "rad": "rad", "radians": "rad"})
    smooth = span.median_step < 0.05 * span.largest_step
    certain = None
    if smooth and 1.001 * TURN_RAD < width <= 1.001 * TURN_DEG and span.largest_step > 0.75 * TURN_DEG:
        certain = "deg"
    elif smooth and width <= 1.001 * TURN_RAD and span.largest_step > 0.75 * TURN_RAD:
        certain = "rad"
    elif width <= 1.001 * TURN_DEG and largest > MAX_UNWRAPPED_RAD:
        certain = "deg"
    evidence = f"{span}" + (f", wraps at {'360' if certain == 'deg' else '2 pi'}" if certain and smooth else "")
    likely, instead, why = unit or certain or ("rad" if largest <= 1.1 * TURN_RAD else "deg"), None, ""
    if unit is None and certain is None:
        why = f"deg or rad? The range looks like {likely}"
    elif unit and certain and unit != certain:
        instead, why = certain, f"the name says {unit}, the range says {certain}"
    elif unit == "deg" and certain is None and width < SMALL_TURN_DEG:
        instead, why = "rad", f"degrees would mean that no log turns {width:.2g} degrees; deg or rad?"
    return Recognised(_name(quantity, likely), source, evidence, instead, why, ask="unit" if why else "")


def _moment(quantity: str, source: str, span: Span) -> Recognised:
    words, metres, normalised = words_of(source), _name(quantity, "N m"), _name(quantity, naming.NORMALISED)
    if source in CANONICAL or "nm" in words or words[-2:] == ["n", "m"]:
        return Recognised(source if source in CANONICAL else metres, source, f"{span}")
    why = f'a {quantity} in newton metres (then {metres} = "{source}") or normalised (then {normalised} = "{source}")?'
    return Recognised(normalised, source, f"{span}", open=why)


def _rudder(quantity: str, source: str, span: Span) -> Recognised:
    unit = _unit_in(source, {"deg": "deg", "degrees": "deg", "rad": "rad", "radians": "rad"})
    likely = unit or ("rad" if max(abs(span.low), abs(span.high)) <= LARGEST_RUDDER_RAD else "deg")
    why = "" if unit else f"deg or rad? The range looks like {likely}"
    return Recognised(_name(quantity, likely), source, f"{span}", open=why, ask="unit" if why else "")


def _force(quantity: str, source: str, span: Span) -> Recognised:
    unit, why = _unit_in(source, FORCE_WORDS), ""
    if f"force_{unit}" in CANONICAL:
        return Recognised(f"force_{unit}", source, f"{span}")
    if unit is not None:
        return Recognised("force_N", source, f"{span}", unit)
    if words_of(source)[-1:] in (["v"], ["mv"], ["volts"]) or is_share(span):
        why = f'a load cell in volts, or a throttle? For a load cell write {{ from = "{source}", scale = NEWTONS }}'
    return Recognised("force_N", source, f"{span}", open=why or "N, kgf or lbf?", ask="" if why else "unit")


def _voltage(quantity: str, source: str, span: Span) -> Recognised:
    if span.low > 1000:
        return Recognised("voltage_V", source, f"{span}", "mV")
    sure = source in CANONICAL or (_named_exactly(quantity, source) and MIN_SUPPLY_V < span.high < 1000)
    return Recognised("voltage_V", source, f"{span}", open="" if sure else "is this the supply, in volts?")


def _speed(quantity: str, source: str, span: Span) -> Recognised:
    key, words = naming.names_of(quantity)[0], words_of(source)
    unit = next((SPEED_WORDS[end] for end in (words[-1], "_".join(words[-2:])) if end in SPEED_WORDS), None)
    sure = source == key or (unit and len(words) > 1)
    why = "" if sure else f'm/s of {quantity}? Then write "{source}"'
    return Recognised(key, source, f"{span}", None if unit == "m/s" else unit, why)


FASTEST_RAD_S = 3.0  # rad/s; few vehicles turn faster, and most exceed it in deg/s


def _rate(quantity: str, source: str, span: Span) -> Recognised:
    """Degrees or radians a second: by the name, else asked."""
    if unit := _unit_in(source, RATE_UNITS):
        return Recognised(_name(quantity, unit), source, f"{span}")
    likely, other = ("rad/s", "deg/s") if max(abs(span.low), abs(span.high)) <= FASTEST_RAD_S else ("deg/s", "rad/s")
    why = f'is this the {naming.called(quantity)} in {likely}, not in {other}? Then write "{source}"'
    return Recognised(_name(quantity, likely), source, f"{span}", open=why)


def _signal(quantity: str, source: str, span: Span) -> Recognised:
    """A control signal: as it is, pulses about a neutral, or one of which neutral or direction is open."""
    plain, low, high = _plain(quantity, source, span), span.low, span.high
    if is_pulses(source, span):
        return replace(plain, evidence=f"{plain.evidence}, pulses about 1500", unit="us", more={"subtract": PULSES[1]})
    if low >= 0 and 0 < span.middle < high and abs(span.middle - (low + high) / 2) <= 0.02 * (high - low):
        why = f"never below 0, mostly {span.middle:.4g}: which value stops the thruster, 0 or {span.middle:.4g}?"
        return replace(plain, open=why, more={"subtract": span.middle}, ask="subtract")
    if low >= 0 and naming.unit_in(source) in ("rpm", "rev/s") and quantity != "n":
        why = "never below 0: the column whose sign says which way it turns; its own name if it never reverses"
        return replace(plain, open=why, more={"sign_from": source}, ask="sign_from")
    return plain


def _plain(quantity: str, source: str, span: Span) -> Recognised:
    return Recognised(source if source in CANONICAL else naming.names_of(quantity)[0], source, f"{span}")


def _name(quantity: str, unit: str) -> str:
    return next(name for name in naming.names_of(quantity) if CANONICAL[name].unit == unit)


def _unit_in(source: str, units: Mapping[str, str]) -> str | None:
    """The unit that the name of a column tells, by the last word that is one of `units`."""
    if source in CANONICAL and CANONICAL[source].unit != naming.TIMESTAMP:
        return CANONICAL[source].unit
    words = words_of(source)
    return next((units[word] for word in reversed(words) if word in units and (len(words) > 1 or len(word) > 3)), None)


LARGEST_RUDDER_RAD = 1.6  # rad; no rudder goes further
_JUDGES = {
    **dict.fromkeys(("rudder", naming.ELEVATOR), _rudder),
    "time": _time,
    "force": _force,
    "voltage": _voltage,
    **dict.fromkeys(naming.VELOCITIES, _speed),
    **dict.fromkeys(THRUSTERS, _signal),
    **dict.fromkeys((dof.position for dof in naming.ROTATIONS), _angle),
    **dict.fromkeys((dof.velocity for dof in naming.ROTATIONS), _rate),
    **dict.fromkeys((dof.command for dof in naming.ROTATIONS), _moment),
}


MIN_FORCE_SHARE = 0.1  # share of the largest force below which a force says no direction
MIN_SIGN_SHARE = 0.97  # share of the readings that one neutral has to tell apart by the sign of their force
NEUTRAL_TOLERANCE_US = 60.0  # us about the usual neutral of pulses


def directed(
    n: Recognised, force: Recognised, signal: Floats, pull: Floats, pulses: bool
) -> tuple[Recognised, Recognised]:
    """Return both with the neutral that the signal needs, or the column that tells its sign, by the numbers of the
    tests, (N,) each; `pulses`: the signal may be some."""
    good = np.isfinite(signal) & np.isfinite(pull)
    signal, pull = signal[good], pull[good]
    if not np.any(pull):
        return n, force
    middle = (float(signal.min()) + float(signal.max())) / 2
    if signal.min() >= 0 and _both_ways(pull):
        between = _neutral(signal, pull)
        if between is None and pulses:  # one thruster of several is mirrored, which a fit of each can tell
            return _about(n, PULSES[1], PULSES[1], PULSES[1]), force
        if between is None:
            why = f"never below 0 while {force.source} goes from {pull.min():.4g} to {pull.max():.4g}: unsigned"
            return replace(n, open="", ask="", evidence=f"{n.evidence}, {why}", more={"sign_from": force.source}), force
        n = _about(n, *between, middle)
    elif signal.min() >= 0 and pulses:
        n = _about(n, PULSES[1], PULSES[1], PULSES[1])
    elif n.ask == "subtract":  # percent, 0 to 100: is there thrust in the middle?
        around = np.abs(signal - middle) <= MIN_FORCE_SHARE * np.ptp(signal) / 2
        rests = around.any() and np.abs(pull[around]).max() < MIN_FORCE_SHARE * np.abs(pull).max()
        n = _about(n, middle, middle, middle) if rests else replace(n, open="", ask="", more={})
    return n, _signed(force, n, signal - n.neutral, pull)


def _both_ways(values: Floats) -> bool:
    largest = float(np.abs(values).max(initial=0.0))
    return bool(values.min() < -MIN_FORCE_SHARE * largest and values.max() > MIN_FORCE_SHARE * largest)


def _neutral(signal: Floats, pull: Floats) -> tuple[float, float] | None:
    """Between which values of the signal the force changes its sign; None where none tells the two ways apart."""
    strong = np.abs(pull) > MIN_FORCE_SHARE * np.abs(pull).max()
    order = np.argsort(signal[strong], kind="stable")
    value, ahead = signal[strong][order], pull[strong][order] > 0
    right = np.cumsum(~ahead) + ahead.sum() - np.cumsum(ahead)  # astern up to here, ahead from here on
    share = np.maximum(right, len(value) - right)[:-1] / len(value)
    share = np.where(np.diff(value) > 0, share, 0.0)
    best = int(np.argmax(share)) if len(share) else 0
    return (float(value[best]), float(value[best + 1])) if len(share) and share[best] >= MIN_SIGN_SHARE else None


def _about(n: Recognised, low: float, high: float, middle: float) -> Recognised:
    """The signal less its neutral, which lies between two values: that of pulses, or the middle of the range."""
    usual = PULSES[1]
    about = f"about {low:.5g}" if low == high else f"the force changes sign between {low:.5g} and {high:.5g}"
    evidence = f"{n.evidence.partition(',')[0]}, {'pulses about 1500' if low == high == usual else about}"
    if PULSES[0] <= low - NEUTRAL_TOLERANCE_US <= usual <= high + NEUTRAL_TOLERANCE_US:
        return replace(n, unit="us", open="", ask="", more={"subtract": usual}, evidence=evidence)
    if low <= middle <= high:
        return replace(n, open="", ask="", more={"subtract": middle}, evidence=evidence)
    why = f"the force changes sign between {low:.4g} and {high:.4g}: at which value does the thruster stop?"
    return replace(n, open=why, more={"subtract": float(f"{(low + high) / 2:.3g}")}, ask="subtract")


def _signed(force: Recognised, n: Recognised, signal: Floats, pull: Floats) -> Recognised:
    """The force with the sign of a command that goes both ways, if it has none; asks where it goes against it."""
    if n.ask or "sign_from" in n.more or not _both_ways(signal):
        return force
    back = signal < -MIN_FORCE_SHARE * np.abs(signal).max()
    if pull.min() >= -MIN_FORCE_SHARE * pull.max() and pull[back].max(initial=0.0) > MIN_FORCE_SHARE * pull.max():
        evidence = f"{force.evidence}, one sign while {n.source} goes both ways: unsigned"
        return replace(force, evidence=evidence, more={"sign_from": _signed_by(n.source, n.neutral)})
    if np.sum(signal * np.abs(signal) * pull) < 0:
        why = f"negative while {n.source} drives ahead: -1 if ahead is logged as negative force"
        return replace(force, open=why, more={"sign": -1}, ask="sign")
    return force


def _signed_by(name: str, neutral: float) -> object:
    return {"from": name, "subtract": neutral} if neutral else name


NEEDED = ("time", YAW.position, YAW.command)
YAW_QUANTITIES = (
    *NEEDED, *YAW.thrusters, YAW.velocity, *(name for name, signal in naming.SIGNALS.items() if signal.columns),
)  # fmt: skip
BOLLARD = ("n", "force", "time", "voltage")
MAX_LOOKED_INTO = 20  # bollard tests of one layout


@dataclass(frozen=True)
class Layout:
    """Logs with the same columns: whether they are thruster tests, their motion, what each column does over all of them
    (`spans`) and is taken for, which quantities are `lacking`, and columns of few words."""

    names: tuple[str, ...]
    bollard: bool
    files: tuple[LogFile, ...]
    spans: Mapping[str, Span]
    dof: Dof
    columns: tuple[Recognised, ...] = ()
    lacking: tuple[str, ...] = ()
    words: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def is_recognised(self) -> bool:
        """Whether its columns are looked for by other names than the canonical ones."""
        return self.dof.angular

    @property
    def rules(self) -> dict[str, ColumnRule]:
        rules = naming.column_rules({column.key: column.rule for column in self.columns if not column.as_named}, "")
        return rules | {key: ColumnRule(name) for key, name in splitting(self.words, self.bollard).items()}

    def ends(self, column: Recognised) -> tuple[float, float, float] | None:
        """The lowest, the highest and the usual value of a column as its rule reads it."""
        span, rule = self.spans.get(column.source), self.rules.get(column.key, ColumnRule(column.source))
        if span is None or len(rule.sources) > 1:
            return None
        if rule.sign_from is not None:
            return -abs(rule.scale) * span.high, abs(rule.scale) * span.high, 0.0
        low, high = sorted(map(rule.read, (span.low, span.high)))
        return low, high, rule.read(span.middle)

    @property
    def unused(self) -> tuple[str, ...]:
        """Columns that no fit looks at; of another motion than yaw all are read that have a canonical name."""
        read_as = {*LABELS, *(column.source for column in self.columns), *(() if self.is_recognised else CANONICAL)}
        used, single = read_as | ColumnMap(self.rules).sources, ("n_", "rpm_", "thruster_")
        return tuple(name for name in self.names if name not in used and not name.startswith(single))

    @property
    def foreign(self) -> bool:
        """Whether nothing in it is of a vehicle."""
        of_vehicle = {YAW.position, YAW.velocity, YAW.command, *YAW.thrusters}
        quantities = naming.quantities_of(column.key for column in self.columns)
        return not self.bollard and self.dof is YAW and not quantities & of_vehicle


@dataclass(frozen=True)
class Maps:
    """Layouts that share the map of all logs, and those with maps of their own by names of files."""

    shared: tuple[Layout, ...] = ()
    apart: tuple[tuple[tuple[str, ...], tuple[Layout, ...]], ...] = ()
    user_map: ColumnMap = field(default_factory=ColumnMap)

    def columns(self) -> ColumnMap:
        parts = tuple(ColumnsOf(names, merged(layouts)) for names, layouts in self.apart)
        return replace(self.user_map, columns=merged(self.shared), columns_of=parts)


def merged(layouts: Sequence[Layout]) -> dict[str, ColumnRule]:
    return {key: rule for layout in reversed(layouts) for key, rule in layout.rules.items()}


def recognised(layout: Layout, alike: Mapping[str, Span], user_map: ColumnMap) -> Layout:
    """Return the layout with its columns taken by `user_map`, then by name and values in logs of the kind (`alike`)."""
    mapped = {}
    for key, rule in user_map.of(layout.files[0].path).columns.items():
        if key not in LABELS and rule.source in layout.names:
            mapped[CANONICAL[key].quantity] = _as_mapped(key, rule, layout.spans)
    sources = {column.source for column in mapped.values()}
    names = [name for name in layout.names if name not in sources]
    spans = {name: alike[name] for name in names if name in alike}
    swing = layout.dof.restoring  # decays need no command
    needed: tuple[str, ...] = ("time", layout.dof.position, layout.dof.command) if swing else NEEDED
    every = BOLLARD if layout.bollard else (*needed, layout.dof.velocity) if swing else YAW_QUANTITIES
    fin = naming.ELEVATOR if layout.dof in naming.FLAT_FINNED else "rudder"
    every = (*every, fin, "surge") if swing and is_called(fin, names) else every
    columns = {quantity: mapped.get(quantity) or recognise(quantity, names, spans) for quantity in every}
    columns |= mapped
    if layout.bollard:
        columns |= _tests(columns, layout, mapped)
    elif not swing and not all(columns[side] is not None for side in YAW.thrusters):
        columns |= {side: mapped.get(side) for side in YAW.thrusters}
    commanded = swing or all(columns.get(side) is not None for side in YAW.thrusters)  # in place of a moment
    commanded = commanded or columns.get("rudder") is not None
    needed = BOLLARD[:2] if layout.bollard else needed[:2] if commanded else needed
    lacking = tuple(quantity for quantity in needed if columns.get(quantity) is None)
    # a column that was recognised as two quantities is the first of them
    first = {column.source: column for column in reversed(list(columns.values())) if column is not None}
    return replace(layout, columns=tuple(first.values())[::-1], lacking=lacking)


def _as_mapped(key: str, rule: ColumnRule, spans: Mapping[str, Span]) -> Recognised:
    usual = asdict(ColumnRule(rule.source, rule.unit))
    more = {name: value for name, value in asdict(rule).items() if value != usual[name]}
    if rule.sign_from is not None:
        more["sign_from"] = _signed_by(rule.sign_from.source, rule.sign_from.subtract)
    if rule.plus:
        parts = (rule, *rule.plus)
        more |= {"from": [part.source for part in parts], "scale": [part.scale for part in parts]}
        more |= {"subtract": [part.subtract for part in parts]} if any(part.subtract for part in parts) else {}
        del more["plus"]
    span = spans.get(rule.source)
    ends = "" if span is None or span.stamps else f", {span.low:.5g} to {span.high:.5g}"
    return Recognised(key, rule.source, f"as --columns says{ends}", rule.unit, more=more)


def _tests(
    columns: Mapping[str, Recognised | None], layout: Layout, mapped: Mapping[str, Recognised]
) -> dict[str, Recognised | None]:
    """Control signal and force of bollard tests, judged together."""
    n, force = columns["n"], columns["force"]
    if n is None and force is not None:  # a throttle called thrust, beside a force with its unit
        for name, span in layout.spans.items():
            if name.lower().startswith("thrust") and name != force.source and is_share(span):
                n = n or Recognised("n", name, f"{span.low:.5g} to {span.high:.5g}, a throttle beside {force.source}")
    if n is None or force is None:
        return {"n": n, "force": force}
    if n.source == force.source:
        return {"n": None, "force": force}
    if not mapped.keys() & {"n", "force"} and (not force.open or force.ask):
        raws = [whole_log(file, ColumnMap()) for file in layout.files[:MAX_LOOKED_INTO]]
        signal, pull = (
            np.concatenate([np.asarray(raw.arrays[raw.names.index(column.source)], float) for raw in raws])
            for column in (n, force)
        )
        n, force = directed(n, force, signal, pull, is_pulses(n.source, layout.spans[n.source]))
    return {"n": n, "force": force}


def maps_of(layouts: Sequence[Layout], files: Sequence[LogFile], folder: Path, user_map: ColumnMap) -> Maps:
    """Make the maps of layouts; those that would read each other's columns wrong have maps of their own."""
    groups: list[list[Layout]] = [[]]
    for layout in layouts:
        group = next((group for group in groups if all(_fits(layout, o) and _fits(o, layout) for o in group)), None)
        if group is None:
            groups.append(group := [])
        group.append(layout)
    inner = {file: Path(os.path.relpath(file.path.resolve(), folder.resolve())).as_posix() for file in files}
    named = []
    for group in groups[1:]:
        members = [file for layout in group for file in layout.files]
        places = places_of([inner[file] for file in members], list(inner.values()))
        stray = [any(file not in members and naming.matches(file.path, place) for file in files) for place in places]
        above = f"{folder.resolve().name}/"
        named.append((tuple(above + place if far else place for place, far in zip(places, stray)), tuple(group)))
    return Maps(tuple(groups[0]), tuple(named), user_map)


def _fits(layout: Layout, other: Layout) -> bool:
    """Whether the rules of a layout read nothing of another but what that one's own rules read."""
    theirs = {column.key: column.rule for column in other.columns}
    quantities = {CANONICAL[key].quantity: key for key in theirs}
    for column in layout.columns:
        key = quantities.get(CANONICAL[column.key].quantity)
        same = key == column.key and theirs[column.key] == column.rule
        if not same and not column.as_named and (key == column.key or column.source in other.names):
            return False
    return True


def together(parts: Iterable[Mapping[str, Span]]) -> dict[str, Span]:
    union: dict[str, Span] = {}
    for part in parts:
        union |= {name: union[name] + span if name in union else span for name, span in part.items()}
    return union


def layouts_of(
    folder: Path, files: Sequence[LogFile], user_map: ColumnMap, jobs: int, progress: Progress
) -> tuple[tuple[LogFile, ...], tuple[Layout, ...], Maps, Mapping[LogFile, LogError]]:
    """Look at the columns of every log: return whole logs, kinds of these but those of no vehicle, the maps that read
    them, and why some cannot be read."""
    logs = whole_logs(files, user_map)
    layout_of = partial(_layout_of, columns=user_map)
    parts = dict(zip(logs, ordered_map(layout_of, logs, jobs, progress=progress, stage="looking at columns")))
    layouts = _recognised(parts.values(), user_map)
    if of_vehicles := {layout.names for layout in layouts if not layout.foreign}:
        # what strangers' columns do says nothing of columns of that name in logs
        layouts = _recognised((p for p in parts.values() if isinstance(p, Layout) and p.names in of_vehicles), user_map)
    maps = maps_of([layout for layout in layouts if layout.is_recognised], files, folder, user_map)
    unread = {file: error for file, error in parts.items() if isinstance(error, LogError)}
    lost = {file: error for file, error in unread.items() if isinstance(error, NoHeading)}
    topics = tuple(dict.fromkeys(name for error in lost.values() for name in error.holds))  # of all, said once
    unread |= {file: NoHeading(error.source, topics, len(lost) > 1) for file, error in lost.items()}
    return tuple(logs), tuple(layouts), maps, unread


def _layout_of(file: LogFile, columns: ColumnMap) -> Layout | LogError:
    try:
        rules = columns.of(file.path)
        raw = whole_log(file, rules)
    except LogError as error:
        return error
    mapped = {name: rule.source for name, rule in rules.columns.items() if rule.source in raw.names}
    dof = naming.motion_of(raw.names, mapped)
    if dof is YAW and not any(is_called(quantity, raw.names) for quantity in (YAW.position, YAW.command)):
        swings = [dof for dof in naming.SWING_DOFS if is_called(dof.position, raw.names)]
        dof = next(iter(swings), YAW)
    names = tuple(name for name in raw.names if name)
    labels = categorical_columns(raw, {*LABELS, *mapped.values()})
    split = naming.RUN in raw.names or naming.RUN in rules.columns or naming.BY in rules.columns
    words = {} if split else {key: label.names for key, label in labels.items()}
    bollard = means_thruster_test(naming.quantities_of([*raw.names, *mapped]), names, dof)
    return Layout(names, bollard, (file,), spans_of(raw), dof, words=words)


def _recognised(parts: Iterable[Layout | LogError], user_map: ColumnMap) -> list[Layout]:
    """Files of the same columns together, yaw first, then those with more logs, with what the columns are."""
    groups: dict[tuple[tuple[str, ...], bool, str], list[Layout]] = {}
    for part in parts:
        if isinstance(part, Layout):
            groups.setdefault((part.names, part.bollard, part.dof.name), []).append(part)
    layouts = [
        replace(group[0], files=tuple(part.files[0] for part in group), spans=together([part.spans for part in group]))
        for group in groups.values()
    ]
    layouts.sort(key=lambda layout: (layout.dof is not YAW, layout.bollard, -len(layout.files)))

    def alike(layout: Layout) -> dict[str, Span]:
        return together(o.spans for o in layouts if (o.bollard, o.dof) == (layout.bollard, layout.dof))

    return [recognised(layout, alike(layout), user_map) if layout.is_recognised else layout for layout in layouts]


def places_of(files: Sequence[str], everywhere: Sequence[str]) -> list[str]:
    """Return folders, globs and files (relative, with forward slashes) that mean exactly `files` of all logs; never
    the folder at the top, where results may be written."""
    remaining, places = set(files), []
    folders = {parent.as_posix() for name in everywhere for parent in PurePosixPath(name).parents[:-1]}
    for folder in sorted(folders, key=lambda folder: (folder.count("/"), folder)):  # outer ones first
        inside = {name for name in everywhere if name.startswith(f"{folder}/")}
        if inside <= remaining and not re.search(r"[*?[]", folder):
            places.append(folder)
            remaining -= inside
    for glob in dict.fromkeys(glob for globs in zip(*map(_globs, sorted(remaining))) for glob in globs):
        folder = glob.rpartition("/")[0]
        meant = {name for name in everywhere if name.rpartition("/")[0] == folder and fnmatchcase(name, glob)}
        if len(meant & remaining) > 1 and meant <= set(files):
            places.append(glob)
            remaining -= meant
    return sorted([*places, *remaining])


def _globs(name: str) -> tuple[str, str]:
    """The logs of a folder that end like this one, and those whose names begin with the same word."""
    folder, slash, last = name.rpartition("/")
    stem = stem_of(last)
    word = "".join(re.findall(r"^(?:[A-Za-z]+[_-]?|\d+)", stem))
    return f"{folder}{slash}*{last.removeprefix(stem)}", f"{folder}{slash}{word}*" if word else name
