"""Campaigns in which something is hidden, as plain files for any tool, and the score of its answers.

    python tests/benchmarks/blind_frozen.py write  FOLDER --key KEY.json [--seeds N] [--form FORM]
    python tests/benchmarks/blind_frozen.py answer FOLDER --answers ANSWERS.json [--jobs N]
    python tests/benchmarks/blind_frozen.py score  ANSWERS.json --key KEY.json

`write` makes FOLDER/campaign_000 and so on: one CSV a run (time_s on a clock that all runs share, heading_deg from 0 to
360, the commanded moment tau or tau_Nm, surge_m_s where it was logged) and base.json, the inertia and drag that a user
would bring, some tenths off. The order of campaigns tells nothing. KEY.json, which no tool may see, holds the
answers. Forms are all, short (21 effects with manoeuvres, three pairs, nothing hidden), noisy (the
same from 24 noisy steps) and clean (nothing hidden, in four kinds; two idle columns, lost rows).

`answer` is how automarine answers; it may be stopped and goes on where it was. Any other tool writes the same:

    {"campaign_000": {"verdict": "named" | "suspected" | "nothing-missing" | "unexplained",
                      "effects": [{"name": "dead-band", "confidence": 0.97, "rivals": ["coulomb-drag"]}]}}

with the names of `automarine effects`. `score` prints marks, who was taken for whom, and how often what was said with a
confidence was right. Marks of a campaign with one or two effects hidden: `right` names just these; `tie` names all of
them, each itself or as a rival, or names another beside them; `half` one of two; `wrong` names something else and does
not list them; `missed` names nothing; `suspected` lists something and does not name it; `learned` names a curve over a
variable, of a law that the library lacks; and `unexplained`. Where nothing is hidden, `right` names nothing, `false`
anything.
"""

import json
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import arguments
import closed_loop_cases
import numpy as np
import pandas as pd
from blind_cases import LAWS, PAIRS, STRANGE, Campaign, Case, make

from automarine_cli.diagnosis.diagnose import diagnose_runs
from automarine_cli.dofs import YAW
from automarine_cli.errors import AutomarineError
from automarine_cli.models.model import BASE_TERMS, Model
from automarine_cli.runs.load import load_runs
from automarine_cli.runs.run import Run

CONFIDENT = (0.0, 0.5, 0.9, 1.001)
DRIVEN = "driven"
CLEAN: dict[str, dict[str, Any]] = {
    "72 runs": {"layout": "steps", "runs": 72, "scatter": 0.03, "noise": 1.0},
    "24 noisy runs": {"layout": "steps", "scatter": 0.05, "noise": 2.0},
    "manoeuvres": {"layout": "full", "scatter": 0.03, "noise": 1.0},
    DRIVEN: {"layout": DRIVEN},  # those of the closed loop
}


def all_cases(seeds: int) -> list[Case]:
    """Every effect by size, layout and seed, none hidden, two, and strange ones."""
    cases, layouts = [], ("steps", "full")
    for seed in range(seeds):
        for law, size in product(LAWS, ("small", "large")):
            cases += [Case((law,), size, layout, seed) for layout in layouts]
        for scatter in (0.0, 0.02, 0.03, 0.05):
            cases += [Case((), f"scatter-{scatter:g}", layout, seed, scatter=scatter) for layout in layouts]
        cases += [Case(pair, "large", "full", seed) for pair in PAIRS]
        cases += [Case((law,), "large", "full", seed) for law in STRANGE]
    return cases + [Case((law,), "usual", "full", seed, runs=48) for seed in range(seeds) for law in LAWS]


def short_cases(seeds: int, noisy: bool) -> list[Case]:
    """One law of each of 21 effects, with manoeuvres or `noisy` steps alone; two effects; nothing hidden."""
    first = {name: law for law, (name, *_) in reversed(LAWS.items())}
    single = [law for law in LAWS if law in first.values()][:21]
    scatter, noise = (0.05, 2.0) if noisy else (None, None)
    layout = "steps" if noisy else "full"
    return [
        Case(hidden, "large" if hidden else "short", layout, seed, scatter=scatter, noise=noise)
        for seed in range(seeds)
        for hidden in [*((law,) for law in single), *PAIRS[:3], ()]
    ]


