"""Diagnoses that try a few effects: judging the whole library is the matter of other tests."""

import contextlib
from collections.abc import Collection, Iterator

import pytest

from automarine_cli.diagnosis import search


@contextlib.contextmanager
def few_candidates(among: Collection[str]) -> Iterator[None]:
    """While the block lasts, a diagnosis in this process tries only the effects `among`."""
    every = search.candidates
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(search, "candidates", lambda *of: [name for name in every(*of) if name in among])
        yield
