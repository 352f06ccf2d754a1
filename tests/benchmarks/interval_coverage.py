"""Coverage: how often 95 % intervals hold the truth: of both estimators of a yaw model; of the sizes of effects planted
in whole runs (the library's likelihood fits the base model with the effect, as a diagnosis does once it has named it);
of the coefficients of equation 2 from bollard tests."""

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from campaigns import BOTH_SIDES, LARGE, make_campaign
from made_runs import INERTIA, K_RR
from scipy import stats
from specified import make_runs
from step_fits import fitted_steps

from automarine_cli import effects
from automarine_cli.commands.fit_thrusters import fit_thrusters
from automarine_cli.diagnosis.diagnose import base_estimates, parameter_estimates
from automarine_cli.diagnosis.study import study_of
from automarine_cli.diagnosis.trials import CandidateFit
from automarine_cli.dofs import YAW
from automarine_cli.errors import AutomarineError
from automarine_cli.estimate import Estimate
from automarine_cli.fits.paper import fit_velocity_error
from automarine_cli.fits.steps import data_of_steps
from automarine_cli.models.model import Model, Term
from automarine_cli.pipeline.parallel import Progress, ordered_map
from automarine_cli.report.tables import Table
from automarine_cli.runs.half_turn import half_turns
from automarine_cli.simulation.specification import SIMULATION_SCHEMA, specification_from

LOW, HIGH = 92, 98  # %
SCATTERS = (0.0, 0.03, 0.05, 0.18)


Trial = tuple[dict[str, tuple[float, float, bool]], bool]
"""Every interval of one campaign by name, as `outcome` has it, and whether the fit converged."""


def outcome(estimate: Estimate, truth: float) -> tuple[float, float, bool]:
    """Error and standard error over the truth's size, and whether the interval holds the truth."""
    size, (low, high) = abs(truth) or 1.0, estimate.ci95
    return (estimate.value - truth) / size, estimate.stderr / size, low <= truth <= high


LAYOUTS = {48: LARGE, 24: BOTH_SIDES}
DRAGS = {"1": (1.2, 0.0), "2": (0.4, 0.9), "3": (0.0, K_RR)}
"""(k_r, k_rr) of the vehicle of each model."""
MOTIONS = {
    f"model {model}, {runs} runs, {noise:g} degrees, {scatter:.0%} scatter": (runs, model, noise, scatter)
    for runs in LAYOUTS
    for model, noise, tried in (("3", 1.0, 4), ("3", 0.5, 2), ("3", 2.0, 2), ("1", 1.0, 4), ("2", 1.0, 4))
    for scatter in SCATTERS[:tried]
}
"""Number of runs, true model, noise of the heading [degrees], scatter of the runs' gains."""


def motion_trial(index: int, runs: int, model: str, noise: float, scatter: float) -> Trial:
    """Simulate one campaign and compare every interval of its fits with the truth."""
    k_r, k_rr = DRAGS[model]
    key = [2, list(LAYOUTS).index(runs), int(model), round(1000 * scatter), round(1000 * noise), index]
    campaign = make_campaign(key, LAYOUTS[runs], k_r=k_r, k_rr=k_rr, scatter=scatter, noise=np.deg2rad(noise))
    data = data_of_steps(half_turns(campaign.runs)[0])
    truth = {"I_r": INERTIA, "k_rr": k_rr, "k_r": k_r}
    rough = fit_velocity_error(data, np.zeros(len(data.moment)))
    drag = rough.drag["1"].drag[0]  # the start is that of `fits.identify`
    begin = (rough.inertia["3"].overall.value, drag if model == "1" else 0.02 * drag, rough.drag["3"].drag[1])
    fit = fitted_steps(data, model, begin)
    out = {f"ML {name}": outcome(estimate, truth[name]) for name, estimate in fit.estimates.items()}
    if fit.inertial_turn_angle is not None:
        out["ML I/k"] = outcome(fit.inertial_turn_angle, INERTIA / k_rr)
    out["delay"] = outcome(fit.delay, 0.0)  # this and the next are at a bound of their range where there is none
    out["gain scatter"] = outcome(fit.gain_scatter, scatter)
    for name, estimate in rough.drag[model].estimates.items():
        out[f"Table 1 {name}"] = outcome(estimate, truth[name])
    if model in rough.inertia:
        out["Table 2 I_r"] = outcome(rough.inertia[model].overall, INERTIA)
    return out, fit.mixed.converged


