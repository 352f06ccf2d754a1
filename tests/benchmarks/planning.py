"""Planning: do fits report the intervals that a plan predicts, how much motion does the paper's precision take, and
does a plan split what the paper's grid of steps leaves tied?

Usage: python tests/benchmarks/planning.py [--campaigns N] [--jobs N]
"""

import os

from identified import identify
from specified import make_runs, specified

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy, and for the processes: each has one core

import argparse
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from campaigns import INERTIA, K_RR
from numpy.typing import NDArray

from automarine_cli.diagnosis.diagnose import split_off
from automarine_cli.diagnosis.scores import fitted_parameters, penalty
from automarine_cli.diagnosis.study import study_of
from automarine_cli.dofs import YAW
from automarine_cli.estimate import Estimate
from automarine_cli.fits.identify import YawFit
from automarine_cli.models.store import StoredModels
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.pipeline.parallel import Progress, ordered_map
from automarine_cli.planning.campaign import Campaign, fitting_of, plan_campaign, specification
from automarine_cli.planning.candidates import Goal, Limits, Logger, Pool, Runs, Supply, paper_grid, scheduled
from automarine_cli.planning.information import ANGLE, Doubt, PriorResults
from automarine_cli.planning.rivals import pairs_of
from automarine_cli.report.tables import Table
from automarine_cli.runs.run import Run
from automarine_cli.simulation.specification import Specification

Floats = NDArray[np.float64]

MODEL = YawModel.base("3", INERTIA, [K_RR], "nu", YAW)
LARGEST = 1.2  # of the paper's moments
SUPPLY = Supply(0.3, 6.0, LARGEST)
PARAMETERS = ("I_r", "k_rr", ANGLE)
THIRD = 1.0 / 3.0
PASSED = 1.1
"""The grid's steps pass half a turn by so much, that less thrust than usual does too; the rest is trimmed off."""
SPLIT = 10.0
"""Lead in evidence from which a diagnosis no longer calls two explanations tied."""
CASES = {
    "an hour, 24 runs": (Limits(), 0.03),
    "an hour, 24 runs, no scatter": (Limits(), 0.0),
    "a third of the paper's motion": (Limits(pool=Pool(minutes=240.0, runs=100)), 0.03),
    "24 steps, fitted to half-turns": (Limits(runs=Runs(fit="half-turns")), 0.03),
}
HIDDEN = {
    "dead-band": ((0.03, 0.0), "coulomb-drag"),
    "thruster-lag": ((0.1,), "input-delay"),
    "water-swirl": ((0.02, 10.0, 0.0), "tether-spring"),
}
"""What is hidden, and what it is mistaken for after the paper's grid."""


def known_of(model: YawModel, doubts: tuple[Doubt, ...] = ()) -> PriorResults:
    """The truth as what is known, without any interval."""
    return PriorResults(StoredModels({"3": MODEL}, "3", "nu", 0.0, "truth", YAW), model, {}, 1.0, None, 0, doubts)


@cache
def grid_motion() -> float:
    """Motion of the paper's grid [s]: 48 steps of half a turn."""
    return sum(one.motion for one in paper_grid(MODEL, LARGEST))


@cache
def planned(case: str, scatter: float) -> Campaign:
    """The plan of a case at a scatter of the thrust."""
    limits = CASES[case][0]
    if "third" in case:
        limits = replace(limits, pool=replace(limits.pool, motion_s=THIRD * grid_motion()))
    limits = replace(limits, logger=Logger(gain_scatter=scatter))
    return plan_campaign(known_of(MODEL), limits, LARGEST, SUPPLY)


def grid_of(like: Campaign, passed: float = 1.0) -> Campaign:
    """The paper's grid in place of a campaign's runs; steps drawn out by the factor `passed`."""
    runs = [
        replace(one, commands=tuple((moment, round(passed * seconds, 1)) for moment, seconds in one.commands))
        for one in paper_grid(MODEL, LARGEST)
    ]
    return replace(like, slots=scheduled(runs, like.limits, SUPPLY))


def made_of(campaign: Campaign) -> Specification:
    """The specification that `automarine simulate` would read from the plan's folder."""
    return specified(specification(campaign, 0)[0])


def estimates(runs: Sequence[Run], fit: str) -> dict[str, Estimate]:
    """What `fit-yaw` reports of model 3."""
    return reported_by(identify(runs, fit))


def reported_by(fit: YawFit) -> dict[str, Estimate]:
    """Estimates of model 3 with its inertial turn angle."""
    found = fit.output_error["3"]
    assert found.inertial_turn_angle is not None
    return {**found.estimates, ANGLE: found.inertial_turn_angle}


