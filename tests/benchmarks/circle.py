"""`make circle`: plan, serve, a link that is cut, collect, run, tune, and the gains flown on the same vehicle.

The vehicle is one of tuning_truth.py, whose laws are not the library's; a first rough model is of eight steps. It is
served by a process of its own, and reached only through a link that resets, stalls, forgets and crawls. Fails unless
the logs are whole, the effect is named, and the vehicle settles with the gains.

Usage: python tests/benchmarks/circle.py [--out DIR]
"""

import json
import multiprocessing
import socket
import subprocess
import sys
import time
from collections.abc import Generator, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import arguments
import numpy as np
from made_link import CuttingProxy
from tuning import NOISE_DEG, flown, values_of, within
from tuning_truth import STEP, Truth, Vehicle

from automarine_cli.control.targets import get
from automarine_cli.control.targets.base import present_gains
from automarine_cli.link.document import LinkCampaign, PlannedRun
from automarine_cli.link.server import serve
from automarine_cli.link.vehicles.base import Halted, Pace
from automarine_cli.report.tables import Table, number

TRUTH = Truth(inertia=0.85, quadratic=1.05, linear=0.0, hidden={"delay": 0.15, "propeller-lag": 0.12})
WAYS = ("reset", "reset", "stall", "half-open", "slow", "none")
"""What becomes of a connection, drawn for each."""
SEED, SPEED = 0, 200.0
HEADER = "time_s,heading_deg,tau\n"


@dataclass(frozen=True)
class Hidden:
    """A vehicle whose laws nobody here knows, as `serve` drives it."""

    def refuse(self, campaign: LinkCampaign) -> None:
        """Everything can be driven."""

    def drive(self, campaign: LinkCampaign, number: int, halted: Halted) -> Generator[str, None, None]:
        yield HEADER
        pace, random = Pace(SPEED), np.random.default_rng([SEED, number])
        for since, heading, moment in driven(campaign.runs[number], campaign.rate_hz, campaign.rest_s, random):
            pace.until(since)
            if halted():
                return
            yield f"{campaign.begins(number) + since:.3f},{heading:.3f},{moment:g}\n"


def driven(
    run: PlannedRun, rate_hz: float, rest_s: float, random: np.random.Generator
) -> Iterator[tuple[float, float, float]]:
    """Time since the run's beginning [s], heading as read [degrees] and the moment commanded."""
    vehicle = Vehicle(TRUTH, np.exp(TRUTH.scatter * random.standard_normal(1)))
    changes = np.cumsum([rest_s, *(seconds for _, seconds in run.commands)])
    moments = [0.0, *(moment for moment, _ in run.commands), 0.0]
    for i in range(int(changes[-1] * rate_hz) + 1):
        since = i / rate_hz
        moment = moments[int(np.searchsorted(changes, since + 1e-9, side="right"))]
        read = run.start_heading_deg + np.rad2deg(vehicle.shown[0]) + NOISE_DEG * random.standard_normal()
        yield since, float(read) % 360.0, moment
        for _ in range(round(1.0 / rate_hz / STEP)):
            vehicle.advance(np.array([moment]))


def serving(folder: Path, address: Any) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]

    def ready(event: Any) -> None:
        if not isinstance(event, str):
            address.put((port, event.token))

    serve(folder, Hidden(), ("127.0.0.1", port), SPEED, ready)


