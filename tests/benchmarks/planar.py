"""Does diagnose name what a planar model lacks? Campaigns of an independent solver, two seeds, mirrored too.

    python tests/benchmarks/planar.py [--seeds 2] [--out planar.json]

Each campaign: five runs of 16 s at 5 Hz are fitted, two are held out; heading, speeds and places with noise, 2 %
scatter of the thrust. Right: that name and no other. Tie: it is among the rivals. Wrong: another name. Missed: none,
or only suspected. Shown is also the error of the heading predicted 5 s ahead on held-out runs. Some ten minutes.
"""

import argparse
import json
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "helpers"))

from made_planar import HIDDEN, campaign

from automarine_cli.diagnosis.planar import PlanarSearch, find_missing, find_planar_where
from automarine_cli.dofs import YAW
from automarine_cli.fits.planar_structure import observed
from automarine_cli.models.planar import Inertia, PlanarModel
from automarine_cli.models.store import StoredPlanar
from automarine_cli.models.yaw_model import Term

GIVEN = PlanarModel(
    Inertia(18.0, 18.0, 2.2),
    surge=(Term("quadratic-drag", (15.0,)),),
    sway=(Term("quadratic-drag", (50.0,)),),
    yaw=(Term("quadratic-drag", (3.0,)),),
)
FITTED, LENGTH = 5, 16.0
ADDED = {"N_ur": "yaw.N_ur", "N_v": "yaw.N_v", "Y_r": "sway.Y_r", "munk-moment": "sway.m_v", "current": "current.north"}


def judged(kind: str, found: PlanarSearch) -> str:
    """Right, tie, wrong or missed; for a campaign with nothing hidden right or wrong."""
    named = [one.candidate.added[0] for one in found.named]
    if kind == "nothing":
        return "wrong" if named else "right"
    if not named:
        return "missed"
    if named == [ADDED[kind]]:
        return "tie" if found.steps[0].rivals else "right"
    rivals = {rival.candidate.added[0] for one in found.steps for rival in one.rivals}
    return "tie" if ADDED[kind] in rivals else "wrong"


def rows(seeds: int) -> Iterator[dict[str, Any]]:
    for kind, craft in HIDDEN.items():
        for seed in range(11, 11 + seeds):
            for mirror in (False, True):
                runs = campaign(craft, seed, FITTED + 2, LENGTH, mirror=mirror)
                begin = time.process_time()
                found = find_missing(StoredPlanar(GIVEN, "by hand"), runs[:FITTED], runs[FITTED:], observed(runs))
                spent = time.process_time() - begin
                where, outlook = find_planar_where(found, 0), found.outlook(True)
                ahead = outlook and outlook.longest
                yield {
                    "hidden": kind, "seed": seed, "mirrored": mirror, "verdict": judged(kind, found),
                    "named": [one.candidate.added[0] for one in found.named],
                    "stands_out": sorted({one.variable for one in where.regions}) if where else [],
                    "before_deg": float(YAW.shown(ahead[0].error)) if ahead else None,
                    "after_deg": float(YAW.shown(ahead[1].error)) if ahead else None,
                    "cpu_s": round(spent, 1),
                }  # fmt: skip


def main() -> None:
    """Print a table, and write it if asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    found = []
    print(f"{'hidden':12} seed mirrored verdict  5 s ahead [deg]   CPU s  named; where")
    for row in rows(asked.seeds):
        found.append(row)
        ahead = "-" if row["before_deg"] is None else f"{row['before_deg']:6.2f} -> {row['after_deg']:5.2f}"
        named, out = (", ".join(row[key]) or "-" for key in ("named", "stands_out"))
        print(
            f"{row['hidden']:12} {row['seed']:4} {row['mirrored']!s:8} {row['verdict']:7}  {ahead:16} {row['cpu_s']:6}"
            f"  {named}; {out}", flush=True,
        )  # fmt: skip
    print(dict(Counter(str(row["verdict"]) for row in found)))
    if asked.out:
        asked.out.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
