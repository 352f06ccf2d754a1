"""The degrees of freedom that vehicles have: yaw, swings in roll and pitch, translations in surge, sway and heave."""

from math import pi
from typing import Any

from automarine_cli.dofs.dof import Dof, Limits, Symbols, Units, Words

DEGREE = pi / 180

# heading against moment, positive clockwise seen from above
YAW = Dof(
    name="yaw", number=5, position="heading", velocity="yaw_rate", command="moment",
    thrusters=("n_port", "n_stbd"),
    sides=(1.0, -1.0),
    levered=True,
    turn=2 * pi,
    symbols=Symbols(
        position="psi", position_print="ψ", position_math=r"\psi", velocity="r", force="tau", force_print="τ",
        force_math=r"\tau", inertia="I_r", linear="k_r", quadratic="k_rr",
        quadratic_math="k_{r|r|}", cubic="k_rrr",
    ),
    words=Words(
        position="heading", positions="headings", sensor="compass", rate="yaw rate", full_force="yaw moment",
        ways=("starboard", "port"), to_ways=("to starboard", "to port"), speed="rate", force="moment",
        inertia="inertia", an_inertia="an inertia", full_inertia="yaw inertia", inertial_length="inertial turn angle",
        travelled="turned angle", step="half-turn",
        reach="half a turn", whole_way="a whole revolution and more", back_again="an unwinding turn", move="turn",
        moves="turns", moved="turned", moving="turning", unit="degree", units="degrees", spring="torsional spring",
        stiffness="torsional stiffness", both_ways="to both sides", each_way="to each side", one_way="to one side",
        other_way="counter-clockwise", the_other="to the other", way="side", rate_sensor="gyro", gone_key="turned",
        way_key="turn", range_key="turns",
    ),
    units=Units(
        base="rad", log="deg", per_base=1 / DEGREE, shown="deg", shown_per_base=1 / DEGREE, mark="°",
        forces=("nu", "N m", "rad"),  # the last of a rudder
    ),
    limits=Limits(
        trim=pi, least=60 * DEGREE, unmoved=5 * DEGREE, start=10 * DEGREE, plausible=(0.05, 3.0), spike=6 * DEGREE,
        end_spike=20 * DEGREE, jump=15 * DEGREE, far=1000 * 2 * pi, fast=8 * pi,
        acceleration=60.0,  # a small vehicle: a moment of 10 N m on 0.2 kg m²
        least_noise=0.2 * DEGREE, long=4.0 * pi,
    ),
    columns={
        "heading": (("heading_deg", "deg"), ("heading_rad", "rad")),
        "yaw_rate": (("yaw_rate_deg_s", "deg/s"), ("yaw_rate_rad_s", "rad/s")),
        "moment": (("tau", "nu"), ("tau_Nm", "N m")),
    },
    nicknames={
        "heading": ("heading", "yaw", "psi", "hdg", "compass", "head", "azimuth", "course", "yaw_deg", "yaw_rad"),
        "yaw_rate": ("yaw_rate", "yawrate", "yaw_speed", "heading_rate", "gyro_z", "r"),
        "moment": (
            "tau", "moment", "torque", "nm", "yaw_moment", "tau_nm", "mz", "torque_z",
            "moment_z", "tau_z", "yaw_torque",
        ),
        "n_port": ("n_port", "port", "port_cmd", "left", "n_left", "cmd_port"),
        "n_stbd": ("n_stbd", "stbd", "starboard", "stbd_cmd", "right", "n_right", "cmd_stbd"),
    },
    plain_names={
        "heading": ("heading", "yaw", "psi", "hdg", "compass"),
        "n_port": ("n_port", "port", "left", "cmd_port", "port_cmd", "n_left"),
        "n_stbd": ("n_stbd", "stbd", "starboard", "right", "cmd_stbd", "stbd_cmd", "n_right"),
    },
    mounts=("port", "starboard"),
)  # fmt: skip


