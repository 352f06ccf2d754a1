"""What a vehicle's software asked of the vehicle as a whole, worked back from what it sent to each motor.

A frame mixes wishes (moment and forces, -1 to 1) into motors by published factors, whose pseudo-inverse finds the
wishes again: as they were, unless a motor was at its end. Parameters in the log say whose factors; PX4's are in `ulog`.

ArduSub sends motor i the pulse 1500 us + 400 us x direction_i x (factors_i . wishes), clipped to ±400 us:
`FRAME_CONFIG` gives the factors, `MOT_i_DIRECTION` the direction, `SERVOn_FUNCTION` the outputs of motors. A boat or
rover with skid steering sends throttle ± steering to its two sides.

Sources: ArduPilot, libraries AP_Motors/AP_Motors6DOF.cpp and .h (`sub_frame_t`); SRV_Channel/SRV_Channel.h
(`Aux_servo_function_t`) and .cpp (`pwm_from_angle`); AR_Motors/AP_MotorsUGV.cpp (`output_skid_steering`)."""

import re
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from automarine_cli.dofs import HEAVE, SURGE, SWAY, YAW
from automarine_cli.logs.columns import NORMALISED, THRUSTERS, ColumnMap, quantities_of
from automarine_cli.logs.formats import LOGGED, CommandOrigin
from automarine_cli.logs.streams import Recording, Stream, taken
from automarine_cli.quantities import Floats
from automarine_cli.text import listed

# what is made, -1 to 1: moment clockwise from above, forces ahead, to starboard and down (SNAME)
CONTROL_AXES = tuple(dof.column(dof.command, NORMALISED) for dof in (YAW, SURGE, SWAY, HEAVE))
SIGNS = {"tau": "clockwise from above", "X": "ahead", "Y": "to starboard", "Z": "down"}
WISH_ERROR = 1e-6  # by which a wish may be found wrong that the motors tell: PX4's parameters have 32 bits
ELSE = "name the commands in a column map (tau, or n_port and n_stbd) and give it with --columns FILE.toml"
FETCH = f"record again after the ground station has fetched them, read the vehicle's own log (.bin, .ulg), or {ELSE}"


Parameters = Sequence[tuple[float, str, float]]  # when told [s, on the clock of the outputs], name, value; by time
Values = Mapping[str, float]  # parameters by name, at one time
Channels = Mapping[int, Floats]  # outputs by their number


def parameters(names: NDArray[np.str_], time: Floats, values: Floats) -> Parameters:
    """Parameters from messages that each tell one: names, times [s] and values, shape (N,)."""
    return sorted(zip(time.tolist(), names.tolist(), values.tolist()), key=itemgetter(0))


def _stretches(history: Parameters, begin: float, end: float) -> tuple[dict[float, Values], list[str]]:
    """Parameters from `begin` [s] and from each change on, and what changed; the first value also stands before it."""
    values = {name: value for _, name, value in reversed(history)}
    values |= {name: value for at, name, value in history if at <= begin}
    stretches: dict[float, Values] = {begin: values}
    changes = []
    for at, name, value in history:
        if begin < at <= end and values[name] != value:
            changes.append(f"{name} from {values[name]:g} to {value:g} at {at - begin:.1f} s")
            stretches[at] = values = values | {name: value}
    return stretches, changes


@dataclass(frozen=True)
class Demand:
    """What was asked of the vehicle: columns of `CONTROL_AXES`, (N,) each, -1 to 1; notes, and where they are from."""

    columns: Mapping[str, Floats] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    origin: CommandOrigin = LOGGED


class Unclear(Exception):
    """Why the outputs do not tell what was asked: a sentence that goes on from `no yaw moment;`."""


