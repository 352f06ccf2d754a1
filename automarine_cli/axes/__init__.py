"""The motions that are identified: yaw, surge and heave; what is of one motion only, and what each calls what.

Every motion is identified by one code, which speaks of yaw: heading, moment, inertia, k_r and k_rr. An `Axis` says what
another motion calls them, in its result files and to people. Positions of surge and heave are metres, depth is positive
down; a force is in newtons, or normalised ("nu").
"""

from collections.abc import Mapping
from math import inf, pi
from typing import Any

from automarine_cli.axes.axis import Axis
from automarine_cli.axes.names import keys_of, words_of
from automarine_cli.quantities import MOMENT_UNITS

__all__ = ["AXES", "HEAVE", "SURGE", "YAW", "Axis"]

YAW = Axis(
    name="yaw",
    position="heading",
    rate="yaw_rate",
    command="moment",
    units=MOMENT_UNITS,
    thrusters=("n_port", "n_stbd"),
    sides=(1.0, -1.0),
    levered=True,
    turn=2 * pi,
    scale=180.0 / pi,
    unit="deg",
    log_scale=180.0 / pi,
    log_unit="deg",
    trim=pi,
    least=60.0 * (pi / 180),
    still=5.0 * (pi / 180),
    start=10.0 * (pi / 180),
    plausible=(0.05, 3.0),
    ways=("starboard", "port"),
)

_TRANSLATION: dict[str, Any] = {
    "levered": False, "turn": inf, "scale": 100.0, "unit": "cm", "log_scale": 1.0, "log_unit": "m",
    "units": ("nu", "N"),
    "trim": inf, "least": 0.3, "still": 0.05, "start": 0.1, "plausible": (0.02, 20.0), "sided": True,
}  # fmt: skip

SURGE = Axis(
    name="surge",
    position="distance",
    rate="surge",
    command="force_X",
    thrusters=("n_port", "n_stbd"),
    sides=(1.0, 1.0),
    ways=("ahead", "astern"),
    keys=keys_of("X", "u", "m_u", "distance"),
    words=words_of("surge", "X", "u", "m_u", "distance", ("ahead", "astern")),
    **_TRANSLATION,
)

HEAVE = Axis(
    name="heave",
    position="depth",
    rate="heave",
    command="force_Z",
    thrusters=("n_vert",),
    sides=(1.0,),
    ways=("down", "up"),
    constant=True,
    keys=keys_of("Z", "w", "m_w", "depth"),
    words=words_of("heave", "Z", "w", "m_w", "depth", ("down", "up")),
    **_TRANSLATION,
)

AXES: Mapping[str, Axis] = {axis.name: axis for axis in (YAW, SURGE, HEAVE)}
