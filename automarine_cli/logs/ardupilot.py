"""ArduPilot's mixing: which output drives which motor, and what the motors of each frame do together.

ArduSub sends motor i the pulse 1500 us + 400 us x direction_i x (factors_i . wishes), clipped to ±400 us: the factors
are published for each frame (`FRAME_CONFIG`), the direction is `MOT_i_DIRECTION`, and `SERVOn_FUNCTION` says which
output carries which motor. A boat or rover with skid steering sends throttle ± steering to its two sides. The wishes
are found again by least squares (the pseudo-inverse of the factors), which gives what was asked back as it was unless
a motor was at its end; then they are what the motors were sent.

Sources: ArduPilot, libraries/AP_Motors/AP_Motors6DOF.cpp (`setup_motors`, `output_armed_stabilizing`,
`calc_thrust_to_pwm`) and AP_Motors6DOF.h (`sub_frame_t`); libraries/SRV_Channel/SRV_Channel.h (`Aux_servo_function_t`)
and SRV_Channel.cpp (`pwm_from_angle`); libraries/AR_Motors/AP_MotorsUGV.cpp (`output_skid_steering`).
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from automarine_cli.logs.mixing import (
    ELSE,
    FETCH,
    ROUNDING,
    Asked,
    Channels,
    Parameters,
    Part,
    Unclear,
    Values,
    refuse_lacking,
    worked_back,
)
from automarine_cli.pipeline.words import listed
from automarine_cli.quantities import Floats

ROW = [2, 4, 5, 3]  # places of WISHES in a row of factors: roll, pitch, yaw, up, ahead, abeam
Row = tuple[float, float, float, float, float, float]

_FOUR: tuple[Row, ...] = ((0, 0, 1, 0, -1, 1), (0, 0, -1, 0, -1, -1), (0, 0, -1, 0, 1, 1), (0, 0, 1, 0, 1, -1))
_TWO: tuple[Row, ...] = ((0, 0, -1, 0, 1, 0), (0, 0, 1, 0, 1, 0))
_SIMPLE: tuple[Row, ...] = (*_TWO, (1, 0, 0, -1, 0, 0), (-1, 0, 0, -1, 0, 0), (0, 0, 0, 0, 0, 1))
FRAMES: Mapping[int, tuple[str, tuple[Row, ...]]] = {
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
CUSTOM = 7
MOTORS = (*range(33, 41), *range(82, 86))  # SERVOn_FUNCTION of motors 1 to 12
STEERED: Mapping[str, Mapping[int, Row]] = {
    "skid steering (SERVOn_FUNCTION 73 and 74)": {73: (0, 0, 1, 0, 1, 0), 74: (0, 0, -1, 0, 1, 0)},
    "steering and throttle (SERVOn_FUNCTION 26 and 70)": {26: (0, 0, 1, 0, 0, 0), 70: (0, 0, 0, 0, 1, 0)},
}
"""Boats and rovers, the first that is whole: left and right throttle; steering and throttle."""
DRIVING = {*MOTORS, *(function for rows in STEERED.values() for function in rows)}
LAST = 32  # the highest number of an output
NEUTRAL, SPAN = 1500.0, 400.0  # us, of ArduSub's motors whatever the limits of their outputs


def asked_of_pulses(source: str, time: Floats, pulses: Channels, known: Parameters) -> Asked:
    """What ArduPilot asked of the vehicle, from pulses [us] by number of the output, shape (N,), at `time` [s].

    `source` is what the file calls the outputs.
    """
    return worked_back(source, time, pulses, {name: told for name, told in known.items() if _drives(name)}, part_of)


def least_squares(factors: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """What leads from motors to `WISHES` for rows of factors, shape (motors, 6): the pseudo-inverse, shape
    (4, motors), and which wishes the motors can tell at all."""
    inverse = np.linalg.pinv(factors)
    kept = inverse @ factors
    found = np.abs(kept - np.eye(len(kept)))[ROW].max(axis=1) < ROUNDING
    return inverse[ROW] * np.array([[1.0], [1.0], [1.0], [-1.0]]), found  # ArduPilot counts up, SNAME down


def _drives(name: str) -> bool:
    """Whether a parameter has a part in how outputs are read."""
    ends = ("_FUNCTION", "_MIN", "_MAX", "_TRIM", "_REVERSED", "_DIRECTION")
    return name == "FRAME_CONFIG" or (name.startswith(("SERVO", "MOT_")) and name.endswith(ends))


def part_of(source: str, channels: Channels, values: Values) -> Part:
    """How the outputs are read by these parameters. Raises Unclear."""
    lacking = [name for name in (f"SERVO{n}_FUNCTION" for n in channels) if name not in values]
    if not values:
        raise Unclear(
            f"{source} would tell it by FRAME_CONFIG, SERVOn_FUNCTION and MOT_n_DIRECTION, but the log does not hold "
            f"these parameters; {FETCH}"
        )
    functions = {n: int(values[f"SERVO{n}_FUNCTION"]) for n in range(1, LAST + 1) if f"SERVO{n}_FUNCTION" in values}
    silent = [n for n, function in functions.items() if function in DRIVING and n not in channels]
    if silent:
        raise Unclear(
            f"{source} holds no pulses of output {listed(map(str, silent))}, which drives the vehicle by its "
            f"SERVOn_FUNCTION; {ELSE}"
        )
    outputs = {function: n for n, function in functions.items() if n in channels}
    if "FRAME_CONFIG" in values:
        return _frame(source, outputs, values, lacking)
    for how, rows in STEERED.items():
        if rows.keys() <= outputs.keys():
            return _steered(how, source, {outputs[number]: row for number, row in rows.items()}, values)
    refuse_lacking(source, lacking)
    if set(MOTORS) & outputs.keys():
        refuse_lacking(source, ["FRAME_CONFIG"])
    raise Unclear(
        f"none of the outputs in {source} is a motor of ArduSub (SERVOn_FUNCTION 33 to 40), a left and right throttle "
        f"(73 and 74), or steering and throttle (26 and 70); {ELSE}"
    )


def _frame(source: str, outputs: Mapping[int, int], values: Values, lacking: Sequence[str]) -> Part:
    """ArduSub's frame."""
    number = int(values["FRAME_CONFIG"])
    if number not in FRAMES:
        name = "custom" if number == CUSTOM else "not one that we know"
        raise Unclear(
            f"FRAME_CONFIG is {number}, which is {name}: how its motors are mixed is in no published table; {ELSE}"
        )
    refuse_lacking(source, lacking)
    name, rows = FRAMES[number]
    motors = {motor: outputs[function] for motor, function in enumerate(MOTORS[: len(rows)]) if function in outputs}
    directions = {motor: f"MOT_{motor + 1}_DIRECTION" for motor in motors}
    refuse_lacking(source, [key for key in directions.values() if key not in values])
    factors = np.array([rows[motor] for motor in motors]).reshape(-1, 6)
    way = np.array([np.sign(values[key]) for key in directions.values()])
    back, found = least_squares(factors)
    if not found.any():
        raise Unclear(
            f"no motor of the frame {name} is among the outputs in {source} (SERVOn_FUNCTION 33 to 40); {ELSE}"
        )
    neutral = np.full(len(motors), NEUTRAL)
    how = f"the mixing of ArduSub's frame {name} (FRAME_CONFIG {number})"
    return Part(how, tuple(motors.values()), neutral - SPAN, neutral, neutral + SPAN, back * way, found)


def _steered(how: str, source: str, rows: Mapping[int, Row], values: Values) -> Part:
    """A boat or rover: pulses between the limits of each output, about its trim."""
    keys = [[f"SERVO{n}_{end}" for end in ("MIN", "TRIM", "MAX", "REVERSED")] for n in rows]
    refuse_lacking(source, [key for four in keys for key in four if key not in values])
    low, neutral, high, turned = np.array([[values[key] for key in four] for four in keys]).T
    if not np.all((low < neutral) & (neutral < high)):
        raise Unclear(
            f"SERVOn_TRIM of an output in {source} is not between SERVOn_MIN and SERVOn_MAX: it goes one way only; "
            f"{ELSE}"
        )
    back, found = least_squares(np.array(list(rows.values())))
    return Part(how, tuple(rows), low, neutral, high, back * np.where(turned > 0, -1.0, 1.0), found)
