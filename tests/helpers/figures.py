"""Figures are made in every test and saved empty, as drawing takes most of a command's time; `drawn()` draws them."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from matplotlib.figure import Figure

SAVE = Figure.savefig


def save_empty(_: Figure, *where: Any, **options: Any) -> None:
    """As `Figure.savefig`, with nothing on the figure."""
    SAVE(Figure((1, 1)), *where, **options)


@contextmanager
def empty() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "savefig", save_empty)
        yield


@contextmanager
def drawn() -> Iterator[None]:
    """Figures are saved as they are: for tests of what they show, and of the bytes that other processes write."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "savefig", SAVE)
        yield
