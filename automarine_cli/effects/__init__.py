"""The library of effects: every file in this folder is one; `get(name)` finds it, `names()` lists them.

Beside them stand the user's own (see `own`), and curves that a diagnosis learned, "learned:VARIABLE", which no list can
hold.
"""

import difflib
import importlib
import pkgutil
from functools import cache

from automarine_cli.effects.base import Card, Commands, Effect, Parameter, Place, State
from automarine_cli.effects.learned import PREFIX, learned
from automarine_cli.effects.own import own_effect, own_files
from automarine_cli.errors import ModelError

__all__ = [
    "Card", "Commands", "Effect", "Parameter", "Place", "State", "built_in", "get", "known", "look_alikes", "names",
]  # fmt: skip

NOT_EFFECTS = frozenset({"base", "inputs", "laws", "learned", "own"})
"""Files of this folder that hold no effect of the library."""


def names() -> tuple[str, ...]:
    """Names of all effects of the library and the user's own, sorted."""
    return tuple(sorted({*built_in(), *own_files()}))


@cache
def built_in() -> tuple[str, ...]:
    """Names of all effects in the library, sorted."""
    found = (m.name for m in pkgutil.iter_modules(__path__) if m.name not in NOT_EFFECTS)
    return tuple(sorted(name.replace("_", "-") for name in found))


def known(name: str) -> bool:
    """Whether there is an effect of that name."""
    return name in names() or (name.startswith(PREFIX) and len(name) > len(PREFIX))


@cache
def look_alikes(name: str) -> frozenset[str]:
    """Effects that one is mistaken for under any of its laws, and that are mistaken for it."""

    def named(one: str) -> set[str]:
        effect = get(one)
        return {*effect.mistaken_for, *(look for law in effect.laws for look in law.mistaken_for)}

    return frozenset(named(name) | {one for one in names() if name in named(one)}) - {name}


def get(name: str) -> Effect:
    """The effect of that name; raises ModelError with the names that there are, and the nearest ones. One of the user's
    own is run from its file."""
    if name in built_in() or name.startswith(PREFIX):
        return _of_library(name)
    own = own_files().get(name)
    if own is not None:
        return own_effect(own)
    near = difflib.get_close_matches(name.lower().replace("_", "-"), names(), n=3, cutoff=0.5)
    meant = f". Did you mean {' or '.join(near)}?" if near else ""
    raise ModelError(f"effect {name!r} is not in the library; known are {', '.join(names())}{meant}")


@cache
def _of_library(name: str) -> Effect:
    """An effect of the library, or one that was learned."""
    if name.startswith(PREFIX):
        return learned(name)
    module = importlib.import_module(f"{__name__}.{name.replace('-', '_')}")
    classes = (c for c in vars(module).values() if isinstance(c, type) and issubclass(c, Effect))
    return next(c for c in classes if vars(c).get("name") == name)()
