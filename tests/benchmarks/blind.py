"""`make blind`: does `diagnose` name what was hidden? Prints the table of marks and writes out/blind.json.

The campaigns come from blind_truth.py and blind_cases.py, which know nothing of the library's equations. Outcomes of a
campaign with one or two effects hidden: `right` names just these; `tie` names all of them, each itself or as a rival,
or names another beside them; `wrong` names something else and does not list them; `missed` names nothing; `suspected`
lists something and does not name it; `learned` names a curve over a variable, of a law that the library lacks; and
`unexplained`. Where nothing is hidden, `right` names nothing and `false`
anything.

Usage: python tests/benchmarks/blind.py [--quick] [--seeds N] [--only TEXT] [--layout steps|full]
"""

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy, and for the processes: each has one core

import argparse
import json
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from blind_cases import JUST, LAWS, OTHER_BASE, PAIRS, STRANGE, Campaign, Case, make

from automarine_cli import effects
from automarine_cli.diagnosis.diagnose import Diagnosis, diagnose_runs
from automarine_cli.diagnosis.scores import probes
from automarine_cli.diagnosis.search import Trial, add_effect
from automarine_cli.diagnosis.verdict import base_estimates, gap
from automarine_cli.dofs import YAW
from automarine_cli.errors import AutomarineError
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.report.tables import Table

SCATTERS = (0.0, 0.02, 0.03, 0.05)


@dataclass(frozen=True)
class Outcome:
    """What came of one case; gaps [deg] on the runs held out, None where they mean nothing."""

    case: str
    kind: str
    layout: str
    size: str
    visible: float | None
    hidden: dict[str, float]
    outcome: str
    named: dict[str, list[str]]
    parameters: dict[str, dict[str, float]]
    residual_over_floor: tuple[float, float]
    gap_before: float | None
    gap_after: float | None
    gap_truth: float | None
    gap_floor: float | None
    covered: dict[str, bool]
    seconds: float


def kind_of(case: Case) -> str:
    """Which row of the table a case counts in."""
    if not case.hidden:
        return "none"
    if any(law in STRANGE for law in case.hidden):
        return "strange"
    return "two" if len(case.hidden) == 2 else f"one, {case.layout}"


def run_case(case: Case) -> Outcome:
    """Make the campaign, diagnose it, judge the answer."""
    campaign = make(case)
    begun = time.perf_counter()
    found = diagnose_runs(campaign.runs, guess(case, campaign), seed=case.seed)
    seconds = time.perf_counter() - begun
    named = {effect.name: [rival.name for rival in effect.rivals] for effect in found.effects}
    outcome = judge(case, found.verdict, named)
    truth = [LAWS[law][0] for law in case.hidden if law in LAWS]
    held = found.held_out_gap
    reference = refitted(found, truth) if truth and held is not None and len(truth) == len(case.hidden) else None
    truth_gap = gap(found.held_out, found.found.base, reference) if reference and found.held_out else None
    degrees = 180.0 / np.pi
    return Outcome(
        case=case.name,
        kind=kind_of(case),
        layout=case.layout,
        size=case.size,
        visible=campaign.visible if np.isfinite(campaign.visible) else None,
        hidden=dict(campaign.vehicle.hidden),
        outcome=outcome,
        named=named,
        parameters={e.name: {key: x.value for key, x in e.parameters.items()} for e in found.effects},
        residual_over_floor=(
            float(found.found.base.fit.noise / found.study.floor),
            float(found.found.final.fit.noise / found.study.floor),
        ),
        gap_before=held.before * degrees if held else None,
        gap_after=held.after * degrees if held else None,
        gap_truth=truth_gap.after * degrees if truth_gap else None,
        gap_floor=held.floor * degrees if held else None,
        covered=coverage(case, campaign, found) if outcome == "right" else {},
        seconds=seconds,
    )


def guess(case: Case, campaign: Campaign) -> YawModel:
    """The base model that a user would bring: the right form, values some tenths off."""
    vehicle = campaign.vehicle
    unit = campaign.runs[0].moment_unit
    if "quadratic" in case.hidden:
        return YawModel.base("1", 1.2 * vehicle.inertia * vehicle.scale, [vehicle.linear * vehicle.scale], unit, YAW)
    return YawModel.base(
        "3", 1.2 * vehicle.inertia * vehicle.scale, [0.85 * vehicle.quadratic * vehicle.scale], unit, YAW
    )


def judge(case: Case, verdict: str, named: dict[str, list[str]]) -> str:
    """One word on a verdict; see the module's docstring."""
    if verdict == "suspected":
        return verdict
    if not case.hidden or any(law in STRANGE for law in case.hidden):
        right = "nothing-missing" if not case.hidden else "unexplained"
        if verdict == "named" and case.hidden and all(name.startswith("learned:") for name in named):
            return "learned"
        if verdict == "named":
            return "tie" if case.hidden and all(named.values()) else "false"
        return "right" if verdict == right else verdict
    if verdict == "nothing-missing":
        return "missed"
    if verdict == "unexplained":
        return "unexplained"
    truth = {LAWS[law][0] for law in case.hidden}
    if set(named) == truth:
        return "right"
    mentioned = set(named) | {rival for rivals in named.values() for rival in rivals}
    if truth <= mentioned:
        return "tie"
    return "half" if truth & mentioned and len(truth) == 2 else "wrong"


