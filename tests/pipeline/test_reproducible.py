"""The same inputs, options and version make the same bytes, wherever and however the command is run."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from repository import ROOT, SAMPLE_RUNS

COMMANDS = {
    "thrusters": ["fit-thrusters", "pool/thrusters", "--thrusters-per-test", "2"],
    "yaw": ["fit-yaw", "pool/steps", "--fit-to", "half-turns"],
    "validation": ["validate", "pool/validation", "--model", "out/yaw/yaw_model.json"],
}


def made_in(place: Path, jobs: str, environment: dict[str, str]) -> dict[str, bytes]:
    """Every file that the commands write, run in processes of their own in a folder with that environment."""
    for name in ("thrusters", "steps", "validation"):
        shutil.copytree(SAMPLE_RUNS / name, place / "pool" / name, copy_function=shutil.copyfile)
    variables = os.environ | {"PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"} | environment
    for name, command in COMMANDS.items():
        given = [sys.executable, "-m", "automarine_cli", *command, "-o", f"out/{name}", "--jobs", jobs, "-q"]
        subprocess.run(given, cwd=place, env=variables, check=True, stdout=subprocess.DEVNULL)
    return {path.relative_to(place).as_posix(): path.read_bytes() for path in place.rglob("out/**/*.*")}


@pytest.mark.slow
def test_parallel_elsewhere_is_serial_here_to_the_byte(tmp_path: Path) -> None:
    here, there = tmp_path / "here", tmp_path / "far" / "away"
    first = made_in(here, "1", {"LC_ALL": "C", "TZ": "UTC", "PYTHONHASHSEED": "0"})
    second = made_in(there, "2", {"LC_ALL": "C.UTF-8", "TZ": "Pacific/Kiritimati", "PYTHONHASHSEED": "42"})
    assert first.keys() == second.keys() and len(first) > 20
    assert [name for name in first if first[name] != second[name]] == []
    assert [name for name, data in first.items() if str(tmp_path).encode() in data] == []
    words = (b"tIME", b"Creation Time", b"Software", b"creation_date")
    assert [name for name, data in first.items() if name.endswith(".png") and any(word in data for word in words)] == []
