"""Results whole or not at all: what stands on the disk after success, refusal, error, interrupt and kill."""

import hashlib
import json
import os
from pathlib import Path

import numpy as np
import pytest

from automarine_cli.errors import OutputError
from automarine_cli.pipeline.outputs import MANIFEST, file_stems, json_text, result_folder


def write(
    out: Path, files: dict[str, str], *, command: str = "fit-yaw", overwrite: bool = False, **more: object
) -> None:
    """One result folder with these files."""
    settings: dict[str, object] = {"options": {}, "inputs": (), "seed": None} | more
    with result_folder(out, command=command, overwrite=overwrite, **settings) as folder:  # type: ignore[arg-type]
        for name, text in files.items():
            folder.write(name, text)


def content(out: Path) -> dict[str, str]:
    """Every file under `out` but the manifest, by relative name."""
    files = (path for path in out.rglob("*") if path.is_file() and path.name != MANIFEST)
    return {path.relative_to(out).as_posix(): path.read_text() for path in sorted(files)}


def hidden(folder: Path) -> list[str]:
    """Names of what staging left in `folder`."""
    return sorted(path.name for path in folder.iterdir() if path.name.startswith("."))


def test_new_folder_appears_with_its_manifest(tmp_path: Path) -> None:
    log = tmp_path / "run.csv"
    log.write_bytes(b"time_s,tau\n")
    out = tmp_path / "deep" / "er" / "out"
    options = {"arm": 0.44, "model": tmp_path / "m.json", "file": str(log), "out": out, "jobs": 4, "overwrite": False}
    write(out, {"b.csv": "1\n", "sub/a.csv": "ψ\n"}, options=options, inputs=[("steps/run.csv", log)], seed=3)

    assert content(out) == {"b.csv": "1\n", "sub/a.csv": "ψ\n"}
    assert hidden(out.parent) == []
    manifest = json.loads((out / MANIFEST).read_text())
    assert manifest["schema"] == "automarine/manifest/1"
    assert manifest["command"] == "fit-yaw"
    assert manifest["seed"] == 3
    assert manifest["options"] == {"arm": 0.44, "model": "m.json", "file": "run.csv"}
    assert manifest["inputs"] == [
        {"file": "steps/run.csv", "role": "log", "sha256": hashlib.sha256(b"time_s,tau\n").hexdigest()}
    ]
    assert manifest["outputs"] == [
        {"file": "b.csv", "sha256": hashlib.sha256(b"1\n").hexdigest()},
        {"file": "sub/a.csv", "sha256": hashlib.sha256("ψ\n".encode()).hexdigest()},
    ]
    assert manifest["libraries"]["numpy"] == np.__version__


def test_manifest_says_nothing_of_the_machine(tmp_path: Path) -> None:
    for name in ("one", "two"):
        folder = tmp_path / name
        folder.mkdir()
        (folder / "run.csv").write_text("t\n")
        options = {"model": folder / "m.json", "hold_out": (str(folder / "x"),)}
        write(folder / "out", {"a": "1"}, options=options, inputs=[("run.csv", folder / "run.csv")])
    first, second = ((tmp_path / name / "out" / MANIFEST).read_bytes() for name in ("one", "two"))
    assert first == second
    assert str(tmp_path).encode() not in first


def test_existing_results_are_refused_before_any_work(tmp_path: Path) -> None:
    out = tmp_path / "out"
    write(out, {"a": "old"})
    with pytest.raises(OutputError, match=r"already holds results of fit-yaw; give --overwrite to replace them"):
        write(out, {"a": "new"})
    assert content(out) == {"a": "old"}


def test_overwrite_replaces_ours_and_keeps_theirs(tmp_path: Path) -> None:
    out = tmp_path / "out"
    write(out, {"a": "old", "validation_gone.png": "old"})
    (out / "notes.txt").write_text("mine")
    (out / "sub" / "empty").mkdir(parents=True)
    (out / "sub" / "x").write_text("mine too")
    (out / "link").symlink_to("notes.txt")
    (out / "sub").chmod(0o700)
    out.chmod(0o750)
    write(out, {"a": "new"}, overwrite=True)
    assert content(out) == {"a": "new", "link": "mine", "notes.txt": "mine", "sub/x": "mine too"}
    assert (out / "link").is_symlink()
    assert (out / "sub" / "empty").is_dir()
    assert out.stat().st_mode & 0o777 == 0o750
    assert (out / "sub").stat().st_mode & 0o777 == 0o700
    assert hidden(tmp_path) == []


