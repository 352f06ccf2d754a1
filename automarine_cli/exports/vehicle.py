"""A vehicle made fit for a target: the models of one motion or several in the target's frame, with what couples them.

Ours: M nu' + C(nu) nu + D(nu) nu + g = tau with every drag positive where it resists, nu = (u, v, w, p, q, r). C is
that of M (Fossen 2021, Handbook of Marine Craft Hydrodynamics and Motion Control, sections 3.3 and 6.3). In ENU what is
not along x or about it counts the other way: an entry changes sign where it joins one of these with one that is.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from automarine_cli.dofs import DOFS, PLANAR
from automarine_cli.effects.rudder_offset import RudderOffset
from automarine_cli.effects.rudder_race import RudderRace
from automarine_cli.exports.base import FRAME_AXES, MapSubject, MotionSubject, Subject, head, joined, mirrored, number
from automarine_cli.models.model import CONSTANT, INERTIA_COUPLINGS, RESTORING, Model
from automarine_cli.quantities import STEERED, Floats

SPEED_LETTERS = "uvwpqr"
PLANES = [dof.number for dof in PLANAR.dofs]
MOTIONS = tuple(sorted(DOFS.values(), key=lambda dof: dof.number))
FRAME_SIGNS = {"NED": np.ones(6), "ENU": np.array([-1.0 if mirrored(dof) else 1.0 for dof in MOTIONS])}
"""What a velocity or force is multiplied by from NED to a frame."""
DAMPING = {
    "linear-drag": ("{0}", "", "linear drag"),
    "quadratic-drag": ("{0}{0}", "abs({0})", "quadratic drag"),
    "cubic-drag": ("{0}{0}{0}", "{0} * {0}", "cubic drag"),
    "drag-asymmetry": ("{0}2", "{0}", "asymmetric drag"),
    "linear-drag-asymmetry": ("abs{0}", "sign({0})", "asymmetric drag"),
}
"""Effects that are entries of D: letters after the force's, factor beside the velocity, meaning."""
MATRIX_EFFECTS = frozenset({*DAMPING, CONSTANT, RESTORING})
RUDDER_LAWS = frozenset({"rudder", "rudder-drag", "rudder-inflow", "cross-coupling"})
RACE, OFFSET = RudderRace.name, RudderOffset.name
STEERING = RUDDER_LAWS | {RACE, OFFSET}
"""Effects that `Vehicle.steering` has: forces by the rudder and the speed ahead, and the rudder's neutral."""
COUPLINGS = "couplings"


@dataclass(frozen=True, order=True)
class Drag:
    """An entry of D: the force at the first of `places` is -value factor(nu) times the velocity at the last; the factor
    is written alike in all languages. Sorted as files list them."""

    rank: int
    places: tuple[int, ...]
    name: str
    factor: str
    value: float
    meaning: str


