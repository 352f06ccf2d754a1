"""Random numbers of a campaign: one independent stream for each run and purpose, the same on every machine.

A stream is keyed by words (seed, run, purpose), so a run that is added, or a logger that loses samples, changes
no other number. Normal deviates are the inverse distribution function of uniform ones: numpy promises to keep
the uniform stream of a bit generator, not what it makes of it.
"""

import hashlib

import numpy as np
from scipy.special import ndtri

from automarine_cli.quantities import Floats

TINY = 2.0**-54  # keeps a uniform deviate off zero


def uniform(count: int, seed: int, *words: str) -> Floats:
    """Uniform deviates in [0, 1), shape (count,), of the stream with that key."""
    return _stream(seed, words).random(count)


def normal(count: int, seed: int, *words: str) -> Floats:
    """Standard normal deviates, shape (count,), of the stream with that key."""
    return np.asarray(ndtri(_stream(seed, words).random(count) + TINY))


def _stream(seed: int, words: tuple[str, ...]) -> np.random.Generator:
    key = hashlib.sha256("\0".join(words).encode()).digest()
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, int.from_bytes(key, "big")])))
