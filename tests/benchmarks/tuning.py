"""`make tuning`: do the promises of `automarine tune` hold, and are its gains better than those of before?

`corners`: five vehicles, each in twelve corners (gain of the thrust ± 15 %, inertia ± 10 %, delay as known and half
as long again), flown with ArduSub's defaults and with new gains: which settle, and the worst of them.
`blind`, `late`, `driven`: vehicles of tuning_truth.py, identified and diagnosed from a simulated pool day and tuned;
then the truth itself is flown with the gains: how often do the promised bands of 95 % hold, does every vehicle settle?
`stack`: twenty more, late, with a dead-band, a curved thrust or little authority, fitted with these effects, flown by
the stack of tuning_stack.py: do gains keep the margin of the truth, how near are they to the best of many random sets
within the documented ranges, and does a vehicle hunt that gains were promised to?

Usage: python tests/benchmarks/tuning.py [corners|blind|late|driven|stack ...] [--vehicles N] [--jobs N] [--out DIR]
"""

import json
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from pathlib import Path
from typing import Any

import arguments
import numpy as np
import pandas as pd
import tuning_stack
from tuning_truth import STEP, Floats, Truth, Vehicle, write_logs

import automarine_cli as am
from automarine_cli.control import design
from automarine_cli.control.targets import get
from automarine_cli.control.targets.base import Gains, Target
from automarine_cli.control.vehicles import Vehicles
from automarine_cli.dofs import YAW
from automarine_cli.errors import AutomarineError
from automarine_cli.models.model import Model

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
TARGETS = ("ardusub", "pid")
FAMILIES = {"blind": Truth.drawn, "late": Truth.late, "driven": Truth.driven}
"""Vehicles with one or two things hidden; late ones; and small ones behind speed controllers, whose thrust is a curve
with a dead-band, identified from steps alone, where that curve hides in the gains of single runs."""


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
    arguments.write_json(place / "model.json", model)
    return place / "model.json"


def corners_of(name: str) -> Vehicles:
    """The twelve corners of one of the five."""
    inertia, drag, full, unit, lag, delay = FIVE[name]
    model = Model.base("3", inertia, [drag], unit, YAW)
    model = model.with_effect("thruster-lag", [lag, 1.0, full, 1.0]).with_effect("input-delay", [delay])
    gain, heavier, later = np.array(list(product((0.85, 1.0, 1.15), (0.9, 1.1), (1.0, 1.5)))).T
    theta = np.tile(model.theta, (12, 1))
    theta[:, 0] *= heavier
    theta[:, model.index("input-delay.t_d")] *= later
    return Vehicles(model, theta, full, gain, np.zeros(12), np.ones(12), np.full(12, 0.5))


def numbers_of(flight: design.FlightScores) -> dict[str, float]:
    """The worst of what was flown."""
    return {
        "overshoot_percent": 100.0 * float(flight.overshoot.max()), "settling_s": float(flight.settling.max()),
        "rms_after_deg": float(np.rad2deg(flight.rms.max())), "load_error_deg": float(np.rad2deg(flight.error.max())),
        "load_left_deg": float(np.rad2deg(flight.left.max())),
    }  # fmt: skip


def corners(name: str) -> list[dict[str, Any]]:
    """Old and new gains of one of the five in its corners."""
    full, begun = FIVE[name][2], time.process_time()
    with tempfile.TemporaryDirectory() as spare:
        path = model_file(Path(spare), name)
        tuned = am.tune(path, target="ardusub", full=full, delay=0.5 * FIVE[name][5]).to_json()
    seconds = time.process_time() - begun
    target, vehicles = get("ardusub"), corners_of(name)
    rows = []
    for kind, gains in (("default", target.defaults), ("new", values_of(tuned["gains"] or {}))):
        if gains:
            tried: Gains = {key: np.full((1, 1), value) for key, value in gains.items()}
            flight = design.scores(
                design.step_and_load(target, tried, vehicles, np.pi / 2, 0.1, 40.0), np.pi / 2, np.deg2rad(2.0)
            )
            highest = min(np.pi / target.period, 60.0 / (1.5 * FIVE[name][5]))
            omega = design.frequencies(highest, design.FINE_FREQUENCIES)
            disk = design.all_margins(target, tried, vehicles, omega).disk
            rows.append({
                "vehicle": name, "gains": kind, "settled": int(flight.settles.sum()), "disk_margin": float(disk.min()),
                **numbers_of(flight), "seconds": seconds,
                "verdict": tuned["verdict"], "values": gains,
            })  # fmt: skip
    return rows


def values_of(gains: dict[str, Any]) -> dict[str, float]:
    """Values of the gains of a tuning's file."""
    return {key: gain["value"] for key, gain in gains.items()}


