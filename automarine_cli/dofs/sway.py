"""Sway: distance abeam, positive to starboard, against force Y; a hull drags alike to both sides."""

from dataclasses import replace

from automarine_cli.dofs.dof import Dof
from automarine_cli.dofs.translation import LIMITS, METRES, symbols, words

SWAY = Dof(
    name="sway",
    number=1,
    position="distance",
    velocity="sway",
    command="force_Y",
    thrusters=(),  # a vehicle that moves abeam has two or more of them, at angles of its own
    sides=(),
    symbols=symbols("Y", "v", "y"),
    words=replace(words("sway", "distance", ("starboard", "port")), to_ways=("to starboard", "to port")),
    units=METRES,
    limits=LIMITS,
    columns={
        "distance": (("distance_m", "m"),),
        "sway": (("sway_m_s", "m/s"),),
        "force_Y": (("force_Y_N", "N"), ("Y", "nu")),
    },
    nicknames={
        "distance": ("distance", "dist", "y", "position", "range", "travel", "sway_position", "pos_y"),
        "sway": ("sway", "v_mps", "v_m_s", "sway_speed", "lateral_speed", "vy"),
        "force_Y": ("force_y", "sway_force", "lateral_force", "thrust_y", "fy", "tau_y", "y_force"),
    },
    plain_names={"sway": ("sway", "v_mps", "v_m_s", "sway_speed", "sway_mps", "lateral_speed", "sway_velocity")},
)
