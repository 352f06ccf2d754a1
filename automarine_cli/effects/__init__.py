"""The library of effects: every file in this folder is one; `get(name)` finds it, `names()` lists them.

Beside them stand effects of one's own, from entry points of installed packages (group `automarine.effects`) or added
by `register`, and curves that a diagnosis learned, "learned:VARIABLE", which no list can hold.
"""

import contextlib
import difflib
import importlib
import inspect
import pkgutil
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

from automarine_cli.effects.base import Card, Commands, Effect, Parameter, Place, State
from automarine_cli.effects.learned import PREFIX, learned
from automarine_cli.errors import ModelError

__all__ = [
    "Card", "Commands", "Effect", "Parameter", "Place", "State", "built_in", "get", "known", "look_alikes", "names",
    "own_files", "register",
]  # fmt: skip

NOT_EFFECTS = frozenset({"base", "learned"})
"""Files of this folder that hold no effect of the library."""
_REGISTERED: dict[str, Effect] = {}


def names() -> tuple[str, ...]:
    return tuple(sorted({*built_in(), *_entry_points(), *_REGISTERED}))


def register(effect: type[Effect]) -> type[Effect]:
    """Add an effect of one's own, a subclass of Effect, in this process; return it, so that it decorates a class.

    Raises ModelError where its name is taken. Worker processes see it if the module that registers it is the script
    itself, at its top level; an entry point they always see.
    """
    name = effect.name
    if name in names() or name.startswith(PREFIX):
        raise ModelError(f"effect {name!r} is in the library already; give yours a new name")
    _REGISTERED[name] = effect()
    look_alikes.cache_clear()
    return effect


@cache
def _entry_points() -> dict[str, EntryPoint]:
    """Entry points by the names of their effects, which have to be new ones."""
    return {point.name: point for point in entry_points(group="automarine.effects") if point.name not in built_in()}


def own_files() -> list[Path]:
    """Files in which effects of one's own are written, sorted; of a notebook's there are none."""
    files = set()
    for name in {*_entry_points(), *_REGISTERED}:
        with contextlib.suppress(OSError, TypeError):
            files.add(Path(inspect.getfile(type(get(name)))))
    return sorted(file for file in files if file.is_file())


@cache
def built_in() -> tuple[str, ...]:
    modules = (m.name for m in pkgutil.iter_modules(__path__) if m.name not in NOT_EFFECTS)
    return tuple(sorted(name.replace("_", "-") for name in modules))


def known(name: str) -> bool:
    return name in names() or (name.startswith(PREFIX) and len(name) > len(PREFIX))


@cache
def look_alikes(name: str) -> frozenset[str]:
    """Effects that one is mistaken for under any of its laws, and that are mistaken for it."""

    def named(effect: Effect) -> set[str]:
        return {*effect.mistaken_for, *(look for law in effect.laws for look in law.mistaken_for)}

    return frozenset(named(get(name)) | {other for other in names() if name in named(get(other))}) - {name}


def get(name: str) -> Effect:
    """The effect of that name; raises ModelError with the names that there are, and the nearest ones."""
    if name in _REGISTERED:
        return _REGISTERED[name]
    if known(name) or name.startswith(PREFIX):
        return _loaded(name)
    close = difflib.get_close_matches(name.lower().replace("_", "-"), names(), n=3, cutoff=0.5)
    meant = f". Did you mean {' or '.join(close)}?" if close else ""
    raise ModelError(f"effect {name!r} is not in the library; known are {', '.join(names())}{meant}")


@cache
def _loaded(name: str) -> Effect:
    """An effect of the library or of a package; whatever the code of a package raises is one ModelError."""
    if name.startswith(PREFIX):
        return learned(name)
    if name in built_in():
        module = importlib.import_module(f"{__name__}.{name.replace('-', '_')}")
        return next(
            kind for kind in vars(module).values() if isinstance(kind, type) and vars(kind).get("name") == name
        )()
    point = _entry_points()[name]
    try:
        effect = point.load()()
        why = "" if isinstance(effect, Effect) and effect.name == name else "expected a subclass of Effect of that name"
    except Exception as problem:
        why = f"{type(problem).__name__}: {problem}"
    if why:
        raise ModelError(f"effect {name!r} of the entry point {point.value}: {why}; correct or delete that package")
    return effect
