"""Campaigns in which something is hidden, as plain files for any tool, and the score of its answers.

    python tests/benchmarks/blind_frozen.py write  FOLDER --key KEY.json [--seeds N] [--form FORM]
    python tests/benchmarks/blind_frozen.py answer FOLDER --answers ANSWERS.json [--jobs N]
    python tests/benchmarks/blind_frozen.py score  ANSWERS.json --key KEY.json [--figure FILE.png]

`write` makes FOLDER/campaign_000 and so on: one CSV a run (time_s on a clock that all runs share, heading_deg from 0 to
360, the commanded moment tau or tau_Nm, surge_m_s where it was logged) and base.json, the inertia and drag that a user
would bring, some tenths off. The order of campaigns tells nothing. KEY.json, which no tool may see, holds the
answers. Forms are all, quick (40 of them), short (21 effects with manoeuvres, three pairs, nothing hidden), noisy (the
same from 24 noisy steps) and clean (nothing hidden, in four kinds; two idle columns, lost rows).

`answer` is how automarine answers; it may be stopped and goes on where it was. Any other tool writes the same:

    {"campaign_000": {"verdict": "named" | "suspected" | "nothing-missing" | "unexplained",
                      "effects": [{"name": "dead-band", "confidence": 0.97, "rivals": ["coulomb-drag"]}]}}

with the names of `automarine effects`. `score` prints marks, who was taken for whom, and how often what was said with a
confidence was right.
"""

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy, and for the processes: each has one core

import argparse
import json
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import closed_loop_cases
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from blind import CLEAN, DRIVEN, all_cases, clean_cases, guess, judge, kind_of, short_cases
from blind_cases import LAWS, Case, make

from automarine_cli.diagnosis.diagnose import diagnose_runs
from automarine_cli.dofs import YAW
from automarine_cli.errors import AutomarineError
from automarine_cli.models.yaw_model import BASE_TERMS, YawModel
from automarine_cli.report.tables import Table
from automarine_cli.runs.load import load_runs
from automarine_cli.runs.run import Run

NOTHING, UNEXPLAINED, SUSPECTED = "nothing", "unexplained", "suspected"
CONFIDENT = (0.0, 0.5, 0.9, 1.0)


FORMS = {
    "all": lambda seeds: all_cases(seeds, quick=False),
    "quick": lambda seeds: all_cases(seeds, quick=True),
    "short": lambda seeds: short_cases(seeds, noisy=False),
    "noisy": lambda seeds: short_cases(seeds, noisy=True),
    "clean": clean_cases,
}


def made(case: Case) -> tuple[Sequence[Run], YawModel, float]:
    """Runs of a case, the base that a user would bring, and how visible what is hidden is."""
    if case.layout == DRIVEN:
        steered = closed_loop_cases.make("clean", case.seed)
        return (*steered.fitted, *steered.kept), steered.base, np.inf
    campaign = make(case)
    runs = campaign.runs if case.size not in CLEAN else with_idle_columns(campaign.runs, case.seed)
    return runs, guess(case, campaign), campaign.visible


def with_idle_columns(runs: Sequence[Run], seed: int) -> list[Run]:
    """Runs as a logger with more sensors keeps them: a battery that empties, a temperature of each run, neither of any
    consequence, and one row in a hundred lost."""
    random, last = np.random.default_rng([seed, 77]), max(run.time[-1] for run in runs)
    wider = []
    for run in runs:
        stays = random.random(len(run)) > 0.01
        noise = random.standard_normal((2, len(run)))
        voltage = 24.65 - 0.5 * run.time / last + 0.05 * random.standard_normal() + 0.03 * noise[0]
        columns = {**run.extras, "voltage": voltage, "water_temp_C": random.uniform(14.0, 20.0) + 0.07 * noise[1]}
        extras = {name: values[stays] for name, values in columns.items()}
        moment = run.command[stays]
        wider.append(replace(run, time=run.time[stays], position=run.position[stays], moment=moment, extras=extras))
    return wider


