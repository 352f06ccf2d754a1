"""What logs of vehicles' own computers share: libraries that not everybody has, directions, names of states."""

import contextlib
import importlib
import io
import warnings
from collections.abc import Iterator, Mapping
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from automarine_cli.errors import LogError
from automarine_cli.quantities import Floats


def needed(module: str, extra: str, source: str, what: str) -> ModuleType:
    """The module of a library that the extra `extra` brings. Raises LogError that says how to install it."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # theirs are none of the user's
            return importlib.import_module(module)
    except ImportError:
        raise LogError(
            f"{source}: {what} are read by {module.partition('.')[0]}, which is not installed; "
            f"say pip install 'automarine[{extra}]'"
        ) from None


@contextlib.contextmanager
def unsound_is_refused(source: str, what: str, mend: str = "copy the file again") -> Iterator[None]:
    """Whatever a library raises or prints over a damaged file becomes one LogError. An interrupt stays one."""
    try:
        quiet = io.StringIO()
        with contextlib.redirect_stdout(quiet), contextlib.redirect_stderr(quiet), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except (LogError, MemoryError):
        raise
    except Exception as problem:
        if isinstance(problem, OSError) and problem.errno is not None:
            raise
        raise LogError(f"{source}: the {what} data is damaged inside; {mend}") from None


def yaw_of(w: Floats, x: Floats, y: Floats, z: Floats) -> Floats:
    """Yaw [rad] of unit quaternions, shape (N,), from -pi to pi: the last of the turns z-y-x (Diebel 2006, eq. 290).

    NaN where there is no direction: PX4 and ROS say so by zeros or NaN.
    """
    yaw = np.arctan2(2 * (w * z + x * y), w**2 + x**2 - y**2 - z**2)
    with np.errstate(invalid="ignore"):
        return np.where(w**2 + x**2 + y**2 + z**2 > 0.5, yaw, np.nan)


def mode_names(codes: NDArray[Any], vehicle: int) -> NDArray[np.str_]:
    """Names of flight modes, shape (N,), for a MAV_TYPE; a mode without a name keeps its number."""
    if codes.dtype.kind not in "iuf":
        return codes.astype(str)
    try:
        from pymavlink.mavutil import mode_mapping_bynumber
    except ImportError:  # a log that needs no pymavlink otherwise
        return named(codes, {}, "mode {}")
    return named(codes, mode_mapping_bynumber(vehicle) or {}, "mode {}")


def named(codes: NDArray[Any], names: Mapping[int, object], other: str = "{}") -> NDArray[np.str_]:
    """The name of each code, shape (N,); one without a name keeps its number, told by `other`."""
    found, at = np.unique(codes, return_inverse=True)
    return np.array([str(names.get(int(code), other.format(int(code)))) for code in found], dtype=str)[at]


def arming(armed: NDArray[np.bool_]) -> NDArray[np.str_]:
    """`armed` or `disarmed`, shape (N,)."""
    return np.where(armed, "armed", "disarmed")
