"""Every log format before the one judge of `reader_contract`."""

import os
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from reader_contract import RECORDERS, SUFFIXES, WRITERS, judge_bad_files, judge_good_file, refusal

from automarine_cli.dofs import YAW
from automarine_cli.errors import LogError
from automarine_cli.logs import LogFile, find_logs, read_log
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


def test_a_workbook_is_read_as_its_text_would_be(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Unnamed index, dates, empty cells, truth values; without its library the extra is told."""
    pytest.importorskip("openpyxl")
    stamps = pd.date_range("2026-05-03 14:00:00", periods=30, freq="100ms")
    sheet = pd.DataFrame({"time": stamps, "heading_deg": np.arange(30.0), "tau": 0.5, "on": True})
    sheet.loc[7, "heading_deg"] = np.nan
    book, text = tmp_path / "log.xlsx", tmp_path / "log.csv"
    sheet.to_excel(book)
    sheet.to_csv(text)
    tables = [read_log(LogFile(path, path.name, True), dof=YAW) for path in (book, text)]
    for quantity in ("time", "heading", "moment"):
        np.testing.assert_allclose(*(table.columns[quantity] for table in tables), atol=1e-6)
    assert np.flatnonzero(np.isnan(tables[0].columns["heading"])).tolist() == [7]
    monkeypatch.setitem(sys.modules, "openpyxl", None)
    assert refusal(LogFile(book, "log.xlsx", True)).endswith("say pip install 'automarine[excel]'")


def test_files_of_other_programs_are_told_how_to_be_saved(tmp_path: Path) -> None:
    (tmp_path / "run.mat").write_bytes(b"MATLAB 5.0 MAT-file")
    for place in (tmp_path, tmp_path / "run.mat"):
        with pytest.raises(LogError, match=r"\.xlsx; in MATLAB save a table with writetable\(T, 'log\.csv'\)$"):
            find_logs([place])
