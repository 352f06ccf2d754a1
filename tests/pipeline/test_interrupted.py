"""Work cut short by kills, full and broken disks, other writers and Ctrl-C: old results whole, or new ones whole."""

import contextlib
import errno
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import torn_writes
from repository import ROOT, SAMPLE_RUNS
from struck_commands import SENTENCE, KilledCommand, strike
from torn_writes import content

from automarine_cli.errors import OutputError
from automarine_cli.pipeline import staging
from automarine_cli.pipeline.lock import held
from automarine_cli.pipeline.outputs import result_folder

BUSY = (
    "another automarine is writing results to out (or to a folder above or in it); wait until it has ended, or "
    "choose another folder with -o"
)
posix_only = pytest.mark.skipif(os.name == "nt", reason="signals and forks of POSIX")


def write(out: Path, files: dict[str, str], *, overwrite: bool = False) -> None:
    """One result folder with these files."""
    torn_writes.write(out, {name: text.encode() for name, text in files.items()}, overwrite=overwrite)


def results(out: Path) -> dict[str, str]:
    """The results in a folder, without the manifest."""
    return {name: data.decode() for name, data in content(out).items() if name != "manifest.json"}


def hidden(folder: Path) -> list[str]:
    """What staging left in a folder."""
    return sorted(path.name for path in folder.iterdir() if path.name.startswith("."))


# Each step of the writing in turn