FORMS = {
    "all": all_cases,
    "short": lambda seeds: short_cases(seeds, noisy=False),
    "noisy": lambda seeds: short_cases(seeds, noisy=True),
    "clean": lambda seeds: [Case((), kind, seed=seed, **more) for seed in range(seeds) for kind, more in CLEAN.items()],
}


def campaign_of(case: Case) -> tuple[Sequence[Run], Model, float | None]:
    """Runs of a case, the base that a user would bring, and how visible what is hidden is."""
    if case.layout == DRIVEN:
        steered = closed_loop_cases.make("clean", case.seed)
        return (*steered.fitted, *steered.held_out), steered.base, None
    campaign = make(case)
    runs = campaign.runs if case.size not in CLEAN else with_idle_columns(campaign.runs, case.seed)
    return runs, guess(case, campaign), campaign.visible if np.isfinite(campaign.visible) else None


def guess(case: Case, campaign: Campaign) -> Model:
    """The base model that a user would bring: the right form, values some tenths off."""
    vehicle, unit = campaign.vehicle, campaign.runs[0].moment_unit
    number, drag = ("1", vehicle.linear) if "quadratic" in case.hidden else ("3", 0.85 * vehicle.quadratic)
    return Model.base(number, 1.2 * vehicle.inertia * vehicle.scale, [drag * vehicle.scale], unit, YAW)


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
    cases, hidden = FORMS[form](seeds), dict[str, Any]()
    for number, i in enumerate(np.random.default_rng(len(cases)).permutation(len(cases))):
        name, case = f"campaign_{number:03d}", cases[i]
        runs, base, visible = campaign_of(case)
        place = folder / name
        place.mkdir(parents=True, exist_ok=True)
        for run in runs:
            logged(run).to_csv(place / f"{run.name}.csv", index=False)
        arguments.write_json(place / "base.json", {"inertia": base.inertia} | {t.name: t.values[0] for t in base.terms})
        hidden[name] = {
            "hidden": list(case.hidden), "effects": [LAWS[law][0] for law in case.hidden if law in LAWS],
            "size": case.size, "layout": case.layout, "seed": case.seed, "visible": visible,
        }  # fmt: skip
    arguments.write_json(key, hidden)
    print(f"{len(cases)} campaigns are in {folder}, what is hidden in {key}")


def logged(run: Run) -> pd.DataFrame:
    """A run as its logger keeps it."""
    moment = "tau_Nm" if run.moment_unit == "N m" else "tau"
    heading = np.degrees(run.position).round(4) % 360.0
    units = {"surge": "_m_s", "voltage": "_V"}
    more = {name + units.get(name, ""): values.round(5) for name, values in run.extras.items()}
    return pd.DataFrame({"time_s": run.time.round(4), "heading_deg": heading, moment: run.moment, **more})


def answer(folder: Path, answers: Path, jobs: int) -> None:
    """Let automarine answer what has no answer yet."""
    said = json.loads(answers.read_text()) if answers.exists() else {}
    left = sorted(p.name for p in folder.iterdir() if (p / "base.json").exists() and p.name not in said)
    with ProcessPoolExecutor(jobs) as pool:
        waiting = {pool.submit(answer_of, folder / name): name for name in left}
        for done, future in enumerate(as_completed(waiting), 1):
            said[waiting[future]] = future.result()
            arguments.write_json(answers, dict(sorted(said.items())))
            print(f"{done}/{len(left)} {waiting[future]}: {said[waiting[future]]}", file=sys.stderr, flush=True)


def answer_of(place: Path) -> dict[str, Any]:
    runs = load_runs([place], dof=YAW).runs
    brought = json.loads((place / "base.json").read_text())
    number = next(number for number, terms in BASE_TERMS.items() if set(terms) == set(brought) - {"inertia"})
    drag = [brought[name] for name in BASE_TERMS[number]]
    base = Model.base(number, brought["inertia"], drag, runs[0].moment_unit, YAW)
    try:
        result = diagnose_runs(runs, base)
    except AutomarineError as error:
        return {"verdict": "refused", "effects": [], "why": str(error)}
    effects = [
        {"name": effect.name, "confidence": effect.confidence, "rivals": [rival.name for rival in effect.rivals]}
        for effect in result.effects
    ]
    return {"verdict": result.verdict, "effects": effects}


