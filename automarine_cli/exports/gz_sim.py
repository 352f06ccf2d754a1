"""Gazebo Sim: an SDF model with the Hydrodynamics system.

The system adds to the link the torque nR r + nRabsR |r| r + nRR r^2 + nDotR r' (Fossen's derivatives: damping and
added inertia are negative); `<fluid_added_mass><rr>` adds a positive inertia inside the physics engine instead, and
then the system's own must be off. Sources: gazebosim.org/api/sim/9, class Hydrodynamics ("System Parameters") and
src/systems/hydrodynamics/Hydrodynamics.cc; sdformat.org, element inertial/fluid_added_mass (since SDF 1.10); gz-sim's
tutorial on migrating added mass to that tag, which is why it is the first form. `<nRabsR>` is what gz-sim has read
since its pull request 1888 (2023); before, `<nRR>` meant that.

The system makes nDotR r' from the last step's acceleration, so r' grows without bound where the added inertia is not
below the rigid one: r_k+1 - r_k = -(added/rigid) (r_k - r_k-1).

In the plane the system adds the forces sum_j (iJ + sum_k iJabsK |nu_k|) nu_j, i of x, y, n, J and K of U, V, R. The
engine makes the Coriolis and Munk forces of the fluid's inertia itself.
"""

from collections.abc import Mapping

import numpy as np

from automarine_cli.errors import SettingError
from automarine_cli.exports.base import DRAGS, Planar, Target, Written, YawSubject, comment, filled, head, number
from automarine_cli.exports.planar import PlanarSubject, rigid_of
from automarine_cli.models.model import FORCES, VELOCITIES

FLUID, DERIVATIVE = "fluid-added-mass", "added-mass-derivative"
AXIS_LETTERS, RIGID_ENTRIES = "xyzpqr", ("mass", "mass", "mass", "ixx", "iyy", "izz")
"""Of the six motions: the letters of the fluid's entries, and where their own inertia stands."""


def write(subject: YawSubject) -> Written:
    """The SDF text. Raises SettingError where the added inertia would make the simulation unstable."""
    rigid, added = subject.inertias
    dof, r = subject.dof, subject.dof.symbols.velocity
    letter, rate, rigid_entry = subject.force.lower(), r.upper(), RIGID_ENTRIES[dof.number]
    linear, dot, entry = f"{letter}{rate}", f"{letter}Dot{rate}", 2 * AXIS_LETTERS[dof.number]
    if subject.form == DERIVATIVE and added >= rigid:
        raise SettingError(
            f"gz-sim takes <{dot}> from the last step's acceleration, which grows without bound where the added "
            f"{dof.words.inertia} ({number(added)}) is not below the rigid one ({number(rigid)}); give --form {FLUID}"
        )
    tags = {
        linear: -subject.value("linear-drag"),
        f"{linear}abs{rate}": -subject.value("quadratic-drag"),
        f"{linear}{rate}": -subject.value("drag-asymmetry"),
        dot: -added if subject.form == DERIVATIVE else 0.0,
    }
    notes = (
        subject.about_inertia(),
        f"No axis but {dof.name} is identified: the other entries are placeholders; merge with the values of "
        f"your model. Needs a gz-sim that reads {linear}abs{rate} (since 2023) and, for fluid_added_mass, the DART "
        "engine.",
    )
    drag = f"{linear} {r} + {linear}abs{rate} |{r}| {r} + {linear}{rate} {r}^2 + {dot} {r}'"
    equation = f"({rigid_entry} + {entry}) {r}' = {subject.force} + {drag}"
    mass, moment = (1.0, rigid) if dof.angular else (rigid, 1.0)
    fluid = {entry: added} if added and subject.form == FLUID else {}
    system = {"disable_added_mass": "false" if tags[dot] else "true"}
    system |= {tag: number(value) for i, (tag, value) in enumerate(tags.items()) if value or i < 2}
    return Written(_sdf(head(subject, equation, notes), mass, moment, fluid, system), notes)


def _sdf(lines: list[str], mass: float, moment: float, fluid: Mapping[str, float], system: Mapping[str, str]) -> str:
    """The file: the link's own inertia, that of the fluid with it, and what the system is told."""
    entries = "".join(f"          <{tag}>{number(value)}</{tag}>\n" for tag, value in fluid.items())
    added = f"        <fluid_added_mass>\n{entries}        </fluid_added_mass>\n" if fluid else ""
    settings = "".join(f"      <{tag}>{value}</{tag}>\n" for tag, value in system.items())
    fields = {"head": comment(lines), "mass": number(mass), "moment": number(moment), "added": added, "told": settings}
    return filled("gz-sim", fields)


ENTRIES = (("xx", 0, 0), ("xy", 0, 1), ("xr", 0, 2), ("yy", 1, 1), ("yr", 1, 2), ("rr", 2, 2))


def write_planar(subject: PlanarSubject) -> Written:
    """The SDF text. Raises SettingError where the vehicle's own mass is not given, or a force always acts."""
    if subject.constant.any():
        wrong = "gz-sim cannot represent a force that always acts; take --to python, which can"
        raise SettingError(f"{subject.origin.file}: {wrong}")
    mass, turning = rigid_of(subject)
    added = subject.inertia - np.diag([mass, mass, turning])
    fluid = {tag: added[i, j] for tag, i, j in ENTRIES if added[i, j]}
    system = {"disable_added_mass": "true", "disable_coriolis": "true"}
    for _, (force, *letters), value in subject.drags():
        size = "".join(f"abs{VELOCITIES[place].upper()}" for place in letters[:-1])
        system[f"{FORCES[force].lower()}{VELOCITIES[letters[-1]].upper()}{size}"] = number(-value)
    notes = (
        f"Mass: {number(mass)} kg and yaw inertia {number(turning)} kg m^2 are the vehicle's own (given); the "
        "rest of M is fluid_added_mass, which needs the DART engine.",
        "Heave, roll and pitch are not identified: merge with the values of your model, and add its buoyancy.",
        *subject.about_water(),
    )
    return Written(_sdf([*subject.head(), *notes], mass, turning, fluid, system), notes)


TARGET = Target(
    name="gz-sim",
    says="Gazebo Sim: SDF for the Hydrodynamics system",
    forms={FLUID: ".sdf", DERIVATIVE: ".sdf"},
    frames=("ENU", "NED"),
    carries=frozenset({*DRAGS, "drag-asymmetry"}),
    uses=frozenset({"rigid_inertia", "rigid_mass", "newton_metres_per_nu"}),
    write=write,
    planar=Planar({FLUID: ".sdf"}, ("ENU", "NED"), write_planar),
)
