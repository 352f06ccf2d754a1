"""The vehicle's and the surface's side as processes of their own."""

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from made_link import MODEL_FILE

ALONE = [sys.executable, "-m", "automarine_cli"]


def served(folder: Path, port: int, *options: str) -> subprocess.Popen[bytes]:
    """The vehicle's computer."""
    command = [*ALONE, "serve", str(folder), *options, "--address", f"127.0.0.1:{port}"]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def simulated(folder: Path, port: int, speed: float) -> subprocess.Popen[bytes]:
    """A simulated vehicle, served."""
    model = folder.with_name("yaw_model.json")
    model.write_text(json.dumps(MODEL_FILE))
    return served(folder, port, "--vehicle", "simulated", "--model", str(model), "--speed", f"{speed:g}")


def collecting(folder: Path, token: str, port: int, campaign: Path) -> subprocess.Popen[bytes]:
    """The surface as a process of its own."""
    url = f"http://127.0.0.1:{port}"
    asks = ["collect", url, "-o", str(folder), "--token", token, "--campaign", str(campaign), "--wait", "600", "-q"]
    return subprocess.Popen([*ALONE, *asks])


def free_port(first: int) -> int:
    """A port that nobody holds, below those that systems hand out; processes of a test run begin to look apart."""
    for port in (10_000 + (first * 7 + i) % 20_000 for i in range(20_000)):
        with contextlib.suppress(OSError), socket.create_server(("127.0.0.1", port)):
            return port
    raise OSError("no port is free")


def children_of(process: subprocess.Popen[bytes]) -> list[int]:
    with contextlib.suppress(OSError):
        return [int(one) for one in Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()]
    return []


def token_in(folder: Path) -> str:
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
