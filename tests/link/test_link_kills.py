"""kill -9 of the vehicle's processes and of the collector at random moments: nothing lost, nothing twice.

The processes are real; a run that a kill interrupts is closed as it stood, marked, and never begun again.
"""

import os
import random
import signal
import time
from pathlib import Path

import pytest
from link_processes import children_of, collecting, ended, free_port, simulated, token_in
from link_requests import logs_in, until
from made_link import expected_logs, made_campaign

from automarine_cli.link.document import LinkCampaign


def kill_and_go_on(folder: Path, campaign: LinkCampaign, kills: int, seed: int, speed: float) -> dict[str, int]:
    """Drive a campaign while one process or another is killed; how many of each kind were."""
    drawn, count = random.Random(seed), {"server": 0, "player": 0, "collector": 0}
    port = free_port(os.getpid() + seed)
    document = folder / "campaign.json"
    document.write_text(campaign.text)
    vehicle, pool = folder / "vehicle", folder / "pool"
    server = simulated(vehicle, port, speed)
    collector = collecting(pool, token_in(vehicle), port, document)
    processes = [server, collector]
    with ended(processes):
        while sum(count.values()) < kills:
            time.sleep(drawn.uniform(0.2, 2.5))
            victim = drawn.choice(list(count))
            if victim == "server":
                server.kill()
                server.wait()
                processes[0] = server = simulated(vehicle, port, speed)
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
    logs, expected, interrupted = logs_in(folder / "pool"), expected_logs(campaign), 0
    assert len(logs) == len(expected)
    for name, whole in expected.items():
        cut = name.replace(".csv", "_interrupted.csv")
        assert (name in logs) != (cut in logs)
        if cut in logs:
            interrupted += 1
            rows, right = logs[cut].splitlines(), whole.splitlines()
            same = sum(a == b for a, b in zip(rows, right, strict=False))
            assert same >= len(rows) - 1  # the last may be neutral instead
            assert same == len(rows) or rows[-1].endswith(b",0")
        else:
            assert logs[name] == whole
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
    server = simulated(vehicle, port, 1.0)
    collector = collecting(tmp_path / "pool", token_in(vehicle), port, document)
    with ended([server, collector]):
        until(lambda: any(log.stat().st_size >= 200 for log in (vehicle / "runs").glob("*.part")))
        (player,) = children_of(server)[-1:]
        server.kill()
        server.wait()
        cmdline = Path(f"/proc/{player}/cmdline")
        until(lambda: not cmdline.exists() or not cmdline.read_bytes())
    (log,) = (vehicle / "runs").glob("*.csv")
    assert log.name.endswith("_interrupted.csv") and log.read_text().splitlines()[-1].endswith(",0")
