"""Arguments -> logs: order, names that do not depend on where the command runs, what is refused."""

import os
from pathlib import Path

import pytest

from automarine_cli.errors import LogError
from automarine_cli.logs import LogFile, find_logs
from automarine_cli.logs.find import ENDINGS as endings


@pytest.fixture
def pool(tmp_path: Path) -> Path:
    """A folder of logs with other things among them."""
    for name in ("b.csv", "a.csv", "sub/c.parquet", "sub/D.CSV.GZ", "notes.txt", ".hidden.csv", ".git/x.csv"):
        path = tmp_path / "pool" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    (tmp_path / "pool/lost.csv").symlink_to("nowhere")
    (tmp_path / "pool/again").symlink_to(tmp_path / "pool")
    return tmp_path / "pool"


def names(logs: list[LogFile]) -> list[str]:
    """What results call them."""
    return [log.name for log in logs]


def test_a_directory_is_searched_in_name_order(pool: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    expected = ["pool/a.csv", "pool/b.csv", "pool/lost.csv", "pool/sub/D.CSV.GZ", "pool/sub/c.parquet"]
    logs = find_logs([pool])
    assert names(logs) == expected and not any(log.named for log in logs)
    monkeypatch.chdir(pool)
    assert names(find_logs(["."])) == names(find_logs([f"..{os.sep}pool"])) == expected


def test_a_named_file_goes_by_its_own_name(pool: Path) -> None:
    logs = find_logs([pool / "sub/c.parquet", str(pool / "a.csv")])
    assert names(logs) == ["a.csv", "c.parquet"] and all(log.named for log in logs)


def test_each_file_once_and_named_wins(pool: Path) -> None:
    logs = find_logs([pool, pool / "a.csv", pool / "sub/../a.csv"])
    assert len(logs) == 5
    assert [log.named for log in logs if log.path.name == "a.csv"] == [True]


def test_the_order_of_the_arguments_changes_nothing(pool: Path) -> None:
    arguments = [pool / "b.csv", pool, pool / "sub", f"{pool}/*.csv", pool / "sub/c.parquet"]
    assert names(find_logs(arguments)) == [
        "b.csv", "c.parquet", "pool/a.csv", "pool/lost.csv", "pool/sub/D.CSV.GZ"]  # fmt: skip
    assert find_logs(arguments) == find_logs(arguments[::-1]) == find_logs(find_logs(arguments))


def test_globs(pool: Path) -> None:
    assert names(find_logs([f"{pool}/*.csv"])) == ["a.csv", "b.csv", "lost.csv"]
    assert names(find_logs([f"{pool}/s*"])) == ["sub/D.CSV.GZ", "sub/c.parquet"]
    assert names(find_logs([f"{pool}/**/*.parquet"])) == ["sub/c.parquet"]
    assert names(find_logs([f"{pool}/**/*"])) == [
        "a.csv", "b.csv", "lost.csv", "sub/D.CSV.GZ", "sub/c.parquet"]  # fmt: skip
    assert not any(log.named for log in find_logs([f"{pool}/*.csv"]))


def test_a_file_whose_name_looks_like_a_glob(tmp_path: Path) -> None:
    (tmp_path / "run[1].csv").touch()
    assert find_logs([tmp_path / "run[1].csv"])[0].named


def test_files_of_one_name_get_their_folders_in_front(tmp_path: Path) -> None:
    for name in ("x/day/run.csv", "y/day/run.csv", "y/day/other.csv"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    logs = find_logs([tmp_path / "x/day/run.csv", tmp_path / "y/day/run.csv", tmp_path / "y/day/other.csv"])
    assert names(logs) == ["other.csv", "x/day/run.csv", "y/day/run.csv"]


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("a\nb.csv", "a\\nb.csv"),
        ('it\'s, "so" $(x) ünï.csv', 'it\'s, "so" $(x) ünï.csv'),
        ("a\x1b[31m.csv", "a\\x1b[31m.csv"),
        (os.fsdecode(b"caf\xe9.csv"), "caf\\xe9.csv"),
    ],
)
def test_odd_names_are_shown_on_one_line(tmp_path: Path, name: str, shown: str) -> None:
    (tmp_path / name).touch()
    assert names(find_logs([tmp_path / name])) == [shown]
    assert names(find_logs([tmp_path])) == [f"{tmp_path.name}/{shown}"]


def test_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # a long path would be shortened in the sentence
    (tmp_path / "notes.txt").touch()
    sentences = {
        "notes.txt": f"'notes.txt': unknown log format; give a file that ends in {endings}",
        "no.csv": "no.csv': no such file or directory; check the spelling and the folder you are in",
        ".": f"': no logs in this directory; give files that end in {endings}",
        "*.csv": f"*.csv': no logs match; give files that end in {endings}",
    }
    for argument, sentence in sentences.items():
        with pytest.raises(LogError) as refused:
            find_logs([f"./{argument}"])
        assert str(refused.value).endswith(sentence)
    with pytest.raises(LogError, match="no logs given"):
        find_logs([])


def test_a_folder_s_files_with_a_shared_ending_are_logs_only_if_they_begin_as_one(tmp_path: Path) -> None:
    (tmp_path / "firmware.bin").write_bytes(b"\x7fELF")
    (tmp_path / "dive.bin").write_bytes(b"\xa3\x95\x80")
    (tmp_path / "empty.bin").touch()
    assert names(find_logs([tmp_path])) == [f"{tmp_path.name}/dive.bin", f"{tmp_path.name}/empty.bin"]
    assert names(find_logs([tmp_path / "firmware.bin"])) == ["firmware.bin"]
