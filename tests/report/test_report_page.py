"""`report`: one page of a campaign that stands alone, whatever the names in the logs; and its Markdown.

What logs call their runs and columns means nothing to LaTeX, Markdown and HTML either, and drives no terminal.
"""

import base64
import json
import re
import shutil
from collections.abc import Callable
from html.parser import HTMLParser
from importlib.resources import files as resources
from pathlib import Path

import pandas as pd
import pytest
from broken_logs.make import csv_of, good_table
from browser import looked_at
from click.testing import Result
from made_sequences import model_file
from small_campaign import make_small_campaign

import automarine_cli as am
from automarine_cli import effects
from automarine_cli.commands.report import report
from automarine_cli.comparison.validation import ForecastEntry, ScoreEntry, ValidationFile
from automarine_cli.dofs import YAW
from automarine_cli.errors import OutputError
from automarine_cli.estimate import Estimate
from automarine_cli.models.store import DiagnosisFile, GapEntry, Use
from automarine_cli.pipeline.records import RunsUsed
from automarine_cli.report.campaign import five_numbers, headlines, make_report, read_steps, worst
from automarine_cli.report.page import figure
from automarine_cli.report.tables import MISSING
from automarine_cli.text import printable

pytestmark = pytest.mark.usefixtures("drawn_figures")
HOSTILE = (
    "<script>alert(1)</script> \\input{/etc/passwd}%c", "\"quoted' `tick` & &lt; $x_1$ &lt;b&gt;",
    "../../escape <!-- {{7*7}} # h",
    "[a](#b) **bold** | bar ![p](q.png) ~~gone~~", "</svg></figure><script>alert(2)</script> =1+1 {}#&^~ \t\"d\"",
    "$\\frac{1}{0}$ {{ 7*7 }} \\", "* _em_ `rm -rf ~` two\nlines \x1b[31mred\x07 Größe_タンク $\\foo_{bar",
)  # fmt: skip
"""A run column may hold any of these; in Parquet a line feed too."""
SHOWN = [" ".join(printable(name).split()) for name in HOSTILE]
TEX = (
    "begin end centering caption toprule midrule bottomrule par smallskip footnotesize textbackslash textasciicircum "
    "textasciitilde textless textgreater textbar textquotedbl label times pm cdot circ tau psi mathrm left right "
    "textbf leq geq approx"
)
TITLE = "Pool day <2> & more"
FIRST_SCREEN = 800  # pixels


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Step folders of a small campaign in which every run, log and column has a hostile name."""
    place = tmp_path_factory.mktemp("campaign")
    logs = make_small_campaign(place / "logs").parent
    for kind in ("steps", "validation"):
        for name, path in zip(HOSTILE, sorted((logs / kind).glob("*.csv"))):
            table = pd.read_csv(path, comment="#").assign(run=name)
            table["$\\frac{|<b>`_x_\x1b[31m\x07"] = table["time_s"] % 7
            table.to_parquet(path.with_name(f"$x$ `|` <b> \\input{{a}}{path.stem}.parquet"))
            path.unlink()
    out, svg = place / "results", ("svg",)
    am.check([logs / "steps", logs / "thrusters"], out=out / "check", figure_formats=svg)
    am.fit_thrusters(logs / "thrusters", thrusters_per_test=2, out=out / "thrusters", figure_formats=("png", "svg"))
    am.fit_yaw(logs / "steps", out=out / "yaw", figure_formats=svg)
    model, thrusters = out / "yaw" / "yaw_model.json", out / "thrusters" / "thrusters.json"
    am.validate([logs / "validation", logs / "driving"], model=model, out=out / "validation", figure_formats=svg)
    am.diagnose(logs / "thrusters", model=thrusters, out=out / "diagnosis", figure_formats=("png", "svg"))
    return out


@pytest.fixture(scope="module")
def files(folder: Path) -> dict[str, str]:
    return make_report(folder, title=TITLE).files


class Elements(HTMLParser):
    """Elements with their attributes, and the text outside of scripts and styles."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str]]] = []
        self.text, self._in = "", ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, {name: value or "" for name, value in attrs}))
        self._in = tag

    def handle_endtag(self, tag: str) -> None:
        self._in = ""

    def handle_data(self, data: str) -> None:
        self.text += data if self._in not in ("script", "style") else ""

    def all(self, tag: str) -> list[dict[str, str]]:
        """Attributes of each element of that name."""
        return [attributes for name, attributes in self.elements if name == tag]


