"""kill -9 of the vehicle's processes and of the collector at random moments: nothing lost, nothing twice.

The processes are real; a run that a kill interrupts is closed as it stood, marked, and never begun again.
"""

import json
import os
import random
import signal
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path

import pytest
from link_processes import ALONE, children_of, collecting, ended, free_port, token_in
from made_link import expected_logs, made_campaign
from test_link_cuts import logs_in

from automarine_cli.link.document import LinkCampaign

MODEL_FILE = {
    "schema": "automarine/yaw-model/1", "moment_unit": "nu", "preferred": "3", "effects": [],
    "models": {"3": {"I_r": {"value": 1.0, "unit": "nu s²"}, "k_rr": {"value": 1.25, "unit": "nu s²"}}},
}  # fmt: skip


def served(
    folder: Path, port: int, speed: float, before: Sequence[str] = (), host: str = "127.0.0.1"
) -> subprocess.Popen[bytes]:
    """A vehicle as processes of its own, started by the command `before`, if any."""
    model = folder.with_name("yaw_model.json")
    model.write_text(json.dumps(MODEL_FILE))
    options = ["--vehicle", "simulated", "--model", str(model), "--speed", f"{speed:g}"]
    address = ["--address", f"{host}:{port}"]
    return subprocess.Popen(
        [*before, *ALONE, "serve", str(folder), *options, *address],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def kill_and_go_on(folder: Path, campaign: LinkCampaign, kills: int, seed: int, speed: float) -> dict[str, int]:
    """Drive a campaign while one process or another is killed; how many of each kind were."""
    drawn, count = random.Random(seed), {"server": 0, "player": 0, "collector": 0}
    port = free_port(os.getpid() + seed)
    document = folder / "campaign.json"
    document.write_text(campaign.text)
    vehicle, pool = folder / "vehicle", folder / "pool"
    server = served(vehicle, port, speed)
    collector = collecting(pool, token_in(vehicle), port, document)
    processes = [server, collector]
    with ended(processes):
        while sum(count.values()) < kills:
            time.sleep(drawn.uniform(0.2, 2.5))
            victim = drawn.choice(list(count))
            if victim == "server":
                server.kill()
                server.wait()
                processes[0] = server = served(vehicle, port, speed)
            elif victim == "player":
                while len(players := children_of(server)) < 2:  # the first is multiprocessing's own
                    time.sleep(0.05)
                os.kill(players[-1], signal.SIGKILL)
            elif victim == "collector" and collector.poll() is None:
                collector.kill()
                collector.wait()
                processes[1] = collector = collecting(pool, token_in(vehicle), port, document)
            else:
                continue
            count[victim] += 1
        assert collector.wait(timeout=600) == 0
    assert logs_in(pool) == logs_in(vehicle / "runs")
    return count


def assert_played_once(folder: Path, campaign: LinkCampaign) -> int:
    """One log for each run: whole with the bytes it should have, or interrupted with their beginning; how many were."""
    found, expected, interrupted = logs_in(folder / "pool"), expected_logs(campaign), 0
    assert len(found) == len(expected)
    for name, whole in expected.items():
        cut = name.replace(".csv", "_interrupted.csv")
        assert (name in found) != (cut in found)
        if cut in found:
            interrupted += 1
            rows, right = found[cut].splitlines(), whole.splitlines()
            same = sum(a == b for a, b in zip(rows, right, strict=False))
            assert same >= len(rows) - 1  # the last may be neutral instead
            assert same == len(rows) or rows[-1].endswith(b",0")
        else:
            assert found[name] == whole
    return interrupted


@pytest.mark.slow
def test_kills_lose_nothing_and_repeat_nothing(tmp_path: Path) -> None:
    campaign = made_campaign(8, seconds=20.0)
    count = kill_and_go_on(tmp_path, campaign, 3, seed=4, speed=30.0)
    assert sum(count.values()) == 3
    assert assert_played_once(tmp_path, campaign) <= 3


@pytest.mark.slow
def test_a_vehicle_without_its_server_falls_silent(tmp_path: Path) -> None:
    campaign = made_campaign(1, seconds=600.0)
    document = tmp_path / "campaign.json"
    document.write_text(campaign.text)
    vehicle, port = tmp_path / "vehicle", free_port(os.getpid())
    server = served(vehicle, port, 1.0)
    collector = collecting(tmp_path / "pool", token_in(vehicle), port, document)
    with ended([server, collector]):
        while not (begun := list((vehicle / "runs").glob("*.part"))) or len(begun[0].read_bytes()) < 200:
            time.sleep(0.05)
        (player,) = children_of(server)[-1:]
        server.kill()
        server.wait()
        ends = time.monotonic() + 600.0
        while Path(f"/proc/{player}/cmdline").exists() and Path(f"/proc/{player}/cmdline").read_bytes():
            assert time.monotonic() < ends
            time.sleep(0.1)
    (log,) = (vehicle / "runs").glob("*.csv")
    assert log.name.endswith("_interrupted.csv") and log.read_text().splitlines()[-1].endswith(",0")
