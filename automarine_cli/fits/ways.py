"""Does drag differ between the two ways of a translation: ahead and astern, down and up?

Both are fitted together, as their middle and half their difference, and pooled unless the difference stands out.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy import special

from automarine_cli.dofs import Dof
from automarine_cli.errors import FitError
from automarine_cli.fits.influence import degrees_of_freedom
from automarine_cli.models.yaw_model import main_drag
from automarine_cli.results.estimate import Estimate

if TYPE_CHECKING:
    from automarine_cli.fits.output_error import OutputErrorFit

LEVEL = 0.05
"""p-value below which the two ways are told apart."""


@dataclass(frozen=True)
class Ways:
    """The drag of each way (`role`, linear or quadratic, is what differs), the ratio of inertia to quadratic drag of
    each [m] where the model has one, and the test of their difference."""

    dof: Dof
    role: str
    drag: Mapping[str, Estimate]
    distance: Mapping[str, Estimate]
    p_value: float

    @property
    def parameter(self) -> str:
        """The symbol of the drag that differs."""
        return self.dof.parameters[self.role]

    @property
    def differ(self) -> bool:
        """Whether chance alone would hardly make them differ as much."""
        return self.p_value < LEVEL

    def to_json(self) -> dict[str, object]:
        """For the result file."""
        found = {way: {self.parameter: one.to_json()} for way, one in self.drag.items()}
        for way, one in self.distance.items():
            found[way][self.dof.ratio_key] = one.to_json()
        return {"differ": self.differ, "p_value": self.p_value, **found}


def by_way(fit: "Callable[[bool], OutputErrorFit]", dof: Dof, both: bool) -> "OutputErrorFit":
    """The fit with drag by way where that differs, else pooled; `fit` takes which, `both` is whether both were gone."""
    if not (dof.directional and both):
        return fit(False)
    try:
        apart = fit(True)
    except FitError:  # a model that is far off may run away with one way more than with both together
        return fit(False)
    found = ways_of(apart, dof)
    return replace(apart if found.differ else fit(False), ways=found)


def ways_of(fit: "OutputErrorFit", dof: Dof) -> Ways:
    """The drag of each way, and the test, from a fit of both: theta holds their middle and half their difference."""
    names, own, role = list(fit.estimates), dof.symbols, main_drag(fit.number)
    main = dof.parameters[role]
    i, j, of_inertia = (names.index(name) for name in (main, own.difference, own.inertia))
    middle, half, covariance = fit.estimates[main].value, fit.estimates[own.difference].value, fit.covariance
    runs, axes = len(fit.mixed.left_out), np.eye(len(fit.mixed.theta))

    def freedom(direction: np.ndarray) -> float:
        return degrees_of_freedom(fit.mixed, direction) if runs > 2 else 1.0

    drag, distance = {}, {}
    for way, sign in zip(dof.words.ways, (1.0, -1.0)):
        value, slope = (
            middle + sign * half,
            middle * axes[i] + sign * axes[j],
        )  # phi holds the logarithm of the middle
        deviation = float(np.sqrt(max(slope @ covariance @ slope, 0.0)))
        of_log = deviation / max(value, 1e-3 * middle, 1e-300)
        drag[way] = Estimate.from_log(value, of_log, freedom(slope), fit.estimates[main].unit)
        if role == "quadratic":
            ratio = axes[of_inertia] - slope / max(value, 1e-3 * middle, 1e-300)
            spread = float(np.sqrt(max(ratio @ covariance @ ratio, 0.0)))
            inertia = fit.estimates[own.inertia].value
            distance[way] = Estimate.from_log(
                inertia / max(value, 1e-3 * middle, 1e-300), spread, freedom(ratio), dof.unit_of("ratio")
            )
    error = float(np.sqrt(max(covariance[j, j], 1e-300)))
    return Ways(dof, role, drag, distance, float(2.0 * special.stdtr(freedom(axes[j]), -abs(half) / error)))
