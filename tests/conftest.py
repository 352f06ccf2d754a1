"""Fixtures that every test may use."""

import os
import signal

if (
    signal.getsignal(signal.SIGINT) is signal.SIG_IGN
):  # as in a shell's background: children would not hear Ctrl-C
    signal.signal(signal.SIGINT, signal.default_int_handler)

for _library in ("OPENBLAS", "OMP", "MKL"):  # as the console script does, before numpy comes
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")

from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from hypothesis import settings

from automarine_cli.cli import automarine

ROOT = Path(__file__).resolve().parent.parent
SAMPLE_RUNS = ROOT / "sample_runs"

# The same examples on every machine, no clock, and no folder of examples beside the repository.
settings.register_profile("house", derandomize=True, deadline=None, database=None, max_examples=50)
settings.load_profile("house")


@pytest.fixture
def run() -> Callable[..., Result]:
    """`run("fit-yaw", path, "-o", out)`: the command line in this process; see `click.testing.Result`."""

    def run_command(*arguments: object) -> Result:
        return CliRunner().invoke(automarine, [str(argument) for argument in arguments])

    return run_command