@pytest.fixture(scope="module")
def page(files: dict[str, str]) -> Elements:
    return Elements(files["report.html"])


@pytest.mark.slow
def test_the_same_bytes(folder: Path, files: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(folder, tmp_path / "elsewhere")
    monkeypatch.chdir(tmp_path)
    assert make_report(Path("elsewhere"), title=TITLE).files == files
    assert not [name for name, text in files.items() if str(folder.parent) in text or "elsewhere" in text]


def test_no_name_becomes_markup_and_nothing_is_fetched(files: dict[str, str], page: Elements) -> None:
    assert len(page.all("script")) == 1 and page.all("svg") == []
    script = re.search("<script>(.*?)</script>", files["report.html"], re.DOTALL)
    assert script and script[1] == resources("automarine_cli.report").joinpath("page.js").read_text().strip()
    assert all(link["href"].startswith("data:") for link in page.all("link"))
    assert "url(" not in files["report.html"] and "@import" not in files["report.html"]
    assert [e for e in page.elements if any(key.startswith("on") for key in e[1])] == []
    assert {tag for tag, _ in page.elements} & {"iframe", "object", "embed", "form", "base", "foreignobject"} == set()
    everything = " ".join([page.text, *(image["alt"] for image in page.all("img"))])
    assert [name for name in (*SHOWN, TITLE) if name not in " ".join(everything.split())] == []


def test_names_are_kept_in_data_and_files_stay_in_their_folder(folder: Path) -> None:
    names = {
        run["run"] for run in json.loads((folder / "check" / "check.json").read_text(encoding="utf-8"))["yaw_runs"]
    }
    assert names == set(map(printable, HOSTILE))
    for path in folder.rglob("*"):
        assert re.fullmatch(r"[\w.+-]+", path.name) and path.stat().st_size > 0


def test_markdown_shows_the_names_and_obeys_none(folder: Path) -> None:
    pages = list(folder.glob("*/*.md"))
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


def test_latex_shows_the_names_and_obeys_none(folder: Path) -> None:
    pages = list(folder.glob("*/*.tex"))
    assert len(pages) >= 3
    for page in pages:
        text = page.read_text(encoding="utf-8")
        plain = re.sub(r"\\[{}$&#%_\\]", "", text.replace(r"\\", ""))
        assert set(re.findall(r"\\([A-Za-z]+)", plain)) <= set(TEX.split()), page
        assert plain.count("{") == plain.count("}") and plain.count("$") % 2 == 0, page
        assert "%" not in plain and "#" not in plain and "~" not in plain, page
        assert not re.search(r"(?m)^[\[*]", text), page  # after a row's \\ these would be options


def test_links_lead_somewhere_and_ids_are_unique(page: Elements) -> None:
    ids = [attributes["id"] for _, attributes in page.elements if "id" in attributes]
    assert len(ids) == len(set(ids))
    assert [link["href"] for link in page.all("a") if link["href"].removeprefix("#") not in ids] == []


def test_every_figure_is_drawn_and_told_in_words(folder: Path, page: Elements) -> None:
    assert read_steps(folder)["diagnosis"].file.verdict == "nothing-missing"  # before is after: two equal lines
    pictures = sorted(path.read_bytes() for path in folder.glob("*/*.svg") if path.stem != "before_after")
    sources = [image["src"].partition(",") for image in page.all("img")]
    assert {head for head, _, _ in sources} == {"data:image/svg+xml;base64"}
    assert sorted(base64.b64decode(data) for _, _, data in sources) == pictures
    assert len(pictures) >= 8 and all(len(image["alt"]) > 2 for image in page.all("img"))
    assert all(image["style"].startswith("max-width:") for image in page.all("img"))


def test_a_figure_of_another_program_stays_a_picture(tmp_path: Path) -> None:
    """What acts in an SVG does not inside an image element; none of it becomes a part of the page."""
    (tmp_path / "yaw").mkdir()
    (tmp_path / "yaw" / "drag.svg").write_text('<svg onload="alert(1)"><script>alert(2)</script></svg>')
    text = figure(tmp_path, "yaw/drag.png", 'say "hi" <now>')
    assert re.sub("base64,[A-Za-z0-9+/=]*", "", text) == (
        '<figure tabindex="0"><img src="data:image/svg+xml;" alt="say &quot;hi&quot; &lt;now&gt;">'
        "<figcaption>say &quot;hi&quot; &lt;now&gt;</figcaption></figure>"
    )
    assert "is not in its folder" in figure(tmp_path / "yaw", "../yaw/drag.png", "")


def test_refusals_say_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"none of the folders check, thrusters, .* is here; give a folder that"):
        make_report(tmp_path)
    write(tmp_path, "yaw/yaw_model.json", {"schema": "automarine/yaw-model/1"})
    with pytest.raises(OutputError, match=r'yaw/yaw_model.json: key "models" is missing; give a file as'):
        make_report(tmp_path)
    (tmp_path / "report.md").touch()
    with pytest.raises(OutputError, match=r"already holds report\.md; give --overwrite to replace it"):
        report(tmp_path)


