"""Values that a slow sensor left standing: a logger that writes faster than a sensor reads repeats the last reading."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

FEWEST = 8
"""Changes of a value that tell anything of its sensor."""
FINE = 5.0
"""A median step of so many of the smallest steps or more: two readings in a row are then hardly ever equal."""
COARSE = 2.0
"""The same below which a value that stands may as well be one that creeps."""
FEW = 0.1
"""Share of repeats below which they are chance, and cost nothing."""
BESIDE = 0.1
"""Share of changes that follow each other without a row between, up to which a coarse sensor counts as held."""


def repeats(*columns: Floats) -> Flags:
    """Which rows (N,) repeat the reading before them; `columns` (N,) come out of one sensor, NaN where it is silent.

    None where the sensor is read in every row: a coarse one may give the same number twice. Of a held one the first
    row is a repeat too, for nobody knows how old its reading is.
    """
    values = np.stack(columns)
    seen = np.all(np.isfinite(values), axis=0)
    found = np.zeros(values.shape[1], dtype=bool)
    steps = np.abs(np.diff(values[:, seen], axis=1))
    changed = np.any(steps > 0, axis=0)
    if np.count_nonzero(changed) < FEWEST or changed.mean() > 1 - FEW or not _held(steps[steps > 0], changed):
        return found
    found[seen] = np.concatenate([[True], ~changed])
    return found


def _held(sizes: Floats, changed: Flags) -> bool:
    """Whether a sensor whose steps have these `sizes` was held where it has not `changed`."""
    coarseness = float(np.median(sizes) / sizes.min())
    if coarseness >= FINE:
        return True
    spans = np.diff(np.flatnonzero(changed))
    return coarseness >= COARSE and bool(np.median(spans) >= 2 and np.mean(spans == 1) <= BESIDE)
