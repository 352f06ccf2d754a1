"""The stacks that gains are designed for: every file in this folder is one; `get(name)` finds it."""

import importlib
import pkgutil

from automarine_cli.control.targets.base import Target
from automarine_cli.errors import SettingError


def names() -> tuple[str, ...]:
    """Names of all targets, sorted."""
    return tuple(
        sorted(
            m.name
            for m in pkgutil.iter_modules(__path__)
            if m.name not in ("base", "ardupilot_parts", "controller_text")
        )
    )


def get(name: str, period: float | None = None, beyond: bool = False) -> Target:
    """The target of that name with loops of `period` [s]. Raises SettingError with the names that there are."""
    if name not in names():
        raise SettingError(f"no target is called {name!r}; give one of {', '.join(names())}")
    module = importlib.import_module(f"{__name__}.{name}")
    kinds = (v for v in vars(module).values() if isinstance(v, type) and issubclass(v, Target))
    kind = next(one for one in kinds if vars(one).get("name") == name)
    if period is not None and not kind.timed:
        raise SettingError(f"{name} runs at its firmware's own rate; leave out --sample-time")
    return kind(period, beyond)
