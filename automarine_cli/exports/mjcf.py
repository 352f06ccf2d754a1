"""MuJoCo: an MJCF model of the vehicle on a joint for each motion, with the water's drag as the joint's damping.

A joint is (I + armature) r' = tau - (d0 + d1 |r| + d2 r^2) r - frictionloss sgn(r) - (s0 + s2 x^2) x. The force of
its actuator is the control, clamped to ctrlrange, late by `delay` and filtered by `filterexact` with one time constant
(T f' = f_c - f, solved exactly), plus the constant of its bias. No fluid model acts: `density` and `viscosity` stay 0.
Sources: mujoco.readthedocs.io, "XML Reference" (joint: damping, stiffness, frictionloss, armature; actuator/general:
dyntype, dynprm, delay, nsample, biasprm, ctrlrange; option) and "Computation" (actuation model, passive forces);
tried in the library: coefficients of higher order are read from 3.7 on, `delay` from 3.5 on.
"""

import math
from collections.abc import Mapping

from automarine_cli.effects.coulomb_drag import CREEP
from automarine_cli.exports import base
from automarine_cli.exports.vehicle import Vehicle
from automarine_cli.models.model import RESTORING

TIMESTEP_S = 0.001  # s; at 50 degrees/s a semi-implicit step is late by a twentieth of a degree
JOINT_AXES = ("1 0 0", "0 1 0", "0 0 1")
SOFTEST = 1e-4  # MuJoCo's least impedance of a constraint (mjMINIMP)
HARDENING = 2  # the law of a tether that pulls with the cube of the way as well
VERSION = "Needs MuJoCo 3.7 or newer, which reads damping and stiffness of higher order."
FREE_NOTE = "Only {0} is identified, and the joint leaves nothing else free: merge it and the actuator with your model."
STICKY = "Dry friction is as soft near rest as in automarine; without solreffriction and solimpfriction it would stick."
UPRIGHT = "Stiffness is the restoring moment as G (x - x^3/6): within 0.4 % of G sin(x) up to 45 degrees."
AXES_STAY = (
    "Joints along the axes do not turn with the hull, and added mass makes no Coriolis or Munk force: exact for one "
    "motion at a time, near enough for small angles."
)
THRUSTS = "The controls of thrusters are thrusts in N: the map makes them of signals."
HELD = "A motion without a joint is not identified and is held: merge joints and actuators with your model."
HEAVY = "Gravity is 0: weight and buoyancy are not part of the model."
MJCF_EFFECTS = (
    *base.DRAGS, "cubic-drag", "coulomb-drag", "tether-spring", "bias-moment", "thruster-lag", "input-delay",
    "saturation", "restoring-moment",
)  # fmt: skip
LACKS = {
    *(("thruster-lag", law) for law in (0, 2, 3, 4, 5)),  # filterexact is first order in the thrust
    ("coulomb-drag", 1), ("input-delay", 1), ("saturation", 1), ("tether-spring", 1),
}  # fmt: skip
"""Laws of effects that it has no counterpart for."""


def write(subject: Vehicle) -> base.Written:
    axes, joints = subject.axes, [_joint(axis) for axis in subject.axes]
    slides = sum(not axis.dof.angular for axis in axes)
    doubts = {
        STICKY: any("frictionloss" in joint for joint in joints),
        HEAVY: slides > 0, UPRIGHT: subject.diagonal(RESTORING).any(),
    }  # fmt: skip
    warnings = [doubt for doubt, applies in doubts.items() if applies]
    ordered = joints[:slides] + joints[slides:][::-1]  # yaw turns what pitches and rolls
    if subject.several:
        notes = [*subject.about_own("the rest of M is armature"), AXES_STAY, HELD, VERSION, *warnings]
        notes += [THRUSTS] if subject.thrusters else []
        lines = subject.head(*notes, coupled=False)
    else:
        axis = subject.axis
        v, drag = axis.dof.symbols.velocity, "(d0 + d1 |{0}| + d2 {0}^2) {0}, d of damping"
        equation = f"({axis.dof.words.inertia} + armature) {v}' = {axis.dof.symbols.force} - {drag.format(v)}"
        notes = [axis.about_inertia(), FREE_NOTE.format(axis.dof.name), VERSION, *warnings]
        lines = base.head(axis, equation, notes)
    places = subject.thrusters.places if subject.thrusters else ()
    up = -1.0 if subject.frame == "NED" else 1.0  # MuJoCo's y is to port
    sites = dict(zip(("thruster_port", "thruster_stbd"), (base.number(up * y) for y in places)))
    fields = {
        "head": base.comment(lines), "step": base.number(TIMESTEP_S), "mass": base.number(subject.mass),
        "moments": base.row(subject.moments),
        "joints": "".join(f"      <joint{_attributes(joint)}/>\n" for joint in ordered),
        "actuators": "".join(
            f'    <general name="{axis.force if subject.several else axis.dof.words.force}" joint="{axis.dof.name}"'
            f"{_attributes(_actuator(axis))}/>\n" for axis in axes
        ) + "".join(f'    <general name="{name}" site="{name}" gear="1 0 0 0 0 0"/>\n' for name in sites),
        "sites": "".join(f'      <site name="{name}" pos="0 {place} 0"/>\n' for name, place in sites.items()),
        "sensors": "".join(
            f'    <joint{kind} name="{f"{axis.dof.name}_{kind}" if subject.several else name.replace(" ", "_")}" '
            f'joint="{axis.dof.name}"/>\n'
            for axis in axes for kind, name in (("pos", axis.dof.words.position), ("vel", axis.dof.words.rate))
        ),
    }  # fmt: skip
    return base.Written(base.filled("mjcf", fields), tuple(notes))


