"""What logs call their runs and columns means nothing to LaTeX, Markdown, HTML, terminals or figures: whole
result folders of runs with hostile names.
"""

import json
import re
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest
from broken_logs.make import csv_of, good_table, parquet_of
from click.testing import Result
from few_candidates import few_candidates
from made_sequences import model_file

from automarine_cli.report.figures.style import FORMATS, new_figure
from automarine_cli.text import printable

Command = Callable[..., Result]

HOSTILE = (
    "a|b $x$", "$\\foo_{bar", r"\input{/etc/passwd}%c", "<script>alert(1)</script>", "`rm -rf ~` two\nlines",
    "[5cm] &lt;b&gt;", "* _em_ **strong** ~~gone~~", "![p](http://x/y.png)", "=1+1 {}#&^~ \t\"d\"",
    "\x1b[31mred\x07 Größe_タンク", "../../escape", "<!-- {{7*7}} # heading",
)  # fmt: skip
"""A run column may hold any of these; in Parquet a line feed too."""
pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("drawn_figures")]


def hostile_log(folder: Path) -> Path:
    """One Parquet file whose runs, turning by turns either way, have all these names, and so has a column."""
    moments = (0.3, -0.3, 0.6, -0.6, 1.0, -1.0)
    tables = [good_table(moments[i % len(moments)], seed=i).assign(run=name) for i, name in enumerate(HOSTILE)]
    table = pd.concat(tables, ignore_index=True)
    table["$\\frac{|<b>`_x_\x1b[31m\x07"] = table["time_s"] % 7
    path = folder / "$x$ `|` <b> \\input{a}.parquet"
    path.write_bytes(parquet_of(table))
    return path


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Results of every command that takes yaw logs."""
    from click.testing import CliRunner

    from automarine_cli.commands import automarine

    folder = tmp_path_factory.mktemp("hostile")
    log, model = hostile_log(folder), model_file(folder / "yaw_model.json")
    commands = {
        "fit-yaw": ("fit-yaw", log, "--fit-to", "half-turns"),
        "whole": ("fit-yaw", log, "--fit-to", "whole-runs"),
        "validate": ("validate", log, "--model", model),
        "diagnose": ("diagnose", log, "--model", model),
    }
    made = {}
    for name, arguments in commands.items():
        made[name] = folder / name
        with few_candidates(("dead-band", "bias-moment")):
            found = CliRunner().invoke(automarine, [str(a) for a in (*arguments, "-o", made[name])])
        assert found.exit_code == 0, found.stderr
        for said in (found.stdout, found.stderr):
            assert "\x1b" not in said and "\x07" not in said
    return made


def test_names_are_kept_in_data(folders: dict[str, Path]) -> None:
    shown = {
        name.replace("\n", "\\n").replace("\t", "\\t").replace("\x1b", "\\x1b").replace("\x07", "\\x07")
        for name in HOSTILE
    }
    data = json.loads((folders["validate"] / "validation.json").read_text(encoding="utf-8"))
    assert set(data["logs"]) == shown
    listed = pd.read_csv(folders["validate"] / "validation.csv", keep_default_na=False)
    assert shown <= set(listed.astype(str).to_numpy().ravel())


def test_files_stay_in_their_folder(folders: dict[str, Path]) -> None:
    figures = {path.name for path in folders["validate"].glob("validation_*.png")}
    assert len(figures) == len(HOSTILE)
    for folder in folders.values():
        for path in folder.rglob("*"):
            assert re.fullmatch(r"[\w.+-]+", path.name) and path.stat().st_size > 0


def test_markdown_shows_the_names_and_obeys_none(folders: dict[str, Path]) -> None:
    pages = [path for folder in folders.values() for path in folder.glob("*.md")]
    assert len(pages) >= 4
    for page in pages:
        text = page.read_text(encoding="utf-8")
        plain = re.sub(r"`[^`\n]*`|\\[!-/:-@\[-`{-~]", "", text)  # without code spans and escaped characters
        assert "<" not in plain and "$" not in plain and "`" not in plain and "~~" not in plain, page
        assert not re.search(r"&#?\w+;", plain.replace("&amp;", "")), page
        assert not re.search(r"(?<![A-Za-z0-9])_[^_\n]+_(?![A-Za-z0-9])", plain), page
        pictures = re.findall(r"!\[[^\]]*\]\(([^)]*)\)", plain)
        assert all((page.parent / picture).is_file() for picture in pictures), page
        assert_rows_have_one_length(plain, page)


def assert_rows_have_one_length(text: str, page: Path) -> None:
    """Every table of a page has as many cells in each row."""
    for table in re.findall(r"(?:^\|.*\n)+", text, flags=re.MULTILINE):
        assert len({row.count("|") for row in table.splitlines()}) == 1, page


def test_latex_shows_the_names_and_obeys_none(folders: dict[str, Path]) -> None:
    pages = [path for folder in folders.values() for path in folder.glob("*.tex")]
    assert len(pages) >= 3
    ours = {
        "begin", "end", "centering", "caption", "toprule", "midrule", "bottomrule", "par", "smallskip", "footnotesize",
        "textbackslash", "textasciicircum", "textasciitilde", "textless", "textgreater", "textbar", "textquotedbl",
        "label", "times", "pm", "cdot", "circ", "tau", "psi", "mathrm", "left", "right", "textbf", "leq", "geq",
        "approx",
    }  # fmt: skip
    for page in pages:
        text = page.read_text(encoding="utf-8")
        plain = re.sub(r"\\[{}$&#%_\\]", "", text.replace(r"\\", ""))
        assert set(re.findall(r"\\([A-Za-z]+)", plain)) <= ours, page
        assert plain.count("{") == plain.count("}") and plain.count("$") % 2 == 0, page
        assert "%" not in plain and "#" not in plain and "~" not in plain, page
        assert not re.search(r"(?m)^[\[*]", text), page  # after a row's \\ these would be options


def test_letters_that_a_font_lacks_are_no_warning() -> None:
    for save in FORMATS.values():
        figure, axes = new_figure()
        axes[0, 0].set_title("Größe_タンク $\\frac{ \\x1b", parse_math=False)
        assert len(save(figure)) > 1000


def test_file_names_of_any_bytes(run: Command, tmp_path: Path) -> None:
    """Names that are not UTF-8, or that would drive a terminal, for every file that is no log."""
    log = tmp_path / "a.csv"
    log.write_bytes(csv_of(good_table()))
    model = model_file(tmp_path / "yaw\x1b[31m\nmodel.json")
    try:
        (tmp_path / "m\udcff.json").write_bytes(model.read_bytes())
    except OSError:
        pytest.skip("this file system takes UTF-8 names only")
    columns = tmp_path / "c\udcff\x1b.toml"
    columns.write_text('[columns]\ntau = "tau"\n')
    for name in (model, tmp_path / "m\udcff.json"):
        out = tmp_path / "out"
        found = run("validate", log, "--model", name, "--columns", columns, "-o", out, "--overwrite")
        assert found.exit_code == 0, found.stderr
        assert "\x1b" not in found.stdout
        inputs = json.loads((out / "manifest.json").read_text(encoding="utf-8"))["inputs"]
        assert printable(name.name) in [one["file"] for one in inputs]
    broken = tmp_path / "b\udcff\x1b\n.json"
    broken.write_text("{}")
    found = run("validate", log, "--model", broken)
    assert found.exit_code == 1 and found.stderr.startswith(r"Error: b\xff\x1b\n.json: schema: found nothing")


def test_figures_are_drawn(folders: dict[str, Path]) -> None:
    for folder in folders.values():
        for picture in folder.glob("*.png"):
            assert picture.read_bytes().startswith(b"\x89PNG") and picture.stat().st_size > 5000
