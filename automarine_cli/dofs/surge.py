"""Surge: distance ahead against force X."""

from automarine_cli.dofs.dof import Dof
from automarine_cli.dofs.translation import LIMITS, METRES, symbols, words

SURGE = Dof(
    name="surge",
    number=0,
    position="distance",
    velocity="surge",
    command="force_X",
    thrusters=("n_port", "n_stbd"),
    sides=(1.0, 1.0),
    symbols=symbols("X", "u", "x"),
    words=words("surge", "distance", ("ahead", "astern")),
    units=METRES,
    limits=LIMITS,
    directional=True,
    columns={
        "distance": (("distance_m", "m"),),
        "surge": (("surge_m_s", "m/s"),),
        "force_X": (("force_X_N", "N"), ("X", "nu")),
    },
    nicknames={
        "distance": ("distance", "dist", "x", "position", "range", "travel", "surge_position", "pos_x"),
        "surge": (
            "surge",
            "u",
            "u_mps",
            "u_m_s",
            "speed",
            "speed_mps",
            "speed_m_s",
            "surge_speed",
            "forward_speed",
            "vx",
        ),
        "force_X": ("force_x", "surge_force", "thrust_x", "fx", "tau_x", "x_force"),
    },
    plain_names={"surge": ("surge", "u_mps", "u_m_s", "surge_speed", "surge_mps", "forward_speed", "surge_velocity")},
    mounts=("port", "starboard"),
)
