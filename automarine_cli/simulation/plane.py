"""Kinematics and Coriolis force of motion in the plane of the water: surge u, sway v and yaw rate r.

Axes of SNAME (1950): x ahead and north, y to starboard and east, z down, so that yaw is positive clockwise seen from
above. Source: Fossen (2021), Handbook of Marine Craft Hydrodynamics and Motion Control, second edition, chapters 2, 3
and 6.
"""

from collections.abc import Callable, Sequence

import numpy as np

from automarine_cli.quantities import Floats


def product_with(matrices: Floats) -> Callable[[Sequence[Floats] | Floats], list[Floats]]:
    """What multiplies vectors (3, P, R) by matrices (P, 3, 3). Entries that are zero in every set cost nothing: most
    hulls couple few motions, and numpy's own products of so small matrices are several times slower."""
    rows = [
        [(j, np.ascontiguousarray(matrices[:, i, j, None])) for j in range(3) if matrices[:, i, j].any()]
        for i in range(3)
    ]

    def product(vectors: Sequence[Floats] | Floats) -> list[Floats]:
        return [np.asarray(sum(entry * vectors[j] for j, entry in row)) for row in rows]

    return product


def turning_of(momentum: Sequence[Floats], velocity: Floats) -> tuple[Floats, Floats, Floats]:
    """Coriolis and centripetal force C(nu) nu [N, N, N m], each (P, R), of velocities (3, P, R) with momentum p = M nu.

    It is (-p_y r, p_x r, p_y u - p_x v): the axes turn with the vehicle (Fossen 2021, chapter 3 for the rigid body,
    chapter 6 for added mass). It does no work. The last entry holds (m_v - m_u) u v, the moment that keeps a vehicle on
    an oblique course: the water's own, the Munk moment, is its opposite and turns it broadside.
    """
    along, abeam, _ = momentum
    u, v, r = velocity
    return -abeam * r, along * r, abeam * u - along * v


def in_earth_axes(velocity: Floats, heading: Floats) -> Floats:
    """Rates of north, east [m/s] and heading [rad/s] of velocities in the vehicle's axes, both (3, P, R)."""
    u, v, r = velocity
    cosine, sine = np.cos(heading), np.sin(heading)
    return np.stack([cosine * u - sine * v, sine * u + cosine * v, r])


def in_body_axes(current: Floats, heading: Floats) -> Floats:
    """A current (2, P, 1) north and east [m/s] in the vehicle's axes at `heading` (..., P, R): its part of the
    velocities over ground, (3, ..., P, R)."""
    north, east = current
    cosine, sine = np.cos(heading), np.sin(heading)
    return np.stack([cosine * north + sine * east, cosine * east - sine * north, np.zeros_like(heading)])
