"""Every log format before the one judge of `reader_contract`."""

import gzip
import os
import random
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from reader_contract import GOOD, RECORDERS, SUFFIXES, WRITERS, judge_bad_files, judge_good_file, log, refusal

from automarine_cli.dofs import YAW
from automarine_cli.errors import AutomarineError
from automarine_cli.logs import LogFile, read_log, require_motion
from automarine_cli.logs.find import FORMATS, format_of, stem_of


def test_formats_are_found_by_themselves() -> None:
    assert {form.name for form in FORMATS} >= {"CSV", "Parquet"}
    assert format_of("a/B.CSV.GZ").name == "CSV"  # type: ignore[union-attr]
    assert format_of("notes.txt") is None
    assert stem_of("run.1.csv.gz") == "run.1"


def test_each_format_has_a_writer_to_be_judged_with() -> None:
    assert set(SUFFIXES) == {*WRITERS, *(suffix.removeprefix(".json") for suffix in RECORDERS)}, (
        "add a writer for the new format to tests/helpers/reader_contract.py"
    )


@pytest.mark.parametrize("suffix", WRITERS)
def test_good_file(tmp_path: Path, suffix: str) -> None:
    judge_good_file(tmp_path, suffix)


@pytest.mark.parametrize("suffix", WRITERS)
def test_bad_files(tmp_path: Path, suffix: str) -> None:
    judge_bad_files(tmp_path, suffix)


@pytest.mark.parametrize("suffix", WRITERS)
def test_damaged_bytes_give_an_answer_or_one_clear_line(tmp_path: Path, suffix: str) -> None:
    good, rng = WRITERS[suffix](GOOD), random.Random(suffix)
    outcomes = set()
    for _ in range(150):
        content = bytearray(good)
        for _ in range(rng.choice([1, 1, 4])):
            place = rng.randrange(len(content))
            if rng.random() < 0.6:
                content[place] = rng.randrange(256)
            else:
                content[place : place + rng.choice([1, 30])] = rng.choice([b"", b'"', b"\n", b"\xff,", b"1e999"])
        try:
            require_motion(read_log(log(tmp_path, bytes(content), f"damaged{suffix}"), dof=YAW))
            outcomes.add("read")
        except AutomarineError as error:
            assert str(error).isprintable() and str(error).startswith("damaged")
            outcomes.add("refused")
    assert "refused" in outcomes


def test_packed_text_that_is_damaged_or_no_log(tmp_path: Path) -> None:
    good = WRITERS[".csv.gz"](GOOD)
    cut = refusal(log(tmp_path, good[:-20], "cut.csv.gz"))
    assert cut == "cut.csv.gz: the gzip data ends too early; the file was cut short, copy it again"
    plain = refusal(log(tmp_path, WRITERS[".csv"](GOOD), "plain.csv.gz"))
    assert plain == (
        "plain.csv.gz: found no gzip data, expected some from its extension; drop .gz from the name if it is plain text"
    )
    torn = refusal(log(tmp_path, good[:60] + bytes(20) + good[80:], "torn.csv.gz"))
    assert torn == "torn.csv.gz: the gzip data is damaged inside; copy the file again"
    bomb = refusal(log(tmp_path, gzip.compress(bytes(70 << 20), 6), "bomb.csv.gz"))
    assert bomb == "bomb.csv.gz: unpacks to more than 100 times its size, which no log does; check its content"


def test_parquet_that_was_cut_short(tmp_path: Path) -> None:
    sentence = refusal(log(tmp_path, WRITERS[".parquet"](GOOD)[:-20], "cut.parquet"))
    assert sentence == "cut.parquet: the Parquet data ends too early; the file was cut short, copy it again"


def test_a_parquet_file_that_would_fill_the_memory(tmp_path: Path) -> None:
    """Few bytes may stand for many rows, or for a long word in every row."""
    rows = 3_000_000
    word = pa.DictionaryArray.from_arrays(pa.array(np.zeros(200_000, np.int32)), pa.array(["x" * 1_000_000]))
    for columns in ({"time_s": np.zeros(rows), "tau": np.zeros(rows), "n": np.zeros(rows)}, {"run": word}):
        pq.write_table(pa.table(columns), tmp_path / "bomb.parquet")
        assert refusal(LogFile(tmp_path / "bomb.parquet", "bomb.parquet", True)) == (
            "bomb.parquet: unpacks to more than 100 times its size, which no log does; check its content"
        )


def test_what_is_no_regular_file_does_not_hang(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.csv")
    assert refusal(LogFile(tmp_path / "pipe.csv", "pipe.csv", True)) == (
        "pipe.csv: not a regular file; expected a CSV file. Rename it, or leave it out"
    )


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may read everything")
@pytest.mark.parametrize("suffix", WRITERS)
def test_a_file_that_may_not_be_read(tmp_path: Path, suffix: str) -> None:
    file = log(tmp_path, WRITERS[suffix](GOOD), f"secret{suffix}")
    file.path.chmod(0)
    assert refusal(file) == (
        f"secret{suffix}: cannot be opened (Permission denied); check that it exists and that you may read it"
    )