def _joint(subject: base.MotionSubject) -> dict[str, str]:
    dof = subject.dof
    turned = subject.frame == "NED" and base.mirrored(dof)  # MuJoCo's z is up, its y to port
    axis = JOINT_AXES[dof.number % 3].replace("1", "-1") if turned else JOINT_AXES[dof.number % 3]
    damping = [subject.value(name) for name in (*base.DRAGS, "cubic-drag")]
    spring = subject.values.get("tether-spring", (0.0, 0.0, 0.0, 0.0))
    upright = subject.value("restoring-moment")
    stiffness = [spring[0] + upright, 0.0, (spring[3] if spring[1] == HARDENING else 0.0) - upright / 6.0]
    added = subject.inertias[1]
    return {
        "name": dof.name, "type": "hinge" if dof.angular else "slide", "axis": axis, "damping": base.row(damping),
        "armature": base.number(added) if added else "", **_friction(subject),
        "stiffness": base.row(stiffness) if any(stiffness) else "",
    }  # fmt: skip


def _friction(subject: base.MotionSubject) -> dict[str, str]:
    """Dry friction as a constraint that is soft: its force rises with the speed as our smoothed sign does, to the same
    way of stopping, integral of v coth(v/CREEP): a straight line to pi/sqrt(6) CREEP. The impedance is MuJoCo's least,
    so that the constraint answers the speed and not what pushes."""
    size = subject.value("coulomb-drag")
    if not size:
        return {}
    damping = size / (math.pi / math.sqrt(6) * CREEP * subject.model.inertia)
    soft = {"solreffriction": [-SOFTEST, -damping], "solimpfriction": [SOFTEST, SOFTEST, 0.001, 0.5, 2.0]}
    return {name: base.row(values) for name, values in {"frictionloss": [size], **soft}.items()}


def _actuator(subject: base.MotionSubject) -> dict[str, str]:
    lag, delay = subject.value("thruster-lag"), subject.value("input-delay")
    most, constant = subject.values.get("saturation", (math.inf,))[0], subject.value("bias-moment")
    attributes = {"dyntype": "filterexact", "dynprm": base.number(lag), "actearly": "true"} if lag else {}
    if delay:
        attributes |= {"delay": base.number(delay), "nsample": str(math.ceil(delay / TIMESTEP_S) + 2)}
    if math.isfinite(most):
        attributes |= {"ctrllimited": "true", "ctrlrange": base.row([-most, most])}
    return attributes | ({"biastype": "affine", "biasprm": base.row([constant, 0.0, 0.0])} if constant else {})


def _attributes(attributes: Mapping[str, str]) -> str:
    return "".join(f' {name}="{value}"' for name, value in attributes.items() if value)


TARGET = base.Target(
    name="mjcf",
    says="MuJoCo: an MJCF model, drag as damping of a joint",
    forms={"joint": ".xml"}, frames=("ENU", "NED"), carries=frozenset(MJCF_EFFECTS), lacks=frozenset(LACKS),
    write=write, several=base.Several({"joint": ".xml"}, thrusters=True),
)  # fmt: skip