PLANTED: dict[str, dict[str, float]] = {
    "dead-band": {"width": 0.05},
    "thruster-lag": {"T": 0.25},
    "water-swirl": {"chi": 0.15, "T_w": 10.0},
    "battery-sag": {"discharge": 0.08, "load": 0.1, "tau_ref": 1.2, "t_ref": 0.0},
    "input-delay": {"t_d": 0.25},
}


def effect_specification(name: str) -> dict[str, Any]:
    """36 runs: 24 steps through a turn and a half, 12 coast-downs."""
    steps = [side * size for size in (0.1, 0.2, 0.4, 0.6, 0.9, 1.2) for side in (-1, 1)]
    coasts = [side * size for size in (0.3, 0.6, 1.0) for side in (-1, 1)]
    return {
        "schema": SIMULATION_SCHEMA,
        "vehicle": {"I_r": INERTIA, "k_rr": K_RR},
        "effects": [{"name": name, **PLANTED[name]}],
        "logger": {"rate_hz": 10, "noise_deg": 1.0},
        "scatter": {"gain": 0.03},
        "campaign": {"order": "random", "rest_before_s": 3, "rest_after_s": 2, "wait_between_s": 300},
        "runs": [
            {"kind": "step", "moments": sorted(steps), "repeats": 2, "turn_deg": 540},
            {"kind": "coast-down", "moments": sorted(coasts), "repeats": 2, "turn_deg": 360, "coast_s": 8},
        ],
    }


def effect_trial(index: int, name: str) -> Trial:
    """Simulate one campaign, fit the base model with the effect, and compare every interval with the truth."""
    base = Model.base("3", INERTIA, (K_RR,), "nu", YAW)
    runs = make_runs(specification_from(effect_specification(name), "specification"), 1000 + index)
    study = replace(study_of(runs, base), driven=False)
    values = tuple(
        study.reference(each.reference) if each.reference else PLANTED[name].get(each.name, each.start)
        for each in effects.get(name).parameters
    )
    model = base.with_term(Term(name, values))
    fit = study.fit(model, warm_start=study.fit(base))
    candidate = CandidateFit((name,), study.with_fitted_values(model, fit), fit, 0.0)
    truth = {key: value for key, value in PLANTED[name].items() if not key.endswith("_ref")}
    estimates = parameter_estimates(study, candidate, name)
    # what was lost before the first run is a gain, which inertia and drag share
    of_base = base_estimates(study, candidate)
    out = {f"{name} {key}": outcome(estimates[key], value) for key, value in truth.items()}
    out |= {key: outcome(of_base[key], value) for key, value in (("I_r", INERTIA), ("k_rr", K_RR))}
    return out, fit.converged


AHEAD, ASTERN = 2.6165e-4, 0.6640e-4  # N per count squared: equation 3 for two thrusters, halved
TOP = 150.0  # counts
BOLLARDS = {
    f"{levels} levels, {noise:g} % noise, {scatter:.0%} scatter": (levels, noise, scatter)
    for levels, noise in ((15, 0.5), (8, 2.0))
    for scatter in SCATTERS
} | {"15 levels, 0.5 % noise, 3% scatter, 4 records, 5% between them": (15, 0.5, 0.03, 4, 0.05)}
"""Levels a direction, noise of a reading in per cent of full scale ahead, scatter of the gain from reading to reading,
records (times that all levels are run through), scatter of each record's gain."""


