"""The same inputs, options and version make the same bytes, wherever, whenever and however the command is run."""

import json
import locale
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest
from repository import ROOT, SAMPLE_RUNS
from torn_writes import content

pytestmark = pytest.mark.slow

STEPS = [f"steps/tau_{sign}{size}_a.csv" for sign in "+-" for size in ("0.1", "0.2", "0.3", "0.4", "0.5", "0.6")]
MANOEUVRES = ["validation/short_pulses.csv", "validation/there_and_back.csv"]
COLUMNS = '[columns]\nheading_deg = "yaw"\ntau = { from = "cmd", sign = -1 }\n[defaults]\narm_m = 0.3\n'

# One process for all commands of one place: its imports are most of the time.
ALL = """
import json, sys
from automarine_cli.commands import automarine
for arguments in json.load(sys.stdin):
    automarine.main(arguments, standalone_mode=False, prog_name="automarine")
"""


def make_pool(pool: Path) -> None:
    """A few of the sample runs, some under other column names, some with the commands of two thrusters."""
    for name in ("thrusters/bollard.csv", *MANOEUVRES):
        (pool / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(SAMPLE_RUNS / name, pool / name)
    for folder in ("steps", "driven"):
        (pool / folder).mkdir()
    for name in STEPS:
        table = pd.read_csv(SAMPLE_RUNS / name, comment="#")
        (table.assign(tau=-table["tau"]).rename(columns={"heading_deg": "yaw", "tau": "cmd"})).to_csv(
            pool / name, index=False
        )
        command = 60.0 * table["tau"].abs().pow(0.5) * table["tau"].apply(lambda tau: (tau > 0) - (tau < 0))
        driven = table.drop(columns="tau").assign(n_port=command, n_stbd=-command)
        driven.to_csv(pool / name.replace("steps", "driven"), index=False)
    readings = pd.read_csv(pool / "thrusters" / "bollard.csv", comment="#")
    readings[::5].to_csv(pool / "second_test.csv", index=False)
    (pool / "columns.toml").write_text(COLUMNS)
    shutil.copy(SAMPLE_RUNS / "hidden_two.toml", pool / "campaign.toml")


def recipes(pool: str, turn: int) -> dict[str, list[str]]:
    """Every command that writes results; `turn` of -1 gives the logs in the opposite order.

    The diagnosis is that of bollard tests: `make reproduce` has that of yaw, which takes half a minute.
    """
    steps = [f"{pool}/{name}" for name in STEPS][::turn]
    return {
        "thrusters": ["fit-thrusters", f"{pool}/thrusters", "--thrusters-per-test", "2"],
        "yaw": ["fit-yaw", *steps, "--columns", f"{pool}/columns.toml"],
        "driven": ["fit-yaw", f"{pool}/driven", "--thrusters", "out/thrusters/thrusters.json", "--arm", "0.3"],
        "validation": [
            "validate", *[f"{pool}/{name}" for name in MANOEUVRES][::turn], "--model", "out/yaw/yaw_model.json",
            "--seed", "3",
        ],
        "diagnosis": [
            "diagnose", f"{pool}/thrusters", "--model", "out/thrusters/thrusters.json",
            "--hold-out", f"{pool}/second_test.csv",
        ],
        "campaign": ["simulate", f"{pool}/campaign.toml", "--seed", "5"],
        "slices": ["slice", *[f"{pool}/{name}" for name in MANOEUVRES][::turn], "--by", "moment"],
    }  # fmt: skip


NAMES = list(recipes("", 1))


def made_in(folder: Path, pool: str, turn: int, jobs: int, umask: int, more: dict[str, str]) -> Path:
    """All results made in a process of its own with that environment; the folder that holds them."""
    folder.mkdir(parents=True, exist_ok=True)
    work = [
        [*recipe, "-o", f"out/{name}", "--jobs", "1" if name == "driven" else str(jobs), "-q"]
        for name, recipe in recipes(pool, turn).items()
    ]
    plain = {name: value for name, value in os.environ.items() if not name.startswith(("LC_", "LANG", "TZ"))}
    done = subprocess.run(
        [sys.executable, "-c", ALL], input=json.dumps(work), cwd=folder, umask=umask, text=True,
        env=plain | {"PYTHONPATH": str(ROOT)} | more, capture_output=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return folder / "out"


def another_locale() -> str:
    """A locale with a decimal comma if the machine has one, else one with other letters."""
    before = locale.setlocale(locale.LC_ALL)
    for name in ("de_DE.UTF-8", "fr_FR.UTF-8", "tr_TR.UTF-8", "C.UTF-8"):
        try:
            locale.setlocale(locale.LC_ALL, name)
        except locale.Error:
            continue
        finally:
            locale.setlocale(locale.LC_ALL, before)
        return name
    return "C"


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All results, made beside the pool, on one process."""
    place = tmp_path_factory.mktemp("first")
    make_pool(place / "pool")
    quiet = {"LC_ALL": "C", "TZ": "UTC", "PYTHONHASHSEED": "0", "OPENBLAS_NUM_THREADS": "1"}
    return made_in(place, "pool", 1, 1, 0o022, quiet)


@pytest.fixture(scope="module")
def second(first: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same from another folder, touched, the other way round, on two processes, in another land."""
    place = tmp_path_factory.mktemp("second") / "far" / "away"
    place.mkdir(parents=True)
    shutil.copytree(first.parent / "pool", place.parent / "pool", copy_function=shutil.copyfile)
    for path in (place.parent / "pool").rglob("*"):
        os.utime(path, (10**9, 10**9))
    land = {
        "LC_ALL": another_locale(), "TZ": "Pacific/Kiritimati", "PYTHONHASHSEED": "4242", "OPENBLAS_NUM_THREADS": "1",
    }  # fmt: skip
    return made_in(place, "../pool", -1, 2, 0o077, land)


@pytest.mark.parametrize("name", NAMES)
def test_same_bytes_elsewhere(first: Path, second: Path, name: str) -> None:
    one, other = content(first / name), content(second / name)
    assert len(one) > 3
    assert [file for file in one if one[file] != other.get(file)] == []
    assert one.keys() == other.keys()
    for place in (first.parent, second.parent.parent):
        assert [file for file, data in one.items() if str(place).encode() in data] == []


def test_nothing_holds_a_date(first: Path) -> None:
    words = (b"tIME", b"Creation Time", b"CreationDate", b"dc:date", b"Software", b"creation_date")
    files = [path for path in first.rglob("*") if path.suffix in (".png", ".svg", ".pdf", ".parquet")]
    assert {path.suffix for path in files} >= {".png", ".parquet"}
    assert [path.name for path in files if any(word in path.read_bytes() for word in words)] == []