def identified(truth: Truth, seed: int, place: Path, steps: bool) -> Path:
    """The diagnosis of a blind vehicle's pool day, in a folder where it may already be."""
    diagnosis, logs, model = place / "diagnosis" / "diagnosis.json", place / "logs", place / "model"
    if not diagnosis.is_file():
        write_logs(truth, logs, np.random.default_rng([seed, 22]), NOISE_DEG, steps)
        am.fit_yaw([str(logs)], fit_to="whole-runs", out=model, overwrite=True)
        am.diagnose([str(logs)], model=model / "yaw_model.json", out=diagnosis.parent, overwrite=True)
    return diagnosis


def blind(seed: int, out: Path, family: str) -> dict[str, Any]:
    """One vehicle: a pool day, a fit, a diagnosis, gains, and the truth flown with them: which promises it kept."""
    truth, target = FAMILIES[family](seed), TARGETS[seed % len(TARGETS)] if family == "blind" else "ardusub"
    row = {"seed": seed, "target": target, "hidden": dict(truth.hidden), "named": [], "held": {}, "seconds": 0.0}
    try:
        diagnosis = identified(truth, seed, out / family / f"{seed:02}", steps=family == "driven")
        row["named"] = [effect["name"] for effect in json.loads(diagnosis.read_text())["effects"]]
        begun = time.process_time()
        result = am.tune(diagnosis, target=target, full=1.0, beyond_range=family == "blind")
    except AutomarineError as problem:
        return row | {"verdict": "refused", "why": str(problem)}
    tuned = result.to_json()
    row |= {"seconds": time.process_time() - begun, "verdict": tuned["verdict"], "why": tuned.get("why", "")}
    if tuned["verdict"] != "gains":
        return row
    random, promised = np.random.default_rng([seed, 19]), tuned["promised"]
    flight = flown(truth, result.target, values_of(tuned["gains"]), tuned["flight_s"], random, tuned["load_recovery_s"])
    did = numbers_of(flight)
    return row | {
        "settled": bool(flight.settles[0]), "flown": did,
        "held": {key: within(value, promised[key]) for key, value in did.items()},
        "promised": {key: promised[key] and promised[key]["ci95"] for key in did},
    }  # fmt: skip


SETS, MOST = 4000, 300  # random sets of gains for the best: drawn, and flown of those that keep the margin
THRUSTS = (0.9, 1.0, 1.1)
OUTPUTS = (0.2, 0.5, 0.9)  # about which a curved thrust has a slope


def fleet_of(truth: Truth) -> tuning_stack.Fleet:
    """The truth with three thrusts, for the independent stack."""
    return tuning_stack.Fleet(
        np.array(THRUSTS), np.full(len(THRUSTS), truth.size("delay")), truth.inertia, truth.quadratic, truth.linear,
        truth.size("thrust-lag"), truth.size("idle"), truth.size("power") or 1.0,
    )  # fmt: skip


def stack(seed: int, out: Path) -> dict[str, Any]:
    """One vehicle: identified, diagnosed and tuned; the truth with the gains, and with the best of random ones."""
    truth = Truth.limited(seed)
    row: dict[str, Any] = {"seed": seed, "hidden": dict(truth.hidden), "inertia": truth.inertia}
    place = out / "limited" / f"{seed:02}"
    source = place / "model" / "yaw_model.json"
    if seed % 4 == 2:  # a curve of the thrust is a diagnosis's to name
        source = identified(truth, seed, place, steps=False)
    elif not source.is_file():
        write_logs(truth, place / "logs", np.random.default_rng([seed, 22]), NOISE_DEG)
        effects = "input-delay,thruster-lag" + (",dead-band" if seed % 4 == 1 else "")
        am.fit_yaw([str(place / "logs")], with_effects=effects, out=source.parent, overwrite=True)
    begun = time.process_time()
    tuned = am.tune(source, target="ardusub", full=1.0).to_json()
    row |= {"seconds": time.process_time() - begun, "verdict": tuned["verdict"], "why": tuned["why"]}
    row["ends"], recovery = tuned["at_end_of_range"], tuned["load_recovery_s"] or 40.0
    if tuned["verdict"] == "cannot-promise":
        return row
    fleet, seconds = fleet_of(truth), max(tuned["flight_s"], recovery)
    slopes = tuple(fleet.slope(output) for output in OUTPUTS)
    flown_gains = tuned["present_gains"] if tuned["verdict"] == "leave" else values_of(tuned["gains"])
    gains = {name: np.array([value]) for name, value in flown_gains.items() if name in tuning_stack.DEFAULTS}
    did = tuning_stack.figures(tuning_stack.fly(gains, fleet, seconds, noise=np.deg2rad(NOISE_DEG)), recovery)
    row |= {"recovery": recovery, "margin": float(tuning_stack.disk_margins(gains, fleet, slopes)[0])}
    row |= {key: float(value[0]) for key, value in did.items()}
    # the best of random sets that keep as much margin as these do, by the same rule: log settling + log load left
    sets = tuning_stack.random_sets(SETS, seed)
    keep = tuning_stack.disk_margins(sets, fleet, slopes) >= min(row["margin"], 0.75)
    sets = {name: value[keep][:MOST] for name, value in sets.items()}
    row["random"] = int(keep.sum())
    if row["random"]:
        tried = tuning_stack.figures(tuning_stack.fly(sets, fleet, 0.5 * seconds), recovery)
        left = np.maximum(tried["left"], 2.0)
        best = int(np.argmin(np.where(np.isfinite(tried["settling"]), tried["settling"], 1e6) * left))
        row |= {"best_settling": float(tried["settling"][best]), "best_left": float(tried["left"][best])}
        row["quickest"] = float(tried["settling"].min())
        row["settling_ratio"] = row["settling"] / row["best_settling"]
        row["left_ratio"] = max(row["left"], 2.0) / float(left[best])
        row["cost_ratio"] = row["settling_ratio"] * row["left_ratio"]
    return row


