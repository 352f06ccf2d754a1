"""The columns that automarine knows: canonical name -> quantity, unit and factor to SI units."""

import difflib
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from itertools import islice

from automarine_cli.dofs import DOFS, YAW, Dof
from automarine_cli.dofs.motion import Motion

DEGREE = math.pi / 180
STANDARD_GRAVITY = 9.80665  # m/s², exact by definition: 1 kgf in newtons
POUND_FORCE = 4.4482216152605  # N, exact by definition

NORMALISED = "nu"  # the unit of a normalised moment or force
TIMESTAMP = "timestamp"  # the unit of a column of calendar times

FORCES = {"N": 1.0, "kgf": STANDARD_GRAVITY, "gf": STANDARD_GRAVITY / 1000, "lbf": POUND_FORCE}
TORQUES = {"N m": 1.0, "Nm": 1.0}
BEARINGS, ANGLES, ANGULAR_RATES = ({"deg": DEGREE}, {"deg": DEGREE, "rad": 1.0}, {"deg/s": DEGREE, "rad/s": 1.0})
LENGTHS, SPEEDS = ({"m": 1.0, "cm": 0.01, "mm": 1e-3, "ft": 0.3048}, {"m/s": 1.0, "cm/s": 0.01, "kn": 1852 / 3600})
VELOCITIES = ("surge", "sway", "heave")  # of the vehicle's body, which tests of every motion may log
PLACES = ("north", "east", "lat", "lon")  # on the water, which logs of motion in the plane may hold
ROTATIONS = tuple(dof for dof in DOFS.values() if dof.wraps)
TRANSLATIONS = tuple(dof for dof in DOFS.values() if not dof.wraps)
UNITS: Mapping[str, Mapping[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, TIMESTAMP: 1.0},
    "voltage": {"V": 1.0, "mV": 1e-3},
    "force": FORCES,
    **dict.fromkeys(VELOCITIES, SPEEDS),
    **dict.fromkeys(PLACES[:2], LENGTHS),
    **dict.fromkeys(PLACES[2:], BEARINGS),
    **{
        quantity: units
        for dof in DOFS.values()
        for quantity, units in zip(
            (dof.position, dof.velocity, dof.command),
            (ANGLES, ANGULAR_RATES, TORQUES) if dof.wraps else (LENGTHS, SPEEDS, FORCES),
        )
    },
}
MOST_LOOKED_AT, LONGEST_GUESSED = 1000, 60  # columns, and characters of a name, in which one may be guessed
COMMANDS = ("n", *dict.fromkeys(name for dof in DOFS.values() for name in dof.thrusters))
"""Control signals keep the file's own unit, whatever it is called."""

SIGNALS = {
    "us": ("us", "usec", "microseconds", "pwm", "pulse"),
    "rpm": ("rpm",),
    "rev/s": ("rps", "rev_s", "hz"),
    "%": ("percent", "pct", "perc", "%"),
}
"""Units of control signals, and the words in names of columns that tell them."""


def unit_in(name: str) -> str:
    """The unit of a control signal that the name of its column tells, "" for none."""
    plain = f"_{re.sub(r'[^a-z0-9%]+', '_', name.lower())}_".replace("%", "_%_")
    return next((unit for unit, words in SIGNALS.items() if any(f"_{word}_" in plain for word in words)), "")


@dataclass(frozen=True)
class Canonical:
    """What a canonical column name stands for: a quantity in a unit."""

    name: str
    quantity: str
    unit: str

    def factor(self, unit: str | None = None) -> float:
        """What a value is multiplied by to be in SI units (a control signal: 1)."""
        unitless = self.quantity in COMMANDS or self.unit == NORMALISED
        return 1.0 if unitless else UNITS[self.quantity][self.unit if unit is None else unit]

    def units(self) -> tuple[str, ...]:
        """Units that a column map may give to this column; empty: any word."""
        if self.unit == NORMALISED:  # normalised moments and forces have no factor to newtons
            return (NORMALISED,)
        return tuple(UNITS.get(self.quantity, ()))


def _own(dofs: Iterable[Dof], *quantities: str) -> Iterator[tuple[str, str, str]]:
    """The columns of these quantities ("position", ...) and the thrusters of motions: names, what they hold, units."""
    for which in quantities:
        for dof in dofs:
            quantity = getattr(dof, which)
            yield from ((name, quantity, unit) for name, unit in dof.columns[quantity])
    yield from ((name, name, "") for dof in dofs for name in dof.thrusters)


_ALL = (
    ("time_s", "time", "s"),
    ("time_ms", "time", "ms"),
    ("time_us", "time", "us"),
    ("time", "time", TIMESTAMP),
    *_own(ROTATIONS, "position", "velocity", "command"),
    ("voltage_V", "voltage", "V"),
    *((f"{name}_m_s", name, "m/s") for name in VELOCITIES),
    *_own(TRANSLATIONS, "velocity", "position", "command"),
    ("north_m", "north", "m"),
    ("east_m", "east", "m"),
    ("lat_deg", "lat", "deg"),
    ("lon_deg", "lon", "deg"),
    ("n", "n", ""),
    ("force_N", "force", "N"),
    ("force_kgf", "force", "kgf"),
    ("force_lbf", "force", "lbf"),
)
CANONICAL: Mapping[str, Canonical] = {name: Canonical(name, *rest) for name, *rest in _ALL}
RUN, MODE, ARMED, BY = "run", "mode", "armed", "by"
LABELS = (RUN, MODE, ARMED, BY)  # columns of words, not of numbers


