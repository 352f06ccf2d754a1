"""Broken logs before every command: refused by name, set aside in a folder, refused under `--strict`; never a
traceback, never in silence.

The sentences are in broken_logs/expected.toml.
"""

import json
import os
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from broken_logs.make import HERE, ODD_NAMES, csv_of, good_table, make
from click.testing import Result
from made_sequences import model_file
from repository import ROOT

from automarine_cli.logs.find import ENDINGS as endings

Command = Callable[..., Result]

EXPECTED: dict[str, dict[str, Any]] = tomllib.loads((HERE / "expected.toml").read_text(encoding="utf-8"))
REFUSED, DOES_NOT_SERVE = EXPECTED["refused"], EXPECTED["does_not_serve"]
ONE_OF_MANY, NOTED, NO_HALF_TURN = (EXPECTED[key] for key in ("one_run_does_not_serve", "noted", "no_half_turn"))
YAW_COMMANDS = ("check", "fit-yaw")  # the others load their runs as fit-yaw does
# What is wrong with a yaw log only: a thruster test needs other columns.
YAW_ONLY = {
    "clock_backwards.csv", "missing_column.csv", "other_name.csv", "twenty_thousand_columns_no_tau.csv",
}  # fmt: skip
MOMENTS = (-1.2, -0.8, -0.3, 0.3, 0.8, 1.2)


