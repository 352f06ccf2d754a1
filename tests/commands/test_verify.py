"""`automarine verify`: what changed, is missing or was added since results were written, and whether inputs did."""

import json
import os
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result

from automarine_cli.pipeline.results_folder import Input, result_folder

Run = Callable[..., Result]


def make_results(out: Path, logs: Path) -> None:
    """Results of two files from two logs and a model."""
    inputs = [Input(f"{logs.name}/{name}", logs / name) for name in ("a.csv", "b.csv")]
    inputs.append(Input("model.json", logs.parent / "model.json", "model"))
    with result_folder(out, command="validate", options={}, inputs=inputs, seed=0, overwrite=True) as folder:
        folder.write("table.csv", "x\n1\n")
        folder.write("sub/figure.png", b"\x89PNG")


@pytest.fixture
def pool(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory: logs, a model, and results in `out/one`."""
    (tmp_path / "logs").mkdir()
    for name in ("logs/a.csv", "logs/b.csv", "model.json"):
        (tmp_path / name).write_text(f"{name}\n")
    make_results(tmp_path / "out" / "one", tmp_path / "logs")
    monkeypatch.chdir(tmp_path)
    return tmp_path


WHOLE = "out/one (validate): 2 of 2 files as written, 3 of 3 inputs found as recorded\n"


def test_whole_results_are_status_0(pool: Path, run: Run) -> None:
    for folder in ("out/one", "out"):
        found = run("verify", folder)
        assert (found.exit_code, found.stdout, found.stderr) == (0, WHOLE, "")
    os.utime(pool / "out/one/table.csv", (0, 0))  # a time is nothing
    (pool / "out/one/.DS_Store").touch()
    assert run("verify", "out/one").exit_code == 0


def test_from_elsewhere_the_inputs_beside_the_results_are_found(
    pool: Path, run: Run, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_results(pool / "two", pool / "logs")
    monkeypatch.chdir(tmp_path_factory.mktemp("elsewhere"))
    assert "3 of 3 inputs found as recorded" in run("verify", pool / "two").stdout


@pytest.mark.parametrize(
    ("harm", "line"),
    [
        (lambda out: (out / "table.csv").write_text("x\n2\n"), "out/one/table.csv: changed since it was written"),
        (lambda out: (out / "table.csv").unlink(), "out/one/table.csv: missing"),
        (lambda out: (out / "sub/figure.png").write_bytes(b""), "out/one/sub/figure.png: changed since it was written"),
        (lambda out: (out / "sub/more.png").touch(),
         "out/one/sub/more.png: extra: not among the files that were written"),
        (lambda out: (out / "new\nline.csv").touch(),
         "out/one/new\\nline.csv: extra: not among the files that were written"),
    ],
)  # fmt: skip
def test_each_change_is_named_and_status_1(pool: Path, run: Run, harm: Callable[[Path], object], line: str) -> None:
    harm(pool / "out/one")
    found = run("verify", "out/one")
    assert (found.exit_code, found.stderr) == (1, f"{line}\n")
    quiet = run("verify", "out/one", "-q")
    assert (quiet.exit_code, quiet.stdout, quiet.stderr) == (1, "", f"{line}\n")


def test_a_changed_input_is_named_and_a_lost_one_is_told(pool: Path, run: Run) -> None:
    (pool / "logs/a.csv").write_text("other\n")
    found = run("verify", "out/one")
    assert (found.exit_code, found.stderr) == (1, "out/one: input logs/a.csv: changed; logs/a.csv has other content\n")
    (pool / "logs/a.csv").unlink()
    found = run("verify", "out/one")
    assert (found.exit_code, found.stderr) == (0, "out/one: input logs/a.csv: not found here or beside the results\n")
    assert "2 of 3 inputs found as recorded" in found.stdout
    found = run("verify", "out/one", "--inputs", "logs", "--inputs", "model.json")
    assert (found.exit_code, found.stderr) == (1, "out/one: input logs/a.csv: not found under logs, model.json\n")


def test_json(pool: Path, run: Run) -> None:
    (pool / "out/one/table.csv").unlink()
    found = run("verify", "out/one", "--json")
    assert found.exit_code == 1
    said = json.loads(found.stdout)
    assert (said["schema"], said["whole"]) == ("automarine/verification/1", False)
    (folder,) = said["folders"]
    assert folder == {
        "folder": "out/one", "command": "validate", "files": 2, "whole": False,
        "outputs": [{"file": "table.csv", "what": "missing", "why": "missing"}],
        "inputs_recorded": 3, "inputs_whole": 3, "inputs": [],
    }  # fmt: skip


def test_results_in_a_folder_of_results_are_not_extra(pool: Path, run: Run) -> None:
    make_results(pool / "out/one/deeper", pool / "logs")
    found = run("verify", "out/one")
    assert (found.exit_code, found.stderr) == (0, "")
    assert found.stdout.count("2 of 2 files as written") == 2


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (None, "Error: out/one: no manifest.json of automarine here or in a folder below; give a folder of results\n"),
        ("{", "Error: manifest.json: not valid JSON: "),
        ("[" * 100_000, "Error: manifest.json: not valid JSON: "),
        ('{"schema": "web/1"}', "Error: manifest.json: is no manifest of automarine; expected the manifest.json in "),
        ('{"schema": "automarine/manifest/1", "automarine": 3}', "Error: manifest.json: automarine: found 3, expected"),
        ('{"schema": "automarine/manifest/1", "automarine": "1", "command": "c", "outputs": [{"file": "/etc/passwd"}]}',
         "Error: manifest.json: outputs[0]: the file name '/etc/passwd' leads out of the folder; "
     "give a manifest of automarine\n"),
    ],
)  # fmt: skip
def test_a_folder_without_a_sound_manifest_is_refused(pool: Path, run: Run, text: str | None, sentence: str) -> None:
    manifest = pool / "out/one/manifest.json"
    manifest.unlink()
    if text is not None:
        manifest.write_text(text)
    found = run("verify", "out/one")
    assert found.exit_code == 1 and found.stderr.startswith(sentence)
    assert found.stderr.count("\n") == 1


def test_an_unreadable_input_is_recorded_without_a_hash(tmp_path: Path) -> None:
    """A log that was set aside because nobody could open it."""
    (tmp_path / "lost.csv").symlink_to("nowhere")
    with result_folder(
        tmp_path / "out", command="c", options={}, inputs=[Input("lost.csv", tmp_path / "lost.csv")], seed=None,
        overwrite=False,
    ) as folder:  # fmt: skip
        folder.write("a", "1")
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert manifest["inputs"] == [{"file": "lost.csv", "role": "log", "sha256": None}]
