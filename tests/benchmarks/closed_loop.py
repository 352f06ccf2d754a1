"""`make closed-loop`: does `diagnose` name what is hidden where a controller steers and the water disturbs?

The campaigns come from closed_loop_truth.py and closed_loop_cases.py, which know nothing of the library's equations.
Outcomes where something is hidden: `right` names just that; `tie` names a look-alike instead and lists the right name
among its rivals; `half` finds one of two; `extra` names all of it and something else; `wrong` names something else;
`missed` names nothing; `unexplained`. Where nothing is hidden: `silent`, `false` (a claim) or `unexplained`. `failed`
is a campaign that ended in an error.

Usage: python tests/benchmarks/closed_loop.py [--kinds TEXT,...] [--seeds N] [--gyro none|half|all] [--jobs N]
"""

import os

os.environ["OPENBLAS_NUM_THREADS"] = os.environ["OMP_NUM_THREADS"] = "1"  # before numpy: each process has one core

import argparse
import json
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, fields, is_dataclass, replace
from pathlib import Path

import numpy as np
from closed_loop_cases import KINDS, LOOK_ALIKES, Kind, make

from automarine_cli import effects
from automarine_cli.diagnosis.diagnose import Gap, diagnose_runs
from automarine_cli.report.tables import Table

RIGHT, WRONG = ("right", "tie"), ("wrong", "extra")
COLUMNS = (
    ("campaign", 24), ("base", 9), ("disturbed", 9), ("unsteady", 8), ("outcome", 11), ("gap", 13), ("seconds", 7),
)  # fmt: skip


@dataclass(frozen=True)
class Case:
    """One campaign to be made."""

    kind: str
    seed: int
    gyro: bool

    @property
    def name(self) -> str:
        return f"{self.kind}/{self.seed}{'/gyro' * self.gyro}"


@dataclass(frozen=True)
class Outcome:
    """What came of a case; `disturbed` and `unsteady` are the truth's; gaps on runs held out as (before, after, floor)
    [deg]; `prediction` is the diagnosis's own, empty if it makes none; `why` is the error of one that failed."""

    case: str
    kind: str
    outcome: str
    base: str = ""
    disturbed: float = 0.0
    unsteady: float = 0.0
    named: Mapping[str, Sequence[str]] | None = None
    parameters: Mapping[str, Mapping[str, float]] | None = None
    gap: tuple[float, float, float] | None = None
    prediction: object = None
    seconds: float = 0.0
    why: str = ""


def run_case(case: Case) -> Outcome:
    """Make the campaign, diagnose it, judge the answer; an error is an outcome."""
    campaign = make(case.kind, case.seed, case.gyro)
    drag = "+".join(term.name.removesuffix("-drag")[:4] for term in campaign.base.terms)
    known = Outcome(case.name, case.kind, "", drag, campaign.chance.disturbance, campaign.chance.unsteady)
    begun = time.perf_counter()
    try:
        found = diagnose_runs(campaign.fitted, campaign.base, hold_out=campaign.kept, seed=case.seed)
    except Exception as error:  # whatever it is, the other campaigns go on
        why, seconds = f"{type(error).__name__}: {error}", time.perf_counter() - begun
        return replace(known, outcome="failed", why=why, seconds=seconds)
    named = {effect.name: [rival.name for rival in effect.rivals] for effect in found.effects}
    return replace(
        known,
        outcome=judge(KINDS[case.kind], found.verdict, named),
        named=named,
        parameters={e.name: {key: x.value for key, x in e.parameters.items()} for e in found.effects},
        gap=degrees(found.held_out_gap),
        prediction=plain(getattr(found, "prediction", None)),
        seconds=time.perf_counter() - begun,
    )


def judge(kind: Kind, verdict: str, named: Mapping[str, Sequence[str]]) -> str:
    """One word on a verdict; see the module's docstring."""
    if verdict != "named":
        silent = "missed" if kind.right else "silent"
        return silent if verdict == "nothing-missing" else verdict
    if not kind.right:
        return "false"
    missing = set(kind.right) - set(named)
    others = [name for name in named if name not in kind.right]
    for name in others:
        meant = {right for right in missing if name in LOOK_ALIKES[right] and right in named[name]}
        if not meant:
            return "wrong" if missing else "extra"
        missing -= {min(meant)}
    if missing:
        return "half"
    return "tie" if others else "right"


def degrees(gap: Gap | None) -> tuple[float, float, float] | None:
    """A gap's numbers [deg]."""
    if gap is None:
        return None
    before, after, floor = (float(np.degrees(x)) for x in (gap.before, gap.after, gap.floor))
    return before, after, floor


def plain(value: object) -> object:
    """Numbers, words and their collections of a result, as JSON has them; arrays are left out."""
    if is_dataclass(value) and not isinstance(value, type):
        return plain({f.name: getattr(value, f.name) for f in fields(value)})
    if isinstance(value, Mapping):
        return {str(key): plain(x) for key, x in value.items() if not isinstance(x, np.ndarray)}
    if isinstance(value, (list, tuple)):
        return [plain(x) for x in value if not isinstance(x, np.ndarray)]
    if isinstance(value, np.generic):
        return value.item()
    return value if isinstance(value, (str, int, float, bool)) or value is None else str(value)


