"""The same model in the other frame, and in newton metres (or newtons) where the logs' moment or force was normalised.

ENU: yaw anticlockwise from east for clockwise from north (NED). With psi_enu = pi/2 - psi, r_enu = -r and
tau_enu = -tau, drag that is odd in the rate keeps its coefficients; a constant moment and every difference between the
two directions change their sign; what depends on the heading changes sine for cosine, since sin psi = cos psi_enu and
sin 2 psi = sin 2 psi_enu, cos 2 psi = -cos 2 psi_enu. Heave, positive down in NED and up in ENU, mirrors alike; surge
is ahead in both (`base.mirrored`).
"""

from collections.abc import Callable
from dataclasses import replace

from automarine_cli import effects
from automarine_cli.effects.base import EVEN, ODD
from automarine_cli.errors import ModelError
from automarine_cli.exports.base import mirrored
from automarine_cli.models.yaw_model import Term, YawModel

Values = tuple[float, ...]

MIXED: dict[str, Callable[[Values], Values]] = {
    # reading: pi/2 - (psi + B sin psi + C cos psi + D sin 2 psi + E cos 2 psi)
    "compass-deviation": lambda v: (-v[1], -v[0], -v[2], *v[3:]),
    "heading-moment": lambda v: (-v[1], -v[0]),
    "wall": lambda v: (-v[0], v[1], v[2], -v[3], v[4]),
    "current-deviation": lambda v: (v[0], -v[1], v[2]),
    "periodic-disturbance": lambda v: (-v[0], -v[1], *v[2:]),
    "thruster-imbalance": lambda v: v,  # a thruster is the same in any frame
}
"""Effects of which a mirror negates some parameters."""


def in_enu(model: YawModel) -> YawModel:
    """The model, given in NED, for yaw angle, rate and moment (or another motion's) in ENU; its own inverse.

    Raises ModelError for an effect whose mirror image nobody has written down here.
    """
    if not mirrored(model.dof):
        return model
    return replace(model, terms=tuple(_mirrored(term) for term in model.terms))


def _mirrored(term: Term) -> Term:
    parity = effects.get(term.name).parity
    if parity == EVEN:
        return term
    if parity == ODD:
        return replace(term, values=tuple(-value for value in term.values))
    if term.name not in MIXED:
        raise ModelError(f"effect {term.name} has no form in ENU yet; export in NED with --frame NED")
    return replace(term, values=MIXED[term.name](term.values))


def in_newton_metres(model: YawModel, newton_metres_per_nu: float) -> YawModel:
    """The same motion under moments in N m (forces in N): inertia and drag times the factor, other effects by their
    units."""
    terms = tuple(
        replace(
            term,
            values=tuple(
                parameter.scaled(value, newton_metres_per_nu)
                for parameter, value in zip(effects.get(term.name).parameters, term.values)
            ),
        )
        for term in model.terms
    )
    inertia, unit = model.inertia * newton_metres_per_nu, model.dof.units.forces[1]
    return replace(model, inertia=inertia, terms=terms, moment_unit=unit)