def write(folder: Path, name: str, content: dict[str, object]) -> None:
    (folder / name).parent.mkdir()
    (folder / name).write_text(json.dumps({"runs": {"used": 9, "set_aside": []}} | content))


def estimate(value: float, half: float) -> dict[str, object]:
    return {"value": value, "stderr": half / 2, "ci95": [value - half, value + half], "unit": "nu s²"}


def write_model(folder: Path, **more: object) -> None:
    model = {"k_rr": estimate(1.165, 0.02), "I_r": estimate(1.059, 0.03)}
    write(folder, "yaw/yaw_model.json", {
        "schema": "automarine/yaw-model/1", "models": {"3": model}, "preferred": "3", **more,
    })  # fmt: skip


def test_the_first_numbers_are_those_of_the_final_model(tmp_path: Path) -> None:
    """A fit, its validation, and a diagnosis that named what was missing."""
    write_model(tmp_path)
    write(tmp_path, "validation/validation.json", {
        "schema": "automarine/validation/1", "models": {"3": {"heading_rmse_deg": 42.0}}, "best": "3",
    })  # fmt: skip
    write(tmp_path, "diagnosis/diagnosis.json", {
        "schema": "automarine/diagnosis/1", "verdict": "named", "effects": [{"name": "water-swirl"}],
        "base": {
            "k_rr": {"before": estimate(1.07, 0.02), "after": estimate(1.247, 0.02)},
            "I_r": {"before": estimate(1.28, 0.02), "after": estimate(1.017, 0.02)},
        },
        "gap": {"fitted_runs": {"before_deg": 3.0, "after_deg": 1.0, "noise_floor_deg": 0.9}},
    })  # fmt: skip
    write(tmp_path, "final_validation/validation.json", {
        "schema": "automarine/validation/1", "models": {"3": {"heading_rmse_deg": 15.4, "restarted_rmse_deg": 5.3}},
        "best": "3", "noise_floor_deg": 1.05, "restarted_expected_deg": 3.7,
    })  # fmt: skip
    text, lines = make_report(tmp_path).files["report.md"], headlines(read_steps(tmp_path))
    assert lines["fit-yaw"] == (
        "model 3 (quadratic drag) with water-swirl: k_rr 1.247 [1.227, 1.267] nu s², I_r 1.017 [0.997, 1.037] nu s² "
        "(without: 1.165, 1.059)"
    )
    assert lines["validate"].startswith("without water-swirl, model 3 (quadratic drag): 42.0 deg free run")
    box = text.partition("## ")[0]
    assert "k_rr 1.247 " in box
    reveals = effects.get("water-swirl").card(YAW).reveals
    assert (
        f"- **Next:** Use `diagnosis/extended_model.json`, the model with it. To see water-swirl better: {reveals}."
        in box
    )
    assert "- **Error:** the model with water-swirl: 15.4 deg free run, 5.30 deg restarted (without: 42.0, –)" in box
    assert "- **Verdict:** good\n" in box and "42" not in box.replace("(without: 42.0", "")
    assert "| restarted error | good | 5.30 deg, 1.4 times the 3.7 deg of a right model |" in text
    assert "| final, with water-swirl | 15.4 | 5.30 |" in text and "| without water-swirl | 42.0 | – |" in text
    assert "This is the model without water-swirl" in text.partition("## Yaw model")[2]


