"""How long work says how far it is: a plain callable, so that no room knows about terminals."""

from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

Item = TypeVar("Item")

Progress = Callable[[str, int, int], None]
"""Called as `progress(stage, done, total)`; `done == total` ends the stage. A `total` of 0 is no stage, but a sentence
that people are to read."""


def silent(stage: str, done: int, total: int) -> None:
    """The progress that says nothing: the default everywhere outside the command line."""


def foretell(progress: Progress, what: str, seconds: float) -> None:
    if seconds >= 60.0:
        progress(f"{what} takes about {round(seconds / 60.0)} min", 0, 0)


def counted(progress: Progress, stage: str, items: Iterable[Item], total: int) -> Iterator[Item]:
    """Yield `items`, telling `progress` after each one how many of `total` are done."""
    for done, item in enumerate(items, start=1):
        yield item
        progress(stage, done, total)
