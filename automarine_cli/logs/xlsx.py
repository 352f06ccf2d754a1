"""Excel workbooks, read by openpyxl: the first sheet, whose first row names the columns, as a table of text."""

import csv
import io
import zipfile
from datetime import datetime
from pathlib import Path

from automarine_cli.logs import formats
from automarine_cli.logs.columns import ColumnMap
from automarine_cli.logs.csv import read_text
from automarine_cli.logs.formats import Format, RawLog
from automarine_cli.logs.streams import needed, unsound_is_refused

ZIP = b"PK\x03\x04"


def read(path: Path, name: str, columns: ColumnMap) -> RawLog:
    """Read the first sheet of a workbook; formulas count as their last values. Raises LogError as for a CSV file."""
    library, text = needed("openpyxl", "excel", name, "Excel files"), io.StringIO()
    with unsound_is_refused(name, "Excel"):
        with zipfile.ZipFile(path) as parts:
            if sum(part.file_size for part in parts.infolist()) > formats.most_unpacked(path):
                raise formats.too_well_packed(name)
        book = library.load_workbook(path, read_only=True, data_only=True)
        writer = csv.writer(text, delimiter="\t", lineterminator="\n")
        for row in book.worksheets[0].iter_rows(values_only=True):
            writer.writerow([_cell(value) for value in row] if any(value is not None for value in row) else [])
        book.close()
    return read_text(text.getvalue().encode(), name, columns)


def _cell(value: object) -> str:
    if value is None or isinstance(value, bool):
        return "" if value is None else str(int(value))
    return value.isoformat() if isinstance(value, datetime) else " ".join(str(value).split())


FORMAT = Format("Excel", (".xlsx",), read, begins=(ZIP,))
