"""Two computers, each a network namespace of its own, and a link between them that is taken down again and again.

It needs Linux, root and the command `ip`, and skips elsewhere.
"""

import contextlib
import os
import random
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from link_processes import ALONE, token_in
from made_link import expected_logs, made_campaign
from test_link_cuts import logs_in
from test_link_kills import served

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        sys.platform != "linux" or os.geteuid() != 0 or shutil.which("ip") is None, reason="needs Linux, root and ip"
    ),
]
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


@pytest.mark.parametrize("seed", [1, 2])
def test_a_link_that_is_taken_down_loses_nothing(seed: int, tmp_path: Path) -> None:
    campaign, drawn = made_campaign(24, seconds=100.0), random.Random(seed)
    document, downs = tmp_path / "campaign.json", 0
    document.write_text(campaign.text)
    with two_computers() as (under, above):
        inside = ["ip", "netns", "exec", under]
        server = served(tmp_path / "vehicle", PORT, 150.0, before=inside, host=VEHICLE)
        try:
            url, token = f"http://{VEHICLE}:{PORT}", token_in(tmp_path / "vehicle")
            asked = ["collect", url, "-o", str(tmp_path / "pool"), "--token", token, "--campaign", str(document), "-q"]
            collector = subprocess.Popen(["ip", "netns", "exec", above, *ALONE, *asked, "--wait", "120"])
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