def write(folder: Path, key: Path, seeds: int, form: str) -> None:
    """Make all campaigns, in an order that tells nothing, and their key."""
    cases = FORMS[form](seeds)
    order = np.random.default_rng(len(cases)).permutation(len(cases))
    known: dict[str, Any] = {}
    for number, i in enumerate(order):
        name, case = f"campaign_{number:03d}", cases[i]
        runs, base, visible = made(case)
        place = folder / name
        place.mkdir(parents=True, exist_ok=True)
        for run in runs:
            logged(run).to_csv(place / f"{run.name}.csv", index=False)
        brought = {"inertia": base.inertia, **{term.name: term.values[0] for term in base.terms}}
        (place / "base.json").write_text(json.dumps(brought, indent=1) + "\n")
        known[name] = {
            "hidden": list(case.hidden),
            "effects": [LAWS[law][0] for law in case.hidden if law in LAWS],
            "size": case.size,
            "layout": case.layout,
            "seed": case.seed,
            "visible": visible if np.isfinite(visible) else None,
        }
    key.write_text(json.dumps(known, indent=1) + "\n")
    print(f"{len(cases)} campaigns are in {folder}, what is hidden in {key}")


def logged(run: Run) -> pd.DataFrame:
    """A run as its logger keeps it."""
    assert run.moment is not None
    moment = "tau_Nm" if run.moment_unit == "N m" else "tau"
    columns = {
        "time_s": run.time.round(4),
        "heading_deg": np.degrees(run.position).round(4) % 360.0,
        moment: run.moment,
    }
    units = {"surge": "_m_s", "voltage": "_V"}
    more = {name + units.get(name, ""): values.round(5) for name, values in run.extras.items()}
    return pd.DataFrame(columns | more)


def answer(folder: Path, answers: Path, jobs: int) -> None:
    """Let automarine answer what has no answer yet."""
    said = json.loads(answers.read_text()) if answers.exists() else {}
    left = sorted(p.name for p in folder.iterdir() if (p / "base.json").exists() and p.name not in said)
    with ProcessPoolExecutor(jobs) as pool:
        waiting = {pool.submit(partial(answer_of, folder), name): name for name in left}
        for done, future in enumerate(as_completed(waiting), 1):
            said[waiting[future]] = future.result()
            fresh = answers.with_suffix(".part")
            fresh.write_text(json.dumps(dict(sorted(said.items())), indent=1) + "\n")
            fresh.replace(answers)
            print(f"{done}/{len(left)} {waiting[future]}: {said[waiting[future]]}", file=sys.stderr, flush=True)


def answer_of(folder: Path, name: str) -> dict[str, Any]:
    runs = load_runs([folder / name], dof=YAW).runs
    brought = json.loads((folder / name / "base.json").read_text())
    number = next(number for number, terms in BASE_TERMS.items() if set(terms) == set(brought) - {"inertia"})
    drag = [brought[name] for name in BASE_TERMS[number]]
    base = YawModel.base(number, brought["inertia"], drag, runs[0].moment_unit, YAW)
    try:
        found = diagnose_runs(runs, base)
    except AutomarineError as error:
        return {"verdict": "refused", "effects": [], "why": str(error)}
    told = [
        {"name": one.name, "confidence": one.confidence, "rivals": [rival.name for rival in one.rivals]}
        for one in found.effects
    ]
    return {"verdict": found.verdict, "effects": told}