def foreign(dof: Dof, motion: Motion | None = None) -> frozenset[str]:
    """Quantities of other motions than `dof`, or of other than a `motion` of several, under names of which a log may
    hold something else."""
    own = {dof.position, dof.velocity, dof.command, *dof.thrusters}
    if motion is not None:
        own |= {name for one in motion.dofs for name in (one.velocity, one.command)} | set(PLACES)
    others = {name for one in DOFS.values() for name in (one.position, one.command, *one.thrusters)}
    aside = {one.velocity for one in DOFS.values() if not one.horizontal}
    return frozenset((others | aside | set(PLACES)) - own)


def motions_in(held: Set[str]) -> list[Dof]:
    """The motions of which a log that holds these quantities is whole: position, and command or every thruster. Of
    those that share a position the ones with a command of their own come first."""
    whole = [dof for dof in DOFS.values() if dof.position in held and (dof.command in held or driven(dof, held))]
    places = {dof.position: i for i, dof in reversed(list(enumerate(whole)))}
    return sorted(whole, key=lambda dof: (places[dof.position], dof.command not in held))


def driven(dof: Dof, held: Set[str]) -> bool:
    """Whether every thruster command of a motion is among the quantities held."""
    return bool(dof.thrusters) and held >= set(dof.thrusters)


def motion_of(names: Iterable[str], mapped: Iterable[str]) -> Dof:
    """The motion that a log is of, by its column names and the canonical names mapped to; yaw where it may be that."""
    held = {CANONICAL[name].quantity for name in (*names, *mapped) if name in CANONICAL}
    begun = (dof for dof in DOFS.values() if {dof.position, dof.command} & held)
    return next(iter(motions_in(held)), None) or next(begun, YAW)


# Words by which people call a quantity; only for suggestions, nothing is ever read by them.
_WORDS: Mapping[str, Sequence[str]] = {
    "time": ("t", "time", "timestamp", "seconds", "secs", "clock", "stamp", "times", "millis", "times_s"),
    "n": ("n", "cmd", "command", "n_rev_s", "effort", "control", "throttle", "thruster_input", "pwm", "rpm"),
    "force": ("force", "thrust", "load", "newtons", "force_n", "thrust_n", "pull", "mean_force", "total_force"),
    "voltage": ("voltage", "volts", "battery", "vbat", "bat", "nominal_voltage_v"),
    **{
        quantity: [word for other in DOFS.values() for word in other.nicknames.get(quantity, ())]
        for dof in DOFS.values()
        for quantity in dof.nicknames
    },
}


_CALLED = {
    "n": "control signal",
    **{dof.command: dof.words.full_force for dof in DOFS.values()},
    **{name: f"{mount} thruster command" for dof in DOFS.values() for name, mount in zip(dof.thrusters, dof.mounts)},
}


def called(quantity: str) -> str:
    """Return a quantity in words."""
    return _CALLED.get(quantity, quantity.replace("_", " "))


def names_of(quantity: str) -> tuple[str, ...]:
    return tuple(name for name, canonical in CANONICAL.items() if canonical.quantity == quantity)


RATES = ("rate", "speed", "velocity", "vel", "gyro", "radps", "dps", "radsec", "degps")
"""Words in names of columns that are how fast something changes, and so no position."""


def likely_column(quantity: str, names: Iterable[str]) -> str | None:
    """The column that may be meant by a quantity, for a suggestion; None where nothing comes near. Of several that come
    as near it is the one of which the word is the usual one."""
    words = (*_WORDS.get(quantity, ()), *(name.lower() for name in names_of(quantity)))
    position = any(quantity == dof.position for dof in DOFS.values())
    best, score = None, 0.75
    for name in islice(names, MOST_LOOKED_AT):
        if len(name) > LONGEST_GUESSED:
            continue
        plain = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")
        if position and set(plain.split("_")) & set(RATES):
            continue
        alike = [difflib.SequenceMatcher(None, plain, word).ratio() for word in words]
        likeness = max(alike) - 1e-6 * alike.index(max(alike))
        if any(len(word) > 2 and plain.startswith(word + "_") for word in words):
            likeness = max(likeness, 0.9)
        if plain and likeness > score:
            best, score = name, likeness
    return best


def likely_canonical(quantity: str, column: str) -> str:
    """The canonical name to propose for a column of the file, with the unit that its name shows."""
    choices, words = names_of(quantity), ("rad", "deg", "kgf", "lbf", "ms", "milli", "us", "Nm")
    endings = ("_ms" if word == "milli" else f"_{word}" for word in words if word.lower() in column.lower())
    return next((name for end in endings for name in choices if name.endswith((end, f"{end}_s"))), choices[0])
