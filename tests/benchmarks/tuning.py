"""`make tuning`: do the promises of `automarine tune` hold, and are its gains better than those of before?

`corners`: five vehicles, each in twelve corners (gain of the thrust ± 15 %, inertia ± 10 %, delay as known and half
as long again), flown with ArduSub's defaults and with new gains: which settle, and the worst of them.
`blind`, `late`, `driven`: vehicles of tuning_truth.py, identified and diagnosed from a simulated pool day and tuned;
then the truth itself is flown with the gains: how often do the promised bands of 95 % hold, does every vehicle settle?

Usage: python tests/benchmarks/tuning.py [corners|blind|late|driven] [--vehicles N] [--jobs N] [--out DIR]
"""

import os

os.environ["OPENBLAS_NUM_THREADS"] = os.environ["OMP_NUM_THREADS"] = "1"  # before numpy: each process has one core

import argparse
import json
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from tuning_truth import STEP, Floats, Truth, Vehicle, write_logs

import automarine_cli as am
from automarine_cli.control.design import (
    FINE,
    ClosedLoopRun,
    Ensemble,
    Scores,
    all_margins,
    grid_for,
    scores,
    step_and_load,
)
from automarine_cli.control.targets import get
from automarine_cli.control.targets.base import Gains, Target
from automarine_cli.control.vehicles import Vehicles
from automarine_cli.dofs import YAW
from automarine_cli.errors import AutomarineError
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.report.tables import Table, number

FIVE = {
    "small, 0.03 s lag, 0.02 s delay": (0.59, 1.5, 30.0, "N m", 0.03, 0.02),
    "small, 0.10, 0.05": (0.59, 1.5, 30.0, "N m", 0.10, 0.05),
    "the paper's, 0.15, 0.10": (1.018, 1.257, 1.2, "nu", 0.15, 0.10),
    "the paper's, 0.15, 0.30": (1.018, 1.257, 1.2, "nu", 0.15, 0.30),
    "boat, 0.2, 0.5": (29.0, 30.0, 40.0, "N m", 0.2, 0.5),
}
"""Inertia, quadratic drag, moment of the whole output, its unit, time constant of the thrust and delay [s]."""


NOISE_DEG, NOISE_DEG_S, READ = 0.7, 0.2, 0.1
"""Of the compass and of a gyro, and how long [s] a reading stands."""


def model_file(place: Path, name: str) -> Path:
    """One of the five as a model's file, with the intervals that a pool day leaves."""
    inertia, drag, full, unit, lag, delay = FIVE[name]

    def estimate(value: float, share: float, unit: str) -> dict[str, Any]:
        error = share * value
        return {"value": value, "stderr": error, "ci95": [value - 2 * error, value + 2 * error], "unit": unit}

    model = {
        "schema": "automarine/yaw-model/1", "moment_unit": unit, "preferred": "3", "gain_scatter": 0.05,
        "heading_noise_deg": NOISE_DEG,
        "models": {"3": {"I_r": estimate(inertia, 0.04, f"{unit} s²"), "k_rr": estimate(drag, 0.04, f"{unit} s²")}},
        "valid_range": {"moment": [-full, full], "yaw_rate_rad_s": [-(full / drag) ** 0.5, (full / drag) ** 0.5]},
        "effects": [
            {"name": "thruster-lag", "parameters": {
                "T": estimate(lag, 0.1, "s"), "law": 1.0, "tau_ref": full, "fall": 1.0}},
            {"name": "input-delay", "parameters": {"t_d": estimate(delay, 0.15, "s")}},
        ],
    }  # fmt: skip
    path = place / "model.json"
    path.write_text(json.dumps(model))
    return path


def corners_of(name: str) -> Vehicles:
    """The twelve corners of one of the five."""
    inertia, drag, full, unit, lag, delay = FIVE[name]
    model = YawModel.base("3", inertia, [drag], unit, YAW)
    model = model.with_effect("thruster-lag", [lag, 1.0, full, 1.0]).with_effect("input-delay", [delay])
    corners = list(product((0.85, 1.0, 1.15), (0.9, 1.1), (1.0, 1.5)))
    theta = np.tile(model.theta, (12, 1))
    theta[:, 0] *= [one[1] for one in corners]
    theta[:, model.index("input-delay.t_d")] *= [one[2] for one in corners]
    gain = np.array([one[0] for one in corners])
    return Vehicles(model, theta, full, gain, np.zeros(12), np.ones(12), np.full(12, 0.5))