def bollard_trial(index: int, levels: int, noise: float, scatter: float, records: int = 1, drift: float = 0.0) -> Trial:
    """Simulate one bollard test, fit it by the tool's own workflow, and compare both intervals with the truth."""
    random = np.random.default_rng([3, levels, records, *(round(1000 * x) for x in (noise, scatter, drift)), index])
    steps = np.linspace(TOP / levels, TOP, levels)
    with tempfile.TemporaryDirectory() as folder:
        for record in range(records):
            n = random.permutation(np.concatenate([-steps, steps]))
            logs = scatter * random.standard_normal(len(n)) + drift * random.standard_normal()
            gain = np.exp(logs - 0.5 * (scatter**2 + drift**2))  # of mean one
            force = gain * np.where(n > 0, AHEAD, ASTERN) * np.abs(n) * n
            force += 0.01 * noise * AHEAD * TOP**2 * random.standard_normal(len(n))
            rows = "".join(f"{a:.6f},{b:.9f}\n" for a, b in zip(n, force))
            Path(folder, f"record_{record}.csv").write_text("n,force_N\n" + rows)
        # equation 2 and its intervals do not depend on the form chosen, and choosing one takes the time
        square = fit_thrusters([folder], form="square").analysis.square
    truth = {"forward": AHEAD, "backward": ASTERN}
    return {f"a, {side}": outcome(estimate, truth[side]) for side, estimate in square.items()}, True


PARTS: dict[str, tuple[Callable[..., Trial], Mapping[str, tuple[Any, ...]]]] = {
    "coverage": (motion_trial, MOTIONS),
    "thrusters": (bollard_trial, BOLLARDS),
    "effects": (effect_trial, {name: (name,) for name in PLANTED}),
}
UNJUDGED = ("Table", "offset", "gain scatter")


def attempt(item: tuple[str, int, str]) -> Trial | str:
    """The trial of one campaign of a case of a part, or the sentence with which a fit refused it."""
    part, index, case = item
    trial, cases = PARTS[part]
    try:
        return trial(index, *cases[case])
    except AutomarineError as refusal:
        return str(refusal)


def coverage(name: str, count: int, jobs: int, progress: Progress) -> tuple[list[Table], dict[str, Any]]:
    """Table and plain results of `count` campaigns a case of a part."""
    cases = PARTS[name][1]
    work = [(name, i, case) for case in cases for i in range(count)]
    every = ordered_map(attempt, work, jobs, progress=progress, stage=name)
    rows, rules, remarks = list[dict[str, Any]](), list[int](), list[str]()
    for i, case in enumerate(cases):
        rules += [len(rows)] if rows else []
        tried = every[i * count : (i + 1) * count]
        trials = [result for result in tried if not isinstance(result, str)]
        if refused := [result for result in tried if isinstance(result, str)]:
            remarks.append(f"Refused: {len(refused)} ({case}): {refused[0]}.")
        if astray := sum(not converged for _, converged in trials):
            remarks.append(f"Did not converge: {astray} ({case}).")
        for interval in dict.fromkeys(key for intervals, _ in trials for key in intervals):
            outcomes = [intervals[interval] for intervals, _ in trials if interval in intervals]
            rows.append({"case": case, "interval": interval, **summary(outcomes)})
    outside = [
        f"{row['coverage %']:.1f} % of {row['interval']} ({row['case']})"
        for row in rows
        if not row["interval"].startswith(UNJUDGED) and not LOW <= row["coverage %"] <= HIGH
    ]
    verdict = f"Outside {LOW} to {HIGH} %: {'; '.join(outside) or 'none'}. Not judged: {', '.join(UNJUDGED)}."
    title = f"Coverage of 95 % intervals, {name}, {count} campaigns"
    return [Table.of(title, rows, [verdict, *remarks], tuple(rules))], {"campaigns": count, "intervals": rows}


def summary(outcomes: Sequence[tuple[float, float, bool]]) -> dict[str, Any]:
    """Coverage with its exact binomial interval (Clopper and Pearson 1934, Biometrika 26:404), relative bias and
    spread, and root mean square standard error over the spread."""
    errors, stderrs, holds = np.array(outcomes, dtype=float).T
    spread = 100 * errors.std(ddof=1) if len(errors) > 1 else None
    exact = stats.binomtest(round(holds.sum()), len(holds)).proportion_ci(method="exact")
    return {
        "coverage %": 100 * holds.mean(), "from": 100 * exact.low, "to": 100 * exact.high,
        "bias %": 100 * errors.mean(), "sd %": spread,
        "stderr/sd": 100 * np.sqrt(np.mean(stderrs**2)) / spread if spread else None, "campaigns": len(holds),
    }  # fmt: skip