SWING_LIMITS = Limits(
    least=2 * DEGREE, unmoved=0.5 * DEGREE, start=1 * DEGREE, plausible=(0.01, 1000.0), spike=6 * DEGREE,
    end_spike=20 * DEGREE, jump=15 * DEGREE, acceleration=60.0, far=180 * DEGREE, fast=8 * 180 * DEGREE,
    position_sd=90 * DEGREE, velocity_sd=2.0, least_noise=0.02 * DEGREE, bias_sd=2 * DEGREE, long=180 * DEGREE,
)  # fmt: skip


def swing(
    name: str, number: int, force: str, angle: str, printed: str, rate: str, ways: tuple[str, str], **more: Any
) -> Dof:
    """Return a swing about a horizontal axis, back to which weight and buoyancy turn the vehicle: an `angle` phi with
    the `rate` p against a moment K; inertia I_p, drag k_p and k_pp. `ways` are those in which the angle is positive
    and negative."""
    return Dof(
        name=name, number=number, position=name, velocity=f"{name}_rate", command=f"moment_{force}",
        symbols=Symbols(
            position=angle, position_print=printed, position_math=f"\\{angle}", velocity=rate, force=force,
            force_print=force, force_math=force, inertia=f"I_{rate}", linear=f"k_{rate}", quadratic=f"k_{2 * rate}",
            quadratic_math=f"k_{{{rate}|{rate}|}}", cubic=f"k_{3 * rate}", constant="constant_moment",
        ),
        words=Words(
            position=name, positions=f"{name} angles", sensor="inclinometer", rate=f"{name} rate",
            full_force=f"{name} moment", ways=ways, to_ways=ways, speed="rate", force="moment", inertia="inertia",
            an_inertia="an inertia", full_inertia=f"{name} inertia", inertial_length="inertial angle",
            travelled=f"{name} since the start", step="swing", reach="the swing", whole_way="several swings",
            back_again="swings from both sides", move="swing", moves="swings", moved="swung", moving="swinging",
            unit="degree", units="degrees", spring="torsional spring", stiffness="torsional stiffness",
            rate_sensor="gyro", gone_key="swung", way_key="swing", range_key="swung_deg",
        ),
        units=Units(
            base="rad", log="deg", per_base=1 / DEGREE, shown="deg", shown_per_base=1 / DEGREE, mark="°",
            forces=("nu", "N m"),
        ),
        limits=SWING_LIMITS, restoring=True, horizontal=False,
        columns={
            name: ((f"{name}_deg", "deg"), (f"{name}_rad", "rad")),
            f"{name}_rate": ((f"{name}_rate_deg_s", "deg/s"), (f"{name}_rate_rad_s", "rad/s")),
            f"moment_{force}": ((f"{force}_Nm", "N m"), (force, "nu")),
        },
        **more,
    )  # fmt: skip


ROLL = swing(
    "roll", 3, "K", "phi", "φ", "p", ("starboard down", "port down"),
    nicknames={
        "roll": ("roll", "phi", "heel", "roll_angle", "heel_angle", "bank"),
        "roll_rate": ("roll_rate", "rollspeed", "roll_speed", "p", "gyro_x"),
        "moment_K": ("roll_moment", "heeling_moment", "roll_torque", "torque_x", "moment_x", "tau_k"),
    },
    plain_names={
        "roll": ("roll", "phi", "heel", "roll_angle", "heel_angle"),
        "roll_rate": ("roll_rate", "rollspeed", "roll_speed", "gyro_x"),
    },
)  # fmt: skip

PITCH = swing(
    "pitch", 4, "M", "theta", "θ", "q", ("bow up", "bow down"),
    nicknames={
        "pitch": ("pitch", "theta", "trim", "pitch_angle", "trim_angle"),
        "pitch_rate": ("pitch_rate", "pitchspeed", "pitch_speed", "q", "gyro_y"),
        "moment_M": ("pitch_moment", "trimming_moment", "pitch_torque", "torque_y", "moment_y", "tau_m"),
    },
    plain_names={
        "pitch": ("pitch", "theta", "trim", "pitch_angle", "trim_angle"),
        "pitch_rate": ("pitch_rate", "pitchspeed", "pitch_speed", "gyro_y"),
    },
)  # fmt: skip