def corners(name: str, beyond: bool = False) -> dict[str, Any]:
    """Old and new gains of one of the five in its corners."""
    full = FIVE[name][2]
    begun = time.process_time()
    with tempfile.TemporaryDirectory() as spare:
        path = model_file(Path(spare), name)
        found = am.tune(path, target="ardusub", full=full, delay=0.5 * FIVE[name][5], beyond_range=beyond).to_json()
    seconds = time.process_time() - begun
    target, vehicles = get("ardusub"), corners_of(name)
    sets = {"default": target.defaults}
    if found["gains"]:
        sets["new"] = {key: one["value"] for key, one in found["gains"].items()}
    rows = {}
    for kind, gains in sets.items():
        own: Gains = {key: np.full((1, 1), value) for key, value in gains.items()}
        flight = step_and_load(target, own, vehicles, np.pi / 2, 0.1, 40.0)
        one = scores(flight, np.pi / 2, np.deg2rad(2.0))
        disk = all_margins(target, own, vehicles, grid_for(target, [Ensemble("", vehicles)], FINE)).disk
        rows[kind] = {
            "disk_margin": float(disk.min()), "overshoot_percent": 100.0 * float(one.overshoot.max()),
            "settled": int(one.settles.sum()), "settling_s": float(one.settling.max()),
            "rms_deg": float(np.rad2deg(one.rms.max())), "load_deg": float(np.rad2deg(one.error.max())),
            "left_deg": float(np.rad2deg(one.end.max())),
        }  # fmt: skip
    return {"vehicle": name, "verdict": found["verdict"], "seconds": seconds, "gains": sets.get("new", {}), **rows}


@dataclass(frozen=True)
class Blind:
    """What became of one blind vehicle: the verdict, what the truth did, and which promises it kept."""

    seed: int
    target: str
    hidden: dict[str, float]
    named: list[str]
    verdict: str
    settled: bool | None
    held: dict[str, bool]
    flown: dict[str, float]
    promised: dict[str, Any]
    seconds: float
    why: str = ""


TARGETS = ("ardusub", "python", "pid")


FAMILIES = {"blind": Truth.drawn, "late": Truth.late, "driven": Truth.driven}
"""Vehicles with one or two things hidden; late ones; and small ones behind speed controllers, whose thrust is a curve
with a dead-band, identified from steps alone, where that curve hides in the gains of single runs."""


def identified(truth: Truth, seed: int, place: Path, steps: bool) -> Path:
    """The diagnosis of a blind vehicle's pool day, in a folder where it may already be."""
    random, diagnosis = np.random.default_rng([seed, 22]), place / "diagnosis" / "diagnosis.json"
    if not diagnosis.is_file():
        write_logs(truth, place / "logs", random, steps=steps)
        am.fit_yaw([str(place / "logs")], fit_to="whole-runs", out=place / "model", overwrite=True)
        model = place / "model" / "yaw_model.json"
        am.diagnose([str(place / "logs")], model=model, out=diagnosis.parent, overwrite=True)
    return diagnosis


def blind(seed: int, out: Path, family: str = "blind") -> Blind:
    """One vehicle: a pool day, a fit, a diagnosis, gains, and the truth flown with them."""
    target, truth = TARGETS[seed % len(TARGETS)] if family == "blind" else "ardusub", FAMILIES[family](seed)
    hidden, begun, names = dict(truth.hidden), time.process_time(), list[str]()
    try:
        diagnosis = identified(truth, seed, out / family / f"{seed:02}", steps=family == "driven")
        names = [one["name"] for one in json.loads(diagnosis.read_text())["effects"]]
        begun = time.process_time()
        tuned = am.tune(diagnosis, target=target, full=1.0, beyond_range=family == "blind")
    except AutomarineError as problem:
        return Blind(seed, target, hidden, names, "refused", None, {}, {}, {}, 0.0, str(problem))
    seconds, found = time.process_time() - begun, tuned.to_json()
    if found["verdict"] != "gains":
        return Blind(seed, target, hidden, names, found["verdict"], None, {}, {}, {}, seconds, found["why"])
    gains = {key: one["value"] for key, one in found["gains"].items()}
    one = flown(truth, tuned.designed.target, gains, found["flight_s"], np.random.default_rng([seed, 19]))
    did = {
        "overshoot_percent": 100.0 * float(one.overshoot[0]), "settling_s": float(one.settling[0]),
        "rms_after_deg": float(np.rad2deg(one.rms[0])), "load_error_deg": float(np.rad2deg(one.error[0])),
    }  # fmt: skip
    held = {key: within(value, found["promised"][key]) for key, value in did.items()}
    promised = {key: None if found["promised"][key] is None else found["promised"][key]["ci95"] for key in did}
    return Blind(seed, target, hidden, names, "gains", bool(one.settles[0]), held, did, promised, seconds)


