"""Results whole or not at all: what stands on the disk after success, refusal, error, interrupt and kill."""

import hashlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import numpy as np
import pytest
from repository import ROOT

from automarine_cli.errors import OutputError
from automarine_cli.pipeline.results_folder import MANIFEST, Input, ResultFolder, result_folder
from automarine_cli.report.sections import file_stems


def write(out: Path, files: dict[str, str], **more: object) -> None:
    with filling(out, **more) as folder:
        for name, text in files.items():
            folder.write(name, text)


def filling(out: Path, **more: object) -> AbstractContextManager[ResultFolder]:
    """The folder while results are written to it."""
    settings = {"command": "fit-yaw", "options": {}, "inputs": (), "seed": None, "overwrite": False} | more
    return result_folder(out, **settings)  # type: ignore[arg-type]


def content(out: Path) -> dict[str, str]:
    """Every file under `out` but the manifest, by relative name."""
    files = (path for path in out.rglob("*") if path.is_file() and path.name != MANIFEST)
    return {path.relative_to(out).as_posix(): path.read_text() for path in sorted(files)}


def test_new_folder_appears_with_its_manifest(tmp_path: Path) -> None:
    log, out = tmp_path / "run.csv", tmp_path / "deep" / "er" / "out"
    log.write_bytes(b"time_s,tau\n")
    options = {"arm": 0.44, "model": tmp_path / "m.json", "file": str(log), "logs": ("a", log)}
    write(out, {"b.csv": "1\n", "sub/a.csv": "ψ\n"}, options=options, inputs=[Input("steps/run.csv", log)], seed=3)
    assert content(out) == {"b.csv": "1\n", "sub/a.csv": "ψ\n"} and list(out.parent.iterdir()) == [out]
    manifest = json.loads((out / MANIFEST).read_text())
    checked, b, a = (hashlib.sha256(data.encode()).hexdigest() for data in ("time_s,tau\n", "1\n", "ψ\n"))
    assert manifest["options"] == {"arm": 0.44, "model": "m.json", "file": "run.csv", "logs": ["a", "run.csv"]}
    assert manifest["inputs"] == [{"file": "steps/run.csv", "role": "log", "sha256": checked}]
    assert manifest["outputs"] == [{"file": "b.csv", "sha256": b}, {"file": "sub/a.csv", "sha256": a}]
    assert (manifest["seed"], manifest["libraries"]["numpy"]) == (3, np.__version__)


def test_overwrite_replaces_ours_and_keeps_theirs(tmp_path: Path) -> None:
    out = tmp_path / "out"
    write(out, {"a": "old", "gone.png": "old"})
    with pytest.raises(OutputError, match=r"already holds results of fit-yaw; give --overwrite to replace them"):
        write(out, {"a": "new"})
    assert content(out) == {"a": "old", "gone.png": "old"}
    (out / "notes.txt").write_text("mine")
    (out / "sub" / "empty").mkdir(parents=True)
    (out / "sub" / "x").write_text("mine too")
    (out / "link").symlink_to("notes.txt")
    out.chmod(0o750)
    write(out, {"a": "new"}, overwrite=True)
    assert content(out) == {"a": "new", "link": "mine", "notes.txt": "mine", "sub/x": "mine too"}
    assert (out / "link").is_symlink() and (out / "sub" / "empty").is_dir()
    assert out.stat().st_mode & 0o777 == 0o750
    write(out, {"map": "1"}, command="fit-thrusters", overwrite=True)  # those of another command stay beside
    assert content(out).keys() == {"a", "map", "link", "notes.txt", "sub/x"} and list(tmp_path.iterdir()) == [out]


def test_a_folder_of_others_takes_results_but_loses_nothing(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "a").write_text("mine")
    with pytest.raises(OutputError, match=r"already holds a file a; give --overwrite"):
        write(out, {"b": "ours", "a": "ours"})
    assert content(out) == {"a": "mine"}
    write(out, {"b": "ours"})
    assert content(out) == {"a": "mine", "b": "ours"}
    (out / MANIFEST).write_text('{"name": "a web page"}')
    with pytest.raises(OutputError, match="not automarine's"):
        write(out, {"a": "1"}, overwrite=True)
    for i in range(1001):
        (tmp_path / f"{i}.txt").touch()
    with pytest.raises(OutputError, match=r"holds 100\d other files; give a folder inside it"):
        write(tmp_path, {"a": "1"})


