"""A column map that comes out of a pipe, as a shell's <(...) gives it, is read once and for all."""

import os
import threading
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result
from repository import SAMPLE_RUNS


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_a_column_map_from_a_pipe(tmp_path: Path, run: Callable[..., Result]) -> None:
    pipe, text = tmp_path / "pipe", "[defaults]\nthrusters_per_test = 2\n"
    os.mkfifo(pipe)
    writer = threading.Thread(target=pipe.write_text, args=(text,))
    writer.start()
    found = run("fit-thrusters", SAMPLE_RUNS / "thrusters", "--columns", pipe, "-o", tmp_path / "piped")
    writer.join()
    assert found.exit_code == 0, found.output
    (tmp_path / "columns.toml").write_text(text)
    found = run(
        "fit-thrusters", SAMPLE_RUNS / "thrusters", "--columns", tmp_path / "columns.toml", "-o", tmp_path / "b"
    )
    assert found.exit_code == 0, found.output
    for name in ("thrusters.json", "manifest.json"):
        assert (tmp_path / "piped" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