def test_results_of_another_command_stay_beside(tmp_path: Path) -> None:
    out = tmp_path / "out"
    write(out, {"thrusters.json": "map"}, command="fit-thrusters")
    write(out, {"yaw_model.json": "model"}, command="fit-yaw", overwrite=True)
    assert content(out) == {"thrusters.json": "map", "yaw_model.json": "model"}


def test_empty_folder_is_used(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    write(out, {"a": "1"})
    assert content(out) == {"a": "1"}


def test_foreign_folder_takes_results_but_loses_nothing(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "a").write_text("mine")
    with pytest.raises(OutputError, match=r"already holds a file a; give --overwrite"):
        write(out, {"b": "ours", "a": "ours"})
    assert content(out) == {"a": "mine"}
    write(out, {"b": "ours"})
    assert content(out) == {"a": "mine", "b": "ours"}


def test_a_home_or_project_is_not_replaced(tmp_path: Path) -> None:
    for i in range(1001):
        (tmp_path / f"{i}.txt").touch()
    with pytest.raises(OutputError, match="holds 1001 other files; give a folder inside it"):
        write(tmp_path, {"a": "1"})
    assert not (tmp_path / "a").exists()


def test_foreign_manifest_is_never_replaced(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / MANIFEST).write_text('{"name": "a web page"}')
    for overwrite in (False, True):
        with pytest.raises(OutputError, match="not automarine's"):
            write(out, {"a": "1"}, overwrite=overwrite)
    assert (out / MANIFEST).read_text() == '{"name": "a web page"}'


def test_symlink_to_a_folder_stays_a_link(tmp_path: Path) -> None:
    real, link = tmp_path / "real", tmp_path / "link"
    real.mkdir()
    link.symlink_to(real)
    write(link, {"a": "1"})
    write(link, {"a": "2"}, overwrite=True)
    assert link.is_symlink()
    assert content(real) == {"a": "2"}


def test_unfit_targets_are_refused_in_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="file is a file; give a folder"):
        write(tmp_path / "file", {"a": "1"})
    with pytest.raises(OutputError, match="file is a file; give a folder"):
        write(tmp_path / "file" / "below", {"a": "1"})
    monkeypatch.chdir(tmp_path)
    with pytest.raises(OutputError, match="the folder this command runs in"):
        write(Path(), {"a": "1"})


def test_full_disk_is_one_sentence_and_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "made" / "out"

    def no_room(number: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", no_room)
    with pytest.raises(OutputError) as refused:
        write(out, {"a": "1"})
    assert str(refused.value) == (
        f"results cannot be written to {out}: no space left on device; nothing was changed there. "
        "Make room, or choose another folder with -o"
    )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("problem", [KeyboardInterrupt(), ValueError("x"), FileNotFoundError(2, "No such log")])
def test_error_or_interrupt_inside_leaves_nothing_and_passes_unchanged(tmp_path: Path, problem: BaseException) -> None:
    out = tmp_path / "made" / "out"
    with (
        pytest.raises(type(problem)) as caught,
        result_folder(out, command="c", options={}, inputs=(), seed=None, overwrite=False) as folder,
    ):
        folder.write("a", "1")
        raise problem
    assert caught.value is problem
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["", "/abs", "../up", "a/../../up", "back\\slash", "twice"])
def test_names_stay_inside(tmp_path: Path, name: str) -> None:
    with pytest.raises(ValueError, match="expected a new relative name"):
        write(tmp_path / "out", {"twice": "1"} | {name: "1"} if name != "twice" else {"twice": "1", "./twice": "2"})
    assert list(tmp_path.iterdir()) == []


def test_json_has_one_form() -> None:
    data = {"b": np.float64(0.1), "a": [np.int64(2), np.bool_(True)], "ψ": np.array([1.0, 2.0]), "none": None}
    assert (
        json_text(data) == '{\n "b": 0.1,\n "a": [\n  2,\n  true\n ],\n "ψ": [\n  1.0,\n  2.0\n ],\n "none": null\n}\n'
    )


@pytest.mark.parametrize("bad", [float("nan"), np.float64("inf"), np.array([1.0, np.nan])])
def test_json_never_holds_nan(bad: object) -> None:
    with pytest.raises(OutputError, match=r"^result\.models\.1\[0\](\[1\])? is not a finite number"):
        json_text({"fine": 1.0, "models": {"1": [bad]}})


def test_file_stems_are_safe_and_distinct() -> None:
    assert file_stems(["steps/run 1", "steps/run_1", "../x", "", "Ab", "aB"]) == [
        "steps_run_1", "steps_run_1_2", "_x", "run", "Ab", "aB_2",
    ]  # fmt: skip
