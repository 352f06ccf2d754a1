"""What a gyro is worth: efficiency of fits to heading and yaw rate against the bound of both, widths of intervals with
and without it, and how well sensors that contradict each other are told."""

from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np
from bounds import bound, fisher_information
from campaigns import INERTIA, K_RR, NOISE, PERIOD, known_half_turns, make_campaign
from faults import FAULTS, HONEST, judged
from identified import identify
from numpy.typing import NDArray
from specified import make_runs, specified

from automarine_cli import effects
from automarine_cli.diagnosis.diagnose import base_estimates, parameter_estimates
from automarine_cli.diagnosis.search import CandidateFit as Explained
from automarine_cli.diagnosis.study import study_of
from automarine_cli.dofs import YAW
from automarine_cli.fits.half_turns import half_turn_data
from automarine_cli.fits.known import Known
from automarine_cli.fits.whole_runs import fit_half_turns
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.pipeline.parallel import Progress, ordered_map
from automarine_cli.report.tables import Table
from automarine_cli.runs.half_turn import half_turns
from automarine_cli.simulation.specification import SCHEMA

Floats = NDArray[np.float64]

TRUTH = (INERTIA, K_RR)
RATE_NOISE, RATE_BIAS = np.deg2rad(0.3), np.deg2rad(1.0)
STREAM = 40
WANTED = 0.9
SCATTER = 0.03
BOTH, INSTANT_KNOWN = "nothing known", "start heading and instant known"
EFFECTS = {"thruster-lag": {"T": 0.25}, "dead-band": {"width": 0.05}}
WORTH = 20
"""Campaigns of which the widths of intervals are compared."""


@dataclass(frozen=True)
class Trial:
    """Relative errors of (I, k) and relative variance bounds, by what was known; noises as shares of the truth."""

    errors: dict[str, Floats]
    bounds: dict[str, Floats]
    noises: Floats
    bias: float


def run_trial(index: int) -> Trial:
    """Simulate one campaign with a gyro, fit it, and compare with the truth and the bound."""
    campaign = make_campaign([STREAM, index], rate_noise=RATE_NOISE, rate_bias=RATE_BIAS)
    turns, _ = half_turns(campaign.runs)
    unknown, known = half_turn_data(turns, YAW.channels), known_half_turns(campaign)
    begin = (1.2 * INERTIA, 0.0, 0.8 * K_RR)
    nothing = fit_half_turns(unknown, "3", begin, "nu", Known())
    instant = fit_half_turns(known, "3", begin, "nu", Known(start_heading=True, switch_instant=True))
    middle = np.array([turn.step.switch_mid for turn in turns])
    since = unknown.time + middle[:, None]  # the true switch is at 0
    both = {"truth": TRUTH, "noise": NOISE, "rate_noise": RATE_NOISE, "interval": PERIOD}
    uniform = fisher_information(since, unknown.observed, unknown.moment, instants="uniform", **both)
    first = fisher_information(known.time, known.observed, known.moment, **both)
    variances = {BOTH: bound(uniform, offset_known=True), INSTANT_KNOWN: bound(first)}
    return Trial(
        {name: fit.mixed.theta[:2] / TRUTH - 1.0 for name, fit in ((BOTH, nothing), (INSTANT_KNOWN, instant))},
        {name: variance / np.square(TRUTH) for name, variance in variances.items()},
        np.array([*nothing.mixed.noise_of.values()]) / [NOISE, RATE_NOISE],
        float(nothing.mixed.own("yaw_rate-bias").std() / RATE_BIAS),
    )


def sensors(count: int, jobs: int, progress: Progress) -> tuple[list[Table], dict[str, Any]]:
    """Tables and plain results of `count` campaigns."""
    trials = ordered_map(run_trial, range(count), jobs, progress=progress, stage="sensors")
    rows, found = [], {}
    for name in (BOTH, INSTANT_KNOWN):
        errors = np.array([trial.errors[name] for trial in trials])
        limit = np.mean([trial.bounds[name] for trial in trials], axis=0)
        mse = (errors**2).mean(axis=0)
        ratio = limit / mse
        doubt = ratio * (errors**2).std(axis=0, ddof=1) / np.sqrt(count) / mse
        cells = [
            (f"{100 * errors[:, i].mean():+.3f}", f"{100 * errors[:, i].std(ddof=1):.3f}",
             f"{100 * np.sqrt(limit[i]):.3f}", f"{ratio[i]:.2f} ± {doubt[i]:.2f}")
            for i in (0, 1)
        ]  # fmt: skip
        rows.append((name, *cells[0], *cells[1]))
        found[name] = {
            p: {"efficiency": ratio[i], "monte_carlo_error": doubt[i]} for i, p in enumerate(("I_r", "k_rr"))
        }
    noises = np.array([trial.noises for trial in trials]).mean(axis=0)
    least = min(one["efficiency"] for case in found.values() for one in case.values())
    notes = (
        f"Required: at least {WANTED}: {'reached' if least >= WANTED else 'MISSED'} ({least:.2f}).",
        f"Noises found, of the true ones: heading {noises[0]:.3f}, yaw rate {noises[1]:.3f}; biases scatter by "
        f"{np.mean([trial.bias for trial in trials]):.2f} of what they do.",
    )
    parts = ("bias %", "sd %", "bound sd %", "efficiency")
    header = ("known", *(f"{p} {part}" for p in ("I", "k") for part in parts))
    title = f"Efficiency with heading (1 deg) and gyro (0.3 deg/s, a bias a run), {count} campaigns: 48 runs, 10 Hz"
    worth, widths = _worth(jobs, progress)
    told, verdicts = _told(count, jobs, progress)
    return [Table(title, header, tuple(rows), notes=notes), worth, told], {
        "campaigns": count, "efficiency": found, "noises": noises.tolist(), "widths": widths, "verdicts": verdicts,
    }  # fmt: skip