def test_unfit_targets_are_refused_in_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    for target in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(OutputError, match="file is a file; give a folder"):
            write(target, {"a": "1"})
    write(tmp_path / "out", {"a": "old"})
    (tmp_path / "out").chmod(0o555)
    with pytest.raises(OutputError, match="out is read-only; choose another folder"):
        write(tmp_path / "out", {"a": "new"}, overwrite=True)
    (tmp_path / "out").chmod(0o755)
    (tmp_path / "link").symlink_to(tmp_path / "out")
    write(tmp_path / "link", {"a": "2"}, overwrite=True)
    assert (tmp_path / "link").is_symlink() and content(tmp_path / "out") == {"a": "2"}
    monkeypatch.chdir(tmp_path)
    with pytest.raises(OutputError, match="the folder this command runs in"):
        write(Path(), {"a": "1"})


@pytest.mark.parametrize("problem", [KeyboardInterrupt(), ValueError("x"), FileNotFoundError(2, "No such log")])
def test_error_or_interrupt_inside_leaves_nothing_and_passes_unchanged(tmp_path: Path, problem: BaseException) -> None:
    with pytest.raises(type(problem)) as caught, filling(tmp_path / "made" / "out") as out:
        out.write("a", "1")
        raise problem
    assert caught.value is problem and list(tmp_path.iterdir()) == []


def test_a_full_disk_is_one_sentence_and_undone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out, rename = tmp_path / "out", Path.rename
    write(out, {"a": "old"})

    def no_room(path: Path, target: Path) -> Path:
        if path.name == "new":
            raise OSError(28, "No space left on device")
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", no_room)
    with pytest.raises(OutputError) as refused:
        write(out, {"a": "new"}, overwrite=True)
    for part in (str(out), "no space left on device; nothing was changed", "another folder with -o, or make room"):
        assert part in str(refused.value)
    assert content(out) == {"a": "old"} and list(tmp_path.iterdir()) == [out]


KILLED = """
import os, shutil, signal, sys
from pathlib import Path
from automarine_cli.pipeline.results_folder import result_folder
how = dict(command="fit-yaw", options={}, inputs=(), seed=None, overwrite=True)
with result_folder(Path("out"), **how) as folder:
    folder.write("a", "new")
    if sys.argv[1] == "filling":
        os.kill(os.getpid(), signal.SIGKILL)
    rename = Path.rename
    def struck(path, target):
        rename(path, target)
        os.kill(os.getpid(), signal.SIGKILL)
    Path.rename = struck
"""


@pytest.mark.parametrize("when", ["filling", "between two renames"])
def test_a_killed_command_leaves_the_old_results(tmp_path: Path, when: str) -> None:
    """The next one clears away what the killed one was filling, and finds the old results."""
    out = tmp_path / "out"
    write(out, {"a": "old"})
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    killed = subprocess.run([sys.executable, "-c", KILLED, when], cwd=tmp_path, env=environment, check=False)
    assert killed.returncode == -signal.SIGKILL
    assert content(out if when == "filling" else tmp_path / ".out.automarine" / "old") == {"a": "old"}
    with pytest.raises(OutputError, match="already holds results"):
        write(out, {"a": "newer"})
    assert content(out) == {"a": "old"} and list(tmp_path.iterdir()) == [out]


def test_a_second_writer_is_refused_and_results_that_appear_meanwhile_stay(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="already holds results"), filling(tmp_path / "out"):
        with pytest.raises(OutputError, match="another automarine is writing results to out"):
            write(tmp_path / "out", {"a": "1"})
        write(tmp_path / "beside", {"a": "first"})
        (tmp_path / "beside").rename(tmp_path / "out")
    assert content(tmp_path) == {"out/a": "first"}


def test_a_lock_taken_away_while_it_is_awaited_is_no_lock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its owner ends between our opening the lock and our locking it: a third process would find another file."""
    fcntl = pytest.importorskip("fcntl")
    lock = fcntl.flock
    for leave in (lambda folder: folder.rmdir(), lambda folder: (folder / "lock").touch()):

        def taken(file: int, how: int, leave: Callable[[Path], None] = leave) -> None:
            folder = tmp_path / ".out.automarine"
            (folder / "lock").unlink()
            leave(folder)
            lock(file, how)

        monkeypatch.setattr(fcntl, "flock", taken)
        with pytest.raises(OutputError, match="another automarine is writing results to out"):
            write(tmp_path / "out", {"a.txt": "theirs"})
        assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["", "/abs", "../up", "a/../../up", "back\\slash", "twice"])
def test_names_stay_inside(tmp_path: Path, name: str) -> None:
    with pytest.raises(ValueError, match="expected a new relative name"), filling(tmp_path / "out") as folder:
        folder.write("twice", "1")
        folder.write(name, "1")
    assert list(tmp_path.iterdir()) == []


def test_file_stems_are_safe_and_distinct() -> None:
    assert file_stems(["steps/run 1", "steps/run_1", "../x", "", "Ab", "aB"]) == [
        "steps_run_1", "steps_run_1_2", "_x", "run", "Ab", "aB_2",
    ]  # fmt: skip
