"""The next campaign: candidates, what each would tell, the choice among them, and what to expect of it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from automarine_cli import effects
from automarine_cli.fits.estimate import Estimate
from automarine_cli.pipeline.progress import Progress, silent
from automarine_cli.planning.budget import Supply
from automarine_cli.planning.candidates import Candidate, paper_grid
from automarine_cli.planning.comparison import Curve, curve_of, one_more
from automarine_cli.planning.fitting import Fitting
from automarine_cli.planning.information import (
    directions,
    information,
    moving,
    predicted,
    reported_covariance,
    told,
)
from automarine_cli.planning.known import (
    NOISE_DEG,
    SCATTER,
    Known,
    covariance_now,
    information_now,
    wanted_directions,
)
from automarine_cli.planning.limits import Limits
from automarine_cli.planning.rivals import Split, splits
from automarine_cli.planning.schedule import Slot, in_order, scheduled
from automarine_cli.planning.selection import pairs_of, select

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Campaign:
    """A campaign on paper.

    `slots` are its runs in order, `why` what each is for; `now`, `alone` and `together` the estimates by name before
    it, of its runs alone, and of these with the earlier ones (empty where these are not known or not to be used);
    `splits` what is expected of each pair of explanations, `grid_splits` of the same on the paper's grid; `plan` and
    `grid` the precision against minutes, `more` that of one run more of each kind.
    """

    fitting: Fitting
    limits: Limits
    supply: Supply
    wanted: tuple[str, ...]
    slots: tuple[Slot, ...]
    why: tuple[str, ...]
    now: Mapping[str, Estimate]
    alone: Mapping[str, Estimate]
    together: Mapping[str, Estimate]
    splits: tuple[Split, ...]
    grid_splits: tuple[Split, ...]
    plan: Curve
    grid: Curve
    more: tuple[Curve, ...]
    notes: tuple[str, ...]

    @property
    def candidates(self) -> tuple[Candidate, ...]:
        """The runs in order."""
        return tuple(slot.candidate for slot in self.slots)

    @property
    def motion(self) -> float:
        """Time in motion over all runs [s]."""
        return float(sum(one.motion for one in self.candidates))


def plan_campaign(
    known: Known,
    limits: Limits,
    largest: float,
    supply: Supply,
    *,
    wanted: tuple[str, ...] = (),
    seed: int = 0,
    progress: Progress = silent,
) -> Campaign:
    """Choose runs for what is `known` within `limits`; moments up to `largest`.

    Doubts that a diagnosis left are split first, then the intervals of the `wanted` parameters (all by default) are
    narrowed; `seed` draws the order. Raises SettingError where the limits allow no campaign, ModelError for a parameter
    that the model does not have.
    """
    fitting = fitting_of(known, limits)
    wanted_ones = wanted_directions(fitting, wanted)
    before = information_now(fitting, known.now, limits.goal.use_earlier_runs)
    grid = scheduled(paper_grid(fitting.base, limits, largest), limits, supply)
    grid_runs = [slot.candidate for slot in grid]
    pairs = pairs_of(known, fitting, grid_runs, largest)
    choice = select(fitting, limits, largest, supply, before, wanted_ones, pairs, progress)
    slots = scheduled(in_order(choice.chosen, choice.check, seed), limits, supply)
    runs = [slot.candidate for slot in slots]
    outcome = splits(pairs, runs)[0]
    per_run, of_grid = information(fitting, runs), information(fitting, grid_runs)
    return Campaign(
        fitting=fitting,
        limits=limits,
        supply=supply,
        wanted=wanted,
        slots=slots,
        why=tuple(choice.why[one.label] for one in runs),
        now=known.now,
        alone=predicted(fitting, per_run),
        together=_together(fitting, per_run, before, known) if _uses_earlier(known, fitting, limits) else {},
        splits=outcome,
        grid_splits=splits(pairs, grid_runs)[0],
        plan=curve_of("this plan", fitting, slots, per_run, before, limits),
        grid=curve_of("the paper's grid", fitting, grid, of_grid, before, limits),
        more=one_more(fitting, choice, slots, per_run, before, limits),
        notes=(*known.notes, *_short_of(outcome, limits)),
    )


def fitting_of(known: Known, limits: Limits) -> Fitting:
    """How the campaign will be fitted: by `diagnose` where the model holds effects, else by `fit-yaw`."""
    base = Fitting(known.model, "whole-runs", 1.0, 0.0).base
    noise = limits.logger.noise_deg or known.noise_deg or NOISE_DEG
    rate_noise = limits.logger.rate_noise_deg_s or known.rate_noise_deg_s
    given = limits.logger.gain_scatter
    scatter = known.scatter if given is None else given
    names = (*(term.name for term in known.model.terms), *(doubt.rival for doubt in known.doubts))
    electric = limits.runs.voltages_V or any("voltage" in effects.get(name).needs for name in names)
    return Fitting(
        known.model,
        limits.runs.fit if known.model == base else "diagnosis",
        float(np.deg2rad(noise)),
        SCATTER if scatter is None else scatter,
        limits.logger.rate_hz,
        limits.runs.rest_before_s,
        limits.battery.volts if electric else None,
        base,
        None if rate_noise is None else float(np.deg2rad(rate_noise)),
    )


def _short_of(outcome: Sequence[Split], limits: Limits) -> tuple[str, ...]:
    """Sentences on explanations that these limits do not split."""
    asked = limits.goal.evidence
    return tuple(
        f"Not split within these limits: {one.true} from {one.other} where {one.true} is true; {one.evidence:.1f} "
        "of the "
        f"{asked:g} asked for is expected. Allow more runs or time, or log what tells them apart directly."
        for one in outcome
        if one.evidence < asked
    )


def _uses_earlier(known: Known, fitting: Fitting, limits: Limits) -> bool:
    return limits.goal.use_earlier_runs and covariance_now(fitting, known.now) is not None


def _together(fitting: Fitting, per_run: Floats, before: Floats, known: Known) -> dict[str, Estimate]:
    """Estimates of the new runs and the earlier ones fitted together."""
    new = reported_covariance(moving(per_run))
    covariance = np.asarray(np.linalg.inv(np.linalg.pinv(new, hermitian=True) + before))
    dof = float(max(len(per_run) + known.used - 1, 1))
    return told(fitting, covariance, dict.fromkeys(directions(fitting), dof))
