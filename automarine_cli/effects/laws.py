"""What effects share that nature knows under several laws: each parameter set follows its own."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from automarine_cli.effects.base import Commands
from automarine_cli.quantities import Floats

Deliver = Callable[[Commands, tuple[Floats, ...]], Floats]


def choose(law: Floats, *options: Callable[[], Floats]) -> Floats:
    """What each parameter set's law gives, in the shape to which `law` (P, ...) and the options broadcast; only options
    that some set asks for are worked out."""
    asked = np.unique(law)
    found = options[round(float(asked[0]))]()
    for one in asked[1:]:
        found = np.where(law == one, options[round(float(one))](), found)
    return found


def deliver_by_law(options: Sequence[Deliver], commands: Commands, values: tuple[Floats, ...], law: Floats) -> Floats:
    """What each parameter set's own law delivers, (P, R, M): every law sees the sets that ask for it, and no others."""
    asked = np.unique(law)
    if len(asked) == 1:
        return options[round(float(asked[0]))](commands, values)
    shape = np.broadcast_shapes(commands.force.shape, commands.length.shape, law.shape)
    delivered = np.empty(shape)
    for one in asked:
        here = np.broadcast_to(law, (shape[0], 1, 1))[:, 0, 0] == one

        def own(x: Floats, here: Floats = here) -> Floats:
            return x[here] if len(x) == len(here) else x

        part = replace(commands, force=own(commands.force), start=own(commands.start), length=own(commands.length))
        delivered[here] = options[round(float(one))](part, tuple(own(value) for value in values))
    return delivered
