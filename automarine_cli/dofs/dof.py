"""What a degree of freedom is: symbols, words, units, limits, and the log columns that hold it; then all six: yaw,
swings in roll and pitch, translations in surge, sway and heave.

One record a degree of freedom (SNAME 1950; Fossen 2021): everything else in automarine is written once, as sentences,
keys and labels that are filled from the record. No text is changed after it was written.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from math import inf, pi
from typing import Any

DEGREE = pi / 180


@dataclass(frozen=True)
class Symbols:
    """Letters. Plain ones name parameters and keys; those of `_print` are for text, `_math` for figures and LaTeX."""

    position: str
    position_print: str
    position_math: str
    velocity: str
    force: str
    force_print: str
    force_math: str
    inertia: str
    linear: str
    quadratic: str
    quadratic_math: str
    cubic: str
    constant: str = "constant_force"  # a force that always acts
    difference: str = "half_difference"  # of drag between the two ways
    restoring: str = "restoring"  # moment of weight and buoyancy, over the sine of the angle
    water: str = "w"  # the water's velocity


@dataclass(frozen=True)
class Words:
    """What people call the states, the parameters and the tests of one motion; English, lower case, singular.

    Where a field has a blank in it, it stands as it is: `both_ways` is "to both sides" or "both ways". What is not
    given is a translation's.
    """

    position: str  # what the log holds: heading, distance, depth
    sensor: str  # what measures it
    rate: str  # its velocity in full: yaw rate, surge speed
    full_force: str  # yaw moment, surge force
    ways: tuple[str, str]  # positive first: starboard, port
    to_ways: tuple[str, str]  # to starboard, to port
    speed: str = "speed"  # the velocity in short
    force: str = "force"  # what drives
    inertia: str = "mass"
    an_inertia: str = "a mass"
    full_inertia: str = "mass with added mass"
    inertial_length: str = "inertial distance"  # inertia over quadratic drag
    travelled: str = "distance covered"
    step: str = "step"  # what is kept of a step
    reach: str = "the way allowed"  # how far a step is followed
    whole_way: str = "the whole way"
    back_again: str = "back again"
    move: str = "move"
    moves: str = "moves"
    moved: str = "moved"
    moving: str = "moving"
    unit: str = "cm"  # of positions as people read them
    units: str = "cm"
    spring: str = "spring"  # what a tether is
    stiffness: str = "stiffness"
    both_ways: str = "both ways"
    each_way: str = "each way"
    one_way: str = "one way"
    other_way: str = "the other way"  # of positions that count against the convention
    the_other: str = "the other"  # than one_way
    way: str = "direction"  # one of the two
    rate_sensor: str = "speed sensor"  # what measures the velocity
    drift: str = "a current, or a speed sensor with a bias"  # what makes a position drift
    gone_key: str = "covered"  # of how far it went
    way_key: str = "travel"  # of how far a step is to go, as a key begins
    range_key: str = "covered_m"  # the key of how far a run went in all
    positions: str = "positions"


@dataclass(frozen=True)
class Units:
    """Units of positions: of all arithmetic (`base`), of the logs (`log`), and as people read them (`shown`).

    A position in the base unit times `per_base` is one in that of the logs, times `shown_per_base` one as people read
    it. `shown` also ends keys, `mark` is it right after a number in text; `forces` are the units in which the force may
    be logged.
    """

    base: str = "m"
    log: str = "m"
    per_base: float = 1.0
    shown: str = "cm"
    shown_per_base: float = 100.0
    mark: str = " cm"
    forces: tuple[str, ...] = ("nu", "N")


@dataclass(frozen=True)
class Limits:
    """Sizes that a motion has in vehicles that tests are made with, all in base units [rad or m] and seconds; what is
    not given is a translation's. Standard deviations are wide ones."""

    trim: float = inf  # how far a step is followed unless asked otherwise
    least: float = 0.3  # what a step has to cover before its end
    unmoved: float = 0.05  # what counts as not having moved
    start: float = 0.1  # what counts as a step's beginning
    plausible: tuple[float, float] = (0.02, 20.0)  # inertia over quadratic drag
    # the least sizes of readings that no vehicle makes, beside what the log's own noise and speed allow
    spike: float = 0.1
    end_spike: float = 0.35
    jump: float = 0.25
    acceleration: float = 20.0  # what none reaches: twice that of a free fall
    far: float = 5000.0  # what none gets to: ten minutes at the speed of a small boat
    fast: float = 15.0
    position_sd: float = 10.0  # of the start of a run
    velocity_sd: float = 1.0
    bias_sd: float = 0.2  # of what a velocity sensor adds
    least_noise: float = 0.002  # what is left of a position sensor's errors however smooth its readings look
    long: float = 5.0  # how far a long run goes