def line(outcome: Outcome) -> str:
    """One row of the table that is printed as the cases end."""
    gap = "" if outcome.gap is None else f"{outcome.gap[0]:.2f} -> {outcome.gap[1]:.2f}"
    cells = (
        outcome.case, outcome.base, f"{100 * outcome.disturbed:.0f} %", f"{100 * outcome.unsteady:.0f} %",
        outcome.outcome, gap, f"{outcome.seconds:.0f}",
    )  # fmt: skip
    named = [f"{name} ({', '.join(r)})" if r else name for name, r in (outcome.named or {}).items()]
    row = "  ".join(cell.ljust(width) for cell, (_, width) in zip(cells, COLUMNS))
    return f"{row}  {outcome.why or '; '.join(named)}".rstrip()


def marks(outcomes: Sequence[Outcome]) -> Table:
    """What was wanted, and what was got."""
    hidden = [o for o in outcomes if KINDS[o.kind].right]
    clean = [o for o in outcomes if not KINDS[o.kind].right]
    rows = (
        ("something hidden: right or flagged tie", ">= 90 %", share(hidden, *RIGHT)),
        ("something hidden: right", "", share(hidden, "right")),
        ("something hidden: wrong, or something else as well", "<= 5 %", share(hidden, *WRONG)),
        ("something hidden: half, missed, unexplained", "", share(hidden, "half", "missed", "unexplained")),
        ("nothing hidden: a claim", "none", share(clean, "false")),
        ("nothing hidden: unexplained", "", share(clean, "unexplained")),
        ("failed", "none", share(outcomes, "failed")),
        ("seconds a campaign, median", "< 60", f"{np.median([o.seconds for o in outcomes]):.1f}"),
    )
    return Table("Closed-loop benchmark", ("case", "wanted", "got"), rows)


def share(outcomes: Sequence[Outcome], *words: str) -> str:
    """Share of outcomes that are one of `words`, with the count."""
    count = sum(o.outcome in words for o in outcomes)
    return f"{100 * count / len(outcomes):.0f} % ({count} of {len(outcomes)})" if outcomes else "-"


def cases_of(kinds: str | None, seeds: int, gyro: str) -> list[Case]:
    """The cases asked for; `kinds` are parts of names with commas between, "half" gives every second one a gyro."""
    wanted = [name for name in KINDS if not kinds or any(part in name for part in kinds.split(","))]
    has = {"none": lambda i: False, "half": lambda i: i % 2 == 1, "all": lambda i: True}[gyro]
    return [Case(name, seed, has(i + seed)) for seed in range(seeds) for i, name in enumerate(wanted)]


def main() -> None:
    """Run the cases asked for, print each as it ends and the marks, keep every outcome."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kinds", help="only kinds that have one of these in their names, as delay,clean")
    parser.add_argument("--seeds", type=int, default=2, help="campaigns a kind (default: 2)")
    parser.add_argument("--gyro", choices=("none", "half", "all"), default="none", help="default: none")
    parser.add_argument("--jobs", type=int, default=1, help="processes (default: 1)")
    parser.add_argument("--out", type=Path, help="file for every outcome, as JSON")
    options = parser.parse_args()
    cases = cases_of(options.kinds, options.seeds, options.gyro)
    if not cases:
        parser.error(f"no kind has {options.kinds!r} in its name; there are {', '.join(KINDS)}")
    print("  ".join(name.ljust(width) for name, width in COLUMNS) + "  named (rivals)", flush=True)
    outcomes: list[Outcome] = []
    with ProcessPoolExecutor(options.jobs) as pool:
        waiting = {pool.submit(run_case, case): case for case in cases}
        for future in as_completed(waiting):
            case = waiting[future]
            try:
                outcomes.append(future.result())
            except Exception as error:  # the process died, or the campaign could not be made
                outcomes.append(Outcome(case.name, case.kind, "failed", why=f"{type(error).__name__}: {error}"))
            print(line(outcomes[-1]), flush=True)
    order = {case.name: i for i, case in enumerate(cases)}
    outcomes.sort(key=lambda o: order[o.case])
    table = marks(outcomes)
    print()
    print(table.to_text())
    if options.out:
        kept = {"marks": [dict(zip(table.header, row)) for row in table.rows], "cases": [asdict(o) for o in outcomes]}
        options.out.parent.mkdir(parents=True, exist_ok=True)
        options.out.write_text(json.dumps(kept, indent=1) + "\n")


if __name__ == "__main__":
    missing = {name for kind in KINDS.values() for name in kind.right} - set(effects.names())
    if missing:
        raise SystemExit(f"the library has no {', '.join(sorted(missing))}")
    main()
