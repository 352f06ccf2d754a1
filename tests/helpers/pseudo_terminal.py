"""The command on a terminal of a given width, as a person sees it."""

import fcntl
import os
import pty
import struct
import subprocess
import sys
import termios

from repository import ROOT

ESCAPE = "\x1b["


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
    return process.wait(timeout=60), said.decode("utf-8").replace("\r\n", "\n")