@dataclass(frozen=True)
class Vehicle(Subject):
    """One motion, or `several` together: `axes` in the order of the six, `couplings` the entries of M off its diagonal
    (6, 6), `crossed` the drags by others' velocities; `water` is the current of the runs north and east [m/s]."""

    axes: tuple[MotionSubject, ...]
    several: bool = False
    couplings: Floats | None = None
    crossed: tuple[Drag, ...] = ()
    water: tuple[float, float] | None = None
    thrusters: MapSubject | None = None

    @property
    def axis(self) -> MotionSubject:
        """The only motion."""
        (axis,) = self.axes
        return axis

    @property
    def places(self) -> list[int]:
        return [axis.dof.number for axis in self.axes]

    def diagonal(self, effect: str) -> Floats:
        """The values of an effect's first parameter in all six motions, (6,), zero where there is none."""
        return self._placed(axis.value(effect) for axis in self.axes)

    @property
    def rigid(self) -> Floats:
        """What is the vehicle's own of each inertia, (6,)."""
        return self._placed(axis.inertias[0] for axis in self.axes)

    @property
    def added(self) -> Floats:
        """The rest of M, (6, 6)."""
        off = np.zeros((6, 6)) if self.couplings is None else self.couplings
        return off + np.diag(self._placed(axis.inertias[1] for axis in self.axes))

    @property
    def inertia(self) -> Floats:
        """M, (6, 6): rigid and added inertia together."""
        return self.added + np.diag(self.rigid)

    def _placed(self, values: Iterable[float]) -> Floats:
        every = np.zeros(6)
        every[self.places] = list(values)
        return every

    @property
    def mass(self) -> float:
        """The vehicle's mass; one where no translation is identified."""
        usual = self.settings.rigid_mass or 1.0
        return next((axis.inertias[0] for axis in self.axes if not axis.dof.angular), usual)

    @property
    def moments(self) -> list[float]:
        """Its inertia about the three axes; where one is not identified the largest of the others, or one."""
        identified = {axis.dof.number: axis.inertias[0] for axis in self.axes if axis.dof.angular}
        return [identified.get(place, max(identified.values(), default=1.0)) for place in (3, 4, 5)]

    @property
    def drags(self) -> list[Drag]:
        """Every entry of D."""
        entries = list(self.crossed)
        for axis in self.axes:
            i, v = axis.dof.number, axis.dof.symbols.velocity
            for rank, (effect, (letters, factor, meaning)) in enumerate(DAMPING.items()):
                if value := axis.value(effect):
                    places, name = (i,) * (1 + min(rank + 1, 2)), f"{axis.force}_{letters.format(v)}"
                    entries.append(Drag(rank, places, name, factor.format(v), value, meaning))
        return sorted(entries)

    def steering(self, rudder: str, thrust: str) -> Iterator[tuple[int, str, float, str, str]]:
        """Motion, name, value, factor and meaning of each force by the angle `rudder`, the speed ahead and the `thrust`
        ahead: the force is the value times the factor, which Python and MATLAB write alike but for ** and ^."""
        neutral = sum(axis.values[OFFSET][0] for axis in self.axes if OFFSET in axis.values)
        squared, angle = "u * abs(u)", f"({rudder} + {number(neutral)})" if neutral else rudder
        for axis in self.axes:
            i, force, values, size = axis.dof.number, axis.force, axis.values, axis.settings.newton_metres_per_nu
            if axis.file is not None and axis.file.force_unit == STEERED and size is not None:
                race, usual = values.get("rudder-inflow", (1.0, 1.0))
                mixed = f" * ({number(race)} + {number((1.0 - race) / usual**2)} * {squared})"
                inflow = mixed if race != 1.0 else ""
                yield i, f"{force}_DELTA", size, f"{angle}{inflow}", "by the angle of the rudder"
            if "rudder" in values:
                value, law, race = values["rudder"]
                inflow = {0: f" * {squared}", 1: f" * ({squared} + {number(race)})"}.get(round(law), "")
                yield i, f"{force}_DELTA", value, f"{angle}{inflow}", "by the angle of the rudder"
            if RACE in values:
                meaning = "by the angle of the rudder and the thrust"
                yield i, f"{force}_DELTAX", values[RACE][0], f"{angle} * {thrust}", meaning
            if "rudder-drag" in values:
                factor = f"{angle}**2 * {squared}"
                yield i, f"{force}_DELTADELTA", -values["rudder-drag"][0], factor, "drag of the rudder"
            if "cross-coupling" in values:
                yield i, f"{force}_UR", values["cross-coupling"][0], "u * r", "coupling with the speed ahead"

    @property
    def not_identified(self) -> list[str]:
        """Motions that none of the models is of; COUPLINGS without a planar model."""
        lacking = [dof.name for dof in MOTIONS if dof.number not in self.places]
        return [*lacking, COUPLINGS] if self.couplings is None else lacking

    def head(self, *notes: str, coupled: bool = True) -> list[str]:
        """What the file of several motions begins with; `coupled` where the target has C."""
        letters = ", ".join(axis.dof.symbols.velocity for axis in self.axes)
        munk = "; C follows from it, the Munk moment among it" if coupled else ""
        c_nu, g = " + C(nu) nu" if coupled else "", " + g" if self.diagonal(RESTORING).any() else ""
        return self.headed((
            f"Equation: M nu'{c_nu} + D(nu) nu{g} = tau, nu = ({letters}) through the water: "
            f"{', '.join(axis.dof.name for axis in self.axes)}.",
            f"Frame: {FRAME_AXES[self.frame]}. Units: N, N m, m/s, rad/s, kg, kg m, kg m^2.",
            f"M is rigid and added inertia together{munk}.",
            *map(str, self.left_out), *self.about_lacking(), *notes,
        ))  # fmt: skip

    def matrix_head(self, remainder: str, law: str, inertia: str) -> tuple[list[str], ...]:
        """Head and notes of a file with vectors and matrices of all six motions: of several, the `remainder` of M is
        what stands beside their own part; of one, its `law` with {entry} ("mass", or `inertia`), {r} and {force}."""
        if self.several:
            entries = "Entries of motions that are not identified are placeholders: merge with your model, and add its"
            notes = [*self.about_own(f"the rest of M is {remainder}"), f"{entries} buoyancy."]
            return self.head(*notes), notes
        axis, entry = self.axis, inertia if self.axis.dof.angular else "mass"
        entries = f"Only {axis.dof.name} is identified: all other entries are placeholders; merge with your model."
        notes = [axis.about_inertia(), entries]
        return head(axis, law.format(entry=entry, r=axis.dof.symbols.velocity, force=axis.force), notes), notes

    def about_lacking(self) -> tuple[str, ...]:
        """The sentence on what no file was of, where the vehicle was put together from files."""
        thrusters = [f"Thrusters: {self.thrusters.about_places()}."] if self.thrusters else []
        return (f"Not identified: {', '.join(self.not_identified)}.", *thrusters) if len(self.origins) > 1 else ()

    def about_own(self, remainder: str) -> tuple[str, ...]:
        """Sentences on what of M is the vehicle's own, and where the `remainder` of it stands."""
        stated = [] if all(axis.dof.angular for axis in self.axes) else [f"{number(self.mass)} kg"]
        turns = [axis for axis in self.axes if axis.dof.angular]
        rigid = [axis for axis in turns if axis.settings.rigid_inertia is not None]
        stated += [f"{axis.dof.name} inertia {number(axis.inertias[0])} kg m^2" for axis in rigid]
        mass = f"Mass: {joined(stated)}" if len(turns) < len(self.axes) else joined(stated).capitalize()
        first = f"{mass} {'are' if len(stated) > 1 else 'is'} the vehicle's own (given); {remainder}."
        total = [axis.about_inertia() for axis in turns if axis not in rigid]
        return (*([first] if stated else []), *total)

    def about_water(self) -> tuple[str, ...]:
        if self.water is None:
            return ()
        north, east = (number(value) for value in self.water)
        return (f"The runs had a current of {north} m/s north and {east} m/s east; it is no part of the vehicle.",)


def planar_couplings(model: Model, frame: str) -> dict[str, Any]:
    """What couples the motions of a planar model, in the frame, as a `Vehicle` has it: `couplings` and `crossed`."""
    side = FRAME_SIGNS[frame]
    couplings, crossed = np.zeros((6, 6)), []
    for (i, j, _), value in zip(INERTIA_COUPLINGS.values(), model.masses[len(PLANES) :]):
        a, b = PLANES[i], PLANES[j]
        couplings[a, b] = couplings[b, a] = side[a] * side[b] * value
    for term in model.terms:
        if term.is_cross and term.values[0]:
            i = PLANES[term.dof]
            *size, j = (SPEED_LETTERS.index(letter) for letter in term.name.partition("_")[2])
            value = float(side[i] * side[j] * term.values[0])
            factor = f"abs({SPEED_LETTERS[size[0]]})" if size else ""
            crossed.append(Drag(len(size), (i, *size, j), term.name, factor, value, "coupling"))
    return {"couplings": couplings, "crossed": tuple(crossed)}
