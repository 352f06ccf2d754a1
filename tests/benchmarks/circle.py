"""`make circle`: plan, serve, a link that is cut, collect, run, tune, and the gains flown on the same vehicle.

The vehicle is one of tuning_truth.py, whose laws are not the library's; a first rough model is of eight steps. It is
served by a process of its own, and reached only through a link that resets, stalls, forgets and crawls. Fails unless
the logs are whole, the effect is named, and the vehicle settles with the gains.

Usage: python tests/benchmarks/circle.py [--out DIR] [--seed N] [--speed N]
"""

import argparse
import json
import multiprocessing
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from made_link import CuttingProxy
from tuning import flown, within
from tuning_truth import STEP, Truth, Vehicle

from automarine_cli.control.targets import get
from automarine_cli.control.targets.base import present_gains
from automarine_cli.link.document import LinkCampaign, PlannedRun
from automarine_cli.link.server import serve
from automarine_cli.link.vehicles.base import Halted, Pace
from automarine_cli.report.tables import Table, number

TRUTH = Truth(inertia=0.85, quadratic=1.05, linear=0.0, hidden={"delay": 0.15, "propeller-lag": 0.12})
NOISE_DEG = 0.7
WAYS = ("reset", "reset", "stall", "half-open", "slow", "none")
"""What becomes of a connection, drawn for each."""


@dataclass(frozen=True)
class Hidden:
    """A vehicle whose laws nobody here knows, as `serve` drives it."""

    truth: Truth
    seed: int
    speed: float

    def refuse(self, campaign: LinkCampaign) -> None:
        """Everything can be driven."""

    def drive(self, campaign: LinkCampaign, number: int, halted: Halted) -> Generator[str, None, None]:
        run, begins = campaign.runs[number], campaign.begins(number)
        yield "time_s,heading_deg,tau\n"
        pace = Pace(self.speed)
        random = np.random.default_rng([self.seed, number])
        for since, heading, moment in driven(self.truth, run, campaign.rate_hz, campaign.rest_s, random):
            pace.until(since)
            if halted():
                return
            yield f"{begins + since:.3f},{heading:.3f},{moment:g}\n"


def driven(
    truth: Truth, run: PlannedRun, rate_hz: float, rest_s: float, random: np.random.Generator
) -> Iterator[tuple[float, float, float]]:
    """Time since the run's beginning [s], heading as read [degrees] and the moment commanded."""
    vehicle = Vehicle(truth, np.exp(truth.scatter * random.standard_normal(1)))
    per_sample = round(1.0 / rate_hz / STEP)
    changes = np.cumsum([rest_s, *(seconds for _, seconds in run.commands)])
    moments = [0.0, *(moment for moment, _ in run.commands), 0.0]
    for i in range(int(changes[-1] * rate_hz) + 1):
        since = i / rate_hz
        moment = moments[int(np.searchsorted(changes, since + 1e-9, side="right"))]
        read = run.start_heading_deg + np.rad2deg(vehicle.shown[0]) + NOISE_DEG * random.standard_normal()
        yield since, float(read) % 360.0, moment
        for _ in range(per_sample):
            vehicle.advance(np.array([moment]))


def first_day(folder: Path, seed: int) -> None:
    """Eight steps, from which a rough model comes."""
    folder.mkdir(parents=True)
    for turn, moment in enumerate((0.3, -0.3, 0.5, -0.5, 0.75, -0.75, 1.0, -1.0)):
        run = PlannedRun(f"step_{moment:+g}", ((moment, 6.0),))
        rows = driven(TRUTH, run, 10.0, 2.0, np.random.default_rng([seed, 100 + turn]))
        lines = [f"{since:.3f},{heading:.3f},{moment:g}" for since, heading, moment in rows]
        (folder / f"{run.name}.csv").write_text("\n".join(["time_s,heading_deg,tau", *lines]) + "\n")


def serving(folder: Path, seed: int, speed: float, told: Any) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    serve(
        folder,
        Hidden(TRUTH, seed, speed),
        ("127.0.0.1", port),
        speed,
        lambda one: isinstance(one, str) or told.put((port, one.token)),
    )


def automarine(*asked: str) -> str:
    """What a command prints; ends where it fails."""
    done = subprocess.run(
        [sys.executable, "-m", "automarine_cli", *asked], stdout=subprocess.PIPE, text=True, check=False
    )
    if done.returncode:
        raise SystemExit(f"automarine {' '.join(asked)} failed with exit status {done.returncode}")
    return done.stdout


