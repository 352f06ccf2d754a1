"""Every log format before the one judge of `reader_contract`."""

import os
from pathlib import Path

import pytest
from reader_contract import RECORDERS, SUFFIXES, WRITERS, judge_bad_files, judge_good_file, refusal

from automarine_cli.logs import LogFile
from automarine_cli.logs.find import format_of, stem_of


def test_formats_are_found_by_themselves_and_each_has_a_writer_to_be_judged_with() -> None:
    assert format_of("a/B.CSV.GZ").name == "CSV"  # type: ignore[union-attr]
    assert format_of("notes.txt") is None and stem_of("run.1.csv.gz") == "run.1"
    assert set(SUFFIXES) == {*WRITERS, *(suffix.removeprefix(".json") for suffix in RECORDERS)}, (
        "add a writer for the new format to tests/helpers/reader_contract.py"
    )


@pytest.mark.parametrize("suffix", WRITERS)
def test_good_and_bad_files(tmp_path: Path, suffix: str) -> None:
    judge_good_file(tmp_path, suffix)
    judge_bad_files(tmp_path, suffix)


def test_what_is_no_regular_file_does_not_hang(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.csv")
    (tmp_path / "folder.csv").mkdir()
    for name, what in (("pipe", "not a regular file"), ("folder", "a directory"), ("absent", "not a regular file")):
        sentence = refusal(LogFile(tmp_path / f"{name}.csv", f"{name}.csv", True))
        assert sentence.startswith(f"{name}.csv: {what}; ") and "leave it out" in sentence