@pytest.mark.slow
@posix_only
@pytest.mark.parametrize("how", ["exchange", "rename"])
@pytest.mark.parametrize("what", ["kill", "fault"])
def test_each_step_killed_or_failing_leaves_old_or_new_whole(tmp_path: Path, what: str, how: str) -> None:
    """With folders exchanged in one step, and with two renames where a system cannot do that."""
    every = "1" if what == "kill" else "3"  # of each fault every third; tests/benchmarks/interruptions.py has all
    found = subprocess.run(
        [sys.executable, str(ROOT / "tests" / "helpers" / "torn_writes.py"), str(tmp_path), what, how, every],
        capture_output=True, text=True, check=False, env=os.environ | {"PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert found.returncode == 0, found.stderr
    counts = json.loads(found.stdout)
    assert counts["old"] >= 30 and counts["new"] >= 15
    assert counts.get("neither", 0) == (1 if (what, how) == ("kill", "rename") else 0)


@pytest.mark.slow
@posix_only
def test_the_command_killed_at_random_moments(tmp_path: Path) -> None:
    killed = KilledCommand(tmp_path)
    assert {killed.kill() for _ in range(3)} <= {"old", "new"}
    killed.next_run()


def test_an_error_between_two_renames_puts_the_old_folder_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "out"
    write(out, {"a": "old"})
    real, calls = Path.rename, []

    def rename(path: Path, target: Path) -> Path:
        calls.append(path)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return real(path, target)

    monkeypatch.setattr(Path, "rename", rename)
    monkeypatch.setattr(staging, "exchanged", lambda one, other: False)
    with pytest.raises(KeyboardInterrupt):
        write(out, {"a": "new"}, overwrite=True)
    assert results(out) == {"a": "old"}
    assert hidden(tmp_path) == []


def test_what_a_killed_run_left_goes_at_the_next_and_nothing_else(tmp_path: Path) -> None:
    write(tmp_path / "out", {"a": "1"})
    for name in (".out.automarine-new", ".out.automarine-old", ".out.automarine-note", ".other.automarine-new"):
        (tmp_path / name / "deep").mkdir(parents=True)
    (tmp_path / ".out.automarine-new" / "deep").chmod(0o500)
    (tmp_path / ".out.automarine-lock").touch()
    with pytest.raises(OutputError, match="--overwrite"):
        write(tmp_path / "out", {"a": "2"})
    assert hidden(tmp_path) == [".other.automarine-new", ".out.automarine-note"]
    assert results(tmp_path / "out") == {"a": "1"}


def test_a_stranded_old_folder_comes_back(tmp_path: Path) -> None:
    write(tmp_path / "out", {"a": "1"})
    (tmp_path / "out").rename(tmp_path / ".out.automarine-old")
    with pytest.raises(OutputError, match="already holds results of fit-yaw"):
        write(tmp_path / "out", {"a": "2"})
    assert results(tmp_path / "out") == {"a": "1"}
    assert hidden(tmp_path) == []


# Two at once


@pytest.mark.parametrize("place", ["out", "out/sub", "."])
def test_a_second_writer_is_refused_and_disturbs_nothing(tmp_path: Path, place: str) -> None:
    """Into the same folder, into a folder in it, and into a folder that holds it."""
    top = tmp_path / "top"
    first, second = top / "out", top / place
    write(first, {"a": "old"})
    with (
        pytest.raises(OutputError) as refused,
        result_folder(first, command="fit-yaw", options={}, inputs=(), seed=None, overwrite=True) as folder,
    ):
        folder.write("a", "new")
        with contextlib.suppress(OutputError):
            write(second, {"b": "2"}, overwrite=True)
            pytest.fail("the second writer was let in")
        write(second, {"b": "2"}, overwrite=True)
    assert str(refused.value) == BUSY.replace("out", second.name, 1)
    assert results(first) == {"a": "old"}
    assert hidden(top) == hidden(tmp_path) == []
    write(second, {"b": "2"}, overwrite=True)  # and now that the first has ended


def test_neighbours_work_at_the_same_time(tmp_path: Path) -> None:
    with result_folder(tmp_path / "a", command="c", options={}, inputs=(), seed=None, overwrite=False) as folder:
        folder.write("one", "1")
        write(tmp_path / "b", {"two": "2"})
    assert (results(tmp_path / "a"), results(tmp_path / "b")) == ({"one": "1"}, {"two": "2"})


def test_two_commands_at_once_one_is_told_to_wait(tmp_path: Path) -> None:
    with held(tmp_path / ".out.automarine-lock"):
        found = subprocess.run(
            [sys.executable, "-m", "automarine_cli", "simulate", str(SAMPLE_RUNS / "hidden_one.toml"), "-o", "out"],
            cwd=tmp_path, env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=False,
        )  # fmt: skip
    assert (found.returncode, found.stdout, found.stderr) == (1, "", f"Error: {BUSY}\n")


def test_results_that_appear_meanwhile_are_not_overwritten(tmp_path: Path) -> None:
    """From a writer that takes no lock: a copy, or a file system without locks."""
    out = tmp_path / "out"
    write(tmp_path / "elsewhere", {"a": "first"})
    with (
        pytest.raises(OutputError, match="already holds results of fit-yaw; give --overwrite"),
        result_folder(out, command="c", options={}, inputs=(), seed=None, overwrite=False) as folder,
    ):
        folder.write("a", "second")
        (tmp_path / "elsewhere").rename(out)
    assert results(out) == {"a": "first"}


# Disks


@pytest.mark.parametrize(
    ("problem", "advice"),
    [
        (errno.ENOSPC, "Make room, or choose another folder with -o"),
        (errno.EDQUOT, "Make room, or choose another folder with -o"),
        (errno.EROFS, "Choose a folder that you may write to with -o"),
        (errno.EACCES, "Choose a folder that you may write to with -o"),
        (errno.EIO, "Choose another folder with -o"),
    ],
)
def test_what_the_disk_refuses_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, problem: int, advice: str
) -> None:
    out = tmp_path / "out"
    write(out, {"a": "old"})

    def fail(number: int) -> None:
        raise OSError(problem, os.strerror(problem))

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(OutputError) as refused:
        write(out, {"a": "new"}, overwrite=True)
    why = os.strerror(problem)
    assert str(refused.value) == (
        f"results cannot be written to {out}: {why[0].lower()}{why[1:]}; nothing was changed there. {advice}"
    )
    assert results(out) == {"a": "old"}
    assert hidden(tmp_path) == []


def test_a_folder_closed_to_writing_is_refused(tmp_path: Path) -> None:
    write(tmp_path / "out", {"a": "old"})
    (tmp_path / "out").chmod(0o555)
    with pytest.raises(OutputError) as refused:
        write(tmp_path / "out", {"a": "new"}, overwrite=True)
    assert str(refused.value) == ("out is read-only; choose another folder with -o, or allow writing to this one")
    assert results(tmp_path / "out") == {"a": "old"}
    (tmp_path / "out").chmod(0o755)


@contextlib.contextmanager
def small_disk(place: Path, options: str) -> Iterator[None]:
    """A disk in memory, mounted on `place`; skips where that is not allowed."""
    mount, unmount = shutil.which("mount"), shutil.which("umount")
    if not mount or not unmount or os.geteuid() != 0:
        pytest.skip("mounting a small disk takes root")
    place.mkdir(exist_ok=True)
    made = subprocess.run([mount, "-t", "tmpfs", "-o", options, "none", place], capture_output=True, check=False)
    if made.returncode:
        pytest.skip("mounting a small disk is not allowed here")
    try:
        yield
    finally:
        subprocess.run([unmount, place], check=True)


@posix_only
def test_a_small_disk_that_runs_full_keeps_the_old_results(tmp_path: Path) -> None:
    with small_disk(tmp_path / "disk", "size=256k"):
        out = tmp_path / "disk" / "out"
        write(out, {"a": "old" * 10_000})
        with pytest.raises(OutputError, match=r"no space left on device; nothing was changed there\. Make room"):
            write(out, {"a": "new" * 10_000, "b": "new" * 100_000}, overwrite=True)
        assert results(out) == {"a": "old" * 10_000}
        assert hidden(out.parent) == []
        write(out, {"a": "new" * 10_000}, overwrite=True)
        assert results(out) == {"a": "new" * 10_000}


@posix_only
def test_a_disk_that_is_read_only_is_one_sentence(tmp_path: Path) -> None:
    with small_disk(tmp_path / "disk", "size=256k"):
        write(tmp_path / "disk" / "out", {"a": "old"})
        subprocess.run(["mount", "-o", "remount,ro", tmp_path / "disk"], check=True)
        with pytest.raises(OutputError, match=r"(read-only file system|is read-only)"):
            write(tmp_path / "disk" / "out", {"a": "new"}, overwrite=True)
        with pytest.raises(OutputError, match=r"read-only file system; nothing was changed there\. Choose a folder"):
            write(tmp_path / "disk" / "other", {"a": "new"})
        assert results(tmp_path / "disk" / "out") == {"a": "old"}


# Interrupts


FIT = ["fit-yaw", str(SAMPLE_RUNS / "hidden_one"), "-o", "out", "--jobs", "2"]
MOMENTS = {
    "libraries are loaded": "command import numpy",
    "logs are read": "command open .csv",
    "processes start": "worker import numpy",
    "processes take work": "worker pickle.find_class automarine_cli.pipeline.parallel",
    "results are written": "command open yaw_model.json",
}


@pytest.mark.slow
@posix_only
@pytest.mark.parametrize(
    ("how", "moment"),
    [
        *((signal.SIGINT, moment) for moment in MOMENTS),
        (signal.SIGTERM, "processes take work"),
        (signal.SIGHUP, "logs are read"),
    ],
)
def test_an_interrupted_command_ends_with_its_processes_and_waits_for_no_work(
    tmp_path: Path, how: int, moment: str
) -> None:
    """Command or process have halted for good: whoever waits for them never ends."""
    found = strike(FIT, tmp_path, MOMENTS[moment], how)
    assert (found.status, found.said) == (130, SENTENCE)
    assert list(tmp_path.iterdir()) == []


DEAF = """
import sys, time
import click
from automarine_cli.commands import automarine
from automarine_cli.__main__ import main

def body():
    click.echo("ready")
    {body}

automarine.add_command(click.Command("try", callback=body))
main()
"""
SWALLOWED = """
    while True:
        try:
            time.sleep(60)
        except KeyboardInterrupt:
            pass
"""
TURNED = """
    try:
        time.sleep(60)
    except KeyboardInterrupt:
        raise ImportError("initialization failed")
"""
IN_C = """
    import numpy
    a = numpy.random.default_rng(0).random((20_000, 20_000), dtype=numpy.float32)
    numpy.linalg.svd(a)
"""


@pytest.mark.slow
@posix_only
@pytest.mark.parametrize("body", [SWALLOWED, TURNED, IN_C], ids=["swallowed", "turned", "in-c"])
def test_an_interrupt_that_a_library_swallows_ends_the_command_all_the_same(body: str) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", DEAF.format(body=body.strip()), "try"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT,
    )  # fmt: skip
    assert process.stdout is not None
    process.stdout.readline()
    time.sleep(0.2)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=600)
    assert (process.returncode, said) == (130, SENTENCE)


@posix_only
def test_what_is_ignored_stays_ignored() -> None:
    """As under nohup: a hang-up does not end the work."""
    code = "import signal\nsignal.signal(signal.SIGHUP, signal.SIG_IGN)\n" + DEAF.format(
        body="time.sleep(0.5); click.echo('done')"
    )
    process = subprocess.Popen([sys.executable, "-c", code, "try"], stdout=subprocess.PIPE, text=True, cwd=ROOT)
    assert process.stdout is not None
    process.stdout.readline()
    process.send_signal(signal.SIGHUP)
    assert process.communicate(timeout=600)[0] == "done\n"
    assert process.returncode == 0