@pytest.mark.parametrize(("after", "says"), [(9.0, "does not fall with water-swirl"), (7.0, "the model with it")])
def test_an_effect_that_runs_not_fitted_do_not_bear_out_is_not_recommended(
    tmp_path: Path, after: float, says: str
) -> None:
    """Of driven runs predictions count, whatever free runs do."""
    write_model(tmp_path)
    for place, ahead, free in (("validation", 8.0, 40.0), ("final_validation", after, 50.0 - after)):
        runs = {"calm": ahead / 2, "rough": 2 * ahead}
        write(tmp_path, f"{place}/validation.json", {
            "schema": "automarine/validation/1", "best": "3", "models": {"3": {"heading_rmse_deg": free}},
            "prediction": {"3": [
                {"horizon_s": 5.0, "rmse_deg": ahead, "constant_rate_deg": 20.0, "constant_heading_deg": 16.0,
                 "runs": runs}
            ]},
        })  # fmt: skip
    write(tmp_path, "diagnosis/diagnosis.json", {
        "schema": "automarine/diagnosis/1", "verdict": "named", "effects": [{"name": "water-swirl"}], "base": {},
        "gap": {"fitted_runs": {"before_deg": 3.0, "after_deg": 1.0, "noise_floor_deg": 0.9}},
    })  # fmt: skip
    text = make_report(tmp_path).files["report.md"]
    assert says in text.partition("- **Next:**")[2].partition("\n")[0]
    assert f"- **Error:** the model with water-swirl: {after:.2f} deg 5 s ahead, " in text
    assert f"| final, with water-swirl | {after:.2f} | " in text and "| a constant heading or rate | 16.0 | – |" in text


def test_a_fit_that_asks_for_an_effect_says_so_where_nothing_was_diagnosed(tmp_path: Path) -> None:
    write_model(tmp_path, proposed={"input-delay": 879.0})
    box = make_report(tmp_path).files["report.md"].partition("## ")[0]
    assert "- **Missing:** the fit itself asks for input-delay (gains 879 in deviance)" in box
    assert "- **Next:** Fit again with input-delay: `--with input-delay`." in box


def test_nothing_missing_is_said_in_one_sentence(folder: Path, files: dict[str, str]) -> None:
    text = files["report.md"]
    assert "- **Missing:** nothing that these levels could show" in text.partition("## ")[0]
    page = text.partition("## Diagnosis")[2].partition("\n## ")[0]
    assert page.startswith("\n\nNothing missing that these levels could show. ")
    assert "before" not in page and (folder / "diagnosis" / "before_after.png").is_file()


GRADES = ("good", "look closer", "do not use")


@pytest.mark.parametrize(
    ("restarted", "half", "used", "verdict", "grade"),
    [
        (5.5, 0.04, 6, "named", 0), (5.7, 0.06, 5, "suspected", 1), (11.5, 1.1, 6, "unexplained", 2),
    ],
)  # fmt: skip
def test_five_numbers_have_their_limits(restarted: float, half: float, used: int, verdict: str, grade: int) -> None:
    score = ScoreEntry(rmse=40.0, restarted=restarted)
    validation = ValidationFile(schema="", models={"3": score}, best="3", expected=3.7, dof=YAW)
    diagnosis = DiagnosisFile(schema="", verdict=verdict, gap=GapEntry(before=1, after=1, noise_floor=1), dof=YAW)
    inertia = Estimate(2.0, 0.5, (2.0 - 2.0 * half, 2.0), "")
    rows = list(five_numbers(RunsUsed(used), {"I_r": inertia, "k_rr": None}, validation, diagnosis))
    assert [row["verdict"] for row in rows] == [
        GRADES[used < 6], GRADES[grade], GRADES[grade], MISSING, GRADES[grade],
    ]  # fmt: skip
    assert worst(rows).startswith(GRADES[grade])


@pytest.mark.parametrize(("rmse", "of_use", "grade"), [(4.0, True, 0), (7.9, True, 1), (8.1, True, 1), (8.1, False, 2)])
def test_driven_runs_are_graded_by_their_predictions(rmse: float, of_use: bool, grade: int) -> None:
    """Of use where a constant is nearer: commands that answer disturbances flatter it."""
    ahead = {"3": (ForecastEntry(2.0, rmse=9.0), ForecastEntry(5.0, rmse=rmse, constant_rate=9.0, constant=8.0))}
    score = {"3": ScoreEntry(rmse=40.0, restarted=99.0)}
    file = ValidationFile(schema="", models=score, best="3", use=Use(of_use), prediction=ahead, dof=YAW)
    rows = {row["look at"]: row for row in five_numbers(RunsUsed(9), {}, file, None)}
    assert rows["error 5 s ahead"]["verdict"] == GRADES[grade] and rows["restarted error"]["verdict"] == MISSING
    assert ("flattered" in str(rows["error 5 s ahead"])) == (rmse > 8.0 and of_use)
    assert worst([*rows.values()]).startswith(GRADES[grade]) and worst([]) == ""
    if grade == 0:
        assert worst([*rows.values()]) == "good, but not known: diagnosis"