@dataclass(frozen=True)
class Part:
    """How outputs are read, one entry a channel that drives the vehicle, while the parameters stay.

    Outputs between `low`, `neutral` and `high` count from -1 to 1, 0 is none. `back` leads from there to the
    CONTROL_AXES, (wishes, channels), `observable` says which of these the channels tell; `how` is for people."""

    how: str
    channels: tuple[int, ...]
    low: Floats
    neutral: Floats
    high: Floats
    back: Floats
    observable: NDArray[np.bool_]

    def wishes(self, outputs: Floats) -> Floats:
        """CONTROL_AXES, shape (wishes, N), of outputs, shape (channels, N); NaN where the channels do not tell them."""
        off = outputs - self.neutral[:, None]
        span = np.where(off > 0, (self.high - self.neutral)[:, None], (self.neutral - self.low)[:, None])
        shares = np.where(outputs != 0, np.clip(off / span, -1, 1), 0.0)
        return np.where(self.observable[:, None], self.back @ shares, np.nan)


def is_commanded_by(columns: ColumnMap) -> bool:
    """Whether a column map names a command itself, so that none is worked back from outputs."""
    return not quantities_of(columns.columns).isdisjoint(quantities_of(CONTROL_AXES) | {*THRUSTERS} - {"n"})


def worked_back(
    source: str, time: Floats, channels: Channels, history: Parameters, read_by: Callable[[str, Channels, Values], Part]
) -> Demand:
    """Work back what was asked of the vehicle, from outputs (N,) by number at `time` [s] of the message `source`;
    `read_by` says how the outputs of each stretch are read, or raises Unclear."""
    stretches, changes = _stretches(history, float(time[0]), float(time[-1]))
    wishes = np.full((len(CONTROL_AXES), len(time)), np.nan)
    hows, why = [], ""
    for (first, values), after in zip(stretches.items(), [*list(stretches)[1:], np.inf]):
        rows = (time >= first) & (time < after)
        try:
            part = read_by(source, channels, values)
        except Unclear as unclear:
            why = why or str(unclear)
            continue
        hows.append(part.how)
        wishes[:, rows] = part.wishes(np.array([channels[number][rows] for number in part.channels]))
    columns = {name: values for name, values in zip(CONTROL_AXES, wishes) if np.isfinite(values).any()}
    if not columns:
        return Demand(origin=CommandOrigin(why_not=why))
    origin = f"{source} by {' and '.join(dict.fromkeys(hows))}"
    notes = [f"commands {meaning(columns)} worked back from {origin}"]
    if changes:
        notes.append(f"parameters changed within the log ({listed(changes)}): each stretch is read by what stood then")
    if why:
        notes.append(f"for a part of the log there are no commands: {why}")
    return Demand(columns, tuple(notes), CommandOrigin(origin))


def meaning(names: Sequence[str] | Mapping[str, Floats]) -> str:
    return f"{', '.join(f'{name} ({SIGNS[name]})' for name in names)}, from -1 to 1,"


def refuse_lacking(source: str, lacking: Sequence[str]) -> None:
    if lacking:
        raise Unclear(
            f"{source} would tell it, but the log does not hold the parameter{'s' if len(lacking) > 1 else ''} "
            f"{listed(lacking)}; {FETCH}"
        )


FACTOR_PLACES = [2, 4, 5, 3]  # places of CONTROL_AXES in a row of factors: roll, pitch, yaw, up, ahead, abeam
Row = tuple[float, float, float, float, float, float]

