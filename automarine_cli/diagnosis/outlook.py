"""How well driven runs are predicted before and after effects were added, and whether runs held out bear these out."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from automarine_cli.diagnosis.study import JUDGED, Study
from automarine_cli.diagnosis.trials import Trial
from automarine_cli.dofs import Dof
from automarine_cli.filters.prediction import Predicted
from automarine_cli.fits.innovations import InnovationsFit

DECIDING = 5.0
"""Horizons [s] up to this have a veto. Over longer ones the logged command answers disturbances that a prediction does
not know."""


@dataclass(frozen=True)
class Ahead:
    """Root mean square errors of positions predicted `horizon` seconds ahead from the filtered state [rad or m]."""

    horizon: float
    before: float
    after: float
    constant_rate: float
    constant: float

    def to_json(self, dof: Dof) -> dict[str, float]:
        """The contract's form, in the unit in which people see positions."""
        key = dof.units.key
        return {
            "horizon_s": self.horizon,
            f"before_{key}": float(dof.shown(self.before)),
            f"after_{key}": float(dof.shown(self.after)),
            f"constant_rate_{key}": float(dof.shown(self.constant_rate)),
            f"constant_{dof.words.position}_{key}": float(dof.shown(self.constant)),
        }


@dataclass(frozen=True)
class Outlook:
    """What both models predict of a set of runs, by horizon, and what the log density of these runs gained."""

    ahead: tuple[Ahead, ...]
    density_gain: float

    @property
    def judged(self) -> Ahead | None:
        """Over the horizon that shows the gap."""
        return next((one for one in self.ahead if one.horizon == JUDGED), None)

    def doubt(self, dof: Dof) -> str:
        """Why runs that were not fitted do not bear the effects out; empty where they do."""
        if self.density_gain <= 0:
            return f"their log density falls by {-self.density_gain:.1f}"
        deciding = [one for one in self.ahead if one.horizon <= DECIDING]
        if not deciding or deciding[-1].after < deciding[-1].before:
            return ""
        one, unit = deciding[-1], dof.units.shown
        return (
            f"predictions {one.horizon:g} s ahead miss by {dof.shown(one.after):.2f} {unit} with them and by "
            f"{dof.shown(one.before):.2f} without"
        )

    def to_json(self, dof: Dof) -> dict[str, object]:
        """The horizon that shows the gap, and all of them."""
        judged = self.judged or self.ahead[-1]
        every = [one.to_json(dof) for one in self.ahead]
        return {**judged.to_json(dof), "log_density_gain": self.density_gain, "horizons": every}


def outlook(study: Study, base: Trial, final: Trial) -> Outlook | None:
    """The outlook on the runs of `study`, which need not have been fitted; None for runs that are not driven, or too
    short for any prediction."""
    first, last = base.fit, final.fit
    if not (isinstance(first, InnovationsFit) and isinstance(last, InnovationsFit)):
        return None
    before, after = study.predictions(base.model, first), study.predictions(final.model, last)
    gained = study.log_density(final.model, last) - study.log_density(base.model, first)
    return outlook_of(before, after, float(np.sum(gained)))


def outlook_of(before: Sequence[Predicted], after: Sequence[Predicted], density_gain: float) -> Outlook | None:
    """The outlook of predictions over each horizon of so many runs; None where there are none."""
    pairs = [(b, a) for b, a in zip(before, after) if len(b.error)]
    if not pairs:
        return None
    ahead = tuple(Ahead(b.horizon, b.rmse(), a.rmse(), b.rmse(b.constant_rate), b.rmse(b.constant)) for b, a in pairs)
    return Outlook(ahead, density_gain)
