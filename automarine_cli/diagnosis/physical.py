"""What no vehicle does: drag that drives."""

import numpy as np

from automarine_cli import effects
from automarine_cli.effects import State
from automarine_cli.models.yaw_model import YawModel

RATES = 50
"""Rates at which drag is asked for its sign, either way round."""


def drag_drives(model: YawModel, fastest: float) -> bool:
    """Whether the drag of `model` would speed the vehicle up at some rate up to `fastest` [rad/s], either way round.

    Such a model follows the runs it was fitted to and runs away on others: the asymmetry of a quadratic drag beside
    a linear one alone, say.
    """
    rates = fastest * np.linspace(-1.0, 1.0, 2 * RATES + 1)[:, None]
    still = np.zeros_like(rates)
    state = State(still, still, rates, rates, still, still, {})
    total, sizes = still, still
    for term in model.terms:
        effect = effects.get(term.name)
        if effect.power is not None:
            values = tuple(np.full((1, 1), value) for value in term.values)
            moment = effect.moment(state, values)
            total, sizes = total + moment, sizes + np.abs(moment)
    return bool(np.any(total * rates > 1e-9 * sizes * np.abs(rates)))
