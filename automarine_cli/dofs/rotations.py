"""Yaw: heading against moment, positive clockwise seen from above. Roll and pitch: angles against the moments K and M;
weight and buoyancy turn the vehicle back, so that it swings."""

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


def symbols(angle: str, rate: str, printed: str) -> Symbols:
    """Return the letters of a swing about a horizontal axis: angle `phi`, rate `p`, inertia I_p, drag k_p and k_pp."""
    return Symbols(
        position=angle, position_print=printed, position_math=f"\\{angle}", velocity=rate, force=_MOMENTS[angle],
        force_print=_MOMENTS[angle], force_math=_MOMENTS[angle], inertia=f"I_{rate}", linear=f"k_{rate}",
        quadratic=f"k_{2 * rate}", quadratic_math=f"k_{{{rate}|{rate}|}}", cubic=f"k_{3 * rate}",
        constant="constant_moment",
    )  # fmt: skip


_MOMENTS = {"phi": "K", "theta": "M"}
SWING_UNITS = Units(
    base="rad", log="deg", per_base=1 / DEGREE, shown="deg", shown_per_base=1 / DEGREE, mark="°", forces=("nu", "N m")
)


def words(name: str, ways: tuple[str, str]) -> Words:
    """Return the words of a swing called `name`; `ways` are those in which the angle is positive and negative."""
    return Words(
        position=name, positions=f"{name} angles", sensor="inclinometer", rate=f"{name} rate",
        full_force=f"{name} moment", ways=ways, to_ways=ways, speed="rate", force="moment", inertia="inertia",
        an_inertia="an inertia", full_inertia=f"{name} inertia", inertial_length="inertial angle",
        travelled=f"{name} since the start", step="swing", reach="the swing", whole_way="several swings",
        back_again="swings from both sides", move="swing", moves="swings", moved="swung", moving="swinging",
        unit="degree", units="degrees", spring="torsional spring", stiffness="torsional stiffness",
        rate_sensor="gyro", gone_key="swung", way_key="swing", range_key="swung_deg",
    )  # fmt: skip


SWING_LIMITS = Limits(
    least=2 * DEGREE, unmoved=0.5 * DEGREE, start=1 * DEGREE, plausible=(0.01, 1000.0), spike=6 * DEGREE,
    end_spike=20 * DEGREE, jump=15 * DEGREE, acceleration=60.0, far=180 * DEGREE, fast=8 * 180 * DEGREE,
    position_sd=90 * DEGREE, velocity_sd=2.0, least_noise=0.02 * DEGREE, bias_sd=2 * DEGREE, long=180 * DEGREE,
)  # fmt: skip

ROLL = Dof(
    name="roll",
    number=3,
    position="roll",
    velocity="roll_rate",
    command="moment_K",
    thrusters=(),
    sides=(),
    symbols=symbols("phi", "p", "φ"),
    words=words("roll", ("starboard down", "port down")),
    units=SWING_UNITS,
    limits=SWING_LIMITS,
    restoring=True,
    columns={
        "roll": (("roll_deg", "deg"), ("roll_rad", "rad")),
        "roll_rate": (("roll_rate_deg_s", "deg/s"), ("roll_rate_rad_s", "rad/s")),
        "moment_K": (("K_Nm", "N m"), ("K", "nu")),
    },
    nicknames={
        "roll": ("roll", "phi", "heel", "roll_angle", "heel_angle", "bank"),
        "roll_rate": ("roll_rate", "rollspeed", "roll_speed", "p", "gyro_x"),
        "moment_K": ("roll_moment", "heeling_moment", "roll_torque", "torque_x", "moment_x", "tau_k"),
    },
    plain_names={
        "roll": ("roll", "phi", "heel", "roll_angle", "heel_angle"),
        "roll_rate": ("roll_rate", "rollspeed", "roll_speed", "gyro_x"),
    },
    horizontal=False,
)

PITCH = Dof(
    name="pitch",
    number=4,
    position="pitch",
    velocity="pitch_rate",
    command="moment_M",
    thrusters=(),
    sides=(),
    symbols=symbols("theta", "q", "θ"),
    words=words("pitch", ("bow up", "bow down")),
    units=SWING_UNITS,
    limits=SWING_LIMITS,
    restoring=True,
    columns={
        "pitch": (("pitch_deg", "deg"), ("pitch_rad", "rad")),
        "pitch_rate": (("pitch_rate_deg_s", "deg/s"), ("pitch_rate_rad_s", "rad/s")),
        "moment_M": (("M_Nm", "N m"), ("M", "nu")),
    },
    nicknames={
        "pitch": ("pitch", "theta", "trim", "pitch_angle", "trim_angle"),
        "pitch_rate": ("pitch_rate", "pitchspeed", "pitch_speed", "q", "gyro_y"),
        "moment_M": ("pitch_moment", "trimming_moment", "pitch_torque", "torque_y", "moment_y", "tau_m"),
    },
    plain_names={
        "pitch": ("pitch", "theta", "trim", "pitch_angle", "trim_angle"),
        "pitch_rate": ("pitch_rate", "pitchspeed", "pitch_speed", "gyro_y"),
    },
    horizontal=False,
)
