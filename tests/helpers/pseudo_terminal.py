"""The command on a terminal of a given width, as a person sees it."""

import fcntl
import os
import pty
import re
import struct
import subprocess
import sys
import termios

from repository import ROOT

ESCAPE = "\x1b["
PATIENCE_S = 600.0  # far beyond what a command takes on a machine that has much else to do


def without_bars(said: str) -> str:
    """What stays on a terminal: a bar, which is drawn only where work takes its time, is taken away again."""
    return re.sub(r"(\r\x1b\[K[^\r\n]*)*\r\x1b\[K", "", said)


def on_terminal(*arguments: object, columns: int = 80, **env: str) -> tuple[int, str]:
    """Exit status, and what `automarine ARGUMENTS` writes, on a terminal of that many columns."""
    here, there = pty.openpty()
    fcntl.ioctl(there, termios.TIOCSWINSZ, struct.pack("HHHH", 40, columns, 0, 0))
    clean = {k: v for k, v in os.environ.items() if k not in ("NO_COLOR", "COLUMNS", "TERM")}
    command = [sys.executable, "-m", "automarine_cli", *map(str, arguments)]
    process = subprocess.Popen(
        command, stdin=there, stdout=there, stderr=there, cwd=ROOT, env=clean | {"TERM": "xterm"} | env
    )
    os.close(there)
    said = b""
    while True:
        try:
            piece = os.read(here, 65536)
        except OSError:  # Linux tells the end of a terminal so
            break
        if not piece:
            break
        said += piece
    os.close(here)
    return process.wait(timeout=PATIENCE_S), said.decode("utf-8").replace("\r\n", "\n")
