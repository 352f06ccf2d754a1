"""How often the 95 % intervals of surge and heave hold the truth: campaigns as in sample_runs, made anew.

python tests/benchmarks/force_coverage.py --campaigns 40
"""

import argparse
from collections import defaultdict
from pathlib import Path

from identified import identify
from specified import make_runs, read_specification

from automarine_cli.estimate import Estimate
from automarine_cli.fits.identify import YawFit
from automarine_cli.runs.half_turn import Trim

SAMPLES = Path(__file__).resolve().parents[2] / "sample_runs"
TRIMS = {"surge": Trim(3.0), "heave": Trim(None, 0.0, 3.6)}
FIRST_SEED = 100


def estimates(fit: YawFit) -> dict[str, Estimate]:
    """Everything that model 3 says, by both estimators."""
    best, seed = fit.output_error["3"], fit.seed_method
    found = dict(best.estimates)
    if best.ways is not None:
        found |= {f"drag {way}": one for way, one in best.ways.drag.items()}
        found |= {f"distance {way}": one for way, one in best.ways.distance.items()}
    if seed is not None:
        found |= {f"{name}, least squares": one for name, one in seed.drag["3"].estimates.items()}
        found[f"{fit.dof.symbols.inertia}, velocity error"] = seed.inertia["3"].overall
    return found


def coverage(motion: str, campaigns: int) -> dict[str, float]:
    """Share of the campaigns in which each interval holds the truth."""
    specification = read_specification(SAMPLES / f"{motion}.toml")
    vehicle, dof = specification.vehicle, specification.vehicle.dof
    constant = dict(vehicle.terms).get("bias-moment", 0.0)
    half = dict(vehicle.terms).get("drag-asymmetry", 0.0)
    own = dof.symbols
    truth = {
        own.inertia: vehicle.inertia, own.quadratic: vehicle.quadratic, own.constant: constant, own.difference: half,
    }  # fmt: skip
    for way, drag in zip(dof.words.ways, (vehicle.quadratic + half, vehicle.quadratic - half)):
        truth |= {f"drag {way}": drag, f"distance {way}": vehicle.inertia / drag}
    held: dict[str, list[bool]] = defaultdict(list)
    for seed in range(FIRST_SEED, FIRST_SEED + campaigns):
        runs = [run for run in make_runs(specification, seed) if run.source.startswith(f"{motion}/")]
        for name, one in estimates(identify(runs, trim=TRIMS[motion])).items():
            low, high = one.ci95
            held[name].append(low <= truth[name.partition(",")[0]] <= high)
    return {name: sum(found) / len(found) for name, found in held.items()}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--campaigns", type=int, default=40)
    asked = parser.parse_args()
    for one in TRIMS:
        for label, share in coverage(one, asked.campaigns).items():
            print(f"{one:6s} {label:28s} {100 * share:5.1f} %")
