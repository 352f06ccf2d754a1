"""A whole diagnosis: search, verdict, where, gaps on runs fitted and held out, what to run next."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from automarine_cli import effects
from automarine_cli.diagnosis.learned_curve import learn, with_curves
from automarine_cli.diagnosis.residual_regions import Where, find_where
from automarine_cli.diagnosis.search import STANDS, TIE, Found, gain_exponent, search, variants, varied
from automarine_cli.diagnosis.study import Study, study_of
from automarine_cli.diagnosis.verdict import (
    NAMED,
    SUSPECTED,
    UNEXPLAINED,
    Gap,
    NamedEffect,
    Outlook,
    Verdict,
    base_estimates,
    detectable,
    gap,
    in_few_words,
    named_effects,
    outlook,
    parameter_estimates,
    verdict_of,
)
from automarine_cli.errors import TooFewRunsError
from automarine_cli.filters.course import LEAST_STEP
from automarine_cli.fits.cautions import covariance_json, valid_range
from automarine_cli.fits.driven import stepped
from automarine_cli.fits.innovations import InnovationsFit, channel_noises, channels_json, random_estimates
from automarine_cli.fits.linear_mixed import GAIN
from automarine_cli.fits.whole_runs import ratio_of
from automarine_cli.models.store import StoredModels, effects_json, model_head
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.pipeline.parallel import Each, alone
from automarine_cli.pipeline.records import Document, Shown, json_document
from automarine_cli.pipeline.result_files import DIAGNOSIS
from automarine_cli.runs.channels import AUTO, NOTHING_TO_CHOOSE, ChannelChoice, choose_channels
from automarine_cli.runs.run import Run, SetAside, runs_json

DRIVEN_S, STEPPED_S = 3e-4, 1e-4
"""Seconds for each reading and effect of a diagnosis of driven runs, and of others, on a machine of 2020; roughly."""
FEWEST_RUNS = 4
FEWEST_TO_HOLD_OUT = 8
SHORT = 5
"""Iterations of a law or size that the fitted runs may not tell from the final one: those that get there do so soon."""


@dataclass(frozen=True)
class Diagnosis:
    """What a diagnosis found; `held_out` and `held_out_gap` are None where too few runs were left to hold any out.

    `said` is the verdict, and `effects` what it names or suspects; `where` is the gap of the base model; the outlooks
    are those of driven runs."""

    study: Study
    said: Verdict
    effects: tuple[NamedEffect, ...]
    where: Where
    gap: Gap
    held_out: Study | None
    held_out_gap: Gap | None
    detectable: dict[str, float]
    outlook: Outlook | None = None
    held_out_outlook: Outlook | None = None
    channels: ChannelChoice = NOTHING_TO_CHOOSE

    @property
    def verdict(self) -> str:
        return self.said.word

    @property
    def found(self) -> Found:
        """The search, as far as the verdict holds."""
        return self.said.found

    @property
    def words(self) -> str:
        return in_few_words(self.verdict, self.found.final.added)


def _of_equals(study: Study, found: Found, held_out: Study, each: Each) -> Found:
    """The law and size that runs held out follow best, of those that the fitted runs do not tell apart: where all their
    commands lie on one side of an edge, its place must not decide whether there is one."""
    final = found.final
    floor = STANDS * study.sensor_floor
    kept = gap(held_out, found.base, final)
    if study.driven or not final.added or final.fit.noise > floor or kept.after <= STANDS * kept.floor:
        return found
    tried = each(partial(varied, study, final, SHORT), variants(study, final), "trying laws on the runs held out")
    equal = [trial for trial in tried if trial is not None and trial.evidence < final.evidence + TIE]
    best = min([final, *equal], key=lambda trial: gap(held_out, found.base, trial).after)
    says = "The fitted runs leave its law or size open; these are what the runs held out follow best."
    return found if best is final else replace(found, final=best, equals=says)


def split_off(runs: Sequence[Run], seed: int, fewest: int = FEWEST_TO_HOLD_OUT) -> tuple[list[Run], list[Run]]:
    """Runs to fit and a quarter to hold out, spread over the moments: one drawn from every four neighbours in moment.

    All are fitted where there are fewer than the `fewest` runs that can spare some."""
    if len(runs) < fewest:
        return list(runs), []
    mean = [float(np.mean(run.command[run.command != 0])) if np.any(run.command != 0) else 0.0 for run in runs]
    order = sorted(range(len(runs)), key=lambda i: (mean[i], runs[i].name))
    random = np.random.default_rng(seed)
    out = {order[i + int(random.integers(4))] for i in range(0, len(order) - 3, 4)}
    return [run for i, run in enumerate(runs) if i not in out], [runs[i] for i in sorted(out)]


def diagnose_runs(
    runs: Sequence[Run], base: YawModel, *, hold_out: Sequence[Run] | None = None, seed: int = 0, each: Each = alone,
    channels: str = AUTO,
) -> Diagnosis:  # fmt: skip
    """Diagnose `base` on `runs`; `hold_out` None draws a quarter of the runs, `channels` says which sensors count
    (`runs.channels.choose_channels`). Raises RunError for too few runs."""
    runs = [run for run in runs if len(run) >= 20]
    chosen = choose_channels([*runs, *(hold_out or ())], base.dof, channels, late_position=True)
    runs, out = ([chosen.cleaned(run) for run in some] for some in (runs, hold_out or ()))
    fitted, kept = split_off(runs, seed) if hold_out is None else (runs, out)
    if len(fitted) < FEWEST_RUNS:
        plural = " is" if len(fitted) == 1 else "s are"
        raise TooFewRunsError(
            f"{len(fitted)} run{plural} too few to tell a missing effect from chance; give at least {FEWEST_RUNS}"
        )
    study = study_of(fitted, base, channels=chosen.names)
    found = search(study, seed, each)
    where = find_where(found.study, found.base, seed)

    def explained(one: Found) -> bool:
        return verdict_of(one.study, one, where, None, None).word != UNEXPLAINED

    found = learn(found.study, found, seed, each, explained)
    study = found.study
    held_out = replace(study, runs=tuple(kept)) if kept else None
    if held_out is not None:
        found = _of_equals(study, found, held_out, each)
    last = found if found.final.added else found.doubtful or found
    ahead = None if held_out is None else outlook(held_out, last.base, last.final)
    said = verdict_of(study, found, where, held_out, ahead)
    before, after, listed = said.found.base, said.found.final, said.word in (NAMED, SUSPECTED)
    return Diagnosis(
        study, said, with_curves(said.found, named_effects(study, said.found)) if listed else (), where,
        gap(study, before, after, fitted=True), held_out, None if held_out is None else gap(held_out, before, after),
        detectable(study, found), outlook(study, before, after),
        None if held_out is None else outlook(held_out, before, after), chosen,
    )  # fmt: skip


def expected_seconds(runs: Sequence[Run]) -> float:
    """Estimate how long a diagnosis takes one process: it fits every effect of the library to all runs."""
    readings = sum(min(len(run), (run.time[-1] - run.time[0]) / LEAST_STEP) for run in runs)
    driven = 2 * sum(stepped(run) for run in runs) < len(runs)
    return float(readings) * len(effects.names()) * (DRIVEN_S if driven else STEPPED_S)


@dataclass(frozen=True, repr=False)
class MotionDiagnosis(Shown):
    """The diagnosis of a stored model of one motion: the model, its file's hash, and the runs left out."""

    diagnosis: Diagnosis
    stored: StoredModels
    parent_sha256: str
    set_aside: tuple[SetAside, ...]

    def document(self, option: str) -> Document:
        if option == "diagnosis":
            return json_document("diagnosis.json", self.to_json())
        return json_document("extended_model.json", self.extended_model())

    def extended_model(self) -> dict[str, object]:
        """Return the base model with the effects named, refitted together: `validate` and `diagnose` take it."""
        study, trial, number = self.diagnosis.study, self.diagnosis.said.leaves, self.stored.preferred
        base, model, dof, fit = base_estimates(study, trial), trial.model, study.base.dof, trial.fit
        roles = ("quadratic", "linear", "inertia", "constant", "difference")
        own = {role: dof.parameters[role] for role in roles if dof.parameter(role) in model.parameter_names}
        drag = {name: base[name].to_json() for name in own.values()}
        ratio, covariance = None, study.covariance(model, fit)
        likeliest = drag | {"covariance": covariance_json(model.short_names, fit.theta, fit.positive, covariance)}
        if "quadratic" in own and base[own["quadratic"]].value > 0:
            i, k = (model.index(dof.parameter(role)) for role in ("inertia", "quadratic"))
            ratio = ratio_of(fit, covariance, i, k, dof.unit_of("ratio"), len(study.runs) - 1).to_json()
        added = {term.name: parameter_estimates(study, trial, term.name) for term in model.terms if not term.own}
        exponent, driven = gain_exponent(study, fit), {}
        ends = (end for run in study.runs for end in (run.command.min(), run.command.max()))
        noise = float(dof.shown(fit.noise)) if study.position_counts else None
        if isinstance(fit, InnovationsFit):
            driven = {"driven": True, "random": random_estimates(fit, covariance, dof)}
        return {
            **model_head(dof, self.stored.moment_unit),
            "fitted_to": "whole runs",
            "models": {number: {**drag, "output_error": likeliest, "velocity_error": None, "sse": None}},
            "preferred": number,
            "preferred_because": f"Model {number} was the base of the diagnosis.",
            dof.ratio_key: ratio,
            "valid_range": valid_range(ends, model),
            "effects": effects_json(added),
            f"{dof.words.position}_noise_{dof.units.key}": noise,
            **driven,
            "gain_scatter": float(fit.factor(GAIN)),
            "gain_exponent": exponent and exponent.to_json(),
            "parent": {"file": self.stored.source, "sha256": self.parent_sha256},
        }

    def to_json(self) -> dict[str, object]:
        diagnosis, dof = self.diagnosis, self.stored.dof
        study, search = diagnosis.study, diagnosis.found
        before, after = (base_estimates(study, trial) for trial in (search.base, diagnosis.said.leaves))
        first = search.rounds[0]
        sets = {
            "fitted_runs": (diagnosis.gap, diagnosis.outlook),
            "held_out_runs": (diagnosis.held_out_gap, diagnosis.held_out_outlook),
        }
        prediction = {name: ahead and ahead.to_json(dof) for name, (_, ahead) in sets.items()}
        cycle = {} if study.cycle is None else {"limit_cycle": study.cycle.to_json()}
        return {
            "schema": DIAGNOSIS.schema,
            **({} if dof.wraps else {"motion": dof.name}),
            "verdict": diagnosis.verdict,
            **{key: text for key in ("why", "left") if (text := getattr(diagnosis.said, key))},
            "model": self.stored.preferred,
            f"{dof.words.force}_unit": self.stored.moment_unit,
            "effects": [effect.to_json() for effect in diagnosis.effects],
            "where": [region.to_json(dof.units.key) for region in diagnosis.where.regions],
            "gap": {name: gap and gap.to_json(dof.units.key, dof.shown) for name, (gap, _) in sets.items()},
            **({} if diagnosis.outlook is None else {**cycle, "prediction": prediction}),
            "candidates": [
                {"name": trial.added[-1], "gain": first.gain(trial)}
                for trial in sorted(first.trials, key=lambda trial: trial.evidence)
            ],
            "threshold": first.threshold,
            "base": {name: {"before": before[name].to_json(), "after": after[name].to_json()} for name in before},
            "smallest_visible": {name: size for name, size in diagnosis.detectable.items() if np.isfinite(size)},
            "open_water": study.driven,
            **channels_json(diagnosis.channels, channel_noises(search.final.fit, dof)),
            "held_out": [] if diagnosis.held_out is None else [run.name for run in diagnosis.held_out.runs],
            "runs": runs_json(len(study.runs), self.set_aside, study.runs),
        }
