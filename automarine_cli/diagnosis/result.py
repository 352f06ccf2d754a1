"""What a diagnosis found, of one motion, of the plane or of a thruster map: verdicts, effects, gaps, and its files."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from automarine_cli.diagnosis.residual_regions import Region, ResidualRegions
from automarine_cli.diagnosis.search import STANDS
from automarine_cli.diagnosis.study import HORIZON, LimitCycle
from automarine_cli.dofs import YAW, Dof
from automarine_cli.dofs.motion import Motion
from automarine_cli.estimate import Estimate
from automarine_cli.filters.kalman import Predicted
from automarine_cli.fits.driven import ForecastScore, worth_of
from automarine_cli.fits.innovations import channels_json
from automarine_cli.fits.stepwise import NamedRival
from automarine_cli.models.store import DIAGNOSIS
from automarine_cli.pipeline.records import Document, Shown, json_document
from automarine_cli.quantities import Floats
from automarine_cli.runs.channels import NOTHING_TO_CHOOSE, ChannelChoice
from automarine_cli.runs.run import ExcludedRun, Run, runs_json
from automarine_cli.thrusters.fit import value_json

NAMED, SUSPECTED, NOTHING, UNEXPLAINED = "named", "suspected", "nothing-missing", "unexplained"
LEFT_OVER = 0.3  # share of the excess variance over the floor that may stay when an effect is named
ASTRAY = 1.1  # growth of the gap on runs held out at which an explanation cannot be right
EVEN = 0.5  # weight against its rivals below which an effect is a tie and no name


@dataclass(frozen=True)
class Gap:
    """Root mean square of measured less modelled, before and after, and the noise estimated without a model.

    Of motions over all samples of a set of runs, with `residuals` (R, N) [rad] before and after, zero in the padding;
    or of predictions over one `horizon` [s], at `time` (R, N). Each run's own start heading, start rate, thrust gain
    and switch instants are taken at their posterior means: what is left is what the model lacks, and noise. Of free
    runs from the commands alone, in the unit that people see, with `ci95` over runs: infinite of a model that
    diverges."""

    before: float
    after: float
    floor: float
    residuals: tuple[Floats, ...] = ()
    horizon: float | None = None
    ci95: tuple[tuple[float, float] | None, ...] = ()
    time: Floats | None = None

    @property
    def exceeds_noise(self) -> bool:
        return self.after > STANDS * self.floor

    @property
    def closed(self) -> float:
        """Share of the mean square above the noise that is gone."""
        return (self.before**2 - self.after**2) / max(self.before**2 - self.floor**2, 1e-24)

    def little(self, least: float) -> str:
        """Say how little of what stands above the noise is gone; empty from the share `least`."""
        if self.before <= STANDS * self.floor or self.closed >= least:
            return ""
        closed = 100.0 * max(self.closed, 0.0)
        return f"closes {closed:.0f} % of the held-out error above the noise: a name takes {100 * least:.0f} %."

    @property
    def in_noises(self) -> str:
        floor = max(self.floor, 1e-12)
        return f"{self.after / floor:.1f} times the noise, and was {self.before / floor:.1f} times"

    def to_json(self, unit: str, convert: Callable[[float], float] = float) -> dict[str, object]:
        sizes = {"before": self.before, "after": self.after, "noise_floor": self.floor}
        return {
            **{f"{name}_{unit}": float(convert(x)) if np.isfinite(x) else None for name, x in sizes.items()},
            **{f"{name}_ci95": ends and list(ends) for name, ends in zip(sizes, self.ci95)},
            **({} if self.horizon is None else {"horizon_s": self.horizon}),
        }


@dataclass(frozen=True)
class ForecastGain:
    """What both models predict of a set of runs, the scores before and after by horizon, and what the log density of
    these runs gained."""

    ahead: tuple[tuple[ForecastScore, ForecastScore], ...]
    density_gain: float

    @property
    def judged(self) -> tuple[ForecastScore, ForecastScore] | None:
        return next((pair for pair in self.ahead if pair[0].horizon == HORIZON), None)

    @property
    def longest(self) -> tuple[ForecastScore, ForecastScore]:
        return self.judged or self.ahead[-1]

    def to_json(self, dof: Dof) -> dict[str, object]:
        def entry(before: ForecastScore, after: ForecastScore) -> dict[str, object]:
            constants = {"constant_rate": before.constant_rate, f"constant_{dof.words.position}": before.constant}
            sizes = {"before": before.error, "after": after.error, **constants}
            errors = {f"{name}_{dof.units.shown}": float(dof.shown(size)) for name, size in sizes.items()}
            return {"horizon_s": before.horizon, **errors}

        every = [entry(*pair) for pair in self.ahead]
        return {**entry(*self.longest), "log_density_gain": self.density_gain, "horizons": every}


def outlook_of(before: Sequence[Predicted], after: Sequence[Predicted], density_gain: float) -> ForecastGain | None:
    """Compare predictions by both models; None where runs are too short for any."""
    ahead = tuple(zip(worth_of(before), worth_of(after)))
    return ForecastGain(ahead, density_gain) if ahead else None


@dataclass(frozen=True)
class NamedEffect:
    """An effect that is missing from the base model, with its parameters, how sure that is, and its rivals.

    `law` says in which form it acts, where nature has more than one; `learned` is the curve (`LearnedCurve`) of one
    that was learned, `label` the name with what it adds, where the name alone does not tell. `evidence` [deviance] and
    the log odds of runs held out are against the model without it alone (`Share`)."""

    name: str
    law: str
    says: str
    parameters: Mapping[str, Any]  # Estimate, or Given of a thruster curve's at its bound
    confidence: float
    p_value: float | None
    rivals: tuple[NamedRival, ...]
    learned: Any = None
    label: str = ""
    evidence: float | None = None
    held_out_log_odds: float | None = None

    @property
    def title(self) -> str:
        return self.label or self.name

    def to_json(self) -> dict[str, object]:
        plain = {
            **vars(self),
            "parameters": {name: value_json(value) for name, value in self.parameters.items()},
            "rivals": [_without_blanks(vars(rival)) for rival in self.rivals],
            "learned": self.learned and self.learned.to_json(),
        }
        return _without_blanks(plain)


def _without_blanks(fields: Mapping[str, object]) -> dict[str, object]:
    return {name: value for name, value in fields.items() if value is not None and value != ""}


def listed_rivals(rivals: Sequence[NamedRival], share: float = 1.0) -> tuple[float, tuple[NamedRival, ...]]:
    """Weigh an effect among rivals whose `confidence` is their odds against it, together `share`; give its weight, and
    the rivals with theirs."""
    weight = share / (1.0 + sum(rival.confidence for rival in rivals))
    return weight, tuple(replace(rival, confidence=weight * rival.confidence) for rival in rivals)


def stretch(region: Region) -> str:
    unit = f" {region.unit}" if region.unit else ""
    return f"where {region.variable} is {region.low:.3g} to {region.high:.3g}{unit}"


def diagnosis_json(
    of: Mapping[str, object], why: str, effects: Iterable[NamedEffect], where: ResidualRegions,
    gaps: Mapping[str, Gap | None], unit: str, convert: Callable[[float], float] = float,
) -> dict[str, object]:  # fmt: skip
    """Begin the diagnosis.json of any family, after what it is `of`: why, effects, regions and gaps in `unit`."""
    return {
        "schema": DIAGNOSIS.schema,
        **of,
        **({"why": why} if why else {}),
        "effects": [effect.to_json() for effect in effects],
        "where": [region.to_json(unit) for region in where.regions],
        "gap": {name: gap and gap.to_json(unit, convert) for name, gap in gaps.items()},
    }


DECIDING = 5.0  # horizons [s] up to this have a veto; over longer ones commands answer what no prediction knows


@dataclass(frozen=True)
class JudgedRuns:
    """Runs that were fitted, or held out, with the gap that both models leave in them, not a number where they are too
    short to show one, and of driven ones what both predict."""

    runs: tuple[Run, ...]
    gap: Gap
    outlook: ForecastGain | None = None

    @property
    def shows(self) -> bool:
        return not np.isnan(self.gap.before)

    def worse(self, dof: Dof) -> str:
        """Say by how much predictions over the longest deciding horizon get worse; empty where they do not."""
        ahead = self.outlook.ahead if self.outlook else ()
        before, after = next((pair for pair in ahead[::-1] if pair[0].horizon <= DECIDING), (None, None))
        if before is None or after is None or after.error < before.error:
            return ""
        return (
            f"predictions {before.horizon:g} s ahead miss by {dof.shown(after.error):.2f} {dof.units.shown} with them "
            f"and by {dof.shown(before.error):.2f} without"
        )


@dataclass(frozen=True, repr=False, kw_only=True)
class Diagnosis(Shown):
    """What a diagnosis of a model of one motion, or of the plane, found; gaps are in the unit of `dof`.

    `why` says what keeps effects from being named, or what is unexplained, `remainder` what stays beside named ones.
    `effects` are those that are named or suspected; `where` is the gap of the base model; `search` is the outcome as
    far as the verdict holds. `held_out` is None where too few runs were left to hold any out, and so is
    `from_commands`, the gap of these runs by the commands alone. `base` has the parameters of the base model before
    and after, `extended` is the base model with the effects named, refitted together. Of one motion `number` is that
    of the model, `detectable` has the smallest sizes that would have been named, `noises` and `channels` are its
    sensors, `gain_scatter` is the share by which thrust differs from run to run, before and after. The base stands in
    the file `parent`; `set_aside` are the runs left out."""

    motion: Motion
    dof: Dof
    search: Any
    verdict: str
    why: str
    effects: tuple[NamedEffect, ...]
    where: ResidualRegions
    fitted: JudgedRuns
    held_out: JudgedRuns | None
    candidates: Sequence[Mapping[str, object]]
    threshold: float
    base: Mapping[str, tuple[Estimate, Estimate]]
    extended: Mapping[str, object]
    driven: bool = True
    remainder: str = ""
    from_commands: Gap | None = None
    number: str = ""
    moment_unit: str = ""
    cycle: LimitCycle | None = None
    detectable: Mapping[str, float] = field(default_factory=dict)
    channels: ChannelChoice = NOTHING_TO_CHOOSE
    noises: Mapping[str, Estimate] = field(default_factory=dict)
    gain_scatter: tuple[float, float] = (0.0, 0.0)
    set_aside: tuple[ExcludedRun, ...] = ()
    parent: object = ""

    @property
    def decisive(self) -> JudgedRuns:
        """The runs whose error the verdict tells: those held out, if they show one."""
        return self.held_out if self.held_out and self.held_out.shows else self.fitted

    def document(self, option: str) -> Document:
        if option == "diagnosis":
            return json_document("diagnosis.json", self.to_json())
        return json_document("extended_model.json", self.extended_model())

    def extended_model(self) -> dict[str, object]:
        """Return the base model with the effects named: `validate` and `diagnose` take it."""
        return {**self.extended, "parent": self.parent}

    def to_json(self) -> dict[str, object]:
        dof, plane, free = self.dof, self.motion.turns, self.from_commands
        held_out = self.held_out.runs if self.held_out else ()
        parts = {"fitted_runs": self.fitted, "held_out_runs": self.held_out}
        gaps = {name: part.gap if part and part.shows else None for name, part in parts.items()}
        outlooks = {name: part and part.outlook and part.outlook.to_json(dof) for name, part in parts.items()}
        of = {**({} if self.motion.name == YAW.name else {"motion": self.motion.name}), "verdict": self.verdict}
        model = {"model": self.number, f"{dof.words.force}_unit": self.moment_unit}
        sensors = {
            "smallest_visible": self.detectable, "open_water": self.driven, **channels_json(self.channels, self.noises),
        }  # fmt: skip
        return {
            **diagnosis_json(of, self.why, self.effects, self.where, gaps, dof.units.shown, dof.shown),
            **({} if self.driven else {"from_commands": {"held_out_runs": free and free.to_json(dof.units.shown)}}),
            **({"left": self.remainder} if self.remainder else {}),
            **({} if plane else model),
            **({} if self.cycle is None else {"limit_cycle": self.cycle.to_json()}),
            **({"prediction": outlooks} if any(outlooks.values()) else {}),
            "candidates": list(self.candidates),
            "threshold": self.threshold,
            "base": {
                name: {"before": before.to_json(), "after": after.to_json()}
                for name, (before, after) in self.base.items()
            },
            **({} if plane else sensors),
            "held_out": [run.name for run in held_out],
            "runs": runs_json(len(self.fitted.runs), self.set_aside, (*self.fitted.runs, *held_out)),
        }
