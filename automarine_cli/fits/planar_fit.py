"""The fit of surge, sway and yaw together: which structure the logs ask for, its parameters, and what they rest on."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from automarine_cli.dofs.motion import PLANAR
from automarine_cli.fits.innovations import InnovationsFit
from automarine_cli.fits.known import NOTHING_KNOWN, Known
from automarine_cli.fits.output_error import run_dof
from automarine_cli.fits.planar_structure import Assumption, Observed, Structure, rough_sizes, rough_velocities
from automarine_cli.fits.planar_use import PlanarUse
from automarine_cli.models.planar import PlanarModel
from automarine_cli.models.planar_store import planar_json, units
from automarine_cli.models.tied import Tied
from automarine_cli.pipeline.records import Document, json_document
from automarine_cli.quantities import Floats
from automarine_cli.results.estimate import Estimate
from automarine_cli.results.records import runs_json
from automarine_cli.results.shown import Shown
from automarine_cli.runs.run import Run, SetAside

FULLY = 3
"""Neighbours of a structure that are fitted, at most."""
LIKELIHOOD, FORECASTS = "innovations", "forecasts"
WAYS = {LIKELIHOOD: "by the innovations of a filter", FORECASTS: "to forecasts over 5 s"}
"""How a structure is fitted."""
AS_LARGE = 0.5
"""Share of the commands from which on a disturbance may answer for what they do."""


@dataclass(frozen=True)
class Estimated:
    """What an estimator found for one model: values in `model`, `covariance` (f, f) of its free parameters.

    `log_likelihood` is that of so many `readings`; `noises` of the channels [base units], `disturbance` by degree of
    freedom and what it is (size, time constant). `random` are all sizes of what is random, by name; `fit` is what an
    estimator by innovations made of the runs.
    """

    model: Tied
    covariance: Floats = field(repr=False)
    log_likelihood: float
    readings: int
    noises: Mapping[str, float] = field(default_factory=dict)
    disturbance: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    converged: bool = True
    random: Mapping[str, float] = field(default_factory=dict, repr=False)
    fit: InnovationsFit | None = field(default=None, repr=False)

    @property
    def known(self) -> dict[str, float]:
        """Values of all parameters of the model by qualified name."""
        return dict(zip(self.model.model.parameter_names, self.model.model.theta.tolist()))

    @property
    def criterion(self) -> float:
        """Bayesian information criterion, the smaller the better; Schwarz (1978), doi 10.1214/aos/1176344136."""
        return float(-2.0 * self.log_likelihood + len(self.model.free) * np.log(max(self.readings, 2)))


class Estimator(Protocol):
    """What tells how likely models make the runs."""

    def estimate(self, model: Tied, near: Estimated | None = None) -> Estimated:
        """The model fitted, from its own values, or from what was found `near` it."""

    def gains(self, wide: Tied, near: Estimated, added: Sequence[tuple[str, ...]]) -> list[float]:
        """The gain in log likelihood to be expected of each group of free parameters of `wide` beside those of an
        estimate `near` it, of which it has the values."""

    def choose(self, tried: Sequence["Tried"]) -> "Choice":
        """What is preferred of the structures that were tried, the best one first."""


@dataclass(frozen=True)
class Tried:
    """One structure of the search, with what it came to."""

    structure: Structure
    found: Estimated

    @property
    def criterion(self) -> float:
        """That of the estimate."""
        return self.found.criterion


@dataclass(frozen=True)
class Choice:
    """What is preferred: a structure with its estimate, which of the WAYS that was made (`way`), of what `use` it is
    (None where that cannot be told), and the sentence that says why."""

    best: Tried
    way: str = LIKELIHOOD
    use: PlanarUse | None = None
    because: str = ""


def search(runs: Sequence[Run], seen: Observed, estimator: Estimator) -> tuple[Tried, ...]:
    """Structures that were tried, the best one first, then in the order of their criterion.

    From the simplest one on, those neighbours are fitted that promise most by the slope and curvature of the
    likelihood, and the best of them is taken as long as it is better.
    """
    simplest = Structure.simplest(seen)
    rough = rough_sizes(runs)
    best = Tried(simplest, estimator.estimate(simplest.model(rough)))
    tried = {str(simplest): best}
    while True:
        new = [one for one in best.structure.neighbours() if str(one) not in tried]
        chosen = [
            Tried(one, estimator.estimate(model, best.found)) for one, model in _promising(best, new, rough, estimator)
        ]
        tried |= {str(one.structure): one for one in chosen}
        better = min(chosen, key=lambda one: one.criterion, default=best)
        if better.criterion >= best.criterion:
            return tuple(sorted(tried.values(), key=lambda one: one.criterion))
        best = better


def _promising(
    best: Tried, new: Sequence[Structure], rough: Mapping[str, float], estimator: Estimator
) -> list[tuple[Structure, Tied]]:
    """The neighbours of the best structure that promise to be better, with where their fits begin.

    What a law of drag gains in place of another is at most what it gains beside it.
    """
    known = best.found.known
    models = [one.beside(known, rough) for one in new]
    added = [tuple(name for name in model.free if name not in best.found.model.free) for model in models]
    gains = estimator.gains(best.structure.widest.beside(known, rough), best.found, added)
    have, price = len(best.found.model.free), np.log(max(best.found.readings, 2))
    promised = [
        2.0 * gain - price * (len(model.free) - have) if 2.0 * gain > price * len(names) else -np.inf
        for gain, model, names in zip(gains, models, added)
    ]
    order = np.argsort(promised)[::-1][:FULLY]
    return [(new[i], models[i]) for i in order if np.isfinite(promised[i])]


@dataclass(frozen=True, repr=False)
class PlanarFit(Shown):
    """The structures that were `tried` on `runs`, the best one first, and what was the `choice`; what was set aside;
    sentences on what thrusters at their `limits` did not give; what was `known` beforehand."""

    tried: tuple[Tried, ...]
    choice: Choice
    runs: tuple[Run, ...]
    seen: Observed
    set_aside: tuple[SetAside, ...] = ()
    limits: tuple[str, ...] = ()
    known: Known = NOTHING_KNOWN

    @property
    def found(self) -> Estimated:
        """What the estimator found for the preferred structure."""
        return self.choice.best.found

    @property
    def structure(self) -> Structure:
        """The preferred structure."""
        return self.choice.best.structure

    @property
    def use(self) -> PlanarUse | None:
        """Of what use that is."""
        return self.choice.use

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
        told, found = units(self.model), {}
        for name, value, error, row in zip(names, self.model.theta.tolist(), deviation.tolist(), spread):
            if not row.any():
                continue
            freedom, positive = self._freedom(int(np.argmax(np.abs(row))))
            one = (
                Estimate.from_log(value, error / value, freedom, told[name])
                if positive
                else Estimate.from_stderr(value, error, freedom, told[name])
            )
            found[name] = replace(one, known=name in self.known.parameters, at_bound=self._at_bound(name, row))
        return found

    def _at_bound(self, name: str, row: Floats) -> bool:
        """Whether a bound stopped a parameter, or what it follows."""
        stopped = () if self.found.fit is None else self.found.fit.at_bound
        return int(np.argmax(np.abs(row))) in stopped and name not in self.known.parameters

    def _freedom(self, i: int) -> tuple[float, bool]:
        """Degrees of freedom of the variance of a free parameter, and whether it is searched on its logarithm."""
        fit = self.found.fit
        if fit is None or len(self.runs) < 2:
            return float(self.found.readings - len(self.found.model.free)), fit is not None and bool(fit.positive[i])
        return run_dof(fit, np.eye(len(fit.theta))[i]), bool(fit.positive[i])

    @property
    def because(self) -> str:
        """Why this structure, in a sentence."""
        count = len(self.tried)
        if count == 1:
            return "No other structure was tried."
        first, second = self.tried[:2]
        which = "this one" if first.structure == self.structure else f"{first.structure}"
        return (
            f"Of {count} structures {which} has the best evidence (Bayesian information criterion); the next, "
            f"{second.structure}, is {second.criterion - first.criterion:.1f} behind."
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

    def document(self, option: str) -> Document:
        """Its result file, for a command that takes a model."""
        return json_document("planar_model.json", self.to_json())

    def to_json(self) -> dict[str, object]:
        """The result file: schema automarine/planar-model/1."""
        estimates = {name: one.to_json() for name, one in self.estimates.items()}
        found = self.found
        return {
            **planar_json(self.model, estimates),
            "fitted_to": "whole runs",
            "structure": str(self.structure),
            "structure_because": self.because,
            "estimated": WAYS[self.choice.way],
            "estimated_because": self.choice.because,
            "assumptions": [asdict(one) for one in self.assumptions],
            "channels": list(self.seen.channels),
            "noises": dict(found.noises),
            "disturbance": {name: dict(one) for name, one in found.disturbance.items()},
            "random": dict(found.random),
            **({"prediction": self.use.to_json()} if self.use else {}),
            "log_likelihood": found.log_likelihood,
            "covariance": {"parameters": list(found.model.free), "matrix": found.covariance.tolist()},
            "valid_range": self.valid_range,
            "warnings": list(self.warnings),
            "runs": runs_json(len(self.runs), self.set_aside, self.runs),
        }

    @property
    def disturbed(self) -> tuple[str, ...]:
        """A sentence where what the filter takes for a disturbance is as large as the commands."""
        large = []
        for dof, inertia in zip(PLANAR.dofs, np.diagonal(self.model.inertia.matrix)):
            commands = np.concatenate([run.command_of(dof) for run in self.runs])
            usual = float(np.sqrt(np.mean(commands**2)))
            size = inertia * self.found.disturbance.get(dof.name, {}).get("size", 0.0)
            if usual > 0 and size > AS_LARGE * usual:
                unit = "N m" if dof.wraps else "N"
                large.append(f"{dof.name} {size:.3g} of {usual:.3g} {unit}")
        if not large:
            return ()
        then = (
            "Masses and inertia rest on forecasts over seconds, not on single readings."
            if self.choice.way == FORECASTS
            else "It may answer for what they do; masses and inertia are then too large."
        )
        return (f"The disturbance is more than half as large as the commands: {', '.join(large)}. {then}",)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a user must not miss."""
        found = [] if self.use is None or self.use.of_use else [self.use.sentences[0]]
        found += self.disturbed
        if not self.found.converged:
            found.append("The fit did not converge; give more or longer runs.")
        loose = [
            name
            for name, one in self.estimates.items()
            if name.partition(".")[2] in ("m_u", "m_v", "I_r") and one.stderr > 0.5 * abs(one.value)
        ]
        if loose:
            found.append(
                f"The logs hardly determine {', '.join(loose)}: the standard error is more than half the value. Add "
                "runs in which the commands change more often."
            )
        return (*found, *self.limits)