def within(value: float, promised: dict[str, Any] | None) -> bool:
    """Whether a value lies in a band, an open end being infinite."""
    if promised is None:
        return False
    low, high = promised["ci95"]
    return (low is None or low <= value) and (high is None or value <= high)


def flown(truth: Truth, target: Target, gains: dict[str, float], seconds: float, random: np.random.Generator) -> Scores:
    """The truth under the target's stack, its readings noisy: a step of 90 degrees, and 10 % load."""
    gain = np.exp(truth.scatter * random.standard_normal(1)) * np.ones(2)
    vehicle = Vehicle(truth, gain)
    own: Gains = {key: np.full((1, 1), value) for key, value in gains.items()}
    reference, load = np.array([[np.pi / 2, 0.0]]), np.array([0.0, 0.1])
    state = target.start(own, np.zeros((1, 2)), np.zeros((1, 1)))
    parts: list[Floats] = []
    left = 0.0
    for k in range(round(seconds / target.period)):
        if k % max(1, round(0.1 / target.period)) == 0:
            parts.append(vehicle.heading)
        if k % max(1, round(READ / target.period)) == 0:
            wrong = np.deg2rad([[NOISE_DEG], [NOISE_DEG_S]]) * random.standard_normal((2, 2))
        heading, rate = vehicle.shown + wrong[0], vehicle.rate + wrong[1]
        state, output = target.step(state, own, reference, heading[None], rate[None])
        left += target.period
        while left > 0.5 * STEP:
            vehicle.advance(output[0], load)
            left -= STEP
    position = np.stack(parts, axis=1)[None]
    time = 0.1 * np.arange(position.shape[2], dtype=float)
    return scores(ClosedLoopRun(time, position, 0.0 * position), np.pi / 2, np.deg2rad(2.0))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", nargs="*", default=["corners", "blind", "late", "driven"])
    parser.add_argument("--vehicles", type=int, default=40)
    parser.add_argument(
        "--first", type=int, default=0, help="number of the first blind vehicle, from which it is drawn"
    )
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--beyond", action="store_true")
    parser.add_argument("--out", type=Path, default=Path("out"))
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(asked.jobs) as pool:
        if "corners" in asked.what:
            print_corners(list(pool.map(corners, FIVE, [asked.beyond] * len(FIVE))), asked.out)
        for family in [name for name in FAMILIES if name in asked.what]:
            found = []
            count = asked.vehicles if family == "blind" else asked.vehicles // 4
            numbers = range(asked.first, asked.first + count)
            for one in pool.map(blind, numbers, [asked.out] * count, [family] * count):
                found.append(one)
                print(json.dumps(asdict(one)), flush=True)
            print_blind(found, asked.out, family)


def print_corners(found: list[dict[str, Any]], out: Path) -> None:
    """Old against new, the worst corner of each."""
    (out / "tuning_corners.json").write_text(json.dumps(found, indent=1))
    rows = []
    for one in found:
        for kind in ("default", "new"):
            if kind in one:
                own = one[kind]
                cells = (
                    number(own[key], 3)
                    for key in ("disk_margin", "overshoot_percent", "settling_s", "rms_deg", "load_deg", "left_deg")
                )
                rows.append((one["vehicle"], kind, f"{own['settled']} of 12", *cells, f"{one['seconds']:.0f}"))
    head = (
        "vehicle",
        "gains",
        "settled",
        "disk margin",
        "overshoot [%]",
        "settles after [s]",
        "rms after [deg]",
        "10 % load [deg]",
        "left of it [deg]",
        "tuned in [s]",
    )
    print(Table("Worst of twelve corners", head, tuple(rows)).to_text())


def print_blind(found: list[Blind], out: Path, family: str) -> None:
    (out / f"tuning_{family}.json").write_text(json.dumps([asdict(one) for one in found], indent=1))
    given = [one for one in found if one.verdict == "gains"]
    rows = [("settled", f"{sum(bool(one.settled) for one in given)} of {len(given)}")]
    for key in given[0].held if given else ():
        rows.append((key, f"{sum(one.held[key] for one in given)} of {len(given)}"))
    whole = [held for one in given for held in one.held.values()]
    rows.append(("all promises", f"{sum(whole)} of {len(whole)}"))
    verdicts = {name: sum(one.verdict == name for one in found) for name in sorted({one.verdict for one in found})}
    rows += [(f"verdict {name}", str(count)) for name, count in verdicts.items()]
    rows.append(("time per tuning [s], most", f"{max(one.seconds for one in found):.0f}"))
    print(Table(f"Vehicles: {family}", ("what", "held"), tuple(rows)).to_text())


if __name__ == "__main__":
    main()
