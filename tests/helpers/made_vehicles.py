"""Vehicles to be controlled: made of inertia, quadratic drag, time constant of the thrust and delay."""

import numpy as np

from automarine_cli.control.targets.base import Gains, Target
from automarine_cli.control.vehicles import Vehicles
from automarine_cli.dofs import YAW
from automarine_cli.models.model import Model


def vehicle(
    inertia: float = 0.59, drag: float = 1.5, full: float = 30.0, lag: float = 0.1, delay: float = 0.05,
    count: int = 1, linear: float = 0.0,
) -> Vehicles:  # fmt: skip
    """`count` vehicles alike."""
    model = Model.base("2", inertia, [drag, linear], "N m", YAW)
    if lag:
        model = model.with_effect("thruster-lag", [lag, 1.0, full, 1.0])
    if delay:
        model = model.with_effect("input-delay", [delay])
    ones = np.ones(count)
    return Vehicles(model, np.tile(model.theta, (count, 1)), full, ones, 0.0 * ones, ones, 0.5 * ones)


def gains_of(target: Target, **changed: float) -> Gains:
    """A target's defaults with some values changed, as one set."""
    return {name: np.full((1, 1), value) for name, value in {**target.defaults, **changed}.items()}