_FOUR: tuple[Row, ...] = ((0, 0, 1, 0, -1, 1), (0, 0, -1, 0, -1, -1), (0, 0, -1, 0, 1, 1), (0, 0, 1, 0, 1, -1))
_TWO: tuple[Row, ...] = ((0, 0, -1, 0, 1, 0), (0, 0, 1, 0, 1, 0))
_SIMPLE: tuple[Row, ...] = (*_TWO, (1, 0, 0, -1, 0, 0), (-1, 0, 0, -1, 0, 0), (0, 0, 0, 0, 0, 1))
FRAME_MIXING: Mapping[int, tuple[str, tuple[Row, ...]]] = {
    0: ("BlueROV1", (*_TWO, (-0.5, 0.5, 0, 0.45, 0, 0), (0.5, 0.5, 0, 0.45, 0, 0), (0, -1, 0, 1, 0, 0),
                     (-0.25, 0, 0, 0, 0, 1))),
    1: ("vectored", (*_FOUR, (1, 0, 0, -1, 0, 0), (-1, 0, 0, -1, 0, 0))),
    2: ("vectored 6 DOF", (*_FOUR, (1, -1, 0, -1, 0, 0), (-1, -1, 0, -1, 0, 0), (1, 1, 0, -1, 0, 0),
                           (-1, 1, 0, -1, 0, 0))),
    3: ("vectored 6 DOF 90 degrees", ((1, 1, 0, 1, 0, 0), (0, 0, 1, 0, 1, 0), (1, -1, 0, 1, 0, 0), (0, 0, 0, 0, 0, 1),
                                      (0, 0, 0, 0, 0, 1), (-1, 1, 0, 1, 0, 0), (0, 0, -1, 0, 1, 0),
                                      (-1, -1, 0, 1, 0, 0))),
    4: ("SimpleROV 3", (*_TWO, (0, 0, 0, -1, 0, 0))),
    5: ("SimpleROV 4", _SIMPLE[:4]),
    6: ("SimpleROV 5", _SIMPLE),
}  # fmt: skip
"""ArduSub's frames by `FRAME_CONFIG`: one row of factors a motor."""
MOTOR_IDS = (*range(33, 41), *range(82, 86))  # SERVOn_FUNCTION of motors 1 to 12
STEERED_ROWS: Mapping[str, Mapping[int, Row]] = {
    "skid steering (SERVOn_FUNCTION 73 and 74)": {73: (0, 0, 1, 0, 1, 0), 74: (0, 0, -1, 0, 1, 0)},
    "steering and throttle (SERVOn_FUNCTION 26 and 70)": {26: (0, 0, 1, 0, 0, 0), 70: (0, 0, 0, 0, 1, 0)},
}
"""Boats and rovers, the first that is whole: left and right throttle; steering and throttle."""
DRIVING = {*MOTOR_IDS, *(function for rows in STEERED_ROWS.values() for function in rows)}
OUTPUTS = 32  # the highest number of an output
MIXING = re.compile(r"FRAME_CONFIG|(SERVO|MOT_).*_(FUNCTION|MIN|MAX|TRIM|REVERSED|DIRECTION)")  # parameters of it
NEUTRAL_US, SPAN_US = 1500.0, 400.0  # us, of ArduSub's motors whatever the limits of their outputs


def recorded(
    messages: Mapping[str, Mapping[str, NDArray[Any]]], clock_of: Callable[[Mapping[str, NDArray[Any]]], Floats | None],
    stamps: Container[str], names: Mapping[str, Mapping[str, str]], outputs: str, history: Parameters,
    columns: ColumnMap, states: Sequence[Stream], holds: Sequence[str], notes: tuple[str, ...],
) -> Recording:  # fmt: skip
    """Make streams of ArduPilot's messages by name and field, (N,): the fields but `stamps` that `names` or the column
    map take, states, and the pulses of the message `outputs` with what was asked of the vehicle by them."""
    streams, demand = [], Demand()
    for name, message in messages.items():
        time = clock_of(message)
        if time is None:
            continue
        fields = {key: values for key, values in message.items() if key not in stamps}
        if name == outputs:  # channels that nothing is connected to are always at 0
            fields = {key: values for key, values in fields.items() if re.search(r"\d", key) and values.any()}
        stream = taken(name, time, fields, names.get(name, {}), columns, keep=name == outputs)
        if name == outputs and fields and not is_commanded_by(columns):
            pulses = {int("".join(filter(str.isdigit, key))): values for key, values in fields.items()}
            demand = worked_back(name, time, pulses, [row for row in history if MIXING.fullmatch(row[1])], part_of)
            stream = replace(stream, columns={**stream.columns, **demand.columns})
        streams.append(stream)
    return Recording([*streams, *states], tuple(holds), (*demand.notes, *notes), demand.origin)


