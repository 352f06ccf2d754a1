"""`make closed-loop`: does `diagnose` name what is hidden where a controller steers and the water disturbs?

The campaigns come from closed_loop_truth.py and closed_loop_cases.py, which know nothing of the library's equations.
Outcomes where something is hidden: `right` names just that; `tie` names a look-alike instead and lists the right name
among its rivals; `half` finds one of two; `extra` names all of it and something else; `wrong` names something else;
`missed` names nothing; `unexplained`. Where nothing is hidden: `silent`, `false` (a claim) or `unexplained`. `failed`
is a campaign that ended in an error. --kinds runs those that have one of these texts in their names, --gyro with one.

Usage: python tests/benchmarks/closed_loop.py [--kinds TEXT,...] [--seeds N] [--gyro] [--jobs N] [--out FILE]
"""

import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import arguments
import numpy as np
from closed_loop_cases import KINDS, LOOK_ALIKES, make

from automarine_cli.diagnosis.diagnose import diagnose_runs
from automarine_cli.report.tables import Table

Row = dict[str, Any]


def run_case(kind: str, seed: int, gyro: bool) -> Row:
    """Make the campaign, diagnose it, judge the answer; an error is an outcome. `disturbed` and `unsteady` are the
    truth's; `gap` is that on runs held out (before, after, floor) [deg]."""
    campaign = make(kind, seed, gyro)
    row = {
        "case": f"{kind}/{seed}{'/gyro' * gyro}", "kind": kind,
        "base": "+".join(term.name.removesuffix("-drag")[:4] for term in campaign.base.terms),
        "disturbed": campaign.chance.disturbance, "unsteady": campaign.chance.unsteady,
    }  # fmt: skip
    begun = time.perf_counter()
    try:
        result = diagnose_runs(campaign.fitted, campaign.base, hold_out=campaign.held_out, seed=seed)
        named = {effect.name: [rival.name for rival in effect.rivals] for effect in result.effects}
        gap = result.held_out and result.held_out.gap
        row |= {
            "outcome": judge(KINDS[kind].right, result.verdict, named), "named": named,
            "parameters": {e.name: {key: x.value for key, x in e.parameters.items()} for e in result.effects},
            "gap": gap and [float(np.degrees(x)) for x in (gap.before, gap.after, gap.floor)],
        }  # fmt: skip
    except Exception as error:  # whatever it is, the other campaigns go on
        row |= {"outcome": "failed", "named": {f"{type(error).__name__}: {error}": []}, "gap": None}
    return row | {"seconds": time.perf_counter() - begun}


def judge(right: Sequence[str], verdict: str, named: Mapping[str, Sequence[str]]) -> str:
    """One word on a verdict; see the module's docstring."""
    if verdict != "named":
        silent = "missed" if right else "silent"
        return silent if verdict == "nothing-missing" else verdict
    if not right:
        return "false"
    missing = set(right) - set(named)
    others = [name for name in named if name not in right]
    for name in others:
        meant = {law for law in missing if name in LOOK_ALIKES[law] and law in named[name]}
        if not meant:
            return "wrong" if missing else "extra"
        missing -= {min(meant)}
    return "half" if missing else "tie" if others else "right"


def marks(rows: Sequence[Row]) -> Table:
    """What was wanted, and what was got."""
    hidden, clean = ([row for row in rows if bool(KINDS[row["kind"]].right) is sought] for sought in (True, False))
    lines = (
        ("something hidden: right or flagged tie", ">= 90 %", share(hidden, "right", "tie")),
        ("something hidden: right", "", share(hidden, "right")),
        ("something hidden: wrong, or something else as well", "<= 5 %", share(hidden, "wrong", "extra")),
        ("something hidden: half, missed, unexplained", "", share(hidden, "half", "missed", "unexplained")),
        ("nothing hidden: a claim", "none", share(clean, "false")),
        ("nothing hidden: unexplained", "", share(clean, "unexplained")),
        ("failed", "none", share(rows, "failed")),
        ("seconds a campaign, median", "< 60", f"{np.median([row['seconds'] for row in rows]):.1f}"),
    )
    return Table("Closed-loop benchmark", ("case", "wanted", "got"), lines)


def share(rows: Sequence[Row], *words: str) -> str:
    """Share of outcomes that are one of `words`, with the count."""
    count = sum(row["outcome"] in words for row in rows)
    return f"{count / len(rows):.0%} ({count} of {len(rows)})" if rows else "-"


def main() -> None:
    """Run the cases asked for, print each as it ends and the marks, write every outcome."""
    chosen = arguments.options(__doc__, kinds="", seeds=2, gyro=False, jobs=1, out={"type": Path})
    kinds = [name for name in KINDS if any(part in name for part in chosen.kinds.split(","))]
    if not kinds:
        raise SystemExit(f"no kind has {chosen.kinds!r} in its name; there are {', '.join(KINDS)}")
    cases = [(name, seed, chosen.gyro) for seed in range(chosen.seeds) for name in kinds]
    rows: dict[tuple[str, int, bool], Row] = {}
    with ProcessPoolExecutor(chosen.jobs) as pool:
        waiting = {pool.submit(run_case, *case): case for case in cases}
        for future in as_completed(waiting):
            row = rows[waiting[future]] = future.result()
            print(f"{row['case']}: {row['outcome']}, {row['seconds']:.0f} s; {row['named']}", flush=True)
    every = [rows[case] for case in cases]
    table = marks(every)
    print(f"\n{table.to_text()}")
    if chosen.out:
        arguments.write_json(
            chosen.out, {"marks": [dict(zip(table.header, cells)) for cells in table.rows], "cases": every}
        )


if __name__ == "__main__":
    main()