def test_a_model_that_the_runs_do_not_determine_is_not_usable(tmp_path: Path) -> None:
    inertia = {"value": 3915.0, "stderr": 1e5, "ci95": [0.0, 246323.0], "unit": "nu s²"}
    models = {"3": {"k_rr": estimate(1.165, 0.02), "I_r": inertia}}
    write_model(tmp_path, models=models, runs={"used": 2, "set_aside": []})
    text = make_report(tmp_path).files["report.md"]
    assert text.splitlines()[2] == "**These runs do not determine I_r; add runs from rest at larger commands.**"
    assert "not usable: model 3" in text and "- **Next:** Drive more runs: a diagnosis needs 4 and more." in text


def test_what_must_not_be_used_stands_first(tmp_path: Path) -> None:
    says = "This model is not usable: it predicts less than nothing; `automarine diagnose` looks for what it lacks."
    write_model(tmp_path, prediction={"of_use": False, "says": says}, warnings=[says])
    text = make_report(tmp_path).files
    assert text["report.md"].splitlines()[2].startswith("**This model is not usable: ")
    assert "`" not in Elements(text["report.html"]).text and "<code>automarine diagnose</code>" in text["report.html"]
    assert headlines(read_steps(tmp_path))["fit-yaw"].startswith(
        "not usable: model 3 (quadratic drag): k_rr 1.165 [1.145, 1.185]"
    )


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


LOOK = """<iframe src="report.html" width="{width}" height="900" style="border: 0"></iframe><script>
onload = () => {{
  const page = document.querySelector("iframe").contentDocument, style = getComputedStyle(page.body);
  const box = page.querySelector("h1 ~ ul").getBoundingClientRect().bottom;
  page.querySelectorAll("details").forEach(each => {{ each.open = true }});
  const seen = {{
    box, broken: [...page.images].filter(image => !image.complete || !image.naturalWidth).length,
    width: page.scrollingElement.scrollWidth, text: page.body.innerText, paper: style.backgroundColor, ink: style.color,
    asked: page.defaultView.performance.getEntriesByType("resource").map(each => each.name),
  }};
  document.documentElement.textContent = JSON.stringify(seen);
}}
</script>"""


USE = """<iframe src="report.html" width="{width}" height="900" style="border: 0"></iframe><script>
onload = () => {{
  const frame = document.querySelector("iframe").contentWindow, page = frame.document, seen = {{}};
  const group = page.querySelector(".choice"), list = group.querySelector("select");
  const figures = [...group.querySelectorAll("figure")];
  const shown = () => figures.filter(each => each.offsetHeight).map(each => each.innerText);
  const send = (kind, target, what) => target.dispatchEvent(new frame[kind](what.type, {{ bubbles: true, ...what }}));
  const told = target => {{  // under the pointer, from the top down, until there is something
    const {{ left, top, width, height }} = target.getBoundingClientRect(), clientX = left + width / 2;
    for (let y = top; y < top + height && !page.querySelector(".note"); y += 5)
      send("PointerEvent", target, {{ type: "pointermove", pointerType: "mouse", clientX, clientY: y }});
    return page.querySelector(".note")?.innerText;
  }};
  seen.runs = [...list.options].map(each => each.text);
  seen.first = shown();
  list.selectedIndex = 1;
  send("Event", list, {{ type: "change" }});
  seen.second = shown();
  const image = group.querySelector("figure:not([hidden]) img");
  seen.values = told(image);
  image.click();
  const stage = page.querySelector(".stage"), large = stage.querySelector("img");
  const wide = () => large.getBoundingClientRect().width;
  const press = key => (send("KeyboardEvent", stage, {{ type: "keydown", key }}), wide());
  seen.open = page.querySelector("dialog").open;
  seen.widths = [wide()];
  send("WheelEvent", stage, {{ type: "wheel", deltaY: -500, clientX: 200, clientY: 300, cancelable: true }});
  seen.widths.push(wide(), press("+"), press("-"));
  send("MouseEvent", stage, {{ type: "dblclick" }});
  seen.widths.push(wide());
  const touch = (type, pointerId, clientX) =>
    send("PointerEvent", stage, {{ type, pointerId, pointerType: "touch", clientX, clientY: 300 }});
  for (const [id, x] of [[11, 100], [12, 200]]) touch("pointerdown", id, x);
  touch("pointermove", 12, 300);
  for (const id of [11, 12]) touch("pointerup", id, 300);
  seen.pinched = wide();
  send("MouseEvent", stage, {{ type: "dblclick" }});
  seen.large = told(stage);
  document.documentElement.textContent = JSON.stringify(seen);
}}
</script>"""