class Circle:
    """The steps, each a sentence on what came of it; results are in the folder `out`."""

    def __init__(self, out: Path) -> None:
        self.out = out
        self.analysis = out / "pool" / "analysis"

    def run(self, *line: object) -> str:
        """What a command prints; ends where it fails."""
        words = [str(word) for word in line]
        done = subprocess.run([sys.executable, "-m", "automarine_cli", *words], stdout=subprocess.PIPE, text=True)
        if done.returncode:
            sys.exit(f"automarine {' '.join(words)} failed with exit status {done.returncode}")
        return done.stdout

    def read(self, *path: str) -> Any:
        return json.loads(self.out.joinpath(*path).read_text())

    def fit_yaw(self) -> str:
        """A first day of eight steps, from which a rough model comes."""
        (self.out / "first").mkdir(parents=True)
        for turn, moment in enumerate((0.3, -0.3, 0.5, -0.5, 0.75, -0.75, 1.0, -1.0)):
            step = PlannedRun(f"step_{moment:+g}", ((moment, 6.0),))
            rows = driven(step, 10.0, 2.0, np.random.default_rng([SEED, 100 + turn]))
            lines = [f"{since:.3f},{heading:.3f},{moment:g}\n" for since, heading, moment in rows]
            (self.out / "first" / f"{step.name}.csv").write_text("".join([HEADER, *lines]))
        self.run("fit-yaw", self.out / "first", "-o", self.out / "rough", "-q")
        model = self.read("rough", "yaw_model.json")
        inertia = model["models"][model["preferred"]]["I_r"]
        return f"I_r {number(inertia['value'])} ± {number(inertia['stderr'], 1)}, truth {TRUTH.inertia:g}"

    def plan(self) -> str:
        self.run("plan", self.out / "rough" / "yaw_model.json", "-o", self.out / "day", "--seed", SEED, "-q")
        totals = self.read("day", "plan.json")["totals"]
        return f"{totals['runs']} runs, {totals['pool_min']:.0f} min"

    def collect(self) -> str:
        """The campaign driven by itself, its logs over a link that is cut, and their analysis."""
        context = multiprocessing.get_context("spawn")
        address = context.Queue()
        vehicle = context.Process(target=serving, args=(self.out / "vehicle", address))
        vehicle.start()
        try:
            port, token = address.get(timeout=60)
            proxy = CuttingProxy(port, WAYS, 20_000, SEED)
            with proxy.running() as url:
                collected = json.loads(self.run(
                    "collect", url, "--token", token, "-o", self.out / "pool", "--campaign", self.out / "day",
                    "--wait", 120, "--then", "run", "--jobs", 2, "--json",
                ))  # fmt: skip
        finally:
            vehicle.terminate()
            vehicle.join()
        logs = {path.name: path.read_bytes() for path in (self.out / "vehicle" / "runs").glob("*.csv")}
        if {path.name: path.read_bytes() for path in (self.out / "pool").glob("*.csv")} != logs:
            sys.exit("the logs that came are not those of the vehicle")
        (state,) = collected["state"]["campaigns"]
        if state["played"] != state["runs"] or state["interrupted"]:
            sys.exit(f"not every run was driven: {state}")
        named = [effect["name"] for effect in self.read("pool", "analysis", "diagnosis", "diagnosis.json")["effects"]]
        if not named:
            sys.exit("the diagnosis names nothing of what is hidden")
        crossed = proxy.bytes_down / sum(map(len, logs.values()))
        return (
            f"{len(logs)} logs whole over {collected['cuts']} cuts, {crossed:.2f} bytes crossed per byte kept; "
            f"hidden {' and '.join(TRUTH.hidden)}, named {' and '.join(named)}"
        )

    def tune(self) -> str:
        diagnosis = self.analysis / "diagnosis" / "diagnosis.json"
        self.run("tune", diagnosis, "--for", "ardusub", "--full", 1, "-o", self.out / "tuning", "--overwrite", "-q")
        tuned = self.read("tuning", "tuning.json")
        if tuned["verdict"] != "gains":
            sys.exit(f"no gains were given: {tuned['verdict']}, {tuned['why']}")
        return ", ".join(f"{name} {value:g}" for name, value in values_of(tuned["gains"]).items())

    def fly(self) -> str:
        """The same vehicle with the gains of the parameter file."""
        tuned, target = self.read("tuning", "tuning.json"), get("ardusub")
        gains = dict(present_gains(target, self.out / "tuning" / "ardusub.param") or {})
        new, old = (
            flown(TRUTH, target, dict(tried), tuned["flight_s"], np.random.default_rng([SEED, 200]))
            for tried in (gains, target.defaults)
        )
        if not new.settles[0]:
            sys.exit("the vehicle does not settle with the new gains")
        held = "as" if within(float(new.settling[0]), tuned["promised"]["settling_s"]) else "not as"
        before = f"settled in {old.settling[0]:.1f} s" if old.settles[0] else "did not settle"
        return f"settles in {new.settling[0]:.1f} s, {held} promised; with ArduSub's defaults {before}"


def main() -> None:
    """Go round once and print what each step took."""
    circle = Circle(arguments.options(__doc__, out=Path("out/circle")).out)
    if circle.out.exists():
        sys.exit(f"{circle.out} is there already; remove it, or give another --out")
    rows, start = [], time.monotonic()
    for step in (circle.fit_yaw, circle.plan, circle.collect, circle.tune, circle.fly):
        begun = time.monotonic()
        result = step()
        rows.append({"step": step.__name__, "s": f"{time.monotonic() - begun:.1f}", "what came of it": result})
    print(Table.of("Once round", rows).to_text())
    print(f"{time.monotonic() - start:.0f} s in all.")


if __name__ == "__main__":
    main()