def score(answers: Mapping[str, Any], key: Mapping[str, Any], figure: Path | None) -> None:
    """Print marks, confusion and calibration of a tool's answers."""
    unanswered = sorted(set(key) - set(answers))
    outcomes: dict[str, Counter[str]] = {}
    confusion: Counter[tuple[str, str]] = Counter()
    sure: list[tuple[float, bool]] = []
    for name, truth in key.items():
        if name in unanswered:
            continue
        said = answers[name]
        case = Case(tuple(truth["hidden"]), truth["size"], truth["layout"], truth["seed"])
        named = {one["name"]: list(one.get("rivals", ())) for one in said["effects"]}
        more = f" ({truth['size']})" if truth["size"] == "small" or not truth["hidden"] else ""
        outcomes.setdefault(kind_of(case) + more, Counter())[judge(case, said["verdict"], named)] += 1
        for hidden in truth["effects"] or [("outside: " + truth["hidden"][0]) if truth["hidden"] else NOTHING]:
            for got in taken_for(hidden, said["verdict"], named):
                confusion[hidden, got] += 1
        if said["verdict"] == "named":
            outside = bool(truth["hidden"]) and not truth["effects"]
            sure += [
                (one.get("confidence", 1.0), one["name"] in truth["effects"] or (outside and is_curve(one["name"])))
                for one in said["effects"]
            ]
    words = sorted({word for counts in outcomes.values() for word in counts})
    rows = [
        (kind, str(sum(counts.values())), *(str(counts[word]) for word in words))
        for kind, counts in sorted(outcomes.items())
    ]
    print(Table("Marks", ("hidden", "campaigns", *words), tuple(rows)).to_text())
    print(calibration(sure).to_text())
    some = f", {unanswered[0]} the first" if unanswered else ""
    print(f"Without an answer: {len(unanswered)} of {len(key)} campaigns{some}")
    if figure is not None:
        draw(confusion, figure)


def is_curve(name: str) -> bool:
    """Whether a name claims a dependence and no law: all that can be said of what is outside the library."""
    return name.startswith("learned:")


def taken_for(hidden: str, verdict: str, named: Mapping[str, Sequence[str]]) -> list[str]:
    """What a hidden effect was taken for."""
    if verdict != "named":
        return [{"nothing-missing": NOTHING}.get(verdict, verdict)]
    return [hidden] if hidden in named else ["learned" if is_curve(name) else name for name in named]


def calibration(sure: Sequence[tuple[float, bool]]) -> Table:
    """How often what was said with a confidence was right."""
    rows = []
    for low, high in pairwise(CONFIDENT):
        inside = [right for said, right in sure if low <= said < high or said == high == 1.0]
        right = f"{100 * np.mean(inside):.0f} %" if inside else "-"
        rows.append((f"{100 * low:.0f} to {100 * high:.0f} %", str(len(inside)), right))
    return Table("Confidence", ("said with", "names", "right"), tuple(rows))


def draw(confusion: Mapping[tuple[str, str], int], path: Path) -> None:
    """The confusion matrix: what was hidden by what was said, as shares of each row."""
    hidden, got = (sorted({pair[i] for pair in confusion}) for i in (0, 1))
    counts = np.array([[confusion.get((h, g), 0) for g in got] for h in hidden], dtype=float)
    shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1.0)
    figure, axes = plt.subplots(figsize=(7.0, 0.19 * len(hidden) + 1.8), layout="constrained")
    image = axes.imshow(shares, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    for (row, column), count in np.ndenumerate(counts):
        if count:
            dark = shares[row, column] > 0.6
            axes.text(column, row, f"{count:.0f}", ha="center", va="center", fontsize=6, color="w" if dark else "k")
    axes.set_xticks(range(len(got)), got, rotation=90, fontsize=6.5)
    axes.set_yticks(range(len(hidden)), hidden, fontsize=6.5)
    axes.set_xlabel("said")
    axes.set_ylabel("hidden")
    figure.colorbar(image, ax=axes, label="share of campaigns", shrink=0.5)
    figure.savefig(path, dpi=200, metadata={"Software": None})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    what = parser.add_subparsers(dest="what", required=True)
    writes, answers, scores = (what.add_parser(name) for name in ("write", "answer", "score"))
    for one in (writes, answers):
        one.add_argument("folder", type=Path)
    scores.add_argument("answers", type=Path)
    for one in (writes, scores):
        one.add_argument("--key", type=Path, required=True)
    answers.add_argument("--answers", type=Path, required=True)
    answers.add_argument("--jobs", type=int, default=2)
    writes.add_argument("--seeds", type=int, default=1)
    writes.add_argument("--form", choices=FORMS, default="all")
    scores.add_argument("--figure", type=Path)
    given = parser.parse_args()
    if given.what == "write":
        write(given.folder, given.key, given.seeds, given.form)
    elif given.what == "answer":
        answer(given.folder, given.answers, given.jobs)
    else:
        score(json.loads(given.answers.read_text()), json.loads(given.key.read_text()), given.figure)


if __name__ == "__main__":
    main()
