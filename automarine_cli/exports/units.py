"""A model told in newton metres, or newtons, where the logs' moment or force was normalised."""

from dataclasses import replace

from automarine_cli import effects
from automarine_cli.models.yaw_model import YawModel


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