def score(answers: Mapping[str, Any], key: Mapping[str, Any]) -> None:
    """Print marks, confusion and calibration of a tool's answers."""
    unanswered = sorted(set(key) - set(answers))
    outcomes, confusion = list[tuple[str, str]](), list[tuple[str, str]]()
    sure = list[tuple[float, bool]]()
    for name, truth in ((name, truth) for name, truth in key.items() if name in answers):
        said, hidden, effects = answers[name], truth["hidden"], truth["effects"]
        named = {effect["name"]: list(effect.get("rivals", ())) for effect in said["effects"]}
        more = f" ({truth['size']})" if truth["size"] == "small" or not hidden else ""
        outcomes.append((kind_of(hidden, truth["layout"]) + more, judge(hidden, said["verdict"], named)))
        for law in effects or [f"outside: {hidden[0]}" if hidden else "nothing"]:
            confusion += [(law, got) for got in taken_for(law, said["verdict"], named)]
        if said["verdict"] == "named":
            outside = bool(hidden) and not effects
            sure += [
                (effect.get("confidence", 1.0), effect["name"] in effects or (outside and is_curve(effect["name"])))
                for effect in said["effects"]
            ]
    marks = pd.DataFrame(outcomes, columns=["hidden", "mark"])
    print(pd.crosstab(marks["hidden"], marks["mark"]).to_string())
    by_confidence = pd.DataFrame(sure, columns=["said with", "right"], dtype=float)
    bands = pd.cut(by_confidence["said with"], CONFIDENT, right=False)
    print(by_confidence.groupby(bands, observed=False)["right"].agg(["size", "mean"]).to_string())
    some = f", {unanswered[0]} the first" if unanswered else ""
    print(f"Without an answer: {len(unanswered)} of {len(key)} campaigns{some}")
    print(pd.DataFrame(confusion, columns=["hidden", "said"]).value_counts(sort=False).to_string())


def kind_of(hidden: Sequence[str], layout: str) -> str:
    """Which row of the table a case counts in."""
    if any(law in STRANGE for law in hidden):
        return "strange"
    return ("none", f"one, {layout}", "two")[len(hidden)]


def judge(hidden: Sequence[str], verdict: str, named: Mapping[str, Sequence[str]]) -> str:
    """One word on a verdict; see the module's docstring."""
    if verdict == "suspected":
        return verdict
    if not hidden or any(law in STRANGE for law in hidden):
        if verdict == "named" and hidden and all(map(is_curve, named)):
            return "learned"
        if verdict == "named":
            return "tie" if hidden and all(named.values()) else "false"
        return "right" if verdict == ("unexplained" if hidden else "nothing-missing") else verdict
    if verdict in ("nothing-missing", "unexplained"):
        return {"nothing-missing": "missed"}.get(verdict, verdict)
    truth = {LAWS[law][0] for law in hidden}
    if set(named) == truth:
        return "right"
    mentioned = set(named) | {rival for rivals in named.values() for rival in rivals}
    if truth <= mentioned:
        return "tie"
    return "half" if truth & mentioned and len(truth) == 2 else "wrong"


def is_curve(name: str) -> bool:
    """Whether a name claims a dependence and no law: all that can be said of what is outside the library."""
    return name.startswith("learned:")


def taken_for(hidden: str, verdict: str, named: Mapping[str, Sequence[str]]) -> list[str]:
    """What a hidden effect was taken for."""
    if verdict != "named":
        return [{"nothing-missing": "nothing"}.get(verdict, verdict)]
    return [hidden] if hidden in named else ["learned" if is_curve(name) else name for name in named]


def main() -> None:
    what: dict[str, Any] = {"choices": ("write", "answer", "score")}
    path: dict[str, Any] = {"type": Path}
    chosen = arguments.options(
        __doc__, {"what": what, "place": path}, key=path, answers=path, seeds=1,
        form={"choices": FORMS, "default": "all"}, jobs=2,
    )  # fmt: skip
    needed = "answers" if chosen.what == "answer" else "key"
    if getattr(chosen, needed) is None:
        sys.exit(f"{chosen.what} needs --{needed} FILE")
    if chosen.what == "write":
        write(chosen.place, chosen.key, chosen.seeds, chosen.form)
    elif chosen.what == "answer":
        answer(chosen.place, chosen.answers, chosen.jobs)
    else:
        score(json.loads(chosen.place.read_text()), json.loads(chosen.key.read_text()))


if __name__ == "__main__":
    main()