def _worth(jobs: int, progress: Progress) -> tuple[Table, dict[str, Any]]:
    """Widths of intervals with and without the gyro."""
    found = ordered_map(run_worth, range(WORTH), jobs, progress=progress, stage="worth")
    rows, widths = [], {}
    for name in found[0]:
        pairs = np.array([one[name] for one in found if name in one])
        mean = 100 * np.median(pairs, axis=0)
        rows.append((name, f"{mean[0]:.2f}", f"{mean[1]:.2f}", f"{mean[1] / mean[0]:.2f}"))
        widths[name] = {"without": mean[0], "with": mean[1], "ratio": mean[1] / mean[0]}
    title = f"Half widths of 95 % intervals, % of the value, {100 * SCATTER:g} % scatter, median of {WORTH} campaigns"
    return Table(title, ("parameter", "heading", "heading and gyro", "ratio"), tuple(rows)), widths


def run_worth(index: int) -> dict[str, tuple[float, float]]:
    """Relative half widths without and with the gyro, by parameter, of one campaign of steps and of one an effect."""
    campaign = make_campaign([STREAM + 1, index], scatter=SCATTER, rate_noise=RATE_NOISE, rate_bias=RATE_BIAS)
    fits = [identify(campaign.runs, channels=channels).output_error["3"] for channels in ("position", "auto")]
    found = {
        name: tuple(_half(fit.estimates[name]) for fit in fits) for name in ("I_r", "k_rr")
    }  # fmt: skip
    found["I_r/k_rr"] = tuple(_half(fit.inertial_turn_angle) for fit in fits)
    for name, values in EFFECTS.items():
        runs = make_runs(specified(_specification(name, index)))
        here = [_with_effect(runs, name, values, channels) for channels in (None, YAW.channels)]
        for key in here[0]:
            found[key] = tuple(one[key] for one in here)
    return found  # type: ignore[return-value]


def _specification(name: str, index: int) -> dict[str, Any]:
    """24 steps through half a turn and more, with an effect."""
    sizes = [0.1, 0.2, 0.4, 0.6, 0.9, 1.2]
    return {
        "schema": SCHEMA, "seed": index,
        "vehicle": {"I_r": INERTIA, "k_rr": K_RR},
        "effects": [{"name": name, **EFFECTS[name]}],
        "logger": {"rate_hz": 10, "noise_deg": 1.0, "rate_noise_deg_s": 0.3, "rate_bias_deg_s": 1.0},
        "scatter": {"gain": SCATTER},
        "campaign": {"order": "random", "rest_before_s": 3, "rest_after_s": 0, "wait_between_s": 60},
        "runs": [
            {"kind": "step", "moments": [s * m for m in sizes for s in (1, -1)], "repeats": 2, "turn_deg": 200}
        ],
    }  # fmt: skip


def _with_effect(runs: Any, name: str, values: dict[str, float], channels: tuple[str, ...] | None) -> dict[str, float]:
    base = YawModel.base("3", INERTIA, (K_RR,), "nu", YAW)
    study = study_of(runs, base, driven=False, channels=channels)
    defaults = {one.name: one.start for one in effects.get(name).parameters}
    model = base.with_effect(name, tuple({**defaults, **values}.values()))
    fit = study.fit(model, warm_start=study.fit(base))
    found = Explained((name,), study.with_fitted_values(model, fit), fit, 0.0)
    own = parameter_estimates(study, found, name)
    widths = {f"{name} {key}": _half(own[key]) for key in values}
    return widths | {f"I_r beside {name}": _half(base_estimates(study, found)["I_r"])}


def _half(estimate: Any) -> float:
    low, high = estimate.ci95
    return float((high - low) / 2.0 / abs(estimate.value))


def _told(count: int, jobs: int, progress: Progress) -> tuple[Table, dict[str, Any]]:
    """What is said of honest gyros and of each fault."""
    rows, found = [], {}
    for fault, right in FAULTS.items():
        work = [(index, fault) for index in range(count)]
        said = Counter(ordered_map(judged, work, jobs, progress=progress, stage=fault))
        wrong = sum(n for word, n in said.items() if word not in right)
        others = ", ".join(f"{word or 'nothing'} {n}" for word, n in said.items() if word not in right)
        rows.append((fault, f"{100 * (1 - wrong / count):.1f} %", others or "–"))
        found[fault] = dict(said)
    note = (
        "Steps of 6 to 48 runs, 5 to 50 Hz, heading 0.1 to 2 degrees, gyro 0.05 to 2 degrees/s, bias up to 5, "
        "readings rounded to up to 1 degree and 0.5 degrees/s; honest ones are right when nothing is said."
    )
    title = f"Sensors that contradict each other, {count} campaigns a case"
    assert HONEST in FAULTS
    return Table(title, ("gyro", "told right", "else"), tuple(rows), notes=(note,)), found
