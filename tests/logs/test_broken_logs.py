"""Broken logs before every command: refused by name, set aside in a folder, refused under `--strict`; never a
traceback, never in silence.

What has to be said of each is in broken_logs/expected.toml.
"""

import json
import os
import re
import shutil
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from broken_logs.make import HERE, ODD_NAMES, csv_of, good_table, make
from click.testing import Result
from made_sequences import model_file

Command = Callable[..., Result]

EXPECTED: dict[str, dict[str, Any]] = tomllib.loads((HERE / "expected.toml").read_text(encoding="utf-8"))
REFUSED, DOES_NOT_SERVE = EXPECTED["refused"], EXPECTED["does_not_serve"]
ONE_OF_MANY, NOTED, NO_HALF_TURN = (EXPECTED[key] for key in ("one_run_does_not_serve", "noted", "no_half_turn"))
# What is wrong with a yaw log only: a thruster test needs other columns.
YAW_ONLY = {
    "clock_backwards.csv", "missing_column.csv", "other_name.csv", "twenty_thousand_columns_no_tau.csv",
}  # fmt: skip
MOMENTS = (-1.2, -0.8, -0.3, 0.3, 0.8, 1.2)
WITH_MODEL = ("validate", "diagnose")


@pytest.fixture(scope="module")
def broken(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make(tmp_path_factory.mktemp("made") / "broken")


@pytest.fixture(scope="module")
def campaign(broken: Path) -> Path:
    (broken / "good").mkdir()
    for seed, moment in enumerate(MOMENTS):
        (broken / "good" / f"tau_{moment:+}.csv").write_bytes(csv_of(good_table(moment, seed)))
    return broken


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return model_file(tmp_path_factory.mktemp("model") / "yaw_model.json")


def options(command: str, model: Path) -> list[object]:
    return ["--model", model] if command in WITH_MODEL else []


def says(sentence: str, parts: str) -> bool:
    """Whether these parts stand in the sentence, in this order."""
    return re.search(".*".join(map(re.escape, parts.split("…"))), sentence) is not None


def stem(file: str) -> str:
    return file.rsplit("/", 1)[-1].split(".")[0]


def is_refusal(result: Result, parts: str) -> None:
    """Exit status 1, one line on standard error that says this, nothing else anywhere."""
    assert (result.exit_code, result.stdout, result.stderr.count("\n")) == (1, "", 1)
    assert isinstance(result.exception, SystemExit)
    assert result.stderr.startswith("Error: ") and result.stderr.strip().isprintable()
    assert says(result.stderr, parts), result.stderr


def are_set_aside(listed: list[dict[str, str]], expected: dict[str, dict[str, str]]) -> None:
    """File and run of everything that is listed, in the order of their names, and what is said of each."""
    assert [(row["file"], row["run"]) for row in listed] == [(f, run) for f, runs in expected.items() for run in runs]
    assert [row for row in listed if not says(row["why"], expected[row["file"]][row["run"]])] == []


def everything_set_aside(folder: str) -> dict[str, dict[str, str]]:
    """File, run and reason of what cannot be used of the broken logs."""
    alone = {file: {stem(file): why} for file, why in (REFUSED | DOES_NOT_SERVE).items()}
    return {f"{folder}/{file}": runs for file, runs in sorted((alone | ONE_OF_MANY).items())}


def test_every_broken_log_has_its_sentence(broken: Path) -> None:
    files = {path.relative_to(broken).as_posix() for path in broken.rglob("*.*") if "good" not in path.parts}
    odd = {*ODD_NAMES, "directory.csv", "never_moves.csv", "twenty_thousand_columns.csv"}
    assert files == {*REFUSED, *DOES_NOT_SERVE, *ONE_OF_MANY, *NOTED, *odd}


@pytest.mark.parametrize("file", [*REFUSED, *DOES_NOT_SERVE])
def test_named_it_is_refused(run: Command, broken: Path, file: str) -> None:
    if file in DOES_NOT_SERVE:
        is_refusal(run("check", broken / file), f"no usable run in 1 log: {file}: {DOES_NOT_SERVE[file]}")
        return
    for command in ("check",) if file in YAW_ONLY else ("check", "fit-thrusters"):
        between = ", " if REFUSED[file].startswith("row ") else ": "
        is_refusal(run(command, broken / file), f"Error: {file}{between}{REFUSED[file]}")


@pytest.mark.parametrize(
    "command", ("check", *(pytest.param(n, marks=pytest.mark.slow) for n in ("fit-yaw", "validate")))
)
def test_found_it_is_set_aside_and_the_rest_goes_on(run: Command, campaign: Path, model: Path, command: str) -> None:
    result = run(command, *options(command, model), campaign, "--json")
    assert result.exit_code == 0, result.stderr
    content = json.loads(result.stdout)
    expected = everything_set_aside("broken")
    listed = content["runs"]["set_aside"]
    if command == "fit-yaw":
        unfit = {row["run"]: row["why"] for row in listed[-len(NO_HALF_TURN) :]}
        assert unfit.keys() == NO_HALF_TURN.keys() and all(says(unfit[name], NO_HALF_TURN[name]) for name in unfit)
        listed = listed[: -len(NO_HALF_TURN)]
    are_set_aside(listed, expected)
    assert result.stderr.startswith(f"Set aside: {len(content['runs']['set_aside'])} runs\n")
    good = len(MOMENTS) + len(ODD_NAMES) + len(["same_name", "same_name_too", "twenty_thousand_columns", "2 whole"])
    assert content["runs"]["used"] == good + 1 + (0 if command == "fit-yaw" else len(NO_HALF_TURN))
    if command == "check":
        looked_at = {row["run"]: row for row in content["yaw_runs"]}
        for name, note in ((name, note) for notes in NOTED.values() for name, note in notes.items()):
            assert any(says(line, note) for line in looked_at[name]["notes"]), name
        assert len(looked_at["twenty_thousand_columns"]["columns"]) == 20_000
        assert all(says(looked_at[name]["why"], why) for name, why in NO_HALF_TURN.items())


@pytest.mark.parametrize(
    ("command", "file"),
    [
        *(("check", next(iter(some))) for some in (REFUSED, DOES_NOT_SERVE, ONE_OF_MANY)),
        *((command, "infinity.csv") for command in ("fit-yaw", "diagnose", "fit-thrusters")),
    ],
)
def test_strict_refuses_it(run: Command, broken: Path, model: Path, tmp_path: Path, command: str, file: str) -> None:
    (tmp_path / "some").mkdir()
    shutil.copy(broken / file, tmp_path / "some" / file)
    (tmp_path / "some" / "z_good.csv").write_bytes(csv_of(good_table()))
    ((name, why),) = ONE_OF_MANY.get(file, {stem(file): (REFUSED | DOES_NOT_SERVE).get(file)}).items()
    result = run(command, *options(command, model), tmp_path / "some", "--strict")
    is_refusal(result, f"Error: some/{file}, run '{name}': {why}…(refused because of --strict)")


@pytest.mark.parametrize(("command", "first"), [("diagnose", "infinity"), ("fit-thrusters", "good")])
def test_too_few_left(run: Command, broken: Path, model: Path, tmp_path: Path, command: str, first: str) -> None:
    for file in ("infinity.csv", "stuck_compass.csv"):
        shutil.copy(broken / file, tmp_path / file)
    (tmp_path / "level.csv").write_text("n,force_N\n5,0.1\n")
    (tmp_path / "good.csv").write_bytes(csv_of(good_table()))
    result = run(command, *options(command, model), tmp_path)
    assert result.exit_code == 1
    assert f"set aside before, the first: {tmp_path.name}/{first}.csv, run '{first}': " in result.stderr


def test_a_file_that_may_not_be_read_is_no_input(
    run: Command, broken: Path, model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    secret = tmp_path / "some" / "secret.csv"
    secret.parent.mkdir()
    for name in ("secret.csv", "good.csv"):
        (secret.parent / name).write_bytes(csv_of(good_table()))
    for name in ("dangling_link.csv", "truncated.parquet"):
        shutil.copy(broken / name, secret.parent / name, follow_symlinks=False)
    opened, allowed = Path.open, os.access

    def refusing(path: Path, *how: Any, **more: Any) -> Any:
        if path.name == "secret.csv":
            raise PermissionError(13, "Permission denied", str(path))
        return opened(path, *how, **more)

    monkeypatch.setattr(Path, "open", refusing)  # the superuser may read everything
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path).name != "secret.csv" and allowed(path, mode))
    why = "cannot be opened (Permission denied); check…that you may read it"
    is_refusal(run("fit-yaw", secret), f"Error: secret.csv: {why}")
    result = run("validate", secret.parent, "--model", model, "-o", tmp_path / "out")
    assert result.exit_code == 0, result.stderr
    listed = json.loads((tmp_path / "out" / "validation.json").read_text())["runs"]["set_aside"]
    expected = {name: REFUSED[name] for name in ("dangling_link.csv", "truncated.parquet")} | {"secret.csv": why}
    are_set_aside(listed, {f"some/{name}": {stem(name): expected[name]} for name in sorted(expected)})
    inputs = [row["file"] for row in json.loads((tmp_path / "out" / "manifest.json").read_text())["inputs"]]
    assert "some/truncated.parquet" in inputs and "some/dangling_link.csv" not in inputs


def test_a_directory_that_may_not_be_listed(run: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "closed").mkdir()
    (tmp_path / "good.csv").write_bytes(csv_of(good_table()))
    scandir = os.scandir

    def refusing(path: Any) -> Any:
        if str(path).endswith("closed"):
            raise PermissionError(13, "Permission denied", str(path))
        return scandir(path)

    monkeypatch.setattr(os, "scandir", refusing)
    is_refusal(run("check", tmp_path), "the directory cannot be listed (Permission denied)…make it readable")


def test_odd_names_are_only_names(run: Command, broken: Path) -> None:
    result = run("check", "--json", "--", *(broken / name for name in ODD_NAMES))
    assert result.exit_code == 0, result.stderr
    files = {row["file"] for row in json.loads(result.stdout)["yaw_runs"]}
    assert files == {name.replace("\n", "\\n").replace("\x1b", "\\x1b") for name in ODD_NAMES}
