"""kill -9 of the vehicle's processes and of the collector at random moments: nothing lost, nothing twice.

The processes are real; a run that a kill interrupts is closed as it stood, marked, and never begun again. A link that
is taken down joins two computers, each a network namespace: it needs Linux, root and `ip`, and skips elsewhere.
"""

import contextlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest
from link_processes import ALONE, children_of, collecting, ended, free_port, token_in
from link_requests import logs_in, until
from made_link import MODEL_FILE, expected_logs, made_campaign

from automarine_cli.link.document import LinkCampaign


def served(
    folder: Path, port: int, speed: float, before: Sequence[str] = (), host: str = "127.0.0.1"
) -> subprocess.Popen[bytes]:
    """A vehicle as processes of its own, started by the command `before`, if any."""
    model = folder.with_name("yaw_model.json")
    model.write_text(json.dumps(MODEL_FILE))
    options = ["--vehicle", "simulated", "--model", str(model), "--speed", f"{speed:g}"]
    command = [*before, *ALONE, "serve", str(folder), *options, "--address", f"{host}:{port}"]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


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
    server = served(vehicle, port, 1.0)
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


# A link that is taken down

VEHICLE, SURFACE = "10.77.19.1", "10.77.19.2"
PORT = 8722


def ip(*asked: str) -> None:
    """The command `ip`."""
    subprocess.run(["ip", *asked], check=True, capture_output=True, timeout=30)


@contextlib.contextmanager
def two_computers() -> Iterator[tuple[str, str]]:
    """The names of the vehicle's and of the surface's namespace, joined by a cable."""
    names = tuple(f"automarine-{os.getpid()}-{side}" for side in ("vehicle", "surface"))
    try:
        for name in names:
            try:
                ip("netns", "add", name)
            except subprocess.CalledProcessError as refused:
                pytest.skip(f"no network namespace can be made here: {refused.stderr.decode()[:80]}")
        ip("link", "add", "cable0", "netns", names[0], "type", "veth", "peer", "name", "cable0", "netns", names[1])
        for name, address in zip(names, (VEHICLE, SURFACE)):
            ip("-n", name, "address", "add", f"{address}/30", "dev", "cable0")
            ip("-n", name, "link", "set", "lo", "up")
            ip("-n", name, "link", "set", "cable0", "up")
        yield names[0], names[1]
    finally:
        for name in names:
            subprocess.run(["ip", "netns", "del", name], check=False, capture_output=True)


@pytest.mark.slow
@pytest.mark.skipif(
    sys.platform != "linux" or os.geteuid() != 0 or shutil.which("ip") is None, reason="needs Linux, root and ip"
)
def test_a_link_that_is_taken_down_loses_nothing(tmp_path: Path) -> None:
    campaign, drawn = made_campaign(24, seconds=100.0), random.Random(1)
    document, downs = tmp_path / "campaign.json", 0
    document.write_text(campaign.text)
    with two_computers() as (under, above):
        inside = ["ip", "netns", "exec", under]
        server = served(tmp_path / "vehicle", PORT, 150.0, before=inside, host=VEHICLE)
        try:
            url, token = f"http://{VEHICLE}:{PORT}", token_in(tmp_path / "vehicle")
            asked = ["collect", url, "-o", str(tmp_path / "pool"), "--token", token, "--campaign", str(document)]
            collector = subprocess.Popen(["ip", "netns", "exec", above, *ALONE, *asked, "-q", "--wait", "120"])
            while collector.poll() is None:
                ip("-n", under, "link", "set", "cable0", "down")
                time.sleep(drawn.uniform(0.2, 2.0))
                ip("-n", under, "link", "set", "cable0", "up")
                downs += 1
                time.sleep(drawn.uniform(0.2, 1.0))
            assert collector.returncode == 0 and downs >= 5
        finally:
            server.terminate()
            server.wait(timeout=30)
    assert logs_in(tmp_path / "pool") == expected_logs(campaign) == logs_in(tmp_path / "vehicle" / "runs")
