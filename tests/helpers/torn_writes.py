"""Results written while the process is killed, or the disk fails, at each step in turn; run as a program.

`python tests/helpers/torn_writes.py FOLDER kill|fault [exchange|rename] [EVERY]` prints one JSON object: how often the
old results stood afterwards and how often the new ones. It ends with an AssertionError if ever anything else did.
It loads no library with threads, so that it can fork for each kill.
"""

import contextlib
import errno
import itertools
import json
import os
import signal
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from automarine_cli.errors import OutputError
from automarine_cli.pipeline import staging
from automarine_cli.pipeline.outputs import MANIFEST, result_folder

STEPS = ("open", "os.listdir", "os.scandir", "os.mkdir", "os.link", "os.rename", "os.remove", "os.rmdir", "os.chmod")
FAULTS = (errno.ENOSPC, errno.EIO, errno.EROFS, errno.EACCES)
OLD = {"a.csv": b"old", "sub/big.csv": b"old" * 10_000, "gone.csv": b"old"}
NEW = {"a.csv": b"new", "sub/big.csv": b"new" * 10_000, "more/b.csv": b"new"}
THEIRS = {"notes.txt": b"mine", "photos/1.jpg": b"mine too"}


class Trap:
    """Acts at the n-th file-system call from when it is set; the interpreter itself reports the calls."""

    def __init__(self) -> None:
        self.left, self.act = 0, print
        sys.addaudithook(self._hear)
        os.fsync = self._sync  # type: ignore[assignment]

    def set(self, at: int, act: Callable[..., Any]) -> None:
        """Act at call number `at`; 0 for never."""
        self.left, self.act = at, act

    def _hear(self, event: str, arguments: tuple[object, ...]) -> None:
        if self.left and event in STEPS:
            self.left -= 1
            if not self.left:
                self.act()

    def _sync(self, number: int) -> None:
        """In place of fsync, whose waiting for the disk shows nothing here; a large file is only half there yet."""
        if os.fstat(number).st_size > 10_000 and self.left == 1:
            os.ftruncate(number, 5_000)
        self._hear("open", ())


def write(out: Path, files: dict[str, bytes], *, overwrite: bool = True) -> None:
    """One result folder with these files."""
    with result_folder(out, command="fit-yaw", options={}, inputs=(), seed=None, overwrite=overwrite) as folder:
        for name, data in files.items():
            folder.write(name, data)


def content(folder: Path) -> dict[str, bytes]:
    """Every file of a folder by relative name."""
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def with_theirs(out: Path) -> None:
    """What a person keeps among the results."""
    for name, data in THEIRS.items():
        (out / name).parent.mkdir(exist_ok=True)
        (out / name).write_bytes(data)


class Bench:
    """A folder of old results, again and again, and the two contents that may stand in it."""

    def __init__(self, folder: Path) -> None:
        self.out = folder / "results"
        self.trap = Trap()
        write(self.out, NEW)
        with_theirs(self.out)
        self.new = content(self.out)
        self.renew()
        self.old = content(self.out)
        assert set(self.old) == {*OLD, *THEIRS, MANIFEST} and set(self.new) == {*NEW, *THEIRS, MANIFEST}

    def renew(self) -> None:
        """Old results, as at the start."""
        write(self.out, OLD)

    def stands(self) -> str:
        """`old` or `new`, whichever is whole; `neither` where nothing stands under the name."""
        if not self.out.exists():
            return "neither"
        found = content(self.out)
        assert found in (self.old, self.new), f"torn: {sorted(found)}"
        return "old" if found == self.old else "new"

    def next_run(self, before: str) -> None:
        """The next run finds whole results (and refuses to overwrite them), and clears away what was left."""
        with contextlib.suppress(OutputError):
            write(self.out, {"a.csv": b"third"}, overwrite=False)
            raise AssertionError("results were lost: the next run found none")
        assert self.stands() == ("old" if before == "neither" else before)
        left = [path.name for path in self.out.parent.iterdir() if path != self.out]
        assert left == [], f"left behind: {left}"


def kills(bench: Bench, every: int) -> Counter[str]:
    """Kill a process that replaces old results at each of its steps in turn."""
    counts: Counter[str] = Counter()
    for at in itertools.count(1, every):
        child = os.fork()
        if not child:
            bench.trap.set(at, lambda: os.kill(os.getpid(), signal.SIGKILL))
            write(bench.out, NEW)
            os._exit(0)
        _, status = os.waitpid(child, 0)
        if not os.WIFSIGNALED(status):
            break
        found = bench.stands()
        counts[found] += 1
        bench.next_run(found)
        bench.renew()
    assert bench.stands() == "new" and at > 20
    return counts


def faults(bench: Bench, every: int) -> Counter[str]:
    """Let each step in turn fail, for each of several reasons."""
    counts: Counter[str] = Counter()
    for reason in FAULTS:
        for at in itertools.count(1, every):

            def fail(reason: int = reason) -> None:
                raise OSError(reason, os.strerror(reason))

            bench.trap.set(at, fail)
            try:
                write(bench.out, NEW)
                outcome = "done"
            except OutputError as refusal:
                outcome = "refused"
                assert "nothing was changed there" in str(refusal) or "holds results" in str(refusal), refusal
            over = bench.trap.left > 0
            bench.trap.set(0, print)
            found = bench.stands()
            if over:
                break
            assert found == ("new" if outcome == "done" else "old"), f"{outcome}, but {found} results stand"
            counts[found] += 1
            bench.next_run(found)
            bench.renew()
        assert at > 20
    return counts


def main() -> None:
    """See the module's text."""
    folder, what, how, every = (
        Path(sys.argv[1]),
        sys.argv[2],
        (*sys.argv[3:4], "exchange")[0],
        (*sys.argv[4:], "1")[0],
    )
    if how == "rename":
        staging.exchanged = lambda one, other: False
    import ctypes  # noqa: F401, now, so that loading it is no step of the work

    bench = Bench(folder)
    counts = (kills if what == "kill" else faults)(bench, int(every))
    if how == "exchange":
        assert not counts["neither"]
    sys.stdout.write(json.dumps(counts) + "\n")


if __name__ == "__main__":
    main()