def within(value: float, promised: dict[str, Any] | None) -> bool:
    """Whether a value lies in a band, an open end being infinite."""
    if promised is None:
        return False
    low, high = promised["ci95"]
    return (low is None or low <= value) and (high is None or value <= high)


def flown(
    truth: Truth, target: Target, gains: dict[str, float], seconds: float, random: np.random.Generator,
    recovery: float = np.inf,
) -> design.FlightScores:  # fmt: skip
    """The truth under the target's stack, its readings noisy: a step of 90 degrees, and 10 % load."""
    vehicle = Vehicle(truth, np.exp(truth.scatter * random.standard_normal(1)) * np.ones(2))
    tried: Gains = {key: np.full((1, 1), value) for key, value in gains.items()}
    reference, load = np.array([[np.pi / 2, 0.0]]), np.array([0.0, 0.1])
    state, controller = target.start(tried, np.zeros((1, 2)), np.zeros((1, 1))), target.controller(tried)
    parts: list[Floats] = []
    left = 0.0
    for k in range(round(seconds / target.period)):
        if k % max(1, round(0.1 / target.period)) == 0:
            parts.append(vehicle.heading)
        if k % max(1, round(READ / target.period)) == 0:
            wrong = np.deg2rad([[NOISE_DEG], [NOISE_DEG_S]]) * random.standard_normal((2, 2))
        heading, rate = vehicle.shown + wrong[0], vehicle.rate + wrong[1]
        state, output = controller(state, reference, heading[None], rate[None])
        left += target.period
        while left > 0.5 * STEP:
            vehicle.advance(output[0], load)
            left -= STEP
    position = np.stack(parts, axis=1)[None]
    clock = 0.1 * np.arange(position.shape[2], dtype=float)
    return design.scores(design.ClosedLoopRun(clock, position), np.pi / 2, np.deg2rad(2.0), recovery)


def main() -> None:
    what = {"nargs": "*", "default": ["corners", "stack", *FAMILIES]}
    chosen = arguments.options(__doc__, {"what": what}, vehicles=40, jobs=1, out=Path("out"))
    with ProcessPoolExecutor(chosen.jobs) as pool:
        if "corners" in chosen.what:
            rows = [row for part in pool.map(corners, FIVE) for row in part]
            arguments.write_json(chosen.out / "tuning_corners.json", rows)
            print(pd.DataFrame(rows).drop(columns="values").to_string(float_format="%.3g"))
        if "stack" in chosen.what:
            rows = []
            for row in pool.map(stack, range(20), [chosen.out] * 20):
                rows.append(row)
                print(json.dumps(row), flush=True)
            arguments.write_json(chosen.out / "tuning_stack.json", rows)
            print(pd.DataFrame(rows).drop(columns=["hidden", "why"]).to_string(float_format="%.3g"))
        for family in [name for name in FAMILIES if name in chosen.what]:
            count = chosen.vehicles if family == "blind" else chosen.vehicles // 4
            vehicles = []
            for vehicle in pool.map(blind, range(count), [chosen.out] * count, [family] * count):
                vehicles.append(vehicle)
                print(json.dumps(vehicle), flush=True)
            arguments.write_json(chosen.out / f"tuning_{family}.json", vehicles)
            tuned = [vehicle for vehicle in vehicles if vehicle["verdict"] == "gains"]
            held = pd.DataFrame([{"settled": vehicle["settled"], **vehicle["held"]} for vehicle in tuned])
            print(f"{family}, shares of promises that held:\n{held.mean().to_string()}")
            print(pd.DataFrame(vehicles).groupby("verdict")["seconds"].agg(["size", "max"]).to_string())


if __name__ == "__main__":
    main()
