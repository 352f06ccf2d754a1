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
from click.testing import CliRunner, Result
from few_candidates import few_candidates
from made_sequences import model_file

from automarine_cli.commands import automarine
from automarine_cli.text import printable

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("drawn_figures")]
HOSTILE = (
    "a|b $x$", "$\\foo_{bar", r"\input{/etc/passwd}%c", "<script>alert(1)</script>", "`rm -rf ~` two\nlines",
    "[5cm] &lt;b&gt;", "* _em_ **strong** ~~gone~~", "![p](http://x/y.png)", "=1+1 {}#&^~ \t\"d\"",
    "\x1b[31mred\x07 Größe_タンク", "../../escape", "<!-- {{7*7}} # heading",
)  # fmt: skip
"""A run column may hold any of these; in Parquet a line feed too."""
TEX = (
    "begin end centering caption toprule midrule bottomrule par smallskip footnotesize textbackslash textasciicircum "
    "textasciitilde textless textgreater textbar textquotedbl label times pm cdot circ tau psi mathrm left right "
    "textbf leq geq approx"
)


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Results of every command that takes yaw logs, of one file whose runs and a column have all these names."""
    folder = tmp_path_factory.mktemp("hostile")
    moments = (0.3, -0.3, 0.6, -0.6, 1.0, -1.0)
    tables = [good_table(moments[i % len(moments)], seed=i).assign(run=name) for i, name in enumerate(HOSTILE)]
    table = pd.concat(tables, ignore_index=True)
    table["$\\frac{|<b>`_x_\x1b[31m\x07"] = table["time_s"] % 7
    log, model = folder / "$x$ `|` <b> \\input{a}.parquet", model_file(folder / "yaw_model.json")
    log.write_bytes(parquet_of(table))
    results = {}
    for name, arguments in {
        "half": ("fit-yaw", log, "--fit-to", "half-turns"), "whole": ("fit-yaw", log, "--fit-to", "whole-runs"),
        "validate": ("validate", log, "--model", model), "diagnose": ("diagnose", log, "--model", model),
    }.items():  # fmt: skip
        results[name] = folder / name
        with few_candidates(("dead-band", "bias-moment")):
            result = CliRunner().invoke(automarine, [str(word) for word in (*arguments, "-o", results[name])])
        assert result.exit_code == 0, result.stderr
        assert "\x1b" not in result.output and "\x07" not in result.output
    return results


def test_names_are_kept_in_data_and_files_stay_in_their_folder(folders: dict[str, Path]) -> None:
    names = {
        name.replace("\n", "\\n").replace("\t", "\\t").replace("\x1b", "\\x1b").replace("\x07", "\\x07")
        for name in HOSTILE
    }
    data = json.loads((folders["validate"] / "validation.json").read_text(encoding="utf-8"))
    assert set(data["logs"]) == names
    listed = pd.read_csv(folders["validate"] / "validation.csv", keep_default_na=False)
    assert names <= set(listed.astype(str).to_numpy().ravel())
    assert len(list(folders["validate"].glob("validation_*.png"))) == len(HOSTILE)
    for path in (path for folder in folders.values() for path in folder.rglob("*")):
        assert re.fullmatch(r"[\w.+-]+", path.name) and path.stat().st_size > 0
        if path.suffix == ".png":
            assert path.read_bytes().startswith(b"\x89PNG") and path.stat().st_size > 5000


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
        for table in re.findall(r"(?:^\|.*\n)+", plain, flags=re.MULTILINE):
            assert len({row.count("|") for row in table.splitlines()}) == 1, page  # as many cells in each row


def test_latex_shows_the_names_and_obeys_none(folders: dict[str, Path]) -> None:
    pages = [path for folder in folders.values() for path in folder.glob("*.tex")]
    assert len(pages) >= 3
    for page in pages:
        text = page.read_text(encoding="utf-8")
        plain = re.sub(r"\\[{}$&#%_\\]", "", text.replace(r"\\", ""))
        assert set(re.findall(r"\\([A-Za-z]+)", plain)) <= set(TEX.split()), page
        assert plain.count("{") == plain.count("}") and plain.count("$") % 2 == 0, page
        assert "%" not in plain and "#" not in plain and "~" not in plain, page
        assert not re.search(r"(?m)^[\[*]", text), page  # after a row's \\ these would be options


def test_file_names_of_any_bytes(run: Callable[..., Result], tmp_path: Path) -> None:
    """Names that are not UTF-8, or that would drive a terminal, for every file that is no log."""
    log, out = tmp_path / "a.csv", tmp_path / "out"
    log.write_bytes(csv_of(good_table()))
    model, other = model_file(tmp_path / "yaw\x1b[31m\nmodel.json"), tmp_path / "m\udcff.json"
    try:
        other.write_bytes(model.read_bytes())
    except OSError:
        pytest.skip("this file system takes UTF-8 names only")
    columns = tmp_path / "c\udcff\x1b.toml"
    columns.write_text('[columns]\ntau = "tau"\n')
    for name in (model, other):
        result = run("validate", log, "--model", name, "--columns", columns, "-o", out, "--overwrite")
        assert result.exit_code == 0, result.stderr
        assert "\x1b" not in result.stdout
        inputs = json.loads((out / "manifest.json").read_text(encoding="utf-8"))["inputs"]
        assert printable(name.name) in [entry["file"] for entry in inputs]
    broken = tmp_path / "b\udcff\x1b\n.json"
    broken.write_text("{}")
    result = run("validate", log, "--model", broken)
    assert result.exit_code == 1 and result.stderr.startswith(r"Error: b\xff\x1b\n.json: schema: found nothing")
