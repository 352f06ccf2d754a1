"""Yaw: heading against moment, positive clockwise seen from above."""

from math import pi

from automarine_cli.dofs.dof import Dof, Limits, Symbols, Units, Words

DEGREE = pi / 180

YAW = Dof(
    name="yaw",
    number=5,
    position="heading",
    velocity="yaw_rate",
    command="moment",
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