def translation(
    name: str, number: int, force: str, velocity: str, axis: str, position: str, ways: tuple[str, str], to: str = "",
    **more: Any,
) -> Dof:  # fmt: skip
    """Return a translation along an `axis` x with a `velocity` u, as Fossen has them, against a force X; mass m_u, drag
    X_u and X_uu. Logs hold a `position` such as distance or depth."""
    drag = f"{force}_{velocity}"
    return Dof(
        name=name, number=number, position=position, velocity=name, command=f"force_{force}",
        symbols=Symbols(
            position=axis, position_print=axis, position_math=axis, velocity=velocity, force=force, force_print=force,
            force_math=force, inertia=f"m_{velocity}", linear=drag, quadratic=drag + velocity,
            quadratic_math=f"{force}_{{{velocity}|{velocity}|}}", cubic=drag + 2 * velocity, water=f"{velocity}_w",
        ),
        words=Words(
            position, f"{position} sensor", f"{name} speed", f"{name} force", ways, (to + ways[0], to + ways[1]),
            positions=f"{position}s",
        ),
        units=Units(), limits=Limits(),
        columns={
            position: ((f"{position}_m", "m"),),
            name: ((f"{name}_m_s", "m/s"),),
            f"force_{force}": ((f"force_{force}_N", "N"), (force, "nu")),
        },
        **more,
    )  # fmt: skip


SURGE = translation(
    "surge", 0, "X", "u", "x", "distance", ("ahead", "astern"), directional=True,
    thrusters=("n_port", "n_stbd"), sides=(1.0, 1.0), mounts=("port", "starboard"),
    nicknames={
        "distance": ("distance", "dist", "x", "position", "range", "travel", "surge_position", "pos_x"),
        "surge": (
            "surge", "u", "u_mps", "u_m_s", "speed", "speed_mps", "speed_m_s", "surge_speed", "forward_speed", "vx",
        ),
        "force_X": ("force_x", "surge_force", "thrust_x", "fx", "tau_x", "x_force"),
    },
    plain_names={"surge": ("surge", "u_mps", "u_m_s", "surge_speed", "surge_mps", "forward_speed", "surge_velocity")},
)  # fmt: skip

# a hull drags alike to both sides; a vehicle that moves abeam has two or more thrusters, at angles of its own
SWAY = translation(
    "sway", 1, "Y", "v", "y", "distance", ("starboard", "port"), to="to ",
    nicknames={
        "distance": ("distance", "dist", "y", "position", "range", "travel", "sway_position", "pos_y"),
        "sway": ("sway", "v_mps", "v_m_s", "sway_speed", "lateral_speed", "vy"),
        "force_Y": ("force_y", "sway_force", "lateral_force", "thrust_y", "fy", "tau_y", "y_force"),
    },
    plain_names={"sway": ("sway", "v_mps", "v_m_s", "sway_speed", "sway_mps", "lateral_speed", "sway_velocity")},
)  # fmt: skip

HEAVE = translation(  # positive down; weight less buoyancy always acts
    "heave", 2, "Z", "w", "z", "depth", ("down", "up"), has_constant=True, windowed=True, directional=True,
    thrusters=("n_vert",), sides=(1.0,), mounts=("vertical",), horizontal=False,
    nicknames={
        "depth": ("depth", "z", "pressure_depth", "depth_sensor", "pos_z"),
        "force_Z": ("force_z", "heave_force", "thrust_z", "fz", "tau_z", "z_force"),
        "n_vert": ("n_vert", "vertical", "vert", "vert_cmd", "cmd_vert", "n_vertical"),
    },
)  # fmt: skip
