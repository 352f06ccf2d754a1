"""The columns that automarine knows: canonical name -> quantity, unit and factor to SI units."""

import difflib
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import islice

from automarine_cli.dofs import DOFS, YAW, Dof

DEGREE = math.pi / 180
STANDARD_GRAVITY = 9.80665  # m/s², exact by definition: 1 kgf in newtons
POUND_FORCE = 4.4482216152605  # N, exact by definition

NORMALISED = "nu"  # the unit of a normalised moment or force
TIMESTAMP = "timestamp"  # the unit of a column of calendar times

FORCES = {"N": 1.0, "kgf": STANDARD_GRAVITY, "gf": STANDARD_GRAVITY / 1000, "lbf": POUND_FORCE}
UNITS: Mapping[str, Mapping[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, TIMESTAMP: 1.0},
    "heading": {"deg": DEGREE, "rad": 1.0},
    "yaw_rate": {"deg/s": DEGREE, "rad/s": 1.0},
    "moment": {"nu": 1.0, "N m": 1.0, "Nm": 1.0},
    "voltage": {"V": 1.0, "mV": 1e-3},
    **{name: {"m/s": 1.0, "cm/s": 0.01, "kn": 1852 / 3600} for name in ("surge", "sway", "heave")},
    **{name: {"m": 1.0, "cm": 0.01, "mm": 1e-3, "ft": 0.3048} for name in ("distance", "depth")},
    **dict.fromkeys(("force", "force_X", "force_Z"), FORCES),
}
MOST_LOOKED_AT, LONGEST_GUESSED = 1000, 60  # columns, and characters of a name, in which one may be guessed
COMMANDS = (
    "n",
    "n_port",
    "n_stbd",
    "n_vert",
)  # a control signal keeps the file's own unit, whatever it is called


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
        if self.quantity == "moment":
            return ("N m", "Nm")
        return tuple(UNITS.get(self.quantity, ()))


_ALL = (
    ("time_s", "time", "s"),
    ("time_ms", "time", "ms"),
    ("time_us", "time", "us"),
    ("time", "time", TIMESTAMP),
    ("heading_deg", "heading", "deg"),
    ("heading_rad", "heading", "rad"),
    ("yaw_rate_deg_s", "yaw_rate", "deg/s"),
    ("yaw_rate_rad_s", "yaw_rate", "rad/s"),
    ("tau", "moment", NORMALISED),
    ("tau_Nm", "moment", "N m"),
    ("n_port", "n_port", ""),
    ("n_stbd", "n_stbd", ""),
    ("voltage_V", "voltage", "V"),
    ("surge_m_s", "surge", "m/s"),
    ("sway_m_s", "sway", "m/s"),
    ("heave_m_s", "heave", "m/s"),
    ("distance_m", "distance", "m"),
    ("depth_m", "depth", "m"),
    ("force_X_N", "force_X", "N"),
    ("X", "force_X", NORMALISED),
    ("force_Z_N", "force_Z", "N"),
    ("Z", "force_Z", NORMALISED),
    ("n_vert", "n_vert", ""),
    ("n", "n", ""),
    ("force_N", "force", "N"),
    ("force_kgf", "force", "kgf"),
    ("force_lbf", "force", "lbf"),
)
CANONICAL: Mapping[str, Canonical] = {name: Canonical(name, *rest) for name, *rest in _ALL}
RUN, MODE, ARMED = "run", "mode", "armed"
LABELS = (RUN, MODE, ARMED)  # columns of words, not of numbers


def foreign(dof: Dof) -> frozenset[str]:
    """Quantities of the other motions, which a log of this one may hold under names that mean something else there."""
    own = {dof.position, dof.command, *dof.thrusters}
    others = {name for one in DOFS.values() for name in (one.position, one.command, *one.thrusters)}
    return frozenset(others - own) | {"heave"} - {dof.velocity}


def motion_of(names: Iterable[str], mapped: Iterable[str]) -> Dof:
    """The motion that a log is of, by its column names and the canonical names mapped to; yaw where it may be that."""
    held = {CANONICAL[name].quantity for name in (*names, *mapped) if name in CANONICAL}
    for dof in DOFS.values():
        if dof.position in held and (dof.command in held or held >= set(dof.thrusters)):
            return dof
    return next((dof for dof in DOFS.values() if {dof.position, dof.command} & held), YAW)


# Words by which people call a quantity; only for suggestions, nothing is ever read by them.
_WORDS = {
    "time": ("t", "time", "timestamp", "seconds", "secs", "clock", "stamp", "times", "millis", "times_s"),
    "heading": ("heading", "yaw", "psi", "hdg", "compass", "head", "azimuth", "course", "yaw_deg", "yaw_rad"),
    "moment": ("tau", "moment", "torque", "nm", "rudder", "rudder_deg", "yaw_moment", "tau_nm", "mz"),
    "distance": ("distance", "dist", "x", "position", "range", "travel", "surge_position", "pos_x"),
    "depth": ("depth", "z", "pressure_depth", "depth_sensor", "pos_z"),
    "force_X": ("force_x", "surge_force", "thrust_x", "fx", "tau_x", "x_force"),
    "force_Z": ("force_z", "heave_force", "thrust_z", "fz", "tau_z", "z_force"),
    "n_vert": ("n_vert", "vertical", "vert", "vert_cmd", "cmd_vert", "n_vertical"),
    "n": ("n", "cmd", "command", "rpm", "pwm", "n_rev_s", "effort", "control", "throttle", "thruster_input"),
    "n_port": ("n_port", "port", "port_cmd", "left", "n_left", "cmd_port"),
    "n_stbd": ("n_stbd", "stbd", "starboard", "stbd_cmd", "right", "n_right", "cmd_stbd"),
    "force": ("force", "thrust", "load", "newtons", "force_n", "thrust_n", "pull"),
    "voltage": ("voltage", "volts", "battery", "vbat", "bat", "nominal_voltage_v"),
}


def names_of(quantity: str) -> tuple[str, ...]:
    """Canonical column names of one quantity."""
    return tuple(name for name, canonical in CANONICAL.items() if canonical.quantity == quantity)


def likely_column(quantity: str, names: Iterable[str]) -> str | None:
    """The column that may be meant by a quantity, for a suggestion; None where nothing comes near."""
    words = (*_WORDS.get(quantity, ()), *(name.lower() for name in names_of(quantity)))
    best, score = None, 0.75
    for name in islice(names, MOST_LOOKED_AT):
        if len(name) > LONGEST_GUESSED:
            continue
        plain = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")
        likeness = max(difflib.SequenceMatcher(None, plain, word).ratio() for word in words)
        if any(len(word) > 2 and plain.startswith(word + "_") for word in words):
            likeness = max(likeness, 0.9)
        if plain and likeness > score:
            best, score = name, likeness
    return best


def likely_canonical(quantity: str, column: str) -> str:
    """The canonical name to propose for a column of the file, with the unit that its name shows."""
    plain = column.lower()
    choices = names_of(quantity)
    for word, ending in (
        ("rad", "_rad"),
        ("deg", "_deg"),
        ("kgf", "_kgf"),
        ("lbf", "_lbf"),
        ("ms", "_ms"),
        ("milli", "_ms"),
        ("us", "_us"),
        ("nm", "_Nm"),
    ):
        if word in plain:
            for choice in choices:
                if choice.endswith(ending):
                    return choice
    return choices[0]