@pytest.fixture(scope="module")
def broken(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All broken logs in one folder."""
    return make(tmp_path_factory.mktemp("made") / "broken")


@pytest.fixture(scope="module")
def campaign(broken: Path) -> Path:
    """The broken logs among good ones."""
    for seed, moment in enumerate(MOMENTS):
        path = broken / "good" / f"tau_{moment:+}.csv"
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(csv_of(good_table(moment, seed)))
    return broken


@pytest.fixture(scope="module")
def options(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[object]]:
    """What each command needs beside its logs."""
    model = model_file(tmp_path_factory.mktemp("model") / "yaw_model.json")
    return {"validate": ["--model", model], "diagnose": ["--model", model]}


def named(file: str, why: str) -> str:
    """The sentence with the file's name in front."""
    return f"{file}{', ' if why.startswith('row ') else ': '}{why}"


def stem(file: str) -> str:
    """The name of the run that is alone in a file."""
    return file.rsplit("/", 1)[-1].split(".")[0]


def is_refusal(result: Result, sentence: str) -> None:
    """Exit status 1, the sentence on standard error, nothing else anywhere."""
    assert (result.exit_code, result.stderr, result.stdout) == (1, f"Error: {sentence}\n", "")
    assert isinstance(result.exception, SystemExit)


def everything_set_aside(folder: str) -> list[dict[str, str]]:
    """What the result file has to list for the broken logs, in the order of their names."""
    whole = {file: {stem(file): why} for file, why in (REFUSED | DOES_NOT_SERVE).items()}
    return [
        {"file": f"{folder}/{file}", "run": run, "why": why}
        for file, runs in sorted((whole | ONE_OF_MANY).items())
        for run, why in runs.items()
    ]


def test_every_broken_log_has_its_sentence(broken: Path) -> None:
    files = {path.relative_to(broken).as_posix() for path in broken.rglob("*.*") if "good" not in path.parts}
    odd = {*ODD_NAMES, "directory.csv", "never_moves.csv", "twenty_thousand_columns.csv"}
    assert files == {*REFUSED, *DOES_NOT_SERVE, *ONE_OF_MANY, *NOTED, *odd}
    for why in (REFUSED | DOES_NOT_SERVE).values():
        assert why.isprintable() and len(why) < 500


# Named on the command line


@pytest.mark.parametrize("command", YAW_COMMANDS)
@pytest.mark.parametrize("file", REFUSED)
def test_named_it_is_refused(
    run: Command, broken: Path, options: dict[str, list[object]], command: str, file: str
) -> None:
    found = run(command, *options.get(command, ()), broken / file)
    is_refusal(found, named(file, REFUSED[file]))


@pytest.mark.parametrize("file", [file for file in REFUSED if file not in YAW_ONLY])
def test_named_as_a_thruster_test_it_is_refused(run: Command, broken: Path, file: str) -> None:
    is_refusal(run("fit-thrusters", broken / file), named(file, REFUSED[file]))


@pytest.mark.parametrize("command", YAW_COMMANDS)
@pytest.mark.parametrize("file", DOES_NOT_SERVE)
def test_named_alone_no_run_is_left(
    run: Command, broken: Path, options: dict[str, list[object]], command: str, file: str
) -> None:
    found = run(command, *options.get(command, ()), broken / file)
    is_refusal(found, f"no usable run in 1 log: {named(file, DOES_NOT_SERVE[file])}")


def test_a_directory_with_a_logs_name(run: Command, broken: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(broken)  # a long path would be cut short in the sentence
    is_refusal(
        run("check", "directory.csv"), f"'directory.csv': no logs in this directory; give files that end in {endings}"
    )


# Found in a folder


@pytest.mark.parametrize(
    "command", ("check", *(pytest.param(n, marks=pytest.mark.slow) for n in ("fit-yaw", "validate")))
)
def test_found_it_is_set_aside_and_the_rest_goes_on(
    run: Command, campaign: Path, options: dict[str, list[object]], command: str
) -> None:
    found = run(command, *options.get(command, ()), campaign, "--json")
    assert found.exit_code == 0, found.stderr
    expected = everything_set_aside("broken")
    if command == "fit-yaw":
        expected += [
            {"file": f"broken/{file.split('.')[0]}.csv", "run": file, "why": why} for file, why in NO_HALF_TURN.items()
        ]
    runs = json.loads(found.stdout)["runs"]
    assert runs["set_aside"] == expected
    lines = found.stderr.splitlines()
    assert lines[0] == f"Set aside: {len(expected)} runs"
    assert lines[1] == f"  broken/absurd_headings.csv, run absurd_headings: {expected[0]['why']}"
    told = list(dict.fromkeys(one["why"] for one in expected))[:8]  # each once, for all that share it
    left = sum(one["why"] not in told for one in expected)
    assert lines[-1] == f"  and {left} more (-v lists all)" and len(lines) == 10
    unmoved = ("never_moves", "hour_long_gap.1", "hour_long_gap.2")
    good = len(MOMENTS) + len(ODD_NAMES) + len(["same_name", "same_name_too", "twenty_thousand_columns", "2 whole"])
    assert runs["used"] == good + 1 + (0 if command == "fit-yaw" else len(unmoved))


def test_what_is_noted(run: Command, campaign: Path) -> None:
    seen = {one["run"]: one for one in json.loads(run("check", campaign, "--json").stdout)["yaw_runs"]}
    for notes in NOTED.values():
        for name, note in notes.items():
            assert note in seen[name]["notes"]
    assert len(seen["twenty_thousand_columns"]["columns"]) == 20_000
    for name, why in NO_HALF_TURN.items():
        assert seen[name]["why"] == why


@pytest.mark.slow
def test_a_few_broken_ones_do_not_stop_a_diagnosis(
    run: Command, campaign: Path, options: dict[str, list[object]], tmp_path: Path
) -> None:
    files = ("truncated.parquet", "text_in_a_number.csv", "stuck_compass.csv", "dangling_link.csv")
    shutil.copytree(campaign / "good", tmp_path / "some" / "good")
    for file in files:
        shutil.copy(campaign / file, tmp_path / "some" / file, follow_symlinks=False)
    out = tmp_path / "out"
    found = run("diagnose", *options["diagnose"], tmp_path / "some", "-o", out)
    assert found.exit_code == 0, found.stderr
    listed = json.loads((out / "diagnosis.json").read_text())["runs"]["set_aside"]
    assert listed == [
        {"file": f"some/{file}", "run": stem(file), "why": (REFUSED | DOES_NOT_SERVE)[file]} for file in sorted(files)
    ]
    inputs = [one["file"] for one in json.loads((out / "manifest.json").read_text())["inputs"]]
    assert "some/truncated.parquet" in inputs and "some/dangling_link.csv" not in inputs


def test_thruster_tests_go_on_as_well(run: Command, broken: Path, tmp_path: Path) -> None:
    folder = tmp_path / "broken"
    shutil.copytree(broken, folder, symlinks=True)
    levels = [-80, -60, -40, -20, 20, 40, 60, 80]
    rows = "".join(f"{n},{0.001 * n * abs(n)}\n" for n in levels for _ in range(3))
    (folder / "bollard.csv").write_text("n,force_N\n" + rows)
    found = run("fit-thrusters", folder, "--json")
    assert found.exit_code == 0, found.stderr
    runs = json.loads(found.stdout)["runs"]
    listed = {one["file"]: one["why"] for one in runs["set_aside"]}
    assert runs["used"] == 1
    for file in (file for file in REFUSED if file not in YAW_ONLY):
        assert listed[f"broken/{file}"] == REFUSED[file]
    assert listed["broken/stuck_compass.csv"].startswith("no control signal and force; found the columns time_s")


# Strict, and nothing left


@pytest.mark.parametrize("file", [next(iter(some)) for some in (REFUSED, DOES_NOT_SERVE, ONE_OF_MANY)])
def test_strict_refuses_it(run: Command, broken: Path, tmp_path: Path, file: str) -> None:
    folder = tmp_path / "some"
    folder.mkdir()
    shutil.copy(broken / file, folder / file, follow_symlinks=False)
    (folder / "a_good_one.csv").write_bytes(csv_of(good_table()))
    ((run_name, why),) = ONE_OF_MANY.get(file, {stem(file): (REFUSED | DOES_NOT_SERVE).get(file)}).items()
    sentence = f"some/{file}, run {run_name!r}: {why} (refused because of --strict)"
    is_refusal(run("check", folder, "--strict"), sentence)
    assert run("check", folder).exit_code == 0


@pytest.mark.parametrize("command", ("fit-yaw", "validate", "diagnose", "fit-thrusters"))
def test_strict_refuses_with_every_command(
    run: Command, broken: Path, options: dict[str, list[object]], tmp_path: Path, command: str
) -> None:
    (tmp_path / "some").mkdir()
    for name, content in (("good.csv", csv_of(good_table())), ("bad.csv", (broken / "infinity.csv").read_bytes())):
        (tmp_path / "some" / name).write_bytes(content)
    found = run(command, *options.get(command, ()), tmp_path / "some", "--strict")
    why = REFUSED["infinity.csv"]
    is_refusal(found, f"some/bad.csv, run 'bad': {why} (refused because of --strict)")


def test_nothing_left_says_why(run: Command, broken: Path, tmp_path: Path) -> None:
    different = sorted({why: file for file, why in sorted(REFUSED.items(), reverse=True)}.values())[:7]
    for file in different:
        shutil.copy(broken / file, tmp_path / file)
    reasons = "; ".join(
        named(f"{tmp_path.name}/{file}", REFUSED[file]).replace(", row", ": row") for file in different[:3]
    )
    is_refusal(run("fit-yaw", tmp_path), f"no usable run in 7 logs: {reasons}; and 4 more")


def test_what_is_wrong_with_many_is_said_once(run: Command, broken: Path, tmp_path: Path) -> None:
    for name in ("a", "b", "c"):
        shutil.copy(broken / "header_only.csv", tmp_path / f"{name}.csv")
    why = named(f"{tmp_path.name}/a.csv and 2 more", REFUSED["header_only.csv"])
    is_refusal(run("fit-yaw", tmp_path), f"no usable run in 3 logs: {why}")


def test_too_few_left_says_what_was_set_aside(
    run: Command, broken: Path, options: dict[str, list[object]], tmp_path: Path
) -> None:
    for file in ("infinity.csv", "stuck_compass.csv"):
        shutil.copy(broken / file, tmp_path / file)
    (tmp_path / "level.csv").write_text("n,force_N\n5,0.1\n")
    (tmp_path / "good.csv").write_bytes(csv_of(good_table()))
    for command, first in (("diagnose", "infinity"), ("fit-thrusters", "good")):
        found = run(command, *options.get(command, ()), tmp_path)
        assert found.exit_code == 1
        beginning = f"(3 runs were set aside before, the first: {tmp_path.name}/{first}.csv, run '{first}': "
        assert beginning in found.stderr
    (tmp_path / "good.csv").write_bytes(csv_of(good_table().head(25)))  # a step that is cut off
    found = run("fit-yaw", tmp_path, "--fit-to", "half-turns")
    why = f"{tmp_path.name}/infinity.csv, run 'infinity': {REFUSED['infinity.csv']}"
    assert found.exit_code == 1 and f"set aside before, the first: {why})" in found.stderr


# What may not be read, and names that are traps


def test_a_file_that_may_not_be_read(run: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    secret = tmp_path / "some" / "secret.csv"
    secret.parent.mkdir()
    for name in ("secret.csv", "good.csv"):
        (secret.parent / name).write_bytes(csv_of(good_table()))
    secret.chmod(0)
    if os.geteuid() == 0:  # the superuser may read everything: the opener refuses instead
        opened, allowed = Path.open, os.access
        monkeypatch.setattr(Path, "open", lambda path, *a, **k: refuse_secret(path) or opened(path, *a, **k))
        monkeypatch.setattr(os, "access", lambda path, mode: Path(path).name != "secret.csv" and allowed(path, mode))
    why = "cannot be opened (Permission denied); check that it exists and that you may read it"
    is_refusal(run("fit-yaw", secret), f"secret.csv: {why}")
    found = run("validate", secret.parent, "--model", model_file(tmp_path / "m.json"), "-o", tmp_path / "out")
    assert found.exit_code == 0, found.stderr
    aside = json.loads((tmp_path / "out" / "validation.json").read_text())["runs"]["set_aside"]
    assert aside == [{"file": "some/secret.csv", "run": "secret", "why": why}]


def refuse_secret(path: Path) -> None:
    """What the system says to a file that may not be read."""
    if path.name == "secret.csv":
        raise PermissionError(13, "Permission denied", str(path))


def test_a_directory_that_may_not_be_listed(run: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "closed").mkdir()
    (tmp_path / "good.csv").write_bytes(csv_of(good_table()))
    scandir = os.scandir

    def refusing(path: Any) -> Any:
        if str(path).endswith("closed"):
            raise PermissionError(13, "Permission denied", str(path))
        return scandir(path)

    monkeypatch.setattr(os, "scandir", refusing)
    found = run("check", tmp_path)
    assert found.exit_code == 1 and "the directory cannot be listed (Permission denied)" in found.stderr


@pytest.mark.parametrize("name", ODD_NAMES, ids=ascii)
def test_an_odd_name_is_only_a_name(run: Command, broken: Path, name: str) -> None:
    found = run("check", "--json", "--", broken / name)
    assert found.exit_code == 0, found.stderr
    (seen,) = json.loads(found.stdout)["yaw_runs"]
    assert seen["file"].isprintable()
    assert seen["file"] == name.replace("\n", "\\n").replace("\x1b", "\\x1b")


@pytest.mark.slow
def test_odd_names_on_a_real_command_line(broken: Path, tmp_path: Path) -> None:
    """In a process of its own, from the folder of the logs, with results written."""
    model = model_file(tmp_path / "yaw_model.json")
    arguments = ["validate", "--model", str(model), "-o", str(tmp_path / "out"), "--", *ODD_NAMES[:4]]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "LC_ALL": "C"}
    found = subprocess.run(
        [sys.executable, "-m", "automarine_cli", *arguments],
        cwd=broken, env=environment, capture_output=True, text=True, encoding="utf-8", check=False,
    )  # fmt: skip
    assert found.returncode == 0, found.stderr
    assert found.stderr == "" and "\x1b" not in found.stdout and not (broken / "x").exists()
    assert len(list((tmp_path / "out").glob("validation_*.png"))) == 4
    data = json.loads((tmp_path / "out" / "validation.json").read_text(encoding="utf-8"))
    assert data["runs"] == {"used": 4, "set_aside": []}
