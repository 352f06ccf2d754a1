"""README and pages show what the commands print: every example is run, and its output is compared.

What `tests/golden` runs too and takes long is not run twice: it stands in the outputs on file, as do the files written.
"""

import re
import shlex
import shutil
import struct
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from io import BufferedWriter
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from click.testing import CliRunner
from fake_ardusub import FakeSub, Station
from golden import CLOSE, LINES, OUTPUTS, SECONDS
from golden import read as read_outputs
from pool_day import write_pool_day
from printed import same, words
from repository import ROOT, SAMPLE_RUNS
from test_readme import PAGES, fences

from automarine_cli.commands import automarine

ALLOWED = ("automarine", "cp", "mkdir", "sed", "echo", "head")
ANYTHING = "..."


BEGAN_S = 1.75e9  # by the ground station's clock
STICKS = (-1000, -700, -450, -250, 250, 450, 700, 1000)
POOL = """schema = "automarine/plan-limits/1"
[pool]
minutes = 12
runs = 12
wait_s = 10
[moments]
largest = 0.45                # of the whole yaw output; a pilot gain of 0.5 gives no more than 0.5
[goal]
use_earlier_runs = false
"""


@dataclass
class Recorded(FakeSub):
    """A vehicle whose packets a ground station keeps."""

    log: BufferedWriter | None = None

    def write(self, data: bytes) -> None:
        """Keep a packet as a .tlog does, with the time in microseconds before it."""
        if self.log is not None:
            self.log.write(struct.pack(">Q", int((BEGAN_S + self.time) * 1e6)) + data)
        super().write(data)


def write_bluerov2_day(folder: Path, seed: int = 3) -> Path:
    """What a BlueROV2's owner has before the first campaign: `dive.tlog`, two and a half minutes of turning to and fro
    by hand, and `pool.toml`; returns the folder."""
    folder.mkdir(parents=True)
    (folder / "pool.toml").write_text(POOL, encoding="utf-8")
    drawn = np.random.default_rng(seed)
    with (folder / "dive.tlog").open("wb") as log:
        vehicle = Recorded(gain=0.5, depth=1.0, log=log)
        for name, value in vehicle.parameters.items():
            vehicle._mav.param_value_send(name.encode(), value, 9, 100, 0)
        vehicle._every |= {30: 0.1, 36: 0.1, 33: 0.2}
        pilot = Station(vehicle)
        vehicle.advance(1.0)
        vehicle.armed = True
        for stick in drawn.permutation(STICKS * 2):
            for pushed in (int(stick), 0):
                ends = vehicle.time + drawn.uniform(3.0, 6.0)
                while vehicle.time < ends:
                    pilot.beat()
                    pilot.mav.manual_control_send(1, 0, 0, 500, pushed, 0)
                    vehicle.advance(0.1)
        vehicle.armed = False
        vehicle.advance(1.0)
    return folder


class Example(NamedTuple):
    """A command line of a page and what it is said to print."""

    page: str
    line: str
    shown: str


def examples() -> Iterator[Example]:
    """Every `$ ...` line in the fenced blocks, in the order of the pages, with the lines below it."""
    for page in PAGES:
        for block in fences(page):
            for one in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:]:
                line, _, shown = one.partition("\n")
                if not line.startswith("make "):
                    yield Example(page, line, shown)


@pytest.fixture(scope="module")
def said(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """What each command line printed: each is run once, in the order of the pages, in one folder."""
    place = tmp_path_factory.mktemp("pages")
    shutil.copytree(SAMPLE_RUNS, place / "sample_runs")
    write_pool_day(place / "pool_day")
    write_bluerov2_day(place / "bluerov2")
    found: dict[str, str] = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        for line in dict.fromkeys(one.line for one in EXAMPLES):
            found[line] = on_file(ON_FILE[line]) if line in ON_FILE else printed(line)
    return found


def on_file(name: str) -> str:
    """What a line of `tests/golden` prints; the files that it writes are put where they belong."""
    outputs = read_outputs(OUTPUTS / f"{name}.txt")
    for path in map(Path, outputs.keys() - {"printed", "files"}):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(outputs[path.as_posix()], encoding="utf-8")
    return outputs["printed"]


def printed(line: str) -> str:
    """Both streams of one command line, without the steps with their times that `run` tells a pipe alone."""
    program, *arguments = shlex.split(line)
    assert program in ALLOWED, f"{line!r} is not run by this test"
    if program == "automarine":
        return SECONDS.sub("", CliRunner().invoke(automarine, arguments).output)
    done = subprocess.run(["bash", "-c", line], capture_output=True, text=True, check=True)
    return done.stdout


EXAMPLES = list(examples())
ON_FILE = {f"automarine {line}": name for name, line in LINES["slow"].items()}


def difference(shown: str, found: str) -> str:
    """Where what is shown departs from what was found ("" where it does not); `...` stands for any words."""
    given, place = words(found), 0
    pieces = [words(piece) for piece in re.split(r"(?<!\S)\.\.\.(?!\S)", shown)]
    for number, piece in enumerate(pieces):
        first, last = number == 0, number == len(pieces) - 1
        starts = range(place, len(given) - len(piece) + 1)
        if first:
            starts = starts[:1]
        if last and not first:
            starts = starts[-1:] if len(given) - len(piece) >= place else range(0)
        for start in starts:
            if all(same(*pair, CLOSE) for pair in zip(piece, given[start:])):
                place = start + len(piece)
                break
        else:
            near = " ".join(given[place : place + len(piece) + 3])
            return f"shown:\n  {' '.join(piece)}\nprinted:\n  {near}"
    return "" if place == len(given) or ANYTHING in shown.split()[-1:] else f"left out: {given[place:][:20]}"


@pytest.mark.slow
@pytest.mark.parametrize("example", EXAMPLES, ids=lambda one: f"{one.page}: {one.line}")
def test_examples_print_what_is_shown(said: dict[str, str], example: Example) -> None:
    assert difference(example.shown, said[example.line]) == ""


def test_enough_is_run() -> None:
    assert {line.split()[0] for _, line, _ in EXAMPLES} <= set(ALLOWED)
    by_page = {one.page for one in EXAMPLES}
    assert {page for page in PAGES if "/commands/" in page} <= by_page
    assert len(PAGES) > 20 and (ROOT / "README.md").is_file()
