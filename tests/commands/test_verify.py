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


def test_whole_results_are_status_0(pool: Path, run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    os.utime(pool / "out/one/table.csv", (0, 0))  # a time is nothing
    (pool / "out/one/.DS_Store").touch()
    for folder in ("out/one", "out"):
        result = run("verify", folder)
        assert (result.exit_code, result.stdout, result.stderr) == (0, WHOLE, "")
    make_results(pool / "out/one/deeper", pool / "logs")  # results in a folder of results are not extra
    result = run("verify", "out/one")
    assert (result.exit_code, result.stderr, result.stdout.count("2 of 2 files as written")) == (0, "", 2)
    make_results(pool / "two", pool / "logs")
    monkeypatch.chdir(pool / "out")  # inputs beside the results are looked for too
    assert "3 of 3 inputs found as recorded" in run("verify", pool / "two").stdout


EXTRA = "extra: not among the files that were written"


@pytest.mark.parametrize(
    ("harm", "line"),
    [
        (lambda out: (out / "table.csv").write_text("x\n2\n"), "table.csv: changed since it was written"),
        (lambda out: (out / "table.csv").unlink(), "table.csv: missing"),
        (lambda out: (out / "sub/figure.png").write_bytes(b""), "sub/figure.png: changed since it was written"),
        (lambda out: (out / "sub/more.png").touch(), f"sub/more.png: {EXTRA}"),
        (lambda out: (out / "new\nline.csv").touch(), f"new\\nline.csv: {EXTRA}"),
    ],
)  # fmt: skip
def test_each_change_is_named_and_status_1(pool: Path, run: Run, harm: Callable[[Path], object], line: str) -> None:
    harm(pool / "out/one")
    result, quiet = run("verify", "out/one"), run("verify", "out/one", "-q")
    assert (result.exit_code, result.stderr) == (1, f"out/one/{line}\n")
    answer = result.stdout.splitlines()[0]
    assert (quiet.exit_code, quiet.stdout, quiet.stderr) == (1, f"{answer}\n", result.stderr)


def test_a_changed_input_is_refused_and_a_lost_one_is_no_more_than_named(pool: Path, run: Run) -> None:
    (pool / "logs/a.csv").write_text("other\n")
    result = run("verify", "out/one")
    assert (result.exit_code, result.stderr) == (
        1, "out/one: input logs/a.csv: changed; logs/a.csv has other content\n"
    )  # fmt: skip
    (pool / "logs/a.csv").unlink()
    result = run("verify", "out/one")
    assert (result.exit_code, result.stderr) == (0, "out/one: input logs/a.csv: not found here or beside the results\n")
    assert "2 of 3 inputs found as recorded" in result.stdout
    result = run("verify", "out/one", "--inputs", "logs", "--inputs", "model.json")
    assert (result.exit_code, result.stderr) == (1, "out/one: input logs/a.csv: not found under logs, model.json\n")


def test_json(pool: Path, run: Run) -> None:
    (pool / "out/one/table.csv").unlink()
    result = run("verify", "out/one", "--json")
    data = json.loads(result.stdout)
    assert (result.exit_code, data["schema"], data["whole"]) == (1, "automarine/verification/1", False)
    assert data["folders"] == [{
        "folder": "out/one", "command": "validate", "files": 2, "whole": False,
        "outputs": [{"file": "table.csv", "what": "missing", "why": "missing"}],
        "inputs_recorded": 3, "inputs_whole": 3, "inputs": [],
    }]  # fmt: skip


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (None, "Error: out/one: no manifest.json of automarine here or in a folder below; give a folder of results\n"),
        ("{", "Error: manifest.json: not valid JSON: "),
        ("[" * 100_000, "Error: manifest.json: not valid JSON: "),
        ('{"schema": "web/1"}', "Error: manifest.json: is no manifest of automarine; expected the manifest.json in "),
        ('{"schema": "automarine/manifest/1", "automarine": 3}', "Error: manifest.json: automarine: found 3, expected"),
        ('{"schema": "automarine/manifest/1", "automarine": "1", "command": "c", "outputs": [{"file": "/etc/passwd"}]}',
         "Error: manifest.json: outputs[0]: the file name '/etc/passwd' leads out of the folder; "),
    ],
)  # fmt: skip
def test_a_folder_without_a_sound_manifest_is_refused(pool: Path, run: Run, text: str | None, sentence: str) -> None:
    manifest = pool / "out/one/manifest.json"
    manifest.unlink()
    if text is not None:
        manifest.write_text(text)
    result = run("verify", "out/one")
    assert result.exit_code == 1 and result.stderr.startswith(sentence) and result.stderr.count("\n") == 1