def refitted(found: Diagnosis, truth: Sequence[str]) -> Trial | None:
    """The base with the library's form of what is hidden, refitted on the same runs from the candidate's own starts."""
    trial: Trial | None = found.found.base
    for name in truth:
        if trial is None:
            return None
        own = [t for t in found.found.rounds[0].trials if t.added[-1] == name]
        first = np.array(own[0].model.terms[-1].values) if own else probes(found.study, name)[0].values[0]
        trial = add_effect(found.study, trial, (name, first))
    return trial


def coverage(case: Case, campaign: Campaign, found: Diagnosis) -> dict[str, bool]:
    """Whether the intervals of inertia and drag hold the truth, where both are told in the same form."""
    if set(case.hidden) & OTHER_BASE:
        return {}
    vehicle = campaign.vehicle
    truth = {"I_r": vehicle.inertia * vehicle.scale, "k_rr": vehicle.quadratic * vehicle.scale}
    estimates = base_estimates(found.study, found.found.final)
    return {key: bool(e.ci95[0] <= truth[key] <= e.ci95[1]) for key, e in estimates.items() if key in truth}


def all_cases(seeds: int, quick: bool) -> list[Case]:
    """Every effect by size, layout and seed, none hidden, two, and strange ones; --quick is 40 of them."""
    cases = []
    for seed in range(seeds):
        for number, law in enumerate(LAWS):
            for size in ("large",) if quick else ("small", "large"):
                for layout in (("full", "steps")[number % 2 :][:1]) if quick else ("steps", "full"):
                    cases.append(Case((law,), size, layout, seed))
        for number, scatter in enumerate(SCATTERS):
            for layout in (("full", "steps")[number % 2 :][:1]) if quick else ("steps", "full"):
                cases.append(Case((), f"scatter-{scatter:g}", layout, seed, scatter=scatter))
        cases += [Case(pair, "large", "full", seed) for pair in (PAIRS[:4] if quick else PAIRS)]
        cases += [Case((law,), "large", "full", seed) for law in STRANGE]
    if not quick:
        cases += [Case((law,), "usual", "full", seed, runs=48) for seed in range(seeds) for law in LAWS]
    return cases


def short_cases(seeds: int, noisy: bool) -> list[Case]:
    """One law of each of 21 effects, with manoeuvres or `noisy` steps alone; two effects; nothing hidden."""
    first = {name: law for law, (name, *_) in reversed(LAWS.items())}
    one = [law for law in LAWS if law in first.values()][:21]
    luck = {"scatter": 0.05, "noise": 2.0} if noisy else {}
    layout = "steps" if noisy else "full"
    return [
        Case(hidden, "large" if hidden else "short", layout, seed, **luck)
        for seed in range(seeds)
        for hidden in [*((law,) for law in one), *PAIRS[:3], ()]
    ]


CLEAN: dict[str, dict[str, Any]] = {
    "72 runs": {"layout": "steps", "runs": 72, "scatter": 0.03, "noise": 1.0},
    "24 noisy runs": {"layout": "steps", "scatter": 0.05, "noise": 2.0},
    "manoeuvres": {"layout": "full", "scatter": 0.03, "noise": 1.0},
}
DRIVEN = "driven"


def clean_cases(seeds: int) -> list[Case]:
    """Nothing hidden: so many campaigns of each of four kinds, the driven ones those of the closed loop."""
    return [
        Case((), kind, **{"layout": DRIVEN, "seed": seed, **CLEAN.get(kind, {})})
        for seed in range(seeds)
        for kind in (*CLEAN, DRIVEN)
    ]


def share(outcomes: Sequence[Outcome], *words: str) -> str:
    """Share of outcomes that are one of `words`, with the count."""
    if not outcomes:
        return "-"
    count = sum(o.outcome in words for o in outcomes)
    return f"{100 * count / len(outcomes):.0f} % ({count} of {len(outcomes)})"


