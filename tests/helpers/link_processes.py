"""The vehicle's and the surface's side as processes of their own."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

ALONE = [sys.executable, "-m", "automarine_cli"]


def collecting(folder: Path, token: str, port: int, campaign: Path) -> subprocess.Popen[bytes]:
    """The surface as a process of its own."""
    url = f"http://127.0.0.1:{port}"
    return subprocess.Popen(
        [*ALONE, "collect", url, "-o", str(folder), "--token", token, "--campaign", str(campaign), "--wait", "60", "-q"]
    )


def children_of(process: subprocess.Popen[bytes]) -> list[int]:
    """The processes that it started."""
    with contextlib.suppress(OSError):
        return [int(one) for one in Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()]
    return []


def token_in(folder: Path) -> str:
    """The token, once there is one."""
    while not (folder / "token").exists():
        time.sleep(0.02)
    return (folder / "token").read_text().strip()


@contextlib.contextmanager
def ended(processes: list[subprocess.Popen[bytes]]) -> Iterator[None]:
    """None of the processes outlives the block."""
    try:
        yield
    finally:
        for one in processes:
            for child in children_of(one):
                with contextlib.suppress(OSError):
                    os.kill(child, signal.SIGKILL)
            one.kill()
            one.wait()