def reported(item: tuple[str, int]) -> list[tuple[float, float]]:
    """(value, standard error) of each parameter from one simulated campaign of a case's plan."""
    case, index = item
    campaign = planned(case, CASES[case][1])
    told = estimates(make_runs(made_of(campaign), 1000 + index), campaign.limits.runs.fit)
    return [(told[name].value, told[name].stderr) for name in PARAMETERS]


def ratios(count: int, jobs: int, progress: Progress) -> tuple[Table, dict[str, Any]]:
    """Predicted over reported standard errors (root mean square over campaigns), and predicted over actual spread."""
    work = [(case, index) for case in CASES for index in range(count)]
    found = ordered_map(reported, work, jobs, progress=progress, stage="predicted intervals")
    rows: list[tuple[str, ...]] = []
    results: dict[str, Any] = {}
    for case in CASES:
        numbers = np.array([one for (other, _), one in zip(work, found) if other == case])
        plan = planned(case, CASES[case][1])
        results[case] = {}
        for i, name in enumerate(PARAMETERS):
            predicted = plan.alone[name].stderr
            told = float(np.sqrt(np.mean(numbers[:, i, 1] ** 2)))
            spread = float(numbers[:, i, 0].std(ddof=1))
            results[case][name] = {"of_reported": predicted / told, "of_spread": predicted / spread}
            percent = f"{100 * predicted / plan.alone[name].value:.2f}"
            rows.append((case, name, percent, f"{predicted / told:.2f}", f"{predicted / spread:.2f}"))
    outside = [
        f"{name} ({case}): {one['of_reported']:.2f}"
        for case, own in results.items() for name, one in own.items() if not 0.9 <= one["of_reported"] <= 1.1
    ]  # fmt: skip
    note = f"Outside 0.9 to 1.1: {'; '.join(outside)}." if outside else "All are within 0.9 to 1.1 of what fits report."
    title = f"Predicted intervals against those of fit-yaw, {count} simulated campaigns a plan"
    header = ("plan", "parameter", "predicted %", "predicted / reported", "predicted / spread of estimates")
    return Table(title, header, tuple(rows), notes=(note,)), {"campaigns": count, "cases": results}


def attained(item: tuple[float, int]) -> dict[str, list[float]]:
    """Estimates from one campaign of the grid by the paper's own method and by maximum likelihood, and of the plan."""
    scatter, index = item
    plan = planned("a third of the paper's motion", scatter)
    grid = identify(make_runs(made_of(grid_of(plan, PASSED)), 5000 + index), "half-turns")
    assert grid.seed_method is not None
    drag, own = grid.seed_method.drag["3"].drag[1], grid.seed_method.inertia["3"].overall.value
    ml, new = (
        {name: one.value for name, one in found.items()}
        for found in (reported_by(grid), estimates(make_runs(made_of(plan), 7000 + index), "whole-runs"))
    )
    return {
        OWN_METHOD: [own, drag, own / drag],
        GRID: [ml[name] for name in PARAMETERS],
        PLAN: [new[name] for name in PARAMETERS],
    }


OWN_METHOD, GRID, PLAN = "the grid, the paper's method", "the grid, maximum likelihood", "the plan"


def precision(count: int, jobs: int, progress: Progress) -> tuple[Table, dict[str, Any]]:
    """Root mean square errors of the grid and of a plan with a third of its motion."""
    scatters, truth = (0.0, 0.03, 0.05), np.array([INERTIA, K_RR, INERTIA / K_RR])
    work = [(scatter, index) for scatter in scatters for index in range(count)]
    found = ordered_map(attained, work, jobs, progress=progress, stage="precision")
    rows: list[tuple[str, ...]] = []
    results: list[dict[str, Any]] = []
    rules: list[int] = []
    for scatter in scatters:
        plan = planned("a third of the paper's motion", scatter)
        rules += [len(rows)] if rows else []
        for name in (OWN_METHOD, GRID, PLAN):
            values = np.array([one[name] for (other, _), one in zip(work, found) if other == scatter])
            error = 100 * np.sqrt(np.mean((values / truth - 1.0) ** 2, axis=0))
            runs, motion = (len(plan.slots), plan.motion) if name == PLAN else (48, grid_motion())
            rows.append((f"{scatter:.0%}", name, str(runs), f"{motion:.0f}", *(f"{x:.2f}" for x in error)))
            results.append({"scatter": scatter, "campaign": name, "motion_s": motion, "error_percent": error.tolist()})
    header = ("scatter", "campaign", "runs", "s of motion", "I_r %", "k_rr %", "I/k %")
    title = f"Errors (root mean square) with a third of the paper's motion, {count} campaigns each"
    return Table(title, header, tuple(rows), tuple(rules)), {"campaigns": count, "rows": results}


