"""Simulators and papers that a model can be written for: every module here with a `TARGET` is one."""

import importlib
import pkgutil
from functools import cache

from automarine_cli.errors import SettingError
from automarine_cli.exports.base import Target

__all__ = ["Target", "get", "names"]


@cache
def _targets() -> dict[str, Target]:
    loaded = (importlib.import_module(f"{__name__}.{module.name}") for module in pkgutil.iter_modules(__path__))
    return {module.TARGET.name: module.TARGET for module in loaded if hasattr(module, "TARGET")}


def names() -> tuple[str, ...]:
    return tuple(sorted(_targets()))


def get(name: str) -> Target:
    """The target of that name; raises SettingError with the names that there are."""
    if name not in _targets():
        raise SettingError(f"--to {name}: no such target; known are {', '.join(names())}")
    return _targets()[name]
