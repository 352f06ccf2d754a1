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

from automarine_cli.errors import SettingError
from automarine_cli.exports.base import DRAGS, Several, Target, Written, comment, filled, head, joined, number
from automarine_cli.exports.vehicle import MOTIONS, SPEED_LETTERS, Vehicle

FLUID, DERIVATIVE = "fluid-added-mass", "added-mass-derivative"
GZ_AXES, GZ_FORCES = "xyzpqr", "xyzkmn"
RIGID_ENTRIES = ("mass", "mass", "mass", "ixx", "iyy", "izz")
"""Of the six motions: the letters of the fluid's entries and of the forces, and where their own inertia stands."""
DENSITY = 1000.0  # of LiftDrag's law; only its product with area and coefficient counts
RUDDER = "The joint rudder takes its angle [rad] from the topic /model/vehicle/joint/rudder/0/cmd_pos."
BEHIND = "No side force of it is identified: one 1 m behind the origin makes its moment; keep force times distance."
ENGINE = "the rest of M is fluid_added_mass, which needs the DART engine"


def write(subject: Vehicle) -> Written:
    """The SDF text. Raises SettingError where the added inertia would make the simulation unstable."""
    added, derivatives = subject.added, dict[str, float]()
    for drag in subject.drags:
        size = ("abs" if drag.factor.startswith("abs") else "") + drag.factor.strip("abs()").upper()
        derivatives[f"{GZ_FORCES[drag.places[0]]}{SPEED_LETTERS[drag.places[-1]].upper()}{size}"] = -drag.value
    rudder, steering = _rudder(subject)
    off = {"disable_added_mass": "true"}
    if subject.several:
        lacking = [dof.name for dof in MOTIONS if dof.number not in subject.places]
        merge = f"{joined(lacking)} {'are' if lacking[1:] else 'is'} not identified: merge" if lacking else "merge"
        merge = f"{merge.capitalize()} with the values of your model, and add its buoyancy."
        notes = (*subject.about_own(ENGINE), merge, *steering, *subject.about_water())
        lines, off = subject.head(*notes), off | {"disable_coriolis": "true"}
    else:
        axis = subject.axis
        i, v = axis.dof.number, axis.dof.symbols.velocity
        linear, dot, entry = f"{GZ_FORCES[i]}{v.upper()}", f"{GZ_FORCES[i]}Dot{v.upper()}", 2 * GZ_AXES[i]
        absolute, square = f"{linear}abs{v.upper()}", f"{linear}{v.upper()}"
        derivatives = {linear: 0.0, absolute: 0.0} | derivatives
        if subject.form == DERIVATIVE and added[i, i]:
            if added[i, i] >= (rigid := axis.inertias[0]):
                raise SettingError(
                    f"gz-sim takes <{dot}> from the last step's acceleration, which grows without bound where the "
                    f"added {axis.dof.words.inertia} ({number(added[i, i])}) is not below the rigid one "
                    f"({number(rigid)}); give --form {FLUID}"
                )
            derivatives[dot], off, added = -added[i, i], {"disable_added_mass": "false"}, 0.0 * added
        notes = (
            axis.about_inertia(),
            f"No axis but {axis.dof.name} is identified: the other entries are placeholders; merge with the values of "
            f"your model. Needs a gz-sim that reads {absolute} (since 2023) and, for fluid_added_mass, the DART "
            "engine.",
            *steering,
        )
        forces = f"{linear} {v} + {absolute} |{v}| {v} + {square} {v}^2 + {dot} {v}'"
        lines = head(axis, f"({RIGID_ENTRIES[i]} + {entry}) {v}' = {axis.force} + {forces}", notes)
    tags = {GZ_AXES[i] + GZ_AXES[j]: added[i, j] for i in range(6) for j in range(i, 6) if added[i, j]}
    entries = "".join(f"          <{tag}>{number(value)}</{tag}>\n" for tag, value in tags.items())
    settings = off | {tag: number(value) for tag, value in derivatives.items()}
    fields = {
        "rudder": rudder, "head": comment(lines), "mass": number(subject.mass),
        **dict(zip(("ixx", "iyy", "izz"), map(number, subject.moments))),
        "added": f"        <fluid_added_mass>\n{entries}        </fluid_added_mass>\n" if tags else "",
        "told": "".join(f"      <{tag}>{value}</{tag}>\n" for tag, value in settings.items()),
    }  # fmt: skip
    return Written(filled("gz-sim", fields), notes)


def _rudder(subject: Vehicle) -> tuple[str, tuple[str, ...]]:
    """The joint with its LiftDrag, and sentences on them; nothing without a rudder."""
    side, turning = (float(subject.diagonal("rudder")[place]) for place in (1, 5))
    if not (side or turning):
        return "", ()
    place, force = (turning / side, side) if side else (-1.0, -turning)
    fields = {"density": number(DENSITY), "lift": number(2.0 * force / DENSITY), "x": number(place)}
    return filled("gz-sim_rudder", fields), (RUDDER,) if side else (RUDDER, BEHIND)


TARGET = Target(
    name="gz-sim",
    says="Gazebo Sim: SDF for the Hydrodynamics system",
    forms={FLUID: ".sdf", DERIVATIVE: ".sdf"}, frames=("ENU", "NED"), write=write,
    carries=frozenset({*DRAGS, "drag-asymmetry", "rudder"}), in_plane=frozenset({"rudder"}),
    lacks=frozenset({("rudder", 1), ("rudder", 2)}), several=Several({FLUID: ".sdf"}, couples=True),
)  # fmt: skip
