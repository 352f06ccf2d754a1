"""Checks that the specification's settings share: each raises SettingError with the key and what was expected."""

import re

from automarine_cli.errors import SettingError
from automarine_cli.pipeline.records import Record, key_of


def positive(settings: Record, *names: str) -> None:
    """Refuse a value that is not above zero (None is fine)."""
    for name in names:
        value = getattr(settings, name)
        if value is not None and value <= 0:
            raise SettingError(f"{key_of(settings, name)} is {value:g}; expected more than 0")


def at_least_zero(settings: Record, *names: str) -> None:
    """Refuse a value below zero (None is fine)."""
    for name in names:
        value = getattr(settings, name)
        if value is not None and value < 0:
            raise SettingError(f"{key_of(settings, name)} is {value:g}; expected 0 or more")


def between(settings: Record, low: float, high: float, *names: str) -> None:
    """Refuse a value outside [low, high]."""
    for name in names:
        value = getattr(settings, name)
        if not low <= value <= high:
            raise SettingError(f"{key_of(settings, name)} is {value:g}; expected {low:g} to {high:g}")


def safe_path(settings: Record, *names: str) -> None:
    """Refuse a name for files that could lead out of the result folder, or that some system cannot write."""
    for name in names:
        value = getattr(settings, name)
        if value is not None and not all(_safe(part) for part in value.split("/")):
            raise SettingError(
                f"{key_of(settings, name)} is {value!r}; expected a name of letters, digits and - + _ . (folders with "
                "/)"
            )


def _safe(part: str) -> bool:
    return re.fullmatch(r"[A-Za-z0-9+_-][A-Za-z0-9+_.-]*", part) is not None and not part.endswith(".")
