"""Coverage of the sizes of effects: one is planted in simulated whole runs, and the library's own likelihood fits the
base model with it, as a diagnosis does once it has named it."""

from typing import Any

from campaigns import INERTIA, K_RR
from interval_coverage import HEADER, Outcome, Trial, failures, misses, summarise, summary_rows
from specified import make_runs, specified

from automarine_cli import effects
from automarine_cli.diagnosis.diagnose import base_estimates, parameter_estimates
from automarine_cli.diagnosis.search import CandidateFit as Explained
from automarine_cli.diagnosis.study import study_of
from automarine_cli.dofs import YAW
from automarine_cli.errors import FitError
from automarine_cli.models.yaw_model import Term, YawModel
from automarine_cli.pipeline.parallel import Progress, ordered_map
from automarine_cli.report.tables import Table
from automarine_cli.simulation.specification import SCHEMA

STREAM = 1000
LARGEST = 1.2
PLANTED: dict[str, dict[str, float]] = {
    "dead-band": {"width": 0.05},
    "thruster-lag": {"T": 0.25},
    "water-swirl": {"chi": 0.15, "T_w": 10.0},
    "battery-sag": {"discharge": 0.08, "load": 0.1, "tau_ref": LARGEST, "t_ref": 0.0},
    "input-delay": {"t_d": 0.25},
}
SCATTER, NOISE_DEG = 0.03, 1.0


def specification(name: str) -> dict[str, Any]:
    """36 runs: 24 steps through a turn and a half, 12 coast-downs."""
    return {
        "schema": SCHEMA,
        "vehicle": {"I_r": INERTIA, "k_rr": K_RR},
        "effects": [{"name": name, **PLANTED[name]}],
        "logger": {"rate_hz": 10, "noise_deg": NOISE_DEG},
        "scatter": {"gain": SCATTER},
        "campaign": {"order": "random", "rest_before_s": 3, "rest_after_s": 2, "wait_between_s": 300},
        "runs": [
            {
                "kind": "step",
                "moments": [-1.2, -0.9, -0.6, -0.4, -0.2, -0.1, 0.1, 0.2, 0.4, 0.6, 0.9, 1.2],
                "repeats": 2,
                "turn_deg": 540,
            },
            {
                "kind": "coast-down",
                "moments": [-1.0, -0.6, -0.3, 0.3, 0.6, 1.0],
                "repeats": 2,
                "turn_deg": 360,
                "coast_s": 8,
            },
        ],
    }


def run_trial(item: tuple[int, str]) -> Trial:
    """Simulate one campaign, fit the base model with the effect, and compare every interval with the truth."""
    index, name = item
    runs = make_runs(specified(specification(name)), STREAM + index)
    base = YawModel.base("3", INERTIA, (K_RR,), "nu", YAW)
    study = study_of(runs, base, driven=False)
    values = tuple(
        study.reference(parameter.reference)
        if parameter.reference
        else PLANTED[name].get(parameter.name, parameter.start)
        for parameter in effects.get(name).parameters
    )
    model = YawModel(base.inertia, (*base.terms, Term(name, values)), base.moment_unit, base.dof)
    try:
        fit = study.fit(model, warm_start=study.fit(base))
    except FitError as refusal:
        return Trial({}, refused=str(refusal))
    found = Explained((name,), study.with_fitted_values(model, fit), fit, 0.0)
    truth = {parameter: value for parameter, value in PLANTED[name].items() if not parameter.endswith("_ref")}
    estimates = parameter_estimates(study, found, name)
    out = {f"{name} {one}": Outcome.of(estimates[one], value) for one, value in truth.items()}
    base_found = base_estimates(study, found)
    # what was lost before the first run is a gain, which inertia and drag share
    out["I_r"] = Outcome.of(base_found["I_r"], INERTIA)
    out["k_rr"] = Outcome.of(base_found["k_rr"], K_RR)
    return Trial(out, fit.converged)


def effect_coverage(count: int, jobs: int, progress: Progress) -> tuple[list[Table], dict[str, Any]]:
    """Table and plain results of `count` campaigns an effect."""
    work = [(index, name) for name in PLANTED for index in range(count)]
    found = ordered_map(run_trial, work, jobs, progress=progress, stage="effects")
    rows: list[tuple[str, ...]] = []
    rules, results, outside, remarks = [], [], [], []
    for i, name in enumerate(PLANTED):
        trials = found[i * count : (i + 1) * count]
        summary = summarise(trials)
        rules += [len(rows)] if rows else []
        rows += [(name, *row) for row in summary_rows(summary)]
        outside += misses(summary, name)
        remarks += failures(trials, name)
        results.append({"case": name, "intervals": summary})
    verdict = f"Outside 92 to 98 %: {'; '.join(outside)}." if outside else "All are within 92 to 98 %."
    title = (
        f"Coverage of 95 % intervals, effects in 36 whole runs, {SCATTER:.0%} scatter, {NOISE_DEG:g} degree of noise, "
        f"{count} campaigns"
    )
    table = Table(title, ("planted", *HEADER), tuple(rows), tuple(rules), (verdict, *remarks))
    return [table], {"campaigns": count, "cases": results}