def least_squares(factors: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the pseudo-inverse of factors (motors, 6) to `CONTROL_AXES`, (4, motors), and which it can tell."""
    inverse = np.linalg.pinv(factors)
    unclear = np.abs(inverse @ factors - np.eye(6))[FACTOR_PLACES].max(axis=1)
    down = np.array([[1.0], [1.0], [1.0], [-1.0]])  # ArduPilot counts up, SNAME down
    return inverse[FACTOR_PLACES] * down, unclear < WISH_ERROR


def part_of(source: str, channels: Channels, values: Values) -> Part:
    """How the outputs are read by these parameters. Raises Unclear."""
    lacking = [name for name in (f"SERVO{n}_FUNCTION" for n in channels) if name not in values]
    if not values:
        refuse_lacking(source, ["FRAME_CONFIG", "SERVOn_FUNCTION", "MOT_n_DIRECTION"])
    functions = {n: int(values[f"SERVO{n}_FUNCTION"]) for n in range(1, OUTPUTS + 1) if f"SERVO{n}_FUNCTION" in values}
    silent = [n for n, function in functions.items() if function in DRIVING and n not in channels]
    if silent:
        raise Unclear(
            f"{source} holds no pulses of output {listed(map(str, silent))}, which drives the vehicle by its "
            f"SERVOn_FUNCTION; {ELSE}"
        )
    outputs = {function: n for n, function in functions.items() if n in channels}
    if "FRAME_CONFIG" in values:
        return _frame(source, outputs, values, lacking)
    for how, rows in STEERED_ROWS.items():
        if rows.keys() <= outputs.keys():
            return _steered(how, source, {outputs[number]: row for number, row in rows.items()}, values)
    refuse_lacking(source, lacking)
    if set(MOTOR_IDS) & outputs.keys():
        refuse_lacking(source, ["FRAME_CONFIG"])
    raise Unclear(
        f"none of the outputs in {source} is a motor of ArduSub (SERVOn_FUNCTION 33 to 40), a left and right throttle "
        f"(73 and 74), or steering and throttle (26 and 70); {ELSE}"
    )


def _frame(source: str, outputs: Mapping[int, int], values: Values, lacking: Sequence[str]) -> Part:
    number = int(values["FRAME_CONFIG"])
    if number not in FRAME_MIXING:
        raise Unclear(f"FRAME_CONFIG is {number}: how the motors of this frame are mixed is in no table; {ELSE}")
    refuse_lacking(source, lacking)
    name, rows = FRAME_MIXING[number]
    motors = {motor: outputs[function] for motor, function in enumerate(MOTOR_IDS[: len(rows)]) if function in outputs}
    if not motors:
        raise Unclear(f"no motor of the frame {name} is among the outputs in {source}; {ELSE}")
    directions = {motor: f"MOT_{motor + 1}_DIRECTION" for motor in motors}
    refuse_lacking(source, [key for key in directions.values() if key not in values])
    factors = np.array([rows[motor] for motor in motors])
    way = np.array([np.sign(values[key]) for key in directions.values()])
    back, observable = least_squares(factors)
    neutral = np.full(len(motors), NEUTRAL_US)
    how = f"the mixing of ArduSub's frame {name} (FRAME_CONFIG {number})"
    return Part(how, tuple(motors.values()), neutral - SPAN_US, neutral, neutral + SPAN_US, back * way, observable)


def _steered(how: str, source: str, rows: Mapping[int, Row], values: Values) -> Part:
    """A boat or rover: pulses between the limits of each output, about its trim."""
    keys = [[f"SERVO{n}_{end}" for end in ("MIN", "TRIM", "MAX", "REVERSED")] for n in rows]
    refuse_lacking(source, [key for four in keys for key in four if key not in values])
    low, neutral, high, turned = np.array([[values[key] for key in four] for four in keys]).T
    if not np.all((low < neutral) & (neutral < high)):
        raise Unclear(f"SERVOn_TRIM of an output in {source} is not between SERVOn_MIN and SERVOn_MAX; {ELSE}")
    back, observable = least_squares(np.array(list(rows.values())))
    return Part(how, tuple(rows), low, neutral, high, back * np.where(turned > 0, -1.0, 1.0), observable)
