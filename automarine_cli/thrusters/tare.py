"""The load cell's zero reading."""

from dataclasses import dataclass, replace

import numpy as np

from automarine_cli.thrusters.contradictions import left_out
from automarine_cli.thrusters.points import Points


@dataclass(frozen=True)
class Tare:
    """Zero reading of the load cell, per thruster [N]: mean, standard error, whether it was subtracted."""

    value: float
    stderr: float
    readings: int
    drift: float
    subtracted: bool

    @property
    def says(self) -> str:
        """One sentence for the terminal and the report."""
        if self.readings == 0:
            return "No reading at zero command: thrust is taken as logged, without a tare."
        where = f"{self.readings} zero-command reading{'s' if self.readings > 1 else ''}"
        if self.value == 0.0:
            return f"The {where} say exactly 0 N: there is no tare."
        if not self.subtracted:
            return f"The tare of {self.value:.4g} N from {where} is within its scatter and was not subtracted."
        drift = f", drifting by {self.drift:.3g} N" if self.drift else ""
        return f"A tare of {self.value:.4g} N from {where}{drift} was subtracted."


def subtract_tare(points: Points) -> tuple[Points, Tare]:
    """Thrust with the zero reading taken off, and what it was.

    A record with its own zero readings uses them, linear in time between them; another record uses the mean
    of all. Zero plateaus of a raw series are always subtracted; single zero readings of a table only when
    their mean is over twice its standard error, because a table is usually tared already and one more noisy
    reading would then be added to every point.
    """
    zero = (points.n == 0.0) & (points.flag == "")
    if not np.any(zero):
        return points, Tare(0.0, 0.0, 0, 0.0, False)
    values = points.force[zero]
    mean = float(np.mean(values))
    raw = bool(np.all(points.raw[zero]))
    stderr = _tare_error(points, zero, raw)
    if not raw and abs(mean) <= 2.0 * stderr:
        return points, Tare(mean, stderr, len(values), 0.0, False)
    offset, drift = np.full(len(points), mean), 0.0
    for record in np.unique(points.record):
        own = zero & (points.record == record)
        if not np.any(own):
            continue
        order = np.argsort(points.when[own], kind="stable")
        knots, readings = points.when[own][order], points.force[own][order]
        here = points.record == record
        if raw:
            offset[here] = np.interp(points.when[here], knots, readings)
            drift = max(drift, float(np.ptp(readings)))
        else:
            offset[here] = np.mean(readings)
    return replace(points, force=points.force - offset), Tare(mean, stderr, len(values), drift, mean != 0.0)


def _tare_error(points: Points, zero: np.ndarray, raw: bool) -> float:
    """Standard error of the zero reading [N]: from samples, repeats, or the table's own roughness."""
    values = points.force[zero]
    if raw:
        # Between two rests a point leans on both of them, not on the mean of all.
        most = max(np.count_nonzero(zero & (points.record == number)) for number in np.unique(points.record))
        leans_on = min(most, 2) if most > 1 else len(values)
        return float(np.sqrt(np.mean(points.stderr[zero] ** 2) / leans_on))
    if len(values) >= 3:
        return float(np.std(values, ddof=1) / np.sqrt(len(values)))
    good = points.flag == ""
    order = np.argsort(points.n[good], kind="stable")
    residual = points.force[good][order] - left_out(points.n[good][order], points.force[good][order])
    rough = 1.4826 * float(np.nanmedian(np.abs(residual))) if np.any(np.isfinite(residual)) else 0.0
    # Too few levels to tell how rough the table is: half a percent of full scale.
    known = np.any(np.isfinite(residual))
    return (rough if known else 0.005 * points.full_scale) / np.sqrt(len(values))
