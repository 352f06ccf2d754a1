"""What every reader of model files asks of an entry: that it is there, that it is an object, a number, finite.

`where` is the path to the entry, for the message; every refusal is a ModelError.
"""

import math
from collections.abc import Mapping

from automarine_cli.errors import ModelError
from automarine_cli.pipeline.plain_data import told

SMALLEST, LARGEST = 1e-30, 1e30  # of any number: beyond it arithmetic overflows


def object_at(data: object, where: str) -> Mapping[str, object]:
    """An object with named keys."""
    if not isinstance(data, Mapping):
        raise ModelError(f"{where}: found {told(data)}, expected an object with named keys")
    return data


def needed(data: Mapping[str, object], key: str, where: str, motion: str) -> object:
    """What stands under a key that must be there; `motion` names the fit that writes such files."""
    if key not in data:
        raise ModelError(f"{where}: key {told(key)} is missing; give a file as `automarine fit-{motion}` writes it")
    return data[key]


def number_at(data: object, where: str, motion: str) -> float:
    """A finite number: an estimate's `value`, or plain."""
    if isinstance(data, Mapping):
        where, data = f"{where}.value", needed(data, "value", where, motion)
    if isinstance(data, bool) or not isinstance(data, int | float):
        raise ModelError(f"{where}: found {told(data)}, expected a number")
    try:
        value = float(data)
    except OverflowError:
        value = math.inf
    if not math.isfinite(value):
        raise ModelError(f"{where}: found {told(data)}, expected a finite number")
    if value and not SMALLEST <= abs(value) <= LARGEST:
        raise ModelError(f"{where}: found {told(data)}, expected 0 or a size of {SMALLEST:g} to {LARGEST:g}")
    return value
