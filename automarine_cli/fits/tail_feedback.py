"""What taking off the tails' bias adds to the uncertainty of what is read from them.

The model that says how far a line misses the steady one was found from the same tails: where they err, so does the
correction. A run's influence on the model goes round that loop, and from the model into every number of the tables.
"""

from dataclasses import dataclass

import numpy as np

from automarine_cli.fits.drag import DragFit, columns_of, sums
from automarine_cli.fits.inertia_table import InertiaTable
from automarine_cli.fits.tail_choice import Reference
from automarine_cli.fits.tails import TailLines
from automarine_cli.models.closed_form import inertia_from_velocity_error
from automarine_cli.quantities import Floats

STEP = 1e-3
"""Relative change of the model's inertia and drag by which the loop is felt."""

MOST_GAIN = 0.9
"""Of the loop: beyond it the correction hardly settles, and its uncertainty has no end."""


@dataclass(frozen=True)
class Feedback:
    """The tails when the correcting model has more inertia, or more drag, by `STEP`; influence of each run on the
    logarithms of both, once round the loop and for ever on, (R, 2)."""

    moved: tuple[TailLines, TailLines]
    influence: Floats

    def on_drag(self, moment: Floats, fit: DragFit) -> DragFit:
        """A drag fit with intervals that know of the correction."""
        values = np.array([e.value for e in fit.estimates.values()])
        slopes = [(self._values(moment, fit, tails) - values) / STEP for tails in self.moved]
        return fit.moved_by(self.influence @ np.array(slopes))

    def on_inertia(self, moment: Floats, fit: DragFit, table: InertiaTable) -> InertiaTable:
        """Table 2 for the drag of `fit` with an interval that knows of the correction."""
        slopes = []
        for tails in self.moved:
            acting = fit.acting_with(moment, self._values(moment, fit, tails).tolist())
            mean = inertia_from_velocity_error(tails.error, *acting).mean()
            slopes.append((mean - table.overall.value) / STEP)
        return table.moved_by(self.influence @ np.array(slopes))

    @staticmethod
    def _values(moment: Floats, fit: DragFit, tails: TailLines) -> Floats:
        return sums(moment, tails.rate, fit.variance, fit.model, columns_of(fit.model, fit.dof, fit.sided)).solve()[0]


def feedback(model: Reference, raw: TailLines, time: Floats) -> Feedback:
    """Of the model that corrects the `raw` tails (lines as they are)."""
    here, influence = model.read(model.steady(raw, time))
    factors = ((1.0 + STEP, 1.0), (1.0, 1.0 + STEP))
    moved = tuple(model.moved(*factor).steady(raw, time) for factor in factors)
    loop = np.stack([(model.read(tails)[0] - here) / STEP for tails in moved], axis=1)
    gain = float(np.abs(np.linalg.eigvals(loop)).max())
    loop *= min(1.0, MOST_GAIN / max(gain, MOST_GAIN))
    return Feedback((moved[0], moved[1]), influence @ np.linalg.inv(np.eye(2) - loop).T)
