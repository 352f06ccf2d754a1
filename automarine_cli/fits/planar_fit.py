"""The fit of surge, sway and yaw together: which structure the logs ask for, its parameters, and what they rest on."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from automarine_cli.dofs.motion import PLANAR
from automarine_cli.fits.estimate import Estimate
from automarine_cli.fits.planar_structure import (
    Assumption,
    Observed,
    Structure,
    rough_sizes,
    rough_velocities,
)
from automarine_cli.models.planar import PlanarModel
from automarine_cli.models.planar_store import planar_json, units
from automarine_cli.models.tied import Tied
from automarine_cli.pipeline.shown import Shown
from automarine_cli.runs.run import Run, SetAside, readings

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Estimated:
    """What an estimator found for one model: values in `model`, `covariance` (f, f) of its free parameters.

    `log_likelihood` is that of so many `readings`; `noises` of the channels [base units], `disturbance` by degree of
    freedom and what it is (size, time constant).
    """

    model: Tied
    covariance: Floats = field(repr=False)
    log_likelihood: float
    readings: int
    noises: Mapping[str, float] = field(default_factory=dict)
    disturbance: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    converged: bool = True

    @property
    def criterion(self) -> float:
        """Bayesian information criterion, the smaller the better; Schwarz (1978), doi 10.1214/aos/1176344136."""
        return float(-2.0 * self.log_likelihood + len(self.model.free) * np.log(max(self.readings, 2)))


Estimator = Callable[[Tied, Sequence[Run], Observed], Estimated]


@dataclass(frozen=True)
class Tried:
    """One structure of the search, with what it came to."""

    structure: Structure
    found: Estimated


def search(runs: Sequence[Run], seen: Observed, estimate: Estimator) -> tuple[Tried, ...]:
    """Structures that were tried, the best one first, then in the order of their criterion.

    From the simplest one on, the best neighbour is taken as long as it is better.
    """
    rough = rough_sizes(runs)

    def judged(structure: Structure, known: Mapping[str, float]) -> Tried:
        return Tried(structure, estimate(structure.model({**rough, **known}), runs, seen))

    best = judged(Structure.simplest(seen), {})
    tried = [best]
    while True:
        model = best.found.model.model
        known = dict(zip(model.parameter_names, model.theta.tolist()))
        new = [one for one in best.structure.neighbours() if one not in [old.structure for old in tried]]
        beside = [judged(structure, known) for structure in new]
        tried += beside
        better = min(beside, key=lambda one: one.found.criterion, default=best)
        if better.found.criterion >= best.found.criterion:
            return tuple(sorted(tried, key=lambda one: one.found.criterion))
        best = better


@dataclass(frozen=True, repr=False)
class PlanarFit(Shown):
    """The structures that were `tried`, the best one first, on `runs`; what was set aside."""

    tried: tuple[Tried, ...]
    runs: tuple[Run, ...]
    seen: Observed
    set_aside: tuple[SetAside, ...] = ()

    @property
    def found(self) -> Estimated:
        """What the estimator found for the best structure."""
        return self.tried[0].found

    @property
    def structure(self) -> Structure:
        """The best structure."""
        return self.tried[0].structure

    @property
    def model(self) -> PlanarModel:
        """The identified model."""
        return self.found.model.model

    @property
    def assumptions(self) -> tuple[Assumption, ...]:
        """What stands in for what the logs do not tell."""
        return self.structure.assumptions

    @cached_property
    def estimates(self) -> dict[str, Estimate]:
        """Every parameter that was identified or follows one, by qualified name."""
        spread, names = self.found.model.spread, self.model.parameter_names
        deviation = np.sqrt(np.einsum("pf,fg,pg->p", spread, self.found.covariance, spread))
        told, free = units(self.model), self.found.readings - len(self.found.model.free)
        return {
            name: Estimate.from_stderr(value, error, free, told[name])
            for name, value, error, row in zip(names, self.model.theta, deviation, spread)
            if row.any()
        }

    @property
    def because(self) -> str:
        """Why this structure, in a sentence."""
        count = len(self.tried)
        if count == 1:
            return "No other structure was tried."
        lead = self.tried[1].found.criterion - self.found.criterion
        return (
            f"Of {count} structures this one has the best evidence (Bayesian information criterion); the next, "
            f"{self.tried[1].structure}, is {lead:.1f} behind."
        )

    @cached_property
    def valid_range(self) -> dict[str, list[float]]:
        """Smallest and largest velocity and command of the runs, by keys such as surge_m_s and force_X_N."""
        found: dict[str, list[float]] = {}
        rough = [rough_velocities(run) for run in self.runs]
        for dof in PLANAR.dofs:
            columns = [one[dof.velocity] for one in rough if dof.velocity in one]
            if columns:
                velocities = np.concatenate(columns)
                found[dof.velocity_key] = [float(np.nanmin(velocities)), float(np.nanmax(velocities))]
            commands = np.concatenate([run.command_of(dof) for run in self.runs])
            column = dof.column(dof.command, dof.units.forces[1])
            found[column] = [float(commands.min()), float(commands.max())]
        return found

    def to_json(self) -> dict[str, object]:
        """The result file: schema automarine/planar-model/1."""
        estimates = {name: one.to_json() for name, one in self.estimates.items()}
        found = self.found
        return {
            **planar_json(self.model, estimates),
            "fitted_to": "whole runs",
            "structure": str(self.structure),
            "structure_because": self.because,
            "assumptions": [asdict(one) for one in self.assumptions],
            "channels": list(self.seen.channels),
            "noises": dict(found.noises),
            "disturbance": {name: dict(one) for name, one in found.disturbance.items()},
            "log_likelihood": found.log_likelihood,
            "covariance": {"parameters": list(found.model.free), "matrix": found.covariance.tolist()},
            "valid_range": self.valid_range,
            "warnings": list(self.warnings),
            "runs": {
                "used": len(self.runs),
                "set_aside": [asdict(one) for one in self.set_aside],
                **readings(self.runs),
            },
        }

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a user must not miss."""
        found = []
        if not self.found.converged:
            found.append(
                "The search for the best parameters ended before it settled; give more or longer runs."
            )
        loose = [
            name
            for name, one in self.estimates.items()
            if name.partition(".")[2] in ("m_u", "m_v", "I_r") and one.stderr > 0.5 * abs(one.value)
        ]
        if loose:
            found.append(
                f"The logs hardly tell {', '.join(loose)}: its standard error is more than half of it. Runs in which "
                "the commands change more often would."
            )
        return tuple(found)