def marks(outcomes: Sequence[Outcome]) -> Table:
    """What was wanted, and what was got."""
    large = [o for o in outcomes if o.size != "small" and (o.visible is None or o.visible >= JUST)]
    full, steps = ([o for o in large if o.kind == f"one, {layout}"] for layout in ("full", "steps"))
    kinds = {word: [o for o in outcomes if o.kind == word] for word in ("none", "two", "strange")}
    pairs = [o for o in outcomes if o.gap_truth is not None and o.size != "small"]
    ratio = [o.gap_after / max(o.gap_truth, 1e-9) for o in pairs if o.gap_after and o.gap_truth]
    closed = [
        o.gap_after**2 - o.gap_floor**2 <= 0.5 * max(o.gap_before**2 - o.gap_floor**2, 0.0) + 0.05 * o.gap_floor**2
        for o in pairs
        if o.gap_after and o.gap_before and o.gap_floor
    ]
    held = [inside for o in outcomes for inside in o.covered.values()]
    rows = (
        ("one hidden, manoeuvres: right", ">= 95 %", share(full, "right")),
        ("  right or tie", "", share(full, "right", "tie")),
        ("  wrong without a flag", "<= 1 %", share(full, "wrong")),
        ("  missed, unexplained", "", f"{share(full, 'missed')}, {share(full, 'unexplained')}"),
        ("one hidden, steps only: right or tie", ">= 95 %", share(steps, "right", "tie")),
        ("  wrong, missed", "", f"{share(steps, 'wrong')}, {share(steps, 'missed')}"),
        ("small (twice what is visible): wrong", "", share([o for o in outcomes if o.size == "small"], "wrong")),
        ("nothing hidden: a claim", "<= 5 %", share(kinds["none"], "false")),
        ("two hidden: both", ">= 80 %", share(kinds["two"], "right", "tie")),
        ("not in the library: unexplained", ">= 80 %", share(kinds["strange"], "right")),
        ("  named with rivals, without", "", f"{share(kinds['strange'], 'tie')}, {share(kinds['strange'], 'false')}"),
        ("held-out gap <= 1.1 x the true model's", "all", _count([r <= 1.1 for r in ratio])),
        ("half of the gap above the floor gone", "all", _count(closed)),
        ("95 % intervals of I_r, k_rr hold the truth", "92-98 %", _count(held)),
        ("seconds a campaign, median", "", f"{np.median([o.seconds for o in outcomes]):.1f}"),
    )
    return Table("Blind benchmark", ("case", "wanted", "got"), rows)


def _count(true: Sequence[bool]) -> str:
    return f"{100 * sum(true) / len(true):.0f} % ({sum(true)} of {len(true)})" if true else "-"


def failures(outcomes: Sequence[Outcome]) -> Table:
    """Every case that was not right, in its own words."""
    rows = tuple(
        (
            o.case,
            o.outcome,
            "; ".join(f"{name} ({', '.join(rivals)})" if rivals else name for name, rivals in o.named.items()),
            f"{o.visible:.0f}" if o.visible else "-",
            f"{o.residual_over_floor[0]:.2f} {o.residual_over_floor[1]:.2f}",
        )
        for o in outcomes
        if o.outcome != "right"
    )
    return Table("Not right", ("case", "outcome", "named (rivals)", "visible", "residual/floor"), rows)


def main() -> None:
    """Run the cases asked for in processes, print the marks, keep every outcome."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=1, help="campaigns a case (default: 1)")
    parser.add_argument("--quick", action="store_true", help="a subset of about 40 campaigns")
    parser.add_argument("--only", help="only cases whose name has this in it, as dead-band/large/full/0")
    parser.add_argument("--layout", choices=("steps", "full"))
    parser.add_argument("--jobs", type=int, default=2, help="processes (default: 2)")
    parser.add_argument("--out", type=Path, default=Path("out/blind.json"), help="default: out/blind.json")
    options = parser.parse_args()
    cases = [
        case
        for case in all_cases(options.seeds, options.quick)
        if (not options.only or options.only in case.name) and options.layout in (None, case.layout)
    ]
    if not cases:
        parser.error(f"no case has {options.only!r} in its name; effects are {', '.join((*LAWS, *STRANGE))}")
    outcomes: list[Outcome] = []
    refused: list[str] = []
    with ProcessPoolExecutor(options.jobs) as pool:
        waiting = {pool.submit(run_case, case): case for case in cases}
        for done, future in enumerate(as_completed(waiting), 1):
            try:
                outcomes.append(future.result())
            except AutomarineError as refusal:  # one campaign that cannot be diagnosed must not end the others
                refused.append(f"{waiting[future].name}: {refusal}")
                print(f"{done}/{len(cases)} {refused[-1]}", file=sys.stderr, flush=True)
                continue
            last = outcomes[-1]
            line = f"{done}/{len(cases)} {last.case}: {last.outcome} {last.named} {last.seconds:.0f} s"
            print(line, file=sys.stderr, flush=True)
    if not outcomes:
        raise SystemExit("no campaign could be diagnosed")
    order = {case.name: i for i, case in enumerate(cases)}
    outcomes.sort(key=lambda o: order[o.case])
    table = marks(outcomes)
    print(table.to_text())
    print(failures(outcomes).to_text())
    print(f"Refused: {'; '.join(refused) or 'none'}")
    options.out.parent.mkdir(parents=True, exist_ok=True)
    kept = {"marks": [dict(zip(table.header, row)) for row in table.rows], "cases": [asdict(o) for o in outcomes]}
    options.out.write_text(json.dumps(kept, indent=1) + "\n")


if __name__ == "__main__":
    missing = {name for name, *_ in LAWS.values()} - set(effects.names())
    if missing:
        raise SystemExit(f"the library has no {', '.join(sorted(missing))}")
    main()
