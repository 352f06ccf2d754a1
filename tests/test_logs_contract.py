"""Every log format before the one judge of `reader_contract`."""

import random
from pathlib import Path

import pytest
from reader_contract import SUFFIXES, WRITERS, YAW, judge_bad_files, judge_good_file, log

from automarine_cli.errors import AutomarineError
from automarine_cli.logs import read_log, require_yaw
from automarine_cli.logs.formats import format_of, formats, stem_of


def test_formats_are_found_by_themselves() -> None:
    assert {form.name for form in formats()} >= {"CSV", "Parquet"}
    assert format_of("a/B.CSV.GZ").name == "CSV"  # type: ignore[union-attr]
    assert format_of("notes.txt") is None
    assert stem_of("run.1.csv.gz") == "run.1"


def test_each_format_has_a_writer_to_be_judged_with() -> None:
    assert set(SUFFIXES) == set(WRITERS), "add a writer for the new format to tests/reader_contract.py"


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_good_file(tmp_path: Path, suffix: str) -> None:
    judge_good_file(tmp_path, suffix)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_bad_files(tmp_path: Path, suffix: str) -> None:
    judge_bad_files(tmp_path, suffix)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_damaged_bytes_give_an_answer_or_one_clear_line(tmp_path: Path, suffix: str) -> None:
    good, rng = WRITERS[suffix](YAW), random.Random(suffix)
    outcomes = set()
    for _ in range(150):
        content = bytearray(good)
        for _ in range(rng.choice([1, 1, 4])):
            place = rng.randrange(len(content))
            if rng.random() < 0.6:
                content[place] = rng.randrange(256)
            else:
                content[place : place + rng.choice([1, 30])] = rng.choice(
                    [b"", b'"', b"\n", b"\xff,", b"1e999"]
                )
        try:
            require_yaw(read_log(log(tmp_path, bytes(content), f"damaged{suffix}")))
            outcomes.add("read")
        except AutomarineError as error:
            assert str(error).isprintable() and str(error).startswith("damaged")
            outcomes.add("refused")
    assert "refused" in outcomes
