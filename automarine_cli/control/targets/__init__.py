"""The stacks that gains are designed for; `get(name)` finds one."""

from automarine_cli.control.targets.ardupilot import ArduRover, ArduSub
from automarine_cli.control.targets.base import Target
from automarine_cli.control.targets.pid import Pid
from automarine_cli.errors import SettingError

TARGETS: dict[str, type[Target]] = {target.name: target for target in (ArduRover, ArduSub, Pid)}


def get(name: str, period: float | None = None, beyond: bool = False) -> Target:
    """Return the target of that name with loops of `period` [s]. Raises SettingError with the names that there are."""
    if name not in TARGETS:
        raise SettingError(f"no target is called {name!r}; give one of {', '.join(TARGETS)}")
    if period is not None and not TARGETS[name].timed:
        raise SettingError(f"{name} runs at its firmware's own rate; leave out --sample-time")
    return TARGETS[name](period, beyond)
