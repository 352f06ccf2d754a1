"""Arguments -> logs: order, names that do not depend on where the command runs, what is refused."""

import os
from pathlib import Path

import pytest

from automarine_cli.errors import LogError
from automarine_cli.logs import LogFile, find_logs


@pytest.fixture
def pool(tmp_path: Path) -> Path:
    """A folder of logs with other things among them."""
    touched(
        tmp_path / "pool", "b.csv", "a.csv", "sub/c.parquet", "sub/D.CSV.GZ", "notes.txt", ".hidden.csv", ".git/x.csv"
    )
    (tmp_path / "pool/lost.csv").symlink_to("nowhere")
    (tmp_path / "pool/again").symlink_to(tmp_path / "pool")
    return tmp_path / "pool"


def touched(folder: Path, *names: str) -> None:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()


def names(logs: list[LogFile]) -> list[str]:
    return [log.name for log in logs]


def test_a_directory_is_searched_in_name_order(pool: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    expected = ["pool/a.csv", "pool/b.csv", "pool/lost.csv", "pool/sub/D.CSV.GZ", "pool/sub/c.parquet"]
    logs = find_logs([pool])
    assert names(logs) == expected and not any(log.named for log in logs)
    monkeypatch.chdir(pool)
    assert names(find_logs(["."])) == names(find_logs([f"..{os.sep}pool"])) == expected


def test_a_named_file_goes_by_its_own_name_and_comes_once(pool: Path) -> None:
    logs = find_logs([pool / "sub/c.parquet", str(pool / "a.csv")])
    assert names(logs) == ["a.csv", "c.parquet"] and all(log.named for log in logs)
    logs = find_logs([pool, pool / "a.csv", pool / "sub/../a.csv"])
    assert len(logs) == 5 and [log.named for log in logs if log.path.name == "a.csv"] == [True]


def test_the_order_of_the_arguments_changes_nothing(pool: Path) -> None:
    arguments = [pool / "b.csv", pool, pool / "sub", f"{pool}/*.csv", pool / "sub/c.parquet"]
    assert names(find_logs(arguments)) == [
        "b.csv", "c.parquet", "pool/a.csv", "pool/lost.csv", "pool/sub/D.CSV.GZ"]  # fmt: skip
    assert find_logs(arguments) == find_logs(arguments[::-1]) == find_logs(find_logs(arguments))


def test_globs(pool: Path) -> None:
    for pattern, expected in {
        "*.csv": ["a.csv", "b.csv", "lost.csv"],
        "s*": ["sub/D.CSV.GZ", "sub/c.parquet"],
        "**/*.parquet": ["sub/c.parquet"],
        "**/*": ["a.csv", "b.csv", "lost.csv", "sub/D.CSV.GZ", "sub/c.parquet"],
    }.items():
        logs = find_logs([f"{pool}/{pattern}"])
        assert names(logs) == expected and not any(log.named for log in logs)
    touched(pool, "run[1].csv")  # a name that looks like a glob
    assert find_logs([pool / "run[1].csv"])[0].named


def test_files_of_one_name_get_their_folders_in_front(tmp_path: Path) -> None:
    files = ("x/day/run.csv", "y/day/run.csv", "y/day/other.csv")
    touched(tmp_path, *files)
    logs = find_logs([tmp_path / file for file in files])
    assert names(logs) == ["other.csv", "x/day/run.csv", "y/day/run.csv"]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["notes.txt"], "unknown log format; give a file that ends in "),
        (["no.csv"], "no such file or directory; check the spelling and the folder you are in"),
        (["."], "no logs in this directory; give files that end in "),
        (["*.csv"], "no logs match; give files that end in "),
        ([], "no logs given"),
    ],
)
def test_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], says: str) -> None:
    monkeypatch.chdir(tmp_path)  # a long path would be shortened in the sentence
    touched(tmp_path, "notes.txt")
    with pytest.raises(LogError) as refused:
        find_logs([f"./{argument}" for argument in arguments])
    assert says in str(refused.value) and all(argument in str(refused.value) for argument in arguments)


def test_a_folder_s_files_with_a_shared_ending_are_logs_only_if_they_begin_as_one(tmp_path: Path) -> None:
    for name, content in (("firmware.bin", b"\x7fELF"), ("dive.bin", b"\xa3\x95\x80"), ("empty.bin", b"")):
        (tmp_path / name).write_bytes(content)
    assert names(find_logs([tmp_path])) == [f"{tmp_path.name}/dive.bin", f"{tmp_path.name}/empty.bin"]
    assert names(find_logs([tmp_path / "firmware.bin"])) == ["firmware.bin"]
