"""Heave: depth, positive down, against force Z; weight less buoyancy always acts."""

from automarine_cli.dofs.dof import Dof
from automarine_cli.dofs.translation import LIMITS, METRES, symbols, words

HEAVE = Dof(
    name="heave",
    number=2,
    position="depth",
    velocity="heave",
    command="force_Z",
    thrusters=("n_vert",),
    sides=(1.0,),
    symbols=symbols("Z", "w", "z"),
    words=words("heave", "depth", ("down", "up")),
    units=METRES,
    limits=LIMITS,
    has_constant=True,
    windowed=True,
    directional=True,
    columns={
        "depth": (("depth_m", "m"),),
        "heave": (("heave_m_s", "m/s"),),
        "force_Z": (("force_Z_N", "N"), ("Z", "nu")),
    },
    nicknames={
        "depth": ("depth", "z", "pressure_depth", "depth_sensor", "pos_z"),
        "force_Z": ("force_z", "heave_force", "thrust_z", "fz", "tau_z", "z_force"),
        "n_vert": ("n_vert", "vertical", "vert", "vert_cmd", "cmd_vert", "n_vertical"),
    },
    mounts=("vertical",),
    horizontal=False,
)
