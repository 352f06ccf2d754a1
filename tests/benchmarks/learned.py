"""What is learned where the library has no law: right variable, band, gap; and silence where nothing is."""

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "helpers"))

from made_learned import BASE, LAWS, campaign, true_curve, true_gap

from automarine_cli.diagnosis.diagnose import Diagnosis, diagnose_runs

SEEDS, CLEAN = 2, 40
SCATTERS = (0.0, 0.02, 0.05)
"""Of the thrust, in clean campaigns one after the other."""


def judged(name: str, diagnosis: Diagnosis) -> dict[str, Any]:
    """What came of a campaign with a law in it."""
    variable = LAWS[name][0]
    found = {"verdict": diagnosis.verdict, "effects": list(diagnosis.found.final.added)}
    curve = next((one.learned for one in diagnosis.effects if one.learned is not None), None)
    if curve is None or diagnosis.held_out_gap is None:
        return found
    truth = true_curve(name, diagnosis)
    return found | {
        "right": diagnosis.found.final.added == (f"learned:{variable}",),
        "rivals": [rival.name for rival in diagnosis.found.rivals],
        "inside_band": float(np.mean((truth > curve.low) & (truth < curve.high))),
        "held_out_gap_to_that_of_the_true_model": diagnosis.held_out_gap.after / true_gap(name, diagnosis),
    }


def main() -> None:
    """Run all, or so many of the clean campaigns, and write what came of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/learned.json"))
    parser.add_argument("--clean", type=int, default=CLEAN)
    parser.add_argument("--seeds", type=int, default=SEEDS)
    given = parser.parse_args()
    found: dict[str, Any] = {}
    for name in [one for one in LAWS if one != "nothing"]:
        for seed in range(given.seeds):
            began = time.perf_counter()
            found[f"{name} {seed}"] = judged(name, diagnose_runs(campaign(name, seed), BASE, seed=seed))
            found[f"{name} {seed}"]["seconds"] = round(time.perf_counter() - began, 1)
            print(name, seed, found[f"{name} {seed}"], flush=True)
    claims = {}
    for seed in range(given.clean):
        runs = campaign("nothing", 100 + seed, gain=SCATTERS[seed % len(SCATTERS)])
        diagnosis = diagnose_runs(runs, BASE, seed=seed)
        print("nothing", seed, diagnosis.verdict, flush=True)
        if diagnosis.verdict != "nothing-missing":
            claims[seed] = {"verdict": diagnosis.verdict, "effects": list(diagnosis.found.final.added)}
    found["nothing"] = {"campaigns": given.clean, "not silent": claims}
    print("nothing", found["nothing"])
    given.out.parent.mkdir(parents=True, exist_ok=True)
    given.out.write_text(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
