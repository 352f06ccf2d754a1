"""Diagnoses that try a few effects, or no curves: judging the whole library is the matter of other tests, and curves,
which take more than half of the time, are that of `test_learned`."""

import contextlib
from collections.abc import Collection, Iterator

import pytest

from automarine_cli.diagnosis import diagnose, search


@contextlib.contextmanager
def few_candidates(among: Collection[str], curves: bool = True) -> Iterator[None]:
    """While the block lasts, a diagnosis in this process tries only the effects `among`, and `curves` or none."""
    every = search.candidates
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(search, "candidates", lambda *of: [name for name in every(*of) if name in among])
        if not curves:
            patch.setattr(diagnose, "learn", lambda study, found, *rest: found)
        yield
