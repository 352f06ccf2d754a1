"""Libraries that only some formats need: imported when such a log is read, kept quiet while they read."""

import contextlib
import importlib
import io
import warnings
from collections.abc import Iterator
from types import ModuleType

from automarine_cli.errors import LogError


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
