"""A planar model made fit for a target: matrices in the target's frame, and what the target has no term for.

Ours: M nu' + C(nu) nu + D nu = tau with every drag positive where it resists; (u, v, r) ahead, to starboard, clockwise.
In ENU v and r, Y and N count the other way: an entry changes sign where it joins one of these with u or X.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from automarine_cli.errors import SettingError
from automarine_cli.exports.base import FRAME_AXES, Origin, Settings, Subject, Unsupported, number, refuse_part
from automarine_cli.models.model import DELAY, FORCES, VELOCITIES
from automarine_cli.models.store import StoredModels
from automarine_cli.quantities import Floats

LINEAR, QUADRATIC, CONSTANT_FORCE = "linear-drag", "quadratic-drag", "bias-moment"
ENU_SIGNS = np.array([1.0, -1.0, -1.0])
"""What a velocity or force is multiplied by from one frame to the other."""


@dataclass(frozen=True)
class PlanarSubject(Subject):
    """A model to be written: M (3, 3), `linear` (3, 3) and `quadratic` (3, 3, 3) drag, and what always acts (3,).

    Force i is -linear[i, j] nu_j - quadratic[i, k, j] |nu_k| nu_j + constant[i]; all in the `frame`. `water` is the
    current of the runs north and east [m/s]."""

    inertia: Floats
    linear: Floats
    quadratic: Floats
    constant: Floats
    water: tuple[float, float] | None

    def drags(self) -> Iterator[tuple[str, tuple[int, ...], float]]:
        """Every drag: Fossen's letters (X_uu, N_vr), places (force, along) or (force, size, along), its value."""
        for places, value in (*np.ndenumerate(self.linear), *np.ndenumerate(self.quadratic)):
            if value:
                yield f"{FORCES[places[0]]}_{''.join(VELOCITIES[j] for j in places[1:])}", places, float(value)

    def head(self) -> list[str]:
        lines = (
            "Equation: M nu' + C(nu) nu + D(nu) nu = tau, nu = (u, v, r) through the water: surge, sway, yaw.",
            f"Frame: {FRAME_AXES[self.frame]}. Units: N, N m, m/s, rad/s, kg, kg m, kg m^2.",
            "M is rigid and added inertia together; C follows from it, the Munk moment among it.",
            *map(str, self.left_out),
        )
        return self.headed(lines)

    def about_water(self) -> tuple[str, ...]:
        if self.water is None:
            return ()
        north, east = (number(value) for value in self.water)
        return (f"The runs had a current of {north} m/s north and {east} m/s east; it is no part of the vehicle.",)


def planar_subject(
    stored: StoredModels, origin: Origin, frame: str, form: str, settings: Settings, target: str
) -> PlanarSubject:
    """The model in matrices of the frame. Raises SettingError for terms they cannot hold, unless allowed; the command
    delay is left out."""
    model = stored.undelayed
    linear, quadratic, constant = np.zeros((3, 3)), np.zeros((3, 3, 3)), np.zeros(3)
    left_out: list[Unsupported] = []
    for term in model.terms:
        i = term.dof
        places = {CONSTANT_FORCE: constant[i:], LINEAR: linear[i, i:], QUADRATIC: quadratic[i, i, i:]}
        if term.is_cross:
            along = tuple(VELOCITIES.index(letter) for letter in term.name.partition("_")[2])
            (linear if len(along) == 1 else quadratic)[i, *along] += term.values[0]
        elif term.name in places:
            places[term.name][0] += term.values[0]
        else:
            name = f"{model.motion.dofs[i].name}.{term.name}"
            left_out.append(Unsupported(name, "no entry of the matrices holds it"))
    if left_out and not settings.allow_partial:
        terms_left = "; ".join(f"{term.name} ({term.why})" for term in left_out)
        remedy = "give --allow-partial to write the file without"
        raise SettingError(f"{origin.file}: {target} cannot represent {terms_left}; {remedy}")
    if stored.command_delay > 0.0:
        left_out.append(Unsupported(DELAY, f"no entry of the matrices holds its {stored.command_delay:.3g} s"))
    inertia = model.inertia_matrix(model.theta[None])[0]
    side = ENU_SIGNS if frame == "ENU" else np.ones(3)
    sides = np.outer(side, side)
    return PlanarSubject(
        origin, frame, form, settings, tuple(left_out), sides * inertia, sides * linear,
        sides[:, None] * quadratic, side * constant, model.water,
    )  # fmt: skip


def rigid_of(subject: PlanarSubject) -> tuple[float, float]:
    """The vehicle's own inertia: the mass and the yaw inertia that the user gave.

    Raises SettingError where they are lacking, or are no part of the total."""
    mass, turning = subject.settings.rigid_mass, subject.settings.rigid_inertia
    if mass is None or turning is None:
        raise SettingError(
            f"{subject.origin.file}: the identified masses hold the water that moves along; as a link's own they would "
            "weigh on the vehicle: give the vehicle's with --rigid-mass and --rigid-inertia"
        )
    (m_u, m_v, inertia) = np.diag(subject.inertia)
    for option, value, most in (("--rigid-mass", mass, min(m_u, m_v)), ("--rigid-inertia", turning, inertia)):
        refuse_part(option, value, most, subject.origin)
    return mass, turning
