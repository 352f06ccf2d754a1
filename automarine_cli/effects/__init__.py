"""The library of effects: every file in this folder is one; `get(name)` finds it, `names()` lists them.

Beside them stand curves that a diagnosis learned, "learned:VARIABLE", which no list can hold.
"""

import difflib
import importlib
import pkgutil
from functools import cache

from automarine_cli.effects.base import Card, Commands, Effect, Parameter, Place, State
from automarine_cli.effects.learned import PREFIX, learned
from automarine_cli.errors import ModelError

__all__ = ["Card", "Commands", "Effect", "Parameter", "Place", "State", "get", "known", "names"]

NOT_EFFECTS = frozenset({"base", "learned", "own"})
"""Files of this folder that hold no effect of the library."""


def names() -> tuple[str, ...]:
    """Names of all effects in the library, sorted."""
    return tuple(
        sorted(m.name.replace("_", "-") for m in pkgutil.iter_modules(__path__) if m.name not in NOT_EFFECTS)
    )


def known(name: str) -> bool:
    """Whether there is an effect of that name."""
    return name in names() or (name.startswith(PREFIX) and len(name) > len(PREFIX))


@cache
def get(name: str) -> Effect:
    """The effect of that name; raises ModelError with the names that there are, and the nearest ones."""
    if name.startswith(PREFIX):
        return learned(name)
    if name not in names():
        near = difflib.get_close_matches(name.lower().replace("_", "-"), names(), n=3, cutoff=0.5)
        meant = f". Did you mean {' or '.join(near)}?" if near else ""
        raise ModelError(f"effect {name!r} is not in the library; known are {', '.join(names())}{meant}")
    module = importlib.import_module(f"{__name__}.{name.replace('-', '_')}")
    found = [
        c for c in vars(module).values() if isinstance(c, type) and issubclass(c, Effect) and c is not Effect
    ]
    return found[0]()
