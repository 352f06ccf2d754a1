"""What a vehicle's software asked of the vehicle as a whole, worked back from what it sent to each motor.

A frame mixes wishes (moment and forces, -1 to 1) into motors by published factors. The wishes are found again by least
squares: as they were, unless a motor was at its end; then they are what the motors were sent. Whose factors these
are is said by `ardupilot` and `ulog`, each by the parameters in the log.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from automarine_cli.dofs import HEAVE, SURGE, SWAY, YAW
from automarine_cli.logs.canonical import CANONICAL, COMMANDS, NORMALISED, names_of
from automarine_cli.logs.columns import ColumnMap
from automarine_cli.logs.formats import LOGGED, Origin
from automarine_cli.pipeline.words import listed
from automarine_cli.quantities import Floats

WISHES = tuple(
    next(name for name in names_of(dof.command) if CANONICAL[name].unit == NORMALISED)
    for dof in (YAW, SURGE, SWAY, HEAVE)
)
"""The columns that are made, -1 to 1: moment clockwise from above, forces ahead, to starboard and down (SNAME)."""
SIGNS = {"tau": "clockwise from above", "X": "ahead", "Y": "to starboard", "Z": "down"}
ROUNDING = 1e-6  # by which a wish may be found wrong that the motors tell: PX4's parameters have 32 bits
ELSE = "name the commands in a column map (tau, or n_port and n_stbd) and give it with --columns FILE.toml"
FETCH = f"record again after the ground station has fetched them, read the vehicle's own log (.bin, .ulg), or {ELSE}"


@dataclass(frozen=True)
class Told:
    """One parameter: when it was told [s, on the clock of the outputs], and the values, each of shape (N,)."""

    time: Floats
    values: Floats

    def at(self, time: float) -> float:
        """Its value then; before it was first told, what it was told as first."""
        return float(self.values[max(int(np.searchsorted(self.time, time, side="right")) - 1, 0)])


Parameters = Mapping[str, Told]
Values = Mapping[str, float]  # parameters by name, at one time
Channels = Mapping[int, Floats]  # outputs by their number


def parameters(names: NDArray[np.str_], time: Floats, values: Floats) -> Parameters:
    """Parameters by name, from messages that each tell one: names, times [s] and values, shape (N,)."""
    order = np.lexsort((time, names))
    known, first = np.unique(names[order], return_index=True)
    parts = zip(np.split(time[order], first[1:]), np.split(values[order], first[1:]))
    return {str(name): Told(*part) for name, part in zip(known, parts)}


@dataclass(frozen=True)
class Asked:
    """What was asked of the vehicle: columns of `WISHES`, each of shape (N,), -1 to 1; what to know of them, and
    where they come from.
    """

    columns: Mapping[str, Floats] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    origin: Origin = LOGGED


class Unclear(Exception):
    """Why the outputs do not tell what was asked: a sentence that goes on from `no yaw moment;`."""


@dataclass(frozen=True)
class Part:
    """How outputs are read while the parameters stay as they are: one entry a channel that drives the vehicle.

    Outputs between `low`, `neutral` and `high` count from -1 to 1, 0 is no output. `back` leads from there to
    `WISHES`, shape (wishes, channels), and `found` says which of these the channels tell at all; `how` is for people.
    """

    how: str
    channels: tuple[int, ...]
    low: Floats
    neutral: Floats
    high: Floats
    back: Floats
    found: NDArray[np.bool_]

    def wishes(self, outputs: Floats) -> Floats:
        """`WISHES`, shape (wishes, N), of outputs, shape (channels, N); NaN where the channels do not tell them."""
        off = outputs - self.neutral[:, None]
        span = np.where(off > 0, (self.high - self.neutral)[:, None], (self.neutral - self.low)[:, None])
        shares = np.where(outputs != 0, np.clip(off / span, -1, 1), 0.0)
        return np.where(self.found[:, None], self.back @ shares, np.nan)


def is_commanded_by(columns: ColumnMap) -> bool:
    """Whether a column map names a command itself, so that none is worked back from outputs."""
    driven = {CANONICAL[name].quantity for name in WISHES} | {*COMMANDS} - {"n"}
    return any(name in CANONICAL and CANONICAL[name].quantity in driven for name in columns.columns)


def worked_back(
    source: str, time: Floats, channels: Channels, known: Parameters, read_by: Callable[[str, Channels, Values], Part]
) -> Asked:
    """What was asked of the vehicle, from outputs by number, shape (N,) each, at `time` [s].

    `source` is what the file calls the outputs; `read_by` makes of it, of the outputs and of parameters by name how
    they are read, or raises Unclear. Where parameters change, each stretch is read by what stood then.
    """
    changes = [
        (float(at), f"{name} from {before:g} to {after:g}")
        for name, told in known.items()
        for at, (before, after) in zip(told.time[1:], pairwise(told.values))
        if before != after and time[0] < at <= time[-1]
    ]
    edges = [time[0], *sorted({at for at, _ in changes}), np.inf]
    wishes = np.full((len(WISHES), len(time)), np.nan)
    hows: dict[str, None] = {}
    why = ""
    for first, after in pairwise(edges):
        rows = (time >= first) & (time < after)
        try:
            part = read_by(source, channels, {name: told.at(first) for name, told in known.items()})
        except Unclear as unclear:
            why = why or str(unclear)
            continue
        hows[part.how] = None
        wishes[:, rows] = part.wishes(np.array([channels[number][rows] for number in part.channels]))
    made = {name: values for name, values in zip(WISHES, wishes) if np.isfinite(values).any()}
    if not made:
        return Asked(origin=Origin(why_not=why))
    origin = f"{source} by {' and '.join(hows)}"
    notes = [f"commands {meaning(made)} worked back from {origin}"]
    if changes:
        told = listed(f"{what} at {at - time[0]:.1f} s" for at, what in sorted(changes))
        notes.append(f"parameters changed within the log ({told}): each stretch is read by what stood then")
    if why:
        notes.append(f"for a part of the log there are no commands: {why}")
    return Asked(made, tuple(notes), Origin(origin))


def meaning(names: Sequence[str] | Mapping[str, Floats]) -> str:
    """`tau (clockwise from above), X (ahead), from -1 to 1`."""
    return f"{', '.join(f'{name} ({SIGNS[name]})' for name in names)}, from -1 to 1,"


def refuse_lacking(source: str, lacking: Sequence[str]) -> None:
    """Raise Unclear where parameters are lacking."""
    if lacking:
        raise Unclear(
            f"{source} would tell it, but the log does not hold the parameter{'s' * (len(lacking) > 1)} "
            f"{listed(lacking)}; {FETCH}"
        )
