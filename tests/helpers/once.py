"""What is costly to make and shared by many tests: made once in a test run, however many processes run it."""

import os
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from automarine_cli.link.store import HeldElsewhereError, held


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], object]) -> Path:
    """The folder `name` as `make(folder)` left it; tests read it, and copy what they change."""
    shared = factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:  # each process has a folder of its own in that of the run
        shared = shared.parent
    made, begun = shared / name, shared / f"{name}.begun"
    while True:
        try:
            with held(shared / f"{name}.lock"):
                if not made.exists():
                    begun.mkdir(exist_ok=True)
                    make(begun)
                    begun.rename(made)
                return made
        except HeldElsewhereError:
            time.sleep(0.1)
