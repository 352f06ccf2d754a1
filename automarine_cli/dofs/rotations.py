"""Roll and pitch: angles against the moments K and M. Weight and buoyancy turn the vehicle back, so that it swings."""

from automarine_cli.dofs.dof import Dof, Limits, Symbols, Units, Words
from automarine_cli.dofs.yaw import DEGREE


def symbols(angle: str, rate: str, printed: str) -> Symbols:
    """Return the letters of a swing about a horizontal axis: angle `phi`, rate `p`, inertia I_p, drag k_p and k_pp."""
    return Symbols(
        position=angle, position_print=printed, position_math=f"\\{angle}", velocity=rate, force=_MOMENTS[angle],
        force_print=_MOMENTS[angle], force_math=_MOMENTS[angle], inertia=f"I_{rate}", linear=f"k_{rate}",
        quadratic=f"k_{2 * rate}", quadratic_math=f"k_{{{rate}|{rate}|}}", cubic=f"k_{3 * rate}",
        constant="constant_moment",
    )  # fmt: skip


_MOMENTS = {"phi": "K", "theta": "M"}
UNITS = Units(
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


LIMITS = Limits(
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
    units=UNITS,
    limits=LIMITS,
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
    units=UNITS,
    limits=LIMITS,
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