@dataclass(frozen=True, eq=False)
class Dof:
    """One degree of freedom: a position, and the moment or force that drives it. One object, the same in every process.

    `number` is its place among the six, from 0: surge, sway, heave, roll, pitch, yaw, forces X, Y, Z, K, M, N.
    `position`, `velocity` and `command` are canonical quantities of the logs, `thrusters` the commands of which a map
    makes moment or force, each counting by `sides`; `levered` where that takes a lever arm. `turn` is after how much
    the position wraps [rad or m], infinite where it does not. `has_constant`: a constant force is part of every
    model; `windowed`: steps are followed inside a window of positions (`depths`), not for a length (`within`);
    `directional`: drag may differ between the two ways, the positive one first; `restoring`: weight and buoyancy turn
    it back to an angle of rest, so that it swings, and a step ends at an angle. `columns` are the names under which
    logs hold its quantities, by quantity, as (column, unit). `nicknames` is how people call them, for suggestions only;
    `plain_names` are those that mean nothing else. `mounts` says which thruster each of `thrusters` is; `horizontal`
    that it is a motion in the plane of the water, of which the velocities are known to tests of all motions.
    """

    name: str
    number: int
    position: str
    velocity: str
    command: str
    symbols: Symbols
    words: Words
    units: Units
    limits: Limits
    thrusters: tuple[str, ...] = ()
    sides: tuple[float, ...] = ()
    turn: float = inf
    levered: bool = False
    has_constant: bool = False
    windowed: bool = False
    directional: bool = False
    restoring: bool = False
    columns: Mapping[str, tuple[tuple[str, str], ...]] = field(default_factory=dict)
    nicknames: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    plain_names: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    mounts: tuple[str, ...] = ()
    horizontal: bool = True

    def __reduce__(self) -> str:
        return self.name.upper()  # pickled as the name that it has in this file

    @property
    def wraps(self) -> bool:
        return self.turn < inf

    @property
    def angular(self) -> bool:
        """Whether positions are angles and forces moments."""
        return self.units.base == "rad"

    @property
    def biased(self) -> bool:
        """Whether a constant force or moment is part of every model: weight less buoyancy, or what makes a list."""
        return self.has_constant or self.restoring

    @property
    def channels(self) -> tuple[str, str]:
        """The quantities that sensors may give of this motion: position and velocity."""
        return self.position, self.velocity

    def column(self, quantity: str, unit: str) -> str:
        return next(name for name, stored in self.columns[quantity] if stored == unit)

    def shown(self, position: Any) -> Any:
        """A position or velocity in the unit in which people see it."""
        return position * self.units.shown_per_base

    def logged(self, position: Any) -> Any:
        """A position or velocity in the unit in which logs hold it."""
        return position * self.units.per_base

    def inner(self, logged: Any) -> Any:
        """A position or velocity as logs hold it in the unit of all arithmetic."""
        return logged * DEGREE if self.angular else logged

    @property
    def parameters(self) -> Mapping[str, str]:
        """Names of the parameters of the equation of motion, by what they are."""
        symbols = self.symbols
        restoring = {"restoring": symbols.restoring} if self.restoring else {}
        return {
            "inertia": symbols.inertia, "linear": symbols.linear, "quadratic": symbols.quadratic,
            "cubic": symbols.cubic, "constant": symbols.constant, "difference": symbols.difference, **restoring,
        }  # fmt: skip

    def parameter(self, role: str) -> str:
        """The qualified name of a parameter of the equation of motion, such as "yaw.k_rr" for "quadratic"."""
        return f"{self.name}.{self.parameters[role]}"

    @property
    def ratio_key(self) -> str:
        return f"{self.words.inertial_length.replace(' ', '_')}_{self.units.base}"

    @property
    def velocity_key(self) -> str:
        return f"{self.velocity}_{self.units.base}_s"

    @property
    def step_key(self) -> str:
        return self.words.step.replace("-", "_")

    @cached_property
    def vocabulary(self) -> Mapping[str, str]:
        """Every word and symbol by name, for templates such as "-{quadratic} |{v}| {v}": the fields of `Words`, the
        parameters by what they are (the inertia's is `inertia_symbol`), `x`, `v`, `f` and `water` for position,
        velocity, force and the water's velocity, `letter` for the force as in N_delta, and the units."""
        words = {k: v for k, v in vars(self.words).items() if isinstance(v, str)}
        plural = {f"{name}s": f"{words[name]}s" for name in ("force", "speed")}
        there, back = self.words.ways
        to, fro = self.words.to_ways
        symbols, units = self.symbols, self.units
        return {
            **self.parameters, **words, **plural, "motion": self.name, "inertia_symbol": symbols.inertia,
            "restoring": symbols.restoring,
            "x": symbols.position, "v": symbols.velocity, "f": symbols.force, "water": symbols.water,
            "letter": "XYZKMN"[self.number], "positive": there, "negative": back, "to_positive": to, "to_negative": fro,
            "base_unit": units.base, "log_unit": units.log, "shown_unit": units.shown,
            "ratio_key": self.ratio_key, "velocity_key": self.velocity_key,
        }  # fmt: skip

    def fill(self, template: str) -> str:
        """A text of the library, such as an effect's sentence, with its fields filled from the `vocabulary`."""
        return template.format_map(self.vocabulary)

    def unit_of(self, parameter: str, force_unit: str = "nu") -> str:
        """Unit of "inertia", "linear", "quadratic", "cubic", "constant", "difference" or "ratio" (inertia over
        quadratic drag) for a force in `force_unit`; also by the parameter's name."""
        role = {name: role for role, name in self.parameters.items()}.get(parameter, parameter)
        if role == "ratio":
            return self.units.base
        if role == "inertia" and force_unit == "N":
            return "kg"
        return self.unit_in(_UNITS[role], force_unit)

    def unit_in(self, template: str, force_unit: str) -> str:
        """A unit such as "{force} s²{/x2}": `{force}` stands for the force's unit, `{x}` for the base unit of
        positions, `{/x}`, `{/x2}`, `{/x3}` for "per metre" (nothing for angles)."""
        per = [""] * 3 if self.angular else [f"/{self.units.base}{power}" for power in ("", "²", "³")]
        return template.format_map(
            {"force": force_unit, "x": self.units.base, "/x": per[0], "/x2": per[1], "/x3": per[2]}
        )


