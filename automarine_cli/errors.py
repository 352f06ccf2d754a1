"""Everything automarine refuses, one class a room; the command line turns each into one line and exit status 1.

A message is one clear sentence: where (file, row, column), what was found, what was expected, what to do. What to do
is a clause that begins with a verb; for a value that a person wrote, what was expected in its place may say it.
"""

import contextlib
import errno
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path


class AutomarineError(Exception):
    """Root of all refusals; never raised itself."""


class LogError(AutomarineError):
    """A log or a column map that cannot be read right."""


class RunError(AutomarineError):
    """Unusable runs: too few left, or a run that was named and cannot be used."""


class TooFewRunsError(RunError):
    """Too few runs for what was asked of them: more would have to be made."""


class SettingError(AutomarineError):
    """A recipe, specification or option value that makes no sense."""


class ModelError(AutomarineError):
    """A model or thruster map that cannot be loaded, or an effect that does not exist."""


class FitError(AutomarineError):
    """A fit whose data cannot carry it."""


class OutputError(AutomarineError):
    """Results that cannot or must not be written."""


@dataclass(frozen=True)
class ExcludedRun:
    """A run that was left out, and why: goes to standard error and into every result."""

    file: str
    run: str
    why: str


@contextlib.contextmanager
def one_sentence(out: Path) -> Iterator[None]:
    """Turn trouble with the disk into an OutputError."""
    try:
        yield
    except OSError as problem:
        reason = problem.strerror or type(problem).__name__
        room = ", or make room" if problem.errno in (errno.ENOSPC, errno.EDQUOT) else ""
        raise OutputError(
            f"results cannot be written to {out}: {reason[:1].lower()}{reason[1:]}; nothing was changed there. "
            f"Choose another folder with -o{room}"
        ) from None