def main() -> None:
    """Go round once and print what each step took."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/circle"))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--speed", type=float, default=200.0)
    asked = parser.parse_args()
    out = asked.out / f"{asked.seed:02d}"
    if out.exists():
        raise SystemExit(f"{out} is there already; remove it, or give another --out")
    first_day(out / "first", asked.seed)
    rows: list[tuple[str, str, str]] = []

    def step(name: str, work: Callable[[], str]) -> None:
        begun = time.monotonic()
        said = work()
        rows.append((name, f"{time.monotonic() - begun:.1f}", said))

    step("fit-yaw", lambda: rough(out))
    step("plan", lambda: planned(out, asked.seed))
    step("serve, collect, run", lambda: collected(out, asked.seed, asked.speed))
    step("tune", lambda: tuned(out))
    step("fly", lambda: flight(out, asked.seed))
    step("plan", lambda: planned_again(out, asked.seed))
    total = sum(float(seconds) for _, seconds, _ in rows)
    print(Table("Once round", ("step", "s", "what came of it"), tuple(rows)).to_text())
    print(f"{total:.0f} s in all.")


def rough(out: Path) -> str:
    automarine("fit-yaw", str(out / "first"), "-o", str(out / "rough"), "-q")
    model = json.loads((out / "rough" / "yaw_model.json").read_text())
    inertia = model["models"][model["preferred"]]["I_r"]
    return f"I_r {number(inertia['value'])} ± {number(inertia['stderr'], 1)}, truth {TRUTH.inertia:g}"


def planned(out: Path, seed: int) -> str:
    automarine("plan", str(out / "rough" / "yaw_model.json"), "-o", str(out / "day"), "--seed", str(seed), "-q")
    totals = json.loads((out / "day" / "plan.json").read_text())["totals"]
    return f"{totals['runs']} runs, {totals['pool_min']:.0f} min"


def collected(out: Path, seed: int, speed: float) -> str:
    """The campaign driven by itself, its logs over a link that is cut, and their analysis."""
    context = multiprocessing.get_context("spawn")
    told = context.Queue()
    vehicle = context.Process(target=serving, args=(out / "vehicle", seed, speed, told))
    vehicle.start()
    try:
        port, token = told.get(timeout=60)
        proxy = CuttingProxy(port, WAYS, 20_000, seed)
        with proxy.running() as url:
            found = json.loads(automarine(
                "collect", url, "--token", token, "-o", str(out / "pool"), "--campaign", str(out / "day"),
                "--wait", "120", "--then", "run", "--jobs", "2", "--json",
            ))  # fmt: skip
    finally:
        vehicle.terminate()
        vehicle.join()
    logs = {path.name: path.read_bytes() for path in (out / "vehicle" / "runs").glob("*.csv")}
    if {path.name: path.read_bytes() for path in (out / "pool").glob("*.csv")} != logs:
        raise SystemExit("the logs that came are not those of the vehicle")
    (state,) = found["state"]["campaigns"]
    if state["played"] != state["runs"] or state["interrupted"]:
        raise SystemExit(f"not every run was driven: {state}")
    names = [one["name"] for one in diagnosis(out)["effects"]]
    if not names:
        raise SystemExit("the diagnosis names nothing of what is hidden")
    size = sum(map(len, logs.values()))
    return (
        f"{len(logs)} logs whole over {found['cuts']} cuts, {proxy.bytes_down / size:.2f} bytes crossed per byte kept; "
        f"hidden {' and '.join(TRUTH.hidden)}, named {' and '.join(names)}"
    )


def diagnosis(out: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((out / "pool" / "analysis" / "diagnosis" / "diagnosis.json").read_text())
    return found


def tuned(out: Path) -> str:
    place = out / "pool" / "analysis" / "diagnosis" / "diagnosis.json"
    automarine("tune", str(place), "--for", "ardusub", "--full", "1", "-o", str(out / "tuning"), "--overwrite", "-q")
    found = json.loads((out / "tuning" / "tuning.json").read_text())
    if found["verdict"] != "gains":
        raise SystemExit(f"no gains were given: {found['verdict']}, {found['why']}")
    return ", ".join(f"{name} {one['value']:g}" for name, one in found["gains"].items())


def flight(out: Path, seed: int) -> str:
    """The same vehicle with the gains of the parameter file."""
    promised = json.loads((out / "tuning" / "tuning.json").read_text())
    target = get("ardusub")
    gains = dict(present_gains(target, out / "tuning" / "ardusub.param") or {})
    did = flown(TRUTH, target, gains, promised["flight_s"], np.random.default_rng([seed, 200]))
    old = flown(TRUTH, target, dict(target.defaults), promised["flight_s"], np.random.default_rng([seed, 200]))
    if not did.settles[0]:
        raise SystemExit("the vehicle does not settle with the new gains")
    held = within(float(did.settling[0]), promised["promised"]["settling_s"])
    before = f"settled in {old.settling[0]:.1f} s" if old.settles[0] else "did not settle"
    return (
        f"settles in {did.settling[0]:.1f} s, {'as' if held else 'not as'} promised; with ArduSub's defaults {before}"
    )


def planned_again(out: Path, seed: int) -> str:
    analysis = out / "pool" / "analysis"
    automarine(
        "plan", str(analysis / "yaw" / "yaw_model.json"), "--diagnosis", str(analysis / "diagnosis" / "diagnosis.json"),
        "-o", str(out / "next"), "--seed", str(seed), "-q",
    )  # fmt: skip
    found = json.loads((out / "next" / "plan.json").read_text())
    return f"{found['totals']['runs']} runs for {', '.join(found['planned_for'][:4])}"


if __name__ == "__main__":
    main()
