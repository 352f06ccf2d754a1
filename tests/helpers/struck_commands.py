"""The real command in a process of its own, struck by a signal at a chosen moment: what it says, what it leaves."""

import contextlib
import os
import random
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from repository import ROOT, SAMPLE_RUNS
from torn_writes import content

SENTENCE = "Interrupted; nothing was left half written.\n"


@dataclass(frozen=True)
class Struck:
    """How a command ended: exit status (negative: ended by that signal), standard error, seconds it still took."""

    status: int
    said: str
    took_s: float


def as_on_a_terminal() -> None:
    """A hang-up is heard, even where the tests themselves run under nohup."""
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


def start(arguments: list[str], folder: Path, halt_at: str = "") -> "subprocess.Popen[str]":
    """`automarine ...` in that folder, in a process group of its own as a terminal makes it; see `halting`."""
    path = [str(ROOT), *([str(Path(__file__).with_name("halting"))] if halt_at else [])]
    more = {"PYTHONPATH": os.pathsep.join(path), "OPENBLAS_NUM_THREADS": "1", "HALT_AT": halt_at}
    return subprocess.Popen(
        [sys.executable, "-m", "automarine_cli", *arguments], cwd=folder, env=os.environ | more,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True, preexec_fn=as_on_a_terminal,
    )  # fmt: skip


def strike(arguments: list[str], folder: Path, when: float | str, how: int) -> Struck:
    """A signal after so many seconds, or once the command has halted for good at a moment (see `halting`).

    Ctrl-C goes to the whole process group, as from a terminal; other signals to the command alone.
    """
    process = start(arguments, folder, when if isinstance(when, str) else "")
    if isinstance(when, str):
        assert process.stdout is not None
        assert process.stdout.readline() == "halted\n"
    else:
        time.sleep(when)
    struck = time.monotonic()
    with contextlib.suppress(ProcessLookupError):
        if how == signal.SIGINT:
            os.killpg(process.pid, how)
        else:
            process.send_signal(how)
    _, said = process.communicate(timeout=600)  # returns when the last process that holds the pipes has gone
    return Struck(process.returncode, said, time.monotonic() - struck)


class KilledCommand:
    """`simulate` that replaces its own results, again and again, killed at random moments."""

    def __init__(self, folder: Path, seed: int = 0) -> None:
        self.folder, self.out, self.random = folder, folder / "out", random.Random(seed)
        self.commands = {seed: self._command(seed) for seed in (1, 2)}
        self.whole, self.takes_s = {}, 0.0
        for number, command in self.commands.items():
            begun = time.monotonic()
            self._to_the_end(command)
            self.takes_s = time.monotonic() - begun
            self.whole[number] = content(self.out)
        self.stands = 2
        assert self.whole[1] != self.whole[2]

    def kill(self) -> str:
        """Kill a replacement at a random moment; `old` or `new`, whichever results then stand whole."""
        other = 3 - self.stands
        after = self.random.uniform(0.1, 1.1) * self.takes_s
        strike(self.commands[other], self.folder, after, signal.SIGKILL)
        found = content(self.out)
        assert found in self.whole.values(), f"torn {after:.3f} s after the start: {sorted(found)}"
        if found == self.whole[self.stands]:
            return "old"
        self.stands = other
        return "new"

    def next_run(self) -> None:
        """The next run that is not killed clears away whatever the killed ones left."""
        self._to_the_end(self.commands[self.stands])
        assert content(self.out) == self.whole[self.stands]
        assert [path.name for path in self.folder.iterdir()] == ["out"]

    def _command(self, seed: int) -> list[str]:
        specification = str(SAMPLE_RUNS / "hidden_one.toml")
        return ["simulate", specification, "--seed", str(seed), "-o", "out", "--overwrite"]

    def _to_the_end(self, command: list[str]) -> None:
        process = start(command, self.folder)
        _, said = process.communicate(timeout=600)
        assert process.returncode == 0, said
