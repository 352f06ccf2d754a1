"""Table 2: the inertia of each run from its velocity error and the drag of Table 1, and that of all runs."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from automarine_cli.dofs import Dof
from automarine_cli.fits.drag import DragFit, columns_of, regressors
from automarine_cli.fits.estimate import Estimate
from automarine_cli.fits.linear_mixed import solve_scaled
from automarine_cli.models.closed_form import inertia_from_velocity_error

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class InertiaTable:
    """Table 2 for one model: inertia of each run (R,), mean at each moment, overall with its interval."""

    per_run: Floats
    per_moment: Mapping[float, float]
    overall: Estimate


def inertia_table(
    moment: Floats, rate: Floats, error: Floats, drag: DragFit, moment_unit: str, dof: Dof
) -> InertiaTable | None:
    """Inertia of each run, mean at each moment and over all; standard error by the jackknife over runs, drag
    refitted.

    None where the drag has no steady rate at some moment: the least squares of model 2 may make k_rr negative.
    """
    per_run = inertia_from_velocity_error(error, *drag.acting(moment))
    levels = np.unique(moment)
    per_moment = {float(level): float(per_run[moment == level].mean()) for level in levels}
    if dof.wraps:
        left_out = _without_each(moment, rate, error, drag)
    else:
        left_out = np.array([_without(i, moment, rate, error, drag) for i in range(len(moment))])
    if not (np.all(np.isfinite(per_run)) and np.all(np.isfinite(left_out))):
        return None
    count = len(moment)
    stderr = float(np.sqrt((count - 1) / count * np.sum((left_out - left_out.mean()) ** 2)))
    overall = Estimate.from_stderr(
        float(per_run.mean()), stderr, count - 1, dof.unit_of("inertia", moment_unit)
    )
    return InertiaTable(per_run, per_moment, overall)


def _without_each(moment: Floats, rate: Floats, error: Floats, drag: DragFit) -> Floats:
    """Mean inertia (R,) without each run in turn, drag refitted: from the normal equations less one row."""
    model = drag.model
    x = regressors(rate, model, columns_of(model, drag.dof))
    unit = np.abs(x).max(axis=0)
    x = x / unit
    values = solve_scaled(x.T @ x - x[:, :, None] * x[:, None, :], x.T @ moment - x * moment[:, None]) / unit
    if model == "2":
        means = [
            np.delete(inertia_from_velocity_error(error, moment, k_r, k_rr), i).mean()
            for i, (k_rr, k_r) in enumerate(values)
        ]
        return np.array(means)
    # equations 7 and 9: inertia goes with the square of k_r, or with k_rr
    one, power = ((1.0, 0.0), 2) if model == "1" else ((0.0, 1.0), 1)
    each = inertia_from_velocity_error(error, moment, *one)
    return np.asarray((each.sum() - each) / (len(each) - 1) * values[:, 0] ** power)


def _without(i: int, moment: Floats, rate: Floats, error: Floats, drag: DragFit) -> float:
    """The same for a translation, without run `i`."""
    keep = np.arange(len(moment)) != i
    names = list(drag.estimates)
    x = regressors(rate[keep], drag.model, columns_of(drag.model, drag.dof, drag.sided))
    values = np.linalg.lstsq(x, moment[keep], rcond=None)[0]
    refitted = replace(
        drag,
        estimates={n: replace(drag.estimates[n], value=float(v)) for n, v in zip(names, values)},
    )
    return float(np.mean(inertia_from_velocity_error(error[keep], *refitted.acting(moment[keep]))))
