"""`make paper`: the paper's Tables 1 and 2 against simulated campaigns of sample_runs/paper.toml.

For every printed number: the median and the 95 % spread over the seeds, and the percentile at which the printed
number falls; then what judges the printed numbers. Prints Markdown; writes paper.md and paper.csv.

Usage: python tests/benchmarks/paper.py [--seeds N] [--jobs N] [--out DIR]
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import arguments
import numpy as np
from repository import SAMPLE_RUNS
from specified import make_runs, read_specification

from automarine_cli.commands.terminal import terminal_progress
from automarine_cli.dofs import YAW
from automarine_cli.fits.paper import fit_drag, fit_velocity_error
from automarine_cli.fits.steps import data_of_steps
from automarine_cli.models.model import inertia_from_velocity_error
from automarine_cli.pipeline.parallel import ordered_map
from automarine_cli.quantities import Floats
from automarine_cli.report.tables import Table, number
from automarine_cli.runs.half_turn import half_turns
from automarine_cli.simulation.specification import EffectSetting, Specification

Values = dict[str, Floats]

CONSTANT = 0.0275
"""c of tau = k_rr |r| r + c that the printed numbers ask for. The vehicle obeys I r' = tau + b - k_rr |r| r, in
steady state tau = k_rr |r| r - b: so the hidden bias moment is b = -c."""

LARGE_MOMENT = 0.5  # Table 2's inertia of model 1 follows from model 3's for a mean over moments from here on
TURNED_HARDLY = 0.75  # as `moment_most` of the specification

PRINTED = (
    ("1", "1", "k_r", "k_r of model 1", 0.9961),
    ("1", "1", "SSE", "SSE of model 1", 1.8908),
    ("1", "2", "k_rr", "k_rr of model 2", 1.259),
    ("1", "2", "k_r", "k_r of model 2", 0.02753),
    ("1", "2", "SSE", "SSE of model 2", 0.8019),
    ("1", "3", "k_rr", "k_rr of model 3", 1.257),
    ("1", "3", "SSE", "SSE of model 3", 0.8353),
    ("1", "1 less 3", "SSE", "SSE of model 1 less model 3", 1.0555),
    ("1", "3 less 2", "SSE", "SSE of model 3 less model 2", 0.0334),
    ("1", "3 less 2", "k_rr", "k_rr of model 3 less model 2", -0.002),
    ("1", "2 as 3+c", "k_rr", "k_rr of model 3+c", 1.259),
    ("1", "2 as 3+c", "c", "c of model 3+c", 0.02753),
    ("1", "2 as 3+c", "SSE", "SSE of model 3+c", 0.8019),
    ("1", "3 less 3+c", "SSE", "SSE of model 3 less model 3+c", 0.0334),
    ("2", "1", "I_r, all moments", "I_r of model 1", 0.7058),
    ("2", "1", "I_r, |τ| ≥ 0.5", "I_r of model 1, large moments", 0.7058),
    ("2", "3", "I_r", "I_r of model 3", 1.018),
)
"""Table, model, symbol, key of `run_trial` and value of every printed number, and what follows from them. Model "3+c"
is tau = k_rr |r| r + c: the reading under which the numbers printed for model 2 are those of a constant moment."""


HIDDEN = f"constant moment {CONSTANT}"
RECORDED = f"{HIDDEN}, scatter in the recorded moment"
SETTINGS = ("nothing hidden", HIDDEN, RECORDED)
"""What the simulated campaigns hide; in the last the scatter of the moments is in what the log says of them and not in
what acts."""


def hiding(setting: str, specification: Specification) -> Specification:
    """The campaign of the specification with that hidden in it."""
    if setting in (HIDDEN, RECORDED):
        bias = EffectSetting("bias-moment", {"b": -CONSTANT}, dof=YAW)
        specification = replace(specification, effects=(*specification.effects, bias))
    if setting == RECORDED:
        specification = replace(specification, scatter=replace(specification.scatter, force=0.0))
    return specification


def run_trial(item: tuple[Specification, str, int]) -> dict[str, float]:
    """Simulate the campaign with that seed and compute every number of `PRINTED`, and what judges them.

    By the plain least squares that the paper had: what the noise of the rates dilutes is not taken off.
    """
    specification, setting, seed = item
    turns, _ = half_turns(make_runs(hiding(setting, specification), seed))
    data = data_of_steps(turns)
    fit = fit_velocity_error(data, np.zeros(len(turns)))
    # the same tails, where the scatter is in the record against moments that were written down wrong
    moment = _misread(data.moment, specification.scatter.force, seed) if setting == RECORDED else data.moment
    drags = {name: fit_drag(moment, fit.tails.rate, name, "nu", YAW) for name in fit.drag}
    columns = np.stack([np.abs(fit.tails.rate) * fit.tails.rate, np.ones(len(turns))], axis=1)
    (k_rr, c), (sse,), *_ = np.linalg.lstsq(columns, moment)
    inertia = {name: inertia_from_velocity_error(fit.tails.error, moment, *drags[name].drag) for name in fit.inertia}
    values = {f"{key} of model {name}": x.value for name, drag in drags.items() for key, x in drag.estimates.items()}
    values |= {f"SSE of model {name}": drag.sse for name, drag in drags.items()}
    values |= {"k_rr of model 3+c": k_rr, "c of model 3+c": c, "SSE of model 3+c": sse}
    values |= {f"I_r of model {name}": float(per_run.mean()) for name, per_run in inertia.items()}
    for key, large, small in (("SSE", "1", "3"), ("SSE", "3", "2"), ("SSE", "3", "3+c"), ("k_rr", "3", "2")):
        less = values[f"{key} of model {large}"] - values[f"{key} of model {small}"]
        values[f"{key} of model {large} less model {small}"] = less
    fast = np.abs(data.moment) >= LARGE_MOMENT - 1e-9  # by the moment that was meant
    rate = np.abs(fit.tails.rate)
    ratio = float(np.sum(rate**3) / np.sum(rate**4))
    return values | {
        "I_r of model 1, large moments": float(inertia["1"][fast].mean()),
        "tail from": float(np.degrees(fit.tail_from)),
        "steady": float(fit.steady),
        "identity gap": abs(values["k_rr of model 3 less model 2"] - values["k_r of model 2"] * ratio),
        "sum ratio": ratio,
        "corrected k_r": fit.drag["2"].drag[0],
        "corrected k_rr": fit.drag["3"].drag[1],
        "residual": float(np.sqrt(values["SSE of model 3"] / len(turns))),
    }


def _misread(moment: Floats, sd: float, seed: int) -> Floats:
    """The moments with the specification's scatter, redrawn by the same rule, in the record of them."""
    random = np.random.default_rng([5, seed])
    error = sd * random.standard_normal(len(moment))
    while np.any(wide := np.abs(error) > TURNED_HARDLY * np.abs(moment)):
        error[wide] = sd * random.standard_normal(int(wide.sum()))
    return moment + error