PRINT = """<iframe src="report.html" width="{width}" height="900" style="border: 0"></iframe><script>
onload = () => {{
  const page = document.querySelector("iframe").contentDocument, shown = each => each.getClientRects().length > 0;
  const figures = [...page.querySelectorAll("figure")], seen = {{ figures: figures.length }};
  seen.chosen = figures.filter(shown).length;
  for (const sheet of page.styleSheets) for (const rule of sheet.cssRules)
    if (rule.media?.mediaText === "print") rule.media.mediaText = "all";
  const body = getComputedStyle(page.body);
  seen.shown = figures.filter(shown).length;
  seen.width = page.scrollingElement.scrollWidth;
  seen.controls = [...page.querySelectorAll("nav, select, dialog")].filter(shown).length;
  [seen.paper, seen.ink] = [body.backgroundColor, body.color];
  document.documentElement.textContent = JSON.stringify(seen);
}}
</script>"""
A4_PX = 718  # 190 mm at 96 pixels an inch


@pytest.fixture
def shown(files: dict[str, str], tmp_path: Path) -> Path:
    """Where the page of a test may show the report."""
    (tmp_path / "report.html").write_text(files["report.html"], encoding="utf-8")
    return tmp_path


@pytest.mark.parametrize("width", [1200, 400])
def test_a_run_is_chosen_and_its_figure_answers(shown: Path, width: int) -> None:
    seen = looked_at(shown, USE.format(width=width))
    off = [float(re.search(r", off by ([\d.]+) deg$", name)[1]) for name in seen["runs"]]  # type: ignore[index]
    assert len(off) > 1 and off == sorted(off, reverse=True)
    assert [len(seen["first"]), len(seen["second"])] == [1, 1] and seen["first"] != seen["second"]
    for values in (seen["values"], seen["large"]):
        assert re.search(r"Time from the start of the run: -?[\d.]+ s\n.+: -?[\d.]+ (deg|nu)$", values), values
    start, wheel, more, less, again = seen["widths"]
    assert seen["open"] and wheel > 2 * start and more > wheel > start
    assert less == pytest.approx(wheel) and again == start
    assert seen["pinched"] == pytest.approx(2.0 * start, abs=1.0)


@pytest.mark.parametrize("dark", [False, True])
def test_paper_shows_every_run_on_white(shown: Path, dark: bool) -> None:
    """The rules of print, on a page as wide as A4 within its margins."""
    scheme = f"--blink-settings=preferredColorScheme={1 - dark}"
    seen = looked_at(shown, PRINT.format(width=A4_PX), scheme)
    assert seen["figures"] > seen["chosen"] > 0 and seen["figures"] == seen["shown"]
    assert seen["width"] <= A4_PX and seen["controls"] == 0
    assert (seen["paper"], seen["ink"]) == ("rgb(255, 255, 255)", "rgb(0, 0, 0)")


@pytest.mark.parametrize(("width", "dark"), [(1200, False), (390, True)])
def test_a_browser_shows_it_and_asks_nobody(shown: Path, width: int, dark: bool) -> None:
    scheme = f"--blink-settings=preferredColorScheme={1 - dark}"
    seen = looked_at(shown, LOOK.format(width=width), scheme)
    assert seen["asked"] == [] and seen["width"] <= width
    assert seen["broken"] == 0 and 0 < seen["box"] < FIRST_SCREEN
    for words in ("Thruster map", "Table 1. Identified yaw models: drag", "never moved", SHOWN[0], SHOWN[4]):
        assert words in seen["text"]
    paper, ink = (sum(map(int, re.findall(r"\d+", seen[name]))) for name in ("paper", "ink"))
    assert (paper < 100 and ink > 600) if dark else (paper > 700 and ink < 150)
