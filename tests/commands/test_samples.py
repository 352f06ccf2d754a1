"""`samples`: the sample logs are copied whole into a new folder, and nothing is replaced."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result
from repository import SAMPLE_RUNS

import automarine_cli as am


def test_all_samples_are_copied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, run: Callable[..., Result]) -> None:
    monkeypatch.chdir(tmp_path)
    found = json.loads(run("samples", "--json").stdout)
    copied = {path.relative_to(SAMPLE_RUNS).as_posix(): path for path in SAMPLE_RUNS.rglob("*") if path.is_file()}
    assert found["files"] == sorted(copied, key=lambda name: Path(name)) and len(copied) > 200
    for name, path in copied.items():
        assert (tmp_path / "sample_runs" / name).read_bytes() == path.read_bytes()
    assert run("check", "sample_runs/steps").exit_code == 0
    again = am.samples(tmp_path / "day")
    assert again.out == tmp_path / "day" and "sample files" in repr(again)


def test_nothing_is_replaced(tmp_path: Path, run: Callable[..., Result]) -> None:
    (tmp_path / "there").mkdir()
    refused = run("samples", tmp_path / "there")
    assert refused.exit_code == 1 and "exists; give another folder, or delete it first" in refused.stderr
    assert list((tmp_path / "there").iterdir()) == [] and len(list(tmp_path.iterdir())) == 1