def printed_table(results: Sequence[Values], seeds: int) -> Table:
    """One row a printed number, two columns a setting; of how many the setting's central 95 % hold the printed one."""
    rows, inside = [], [0] * len(results)
    for table, model, symbol, key, value in PRINTED:
        row = {"": f"Table {table}", "model": model, "number": symbol, "printed": number(value)}
        for i, (setting, values) in enumerate(zip(SETTINGS, results)):
            low, median, high = np.percentile(values[key], (2.5, 50.0, 97.5))
            row[f"{setting}: median [95 %]"] = f"{median:.4g} [{low:.4g}, {high:.4g}]"
            row["percentile" + " " * i] = f"{100.0 * np.mean(values[key] < value):.1f}"
            inside[i] += low <= value <= high
        rows.append(row)
    notes = [
        f"With {setting}: {count} of {len(PRINTED)} numbers fall inside the 95 % spread."
        for setting, count in zip(SETTINGS, inside)
    ]
    title = f"The paper's Tables 1 and 2 in {seeds} simulated campaigns: where the printed numbers fall"
    return Table.of(title, rows, notes)


def judging_table(results: Sequence[Values]) -> Table:
    """What the printed numbers are judged by, a column a setting."""
    k_r, gap = (next(value for *_, key, value in PRINTED if key == wanted) for wanted in (
        "k_r of model 2", "k_rr of model 3 less model 2"))  # fmt: skip
    measures = {
        "k3 = k2 + k_r Σ|r|³/Σr⁴ (the least-squares pair of any data) holds to": lambda v: v["identity gap"].max(),
        "campaigns with k_r > 0 and k3 < k2, as printed": lambda v: np.sum(
            (v["k_r of model 2"] > 0) & (v["k_rr of model 3 less model 2"] < 0)
        ),
        f"least k3 - k2 that the printed k_r of {k_r} needs; printed is {gap}": lambda v: k_r * v["sum ratio"].min(),
        f"% of campaigns with a constant of {k_r} or more": lambda v: 100 * np.mean(np.abs(v["c of model 3+c"]) >= k_r),
        "k_rr of model 3, dilution taken off as by fit-yaw, median": lambda v: np.median(v["corrected k_rr"]),
        "k_r of model 2, dilution taken off as by fit-yaw, median": lambda v: np.median(v["corrected k_r"]),
        "campaigns in which no tail reaches its bias limit": lambda v: np.sum(v["steady"] == 0),
        "start of the tail [degrees], median": lambda v: np.median(v["tail from"]),
        f"residual of model 3, rms, median; printed {np.sqrt(0.8353 / 44):.3f} if 44 runs were fitted": lambda v: (
            np.median(v["residual"])
        ),
    }
    rows = [
        {"": name, **{setting: number(float(of(v)), 3) for setting, v in zip(SETTINGS, results)}}
        for name, of in measures.items()
    ]
    note = f"Hidden constant moment: c = {CONSTANT}, that is b = -c in I r' = tau + b - k_rr |r| r."
    return Table.of("What judges them", rows, [note])


def main() -> None:
    """Run the campaigns, print both tables, write them."""
    chosen = arguments.options(__doc__, seeds=200, jobs=2, out=Path("out"))
    specification = read_specification(SAMPLE_RUNS / "paper.toml")
    work = [(specification, setting, seed) for setting in SETTINGS for seed in range(1, chosen.seeds + 1)]
    trials = ordered_map(run_trial, work, chosen.jobs, progress=terminal_progress(), stage="campaigns")
    results = []
    for i in range(len(SETTINGS)):
        part = trials[i * chosen.seeds : (i + 1) * chosen.seeds]
        results.append({key: np.array([values[key] for values in part]) for key in part[0]})
    table = printed_table(results, chosen.seeds)
    markdown = f"{table.to_markdown()}\n{judging_table(results).to_markdown()}"
    chosen.out.mkdir(parents=True, exist_ok=True)
    (chosen.out / "paper.md").write_text(markdown, encoding="utf-8")
    (chosen.out / "paper.csv").write_text(table.to_csv(), encoding="utf-8")
    print(markdown, end="")


if __name__ == "__main__":
    main()