@cache
def splitting(name: str) -> tuple[Campaign, YawModel, YawModel]:
    """The plan for what is hidden and its rival, and the two models."""
    values, rival = HIDDEN[name]
    true = MODEL.with_effect(name, values)
    known = known_of(true, (Doubt(name, rival),))
    limits = Limits(goal=Goal(), logger=Logger(gain_scatter=0.03))
    campaign = plan_campaign(known, limits, LARGEST, SUPPLY)
    grid = [slot.candidate for slot in grid_of(campaign).slots]
    other = pairs_of(known, fitting_of(known, limits), grid, LARGEST)[0][1]
    return campaign, true, other.fitting.model


def lead(item: tuple[str, bool, int]) -> float:
    """Lead in evidence of what is hidden over its rival, both fitted by `diagnose` to one simulated campaign."""
    name, of_plan, index = item
    campaign, true, other = splitting(name)
    campaign = campaign if of_plan else grid_of(campaign)
    fitted, _ = split_off(make_runs(made_of(campaign), 9000 + index), index)
    study = study_of(fitted, MODEL)
    costs, base = [], study.fit(MODEL)
    for model in (true, other):
        own = model.terms[-1]
        fit = study.fit(model, warm_start=base)
        cost = penalty(fitted_parameters(own.name, own.values), len(study.runs))
        costs.append(cost - 2.0 * fit.log_likelihood)
    return float(costs[1] - costs[0])


def splits(count: int, jobs: int, progress: Progress) -> tuple[Table, dict[str, Any]]:
    """How often the plan and the grid split what is hidden from its rival."""
    work = [(name, of_plan, index) for name in HIDDEN for of_plan in (False, True) for index in range(count)]
    found = ordered_map(lead, work, jobs, progress=progress, stage="splitting")
    rows, results = [], []
    for name, (_, rival) in HIDDEN.items():
        campaign = splitting(name)[0]
        for of_plan in (False, True):
            leads = np.array([one for (other, plan, _), one in zip(work, found) if (other, plan) == (name, of_plan)])
            expected = (campaign.splits if of_plan else campaign.grid_splits)[0].evidence
            made = campaign if of_plan else grid_of(campaign)
            label = "the plan" if of_plan else "the paper's grid"
            right, wrong = int(np.sum(leads >= SPLIT)), int(np.sum(leads <= -SPLIT))
            rows.append((
                f"{name}, not {rival}", label, str(len(made.slots)), f"{made.motion:.0f}", f"{expected:.0f}",
                f"{np.median(leads):.0f}", f"{right} of {count}", f"{wrong} of {count}",
            ))  # fmt: skip
            results.append(
                {"hidden": name, "rival": rival, "campaign": label, "expected": expected, "leads": leads.tolist()}
            )
    header = ("hidden", "campaign", "runs", "s of motion", "expected lead", "median lead", "split", "wrong")
    title = f"Evidence for what is hidden over its rival, 3 % scatter, {count} campaigns; split from {SPLIT:.0f} on"
    return Table(title, header, tuple(rows), (2, 4)), {"campaigns": count, "rows": results}


PARTS = {"intervals": (ratios, 1.0), "precision": (precision, 1.0), "splits": (splits, 0.2)}
"""Each table, and how many of the campaigns it takes."""


def planning(count: int, jobs: int, progress: Progress) -> tuple[list[Table], dict[str, Any]]:
    """Tables and plain results of `count` campaigns a case; a fifth of them where explanations are fitted."""
    tables, results = [], {}
    for name in PARTS:
        table, results[name] = part(name, count, jobs, progress)
        tables.append(table)
    return tables, results


def part(name: str, count: int, jobs: int, progress: Progress) -> tuple[Table, dict[str, Any]]:
    """One table, with its share of the campaigns."""
    measure, share = PARTS[name]
    found: tuple[Table, dict[str, Any]] = measure(max(2, round(share * count)), jobs, progress)
    return found


def main() -> None:
    from automarine_cli.commands.terminal import terminal_progress

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--jobs", type=int, default=1, help="processes (default: 1)")
    parser.add_argument("--campaigns", type=int, default=50, help="simulated campaigns a case (default: 50)")
    options = parser.parse_args()
    for name in PARTS:
        print(part(name, options.campaigns, options.jobs, terminal_progress())[0].to_text(), flush=True)


if __name__ == "__main__":
    main()
