"""Work that results can do without: where it fails, a sentence says so and everything else is kept."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

from automarine_cli.errors import AutomarineError
from automarine_cli.pipeline.interrupts import struck
from automarine_cli.pipeline.words import printable

Made = TypeVar("Made")


@dataclass(frozen=True)
class Attempt(Generic[Made]):
    """What was made; or None, and a sentence that says why."""

    made: Made | None
    warning: str = ""


def attempted(failure: str, work: Callable[[], Made]) -> Attempt[Made]:
    """What `work` makes; `failure` begins the sentence on why it made nothing: "The figure drag could not be drawn".

    An interrupt and a want of memory pass: what they end is no matter of this piece of work.
    """
    try:
        return Attempt(work())
    except MemoryError:
        raise
    except Exception as problem:
        if struck():  # some libraries make another exception of an interrupt
            raise
        kind = "" if isinstance(problem, AutomarineError) else f"{type(problem).__name__}: "
        why = printable(" ".join(f"{kind}{problem}".split()).removesuffix(":"))
        return Attempt(None, f"{failure} ({why}); everything else was written.")
