"""Tables: any text keeps their shape; digits of numbers and intervals. Their forms are in `tests/golden`, what escapes
names in `test_report_page`."""

import csv
import io
import re
import shutil
import string
import subprocess
from functools import partial
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from repository import SAMPLE_RUNS

from automarine_cli.commands.fit_motion import fit_surge, fit_yaw
from automarine_cli.commands.validate import validate
from automarine_cli.estimate import Estimate
from automarine_cli.report.tables import MISSING, Table, interval, number

Interval = partial(Estimate, unit="")
AWKWARD = Table(
    "Table_1: 50 % & more",
    ("run", "k_rr", "why"),
    (
        ("a|b_c, d", "-1.257", 'says "no" <here>'),
        ("C:\\logs\\#1", "1.5e-7", "{~^} ψ 10 $"),
        ("mean", MISSING, "two\nlines"),
    ),
    rules=(2,),
    notes=("r² in rad/s ± 5 %",),
)


def test_csv_is_read_back_by_any_program() -> None:
    assert list(csv.reader(io.StringIO(AWKWARD.to_csv()))) == [
        ["run", "k_rr", "why"], ["a|b_c, d", "-1.257", 'says "no" <here>'], ["C:\\logs\\#1", "1.5e-7", "{~^} ψ 10 $"],
        ["mean", "", "two\nlines"],
    ]  # fmt: skip


def latex_files(folder: Path) -> dict[str, str]:
    """The LaTeX that commands write for models of yaw and surge, and for a table of awkward cells."""
    fit_yaw([SAMPLE_RUNS / "steps"], out=folder / "yaw", figure_formats=())
    fit_surge([SAMPLE_RUNS / "surge"], within=3.0, out=folder / "surge", figure_formats=())
    validate([SAMPLE_RUNS / "validation"], model=folder / "yaw" / "yaw_model.json", out=folder / "v", figure_formats=())
    texts = {path.relative_to(folder).as_posix(): path.read_text(encoding="utf-8") for path in folder.rglob("*.tex")}
    return texts | {"awkward": AWKWARD.to_latex()}


def test_latex_compiles_as_it_is(tmp_path: Path) -> None:
    """Nothing that LaTeX would refuse, by rules that need no LaTeX; and compiled where there is one."""
    texts = latex_files(tmp_path)
    for name, text in texts.items():
        labels = re.findall(r"\\label\{(.*?)\}", text)
        tables = text.split(r"\begin{table}")[1:]
        assert len(labels) == len(set(labels)) == len(tables) > 0, name
        assert all(table.count(r"\caption{") == 1 and r"\caption{Table " not in table for table in tables), name
        rows = [row for table in tables for row in re.findall(r".* & .*", table)]
        assert rows and all(row.endswith(r" \\") for row in rows), name
        plain = re.sub(r"\$[^$]*\$|\\[%&#_{}$]|\\[a-z]+|\\(?:label|begin|end)\{.*?\}", "", text.replace(r"\\", ""))
        assert not re.search(r"[$#%_^~<>|\"\\]", plain), (name, plain)
        assert set(text) - set(string.printable) <= set("“”’…"), name
    if (latex := shutil.which("pdflatex")) is None:
        pytest.skip("no LaTeX is installed (Debian: apt-get install texlive-latex-recommended)")
    body = "\n".join(texts.values())
    head = r"\documentclass{article}\usepackage[T1]{fontenc}\usepackage{booktabs}\begin{document}"
    (tmp_path / "all.tex").write_text(f"{head}\n{body}\n\\end{{document}}\n", encoding="utf-8")
    command = [latex, "-interaction=nonstopmode", "-halt-on-error", "all.tex"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-2000:]


@given(st.lists(st.tuples(st.text(max_size=9), st.text(max_size=9)), max_size=4))
def test_any_text_keeps_the_shape(rows: list[tuple[str, str]]) -> None:
    table = Table("T", ("a", "b"), tuple(rows))
    assert len(table.to_markdown().split("\n")[4:]) == len(rows) + 1  # each row one line
    latex = table.to_latex()
    assert latex.count(r" \\" + "\n") == len(rows) + 1
    unescaped = latex.replace(r"\&", "").replace(r"\%", "")
    assert unescaped.count("&") == len(rows) + 1 and "%" not in unescaped


@pytest.mark.parametrize(
    ("x", "text"),
    [
        (1.2573, "1.257"), (0.027531, "0.02753"), (-12.345, "-12.35"), (-0.0, "0"), (9.9999, "10.00"),
        (99999.6, "100000"), (1.23456e-7, "1.235e-7"), (2.5e9, "2.500e9"), (None, "–"), (float("nan"), "–"),
        (float("inf"), "–"), (0.99996, "1.000"),
    ],
)  # fmt: skip
def test_number_has_four_digits(x: float | None, text: str) -> None:
    assert number(x) == text


@given(st.floats(allow_nan=False, allow_infinity=False, min_value=-1e300, max_value=1e300))
def test_number_is_right_to_its_digits(x: float) -> None:
    assert float(number(x)) == pytest.approx(x, rel=5.1e-4, abs=1e-307)


@pytest.mark.parametrize(
    ("estimate", "text"),
    [
        (Interval(1.2573, 0.0085, (1.2403, 1.2743)), "1.2573 [1.2403, 1.2743]"),
        (Interval(-0.5, 0.12, (-0.74, -0.26)), "-0.50 [-0.74, -0.26]"),
        (Interval(123.4, 25.0, (74.4, 172.4)), "123 [74, 172]"),
        (Interval(1e-9, 2e-10, (6e-10, 1.4e-9)), "1.000e-9 [6.000e-10, 1.400e-9]"),
        (Interval(1.5, 0.0, (1.5, 1.5)), "1.500"),
        (Interval(1.5, float("nan"), (float("nan"), float("nan"))), "1.500"),
        (None, "–"),
    ],
)
def test_interval_shows_the_digits_that_count(estimate: Estimate | None, text: str) -> None:
    assert interval(estimate) == text


def test_rows_and_columns_that_hold_nothing_are_left_out() -> None:
    table = Table("", ("Model", "1", "2"), (("a", "–", "–"), ("b", "1", "–"), ("c", "–", "–"), ("d", "2", "–")), (1, 3))
    rows = table.without_empty_rows()
    assert [row[0] for row in rows.rows] == ["b", "d"] and rows.rules == (0, 1)
    columns = rows.without_empty_columns()
    assert columns.header == ("Model", "1") and columns.rows == (("b", "1"), ("d", "2"))