_UNITS = {
    "inertia": "{force} s²{/x}", "linear": "{force} s{/x}", "quadratic": "{force} s²{/x2}",
    "cubic": "{force} s³{/x3}", "constant": "{force}", "restoring": "{force}", "difference": "{force} s²{/x2}",
}  # fmt: skip


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
        other_way="counter-clockwise", the_other="to the other", way="side", rate_sensor="gyro",
        drift="a gyro with a bias", gone_key="turned", way_key="turn", range_key="turns",
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
        "heading": ("head", "hdt", "azimuth", "course", "yaw_deg", "yaw_rad"),
        "yaw_rate": ("yaw_speed", "heading_rate", "wz", "gz", "r"),
        "moment": (
            "tau", "moment", "torque", "nm", "yaw_moment", "tau_nm", "mz", "torque_z",
            "moment_z", "tau_z", "yaw_torque",
        ),
    },
    plain_names={
        "heading": ("heading", "yaw", "psi", "hdg", "compass"),
        "yaw_rate": ("yaw_rate", "yawrate", "gyro_z", "omega_z", "angular_velocity_z"),
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
            rate_sensor="gyro", drift="a gyro with a bias", gone_key="swung", way_key="swing", range_key="swung_deg",
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
        "roll": ("bank",),
        "roll_rate": ("p",),
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
        "pitch_rate": ("q",),
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
        "surge": ("u", "speed", "speed_mps", "speed_m_s", "vx", "sog", "stw"),
        "force_X": ("force_x", "surge_force", "thrust_x", "fx", "tau_x", "x_force"),
    },
    plain_names={"surge": ("surge", "u_mps", "u_m_s", "surge_speed", "surge_mps", "forward_speed", "surge_velocity")},
)  # fmt: skip

# a hull drags alike to both sides; a vehicle that moves abeam has two or more thrusters, at angles of its own
SWAY = translation(
    "sway", 1, "Y", "v", "y", "distance", ("starboard", "port"), to="to ",
    nicknames={
        "distance": ("distance", "dist", "y", "position", "range", "travel", "sway_position", "pos_y"),
        "sway": ("vy",),
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

DOFS: Mapping[str, Dof] = {dof.name: dof for dof in (YAW, SURGE, HEAVE, SWAY, ROLL, PITCH)}
