"""`make circle`: plan, serve, a link that is cut, collect, run, tune, and the gains flown on the same vehicle.

The vehicle is one of tuning_truth.py, whose laws are not the library's; a first rough model is of its steps. It is
reached only through a link that resets, stalls, forgets and crawls. Fails unless the logs are whole, the effect is
named, and the vehicle settles with the gains.

Usage: python tests/benchmarks/circle.py [--out DIR]
"""

import json
import subprocess
import sys
import time
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import arguments
import numpy as np
from made_link import TOKEN, CuttingProxy, vehicle_at
from tuning import NOISE_DEG, flown, values_of, within
from tuning_truth import STEP, Truth, Vehicle, write_logs

from automarine_cli.control.targets import get
from automarine_cli.control.targets.base import present_gains
from automarine_cli.link.document import LinkCampaign
from automarine_cli.link.vehicles.base import Halted, Pace
from automarine_cli.report.tables import Table, number

TRUTH = Truth(inertia=0.85, quadratic=1.05, linear=0.0, hidden={"delay": 0.15, "propeller-lag": 0.12})
WAYS = ("reset", "reset", "stall", "half-open", "slow", "none")
"""What becomes of a connection, drawn for each."""
SEED, SPEED = 0, 200.0


@dataclass(frozen=True)
class Hidden:
    """A vehicle whose laws nobody here knows, as `serve` drives it."""

    def refuse(self, campaign: LinkCampaign) -> None:
        """Everything can be driven."""

    def drive(self, campaign: LinkCampaign, number: int, halted: Halted) -> Generator[str, None, None]:
        """Rows of the run: time by the campaign's clock [s], heading as read [degrees], the moment commanded."""
        yield "time_s,heading_deg,tau\n"
        run, pace, random = campaign.runs[number], Pace(SPEED), np.random.default_rng([SEED, number])
        vehicle = Vehicle(TRUTH, np.exp(TRUTH.scatter * random.standard_normal(1)))
        changes = np.cumsum([campaign.rest_s, *(seconds for _, seconds in run.commands)])
        moments = [0.0, *(moment for moment, _ in run.commands), 0.0]
        for i in range(int(changes[-1] * campaign.rate_hz) + 1):
            since = i / campaign.rate_hz
            pace.until(since)
            if halted():
                return
            moment = moments[int(np.searchsorted(changes, since + 1e-9, side="right"))]
            read = run.start_heading_deg + np.rad2deg(vehicle.shown[0]) + NOISE_DEG * random.standard_normal()
            yield f"{campaign.begins(number) + since:.3f},{float(read) % 360.0:.3f},{moment:g}\n"
            for _ in range(round(1.0 / campaign.rate_hz / STEP)):
                vehicle.advance(np.array([moment]))


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
        """A first day of steps, from which a rough model comes."""
        write_logs(TRUTH, self.out / "first", np.random.default_rng([SEED, 100]), NOISE_DEG, steps=True)
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
        with vehicle_at(self.out / "vehicle", SPEED, Hidden()) as vehicle:
            proxy = CuttingProxy(vehicle.port, WAYS, 20_000, SEED)
            with proxy.running() as url:
                collected = json.loads(self.run(
                    "collect", url, "--token", TOKEN, "-o", self.out / "pool", "--campaign", self.out / "day",
                    "--wait", 120, "--then", "run", "--jobs", 2, "--json",
                ))  # fmt: skip
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
