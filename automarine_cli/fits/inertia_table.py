"""Table 2: the inertia of each run from its velocity error and the drag of Table 1, and that of all runs."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from automarine_cli.dofs import Dof
from automarine_cli.fits.drag import DragFit, columns_of, regressors, sums
from automarine_cli.fits.linear_mixed import solve_scaled
from automarine_cli.fits.tails import TailLines
from automarine_cli.models.closed_form import inertia_from_velocity_error
from automarine_cli.quantities import Floats
from automarine_cli.results.estimate import Estimate


@dataclass(frozen=True)
class InertiaTable:
    """Table 2 for one model: inertia of each run (R,), mean at each moment, overall with its interval, and the
    influence of each run on it (R,)."""

    per_run: Floats
    per_moment: Mapping[float, float]
    overall: Estimate
    influence: Floats

    def moved_by(self, influence: Floats) -> "InertiaTable":
        """The same with an interval that knows of this influence of the runs (R,) on the inertia beside its own."""
        total = self.influence + influence
        stderr = float(np.sqrt(total @ total))
        overall = Estimate.from_stderr(self.overall.value, stderr, len(total) - 1, self.overall.unit)
        return replace(self, overall=overall, influence=total)


def inertia_table(moment: Floats, tails: TailLines, drag: DragFit, moment_unit: str, dof: Dof) -> InertiaTable | None:
    """Inertia of each run, mean at each moment and over all; standard error by the jackknife over runs, drag
    refitted.

    None where the drag has no steady rate at some moment: the least squares of model 2 may make k_rr negative.
    """
    error = tails.error
    per_run = inertia_from_velocity_error(error, *drag.acting(moment))
    levels = np.unique(moment)
    per_moment = {float(level): float(per_run[moment == level].mean()) for level in levels}
    left_out = _without_each(moment, error, drag, _refitted(moment, tails.rate, drag))
    if not (np.all(np.isfinite(per_run)) and np.all(np.isfinite(left_out))):
        return None
    count = len(moment)
    influence = np.sqrt((count - 1) / count) * (left_out.mean() - left_out)
    stderr = float(np.sqrt(influence @ influence))
    overall = Estimate.from_stderr(float(per_run.mean()), stderr, count - 1, dof.unit_of("inertia", moment_unit))
    return InertiaTable(per_run, per_moment, overall, influence)


def _refitted(moment: Floats, rate: Floats, drag: DragFit) -> Floats:
    """Drag (R, p) without each run in turn: from the normal equations less one run."""
    columns = columns_of(drag.model, drag.dof, drag.sided)
    unit = np.abs(regressors(rate, drag.model, columns)).max(axis=0)
    every = sums(moment, rate, drag.variance, drag.model, columns)
    squares, products = every.squares / (unit[:, None] * unit), every.products / unit
    return solve_scaled(squares.sum(axis=0) - squares, products.sum(axis=0) - products) / unit


def _without_each(moment: Floats, error: Floats, drag: DragFit, refitted: Floats) -> Floats:
    """Mean inertia (R,) without each run in turn, by the drag refitted without it, (R, p)."""
    columns = columns_of(drag.model, drag.dof, drag.sided)
    if len(columns) == 1:  # equations 7 and 9: inertia goes with the square of linear drag, or with quadratic drag
        one, power = ((1.0, 0.0), 2) if columns == ("linear",) else ((0.0, 1.0), 1)
        each = inertia_from_velocity_error(error, moment, *one)
        return np.asarray((each.sum() - each) / (len(each) - 1) * refitted[:, 0] ** power)
    means = []
    for i, values in enumerate(refitted):
        keep = np.arange(len(moment)) != i
        acting = drag.acting_with(moment[keep], values.tolist())
        means.append(float(np.mean(inertia_from_velocity_error(error[keep], *acting))))
    return np.array(means)
