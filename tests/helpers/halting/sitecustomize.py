"""Python halts for good at a moment named by HALT_AT, and says so; for processes with this folder in PYTHONPATH.

HALT_AT is `PROCESS EVENT WORD`: `command` or `worker` (one that the command started), the name of one of Python's
audit events, and how its first argument ends. Nothing but a signal then ends the process.
"""

import os
import sys
import time
from multiprocessing.process import parent_process


def halt(event: str, arguments: tuple[object, ...]) -> None:
    """Sleep where the event is the one asked for, in the process asked for."""
    process = "command" if parent_process() is None else "worker"
    if (process, event) == (PROCESS, EVENT) and str(arguments[0]).endswith(WORD):
        os.write(1, b"halted\n")
        while True:
            time.sleep(3600)


PROCESS, EVENT, WORD = os.environ["HALT_AT"].split(maxsplit=2)
sys.addaudithook(halt)
