"""Surge, sway and heave: distance ahead, distance abeam and depth, against the forces X, Y and Z."""

from automarine_cli.dofs.dof import Dof, Limits, Symbols, Units, Words


def symbols(force: str, velocity: str, position: str) -> Symbols:
    """Return the letters of a translation, as Fossen has them: force `X`, velocity `u`, position `x`, drag `X_u`."""
    drag = f"{force}_{velocity}"
    return Symbols(
        position=position, position_print=position, position_math=position, velocity=velocity, force=force,
        force_print=force, force_math=force, inertia=f"m_{velocity}", linear=drag, quadratic=drag + velocity,
        quadratic_math=f"{force}_{{{velocity}|{velocity}|}}", cubic=drag + 2 * velocity, water=f"{velocity}_w",
    )  # fmt: skip


def words(name: str, position: str, ways: tuple[str, str], to: str = "") -> Words:
    """Return the words of a translation called `name` whose logs hold a `position` (distance, depth)."""
    to_ways = (to + ways[0], to + ways[1])
    more = {"positions": f"{position}s"}
    return Words(position, f"{position} sensor", f"{name} speed", f"{name} force", ways, to_ways, **more)


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
    units=Units(),
    limits=Limits(),
    directional=True,
    columns={
        "distance": (("distance_m", "m"),),
        "surge": (("surge_m_s", "m/s"),),
        "force_X": (("force_X_N", "N"), ("X", "nu")),
    },
    nicknames={
        "distance": ("distance", "dist", "x", "position", "range", "travel", "surge_position", "pos_x"),
        "surge": (
            "surge", "u", "u_mps", "u_m_s", "speed", "speed_mps", "speed_m_s", "surge_speed", "forward_speed", "vx",
        ),
        "force_X": ("force_x", "surge_force", "thrust_x", "fx", "tau_x", "x_force"),
    },
    plain_names={"surge": ("surge", "u_mps", "u_m_s", "surge_speed", "surge_mps", "forward_speed", "surge_velocity")},
    mounts=("port", "starboard"),
)  # fmt: skip

SWAY = Dof(  # a hull drags alike to both sides
    name="sway",
    number=1,
    position="distance",
    velocity="sway",
    command="force_Y",
    thrusters=(),  # a vehicle that moves abeam has two or more of them, at angles of its own
    sides=(),
    symbols=symbols("Y", "v", "y"),
    words=words("sway", "distance", ("starboard", "port"), to="to "),
    units=Units(),
    limits=Limits(),
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

HEAVE = Dof(  # positive down; weight less buoyancy always acts
    name="heave",
    number=2,
    position="depth",
    velocity="heave",
    command="force_Z",
    thrusters=("n_vert",),
    sides=(1.0,),
    symbols=symbols("Z", "w", "z"),
    words=words("heave", "depth", ("down", "up")),
    units=Units(),
    limits=Limits(),
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
