"""`report`: one page of a campaign that stands alone, whatever the names in the logs; and its Markdown."""

import base64
import json
import re
import shutil
from collections.abc import Callable, Iterator
from html.parser import HTMLParser
from pathlib import Path

import pandas as pd
import pytest
from browser import Tab, browser, chromium
from click.testing import Result
from small_campaign import make_small_campaign

import automarine_cli as am
from automarine_cli.commands.report import report
from automarine_cli.errors import OutputError
from automarine_cli.report.campaign import headlines, make_report, read_steps
from automarine_cli.report.page import figure, to_html

pytestmark = pytest.mark.usefixtures("drawn_figures")
HOSTILE = (
    "<script>alert(1)</script>", "\"quoted' `tick` & &lt; $x_1$", "<img src=x onerror=alert(1)>",
    "[a](#b) **bold** | bar ![p](q.png)", "</svg></figure><script>alert(2)</script>", "$\\frac{1}{0}$ {{ 7*7 }} \\",
)  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Step folders of a small campaign in which every run has a hostile name."""
    here = tmp_path_factory.mktemp("campaign")
    logs = make_small_campaign(here / "logs").parent
    for kind in ("steps", "validation"):
        for name, path in zip(HOSTILE, sorted((logs / kind).glob("*.csv"))):
            pd.read_csv(path, comment="#").assign(run=name).to_csv(path, index=False)
    made, figures = here / "results", ("png", "svg")
    am.check([logs / "steps", logs / "thrusters"], out=made / "check")
    am.fit_thrusters(logs / "thrusters", thrusters_per_test=2, out=made / "thrusters", figure_formats=figures)
    am.fit_yaw(logs / "steps", out=made / "yaw", figure_formats=figures)
    model, thrusters = made / "yaw" / "yaw_model.json", made / "thrusters" / "thrusters.json"
    am.validate(logs / "validation", model=model, out=made / "validation", figure_formats=figures)
    am.diagnose(logs / "thrusters", model=thrusters, out=made / "diagnosis", figure_formats=figures)
    return made


@pytest.fixture(scope="module")
def files(folder: Path) -> dict[str, str]:
    return make_report(folder, title="Pool day <2> & more").files


class Elements(HTMLParser):
    """Elements with their attributes, and the text outside of scripts and styles."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.text, self._in = "", ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        self._in = tag

    def handle_endtag(self, tag: str) -> None:
        self._in = ""

    def handle_data(self, data: str) -> None:
        self.text += data if self._in not in ("script", "style") else ""

    def all(self, tag: str) -> list[dict[str, str | None]]:
        """Attributes of each element of that name."""
        return [attributes for name, attributes in self.elements if name == tag]


@pytest.fixture(scope="module")
def page(files: dict[str, str]) -> Elements:
    return Elements(files["report.html"])


def test_the_same_bytes_from_anywhere(
    folder: Path, files: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(folder, tmp_path / "elsewhere")
    monkeypatch.chdir(tmp_path)
    assert make_report(Path("elsewhere"), title="Pool day <2> & more").files == files
    assert not [name for name, text in files.items() if str(folder.parent) in text or "elsewhere" in text]


def test_sections_stand_in_order_and_hold_what_was_found(folder: Path, files: dict[str, str], page: Elements) -> None:
    headings = re.findall(r"^## (.*)$", files["report.md"], flags=re.MULTILINE)
    assert headings == [
        "Thruster map",
        "Yaw model",
        "Validation",
        "Diagnosis",
        "Logs",
        "Runs set aside",
        "How this was made",
    ]
    model = json.loads((folder / "yaw" / "yaw_model.json").read_text(encoding="utf-8"))
    low, high = model["models"][model["preferred"]]["I_r"]["ci95"]
    said = re.search(r"I\s*r ([\d.]+) \[([\d.]+), ([\d.]+)\]", page.text)
    assert said and float(said[2]) == pytest.approx(low, abs=0.01) and float(said[3]) == pytest.approx(high, abs=0.01)
    for words in ("Table 1. Identified yaw models: drag", "Table 2. Identified yaw models: inertia", "never moved"):
        assert words in page.text
    assert "over 1 run not fitted" in page.text
    verdict = (folder / "diagnosis" / "diagnosis.md").read_text(encoding="utf-8").split("\n\n")[1]
    assert "% of full scale" in verdict and verdict in files["report.md"]


def test_no_name_becomes_markup(files: dict[str, str], page: Elements) -> None:
    assert page.all("script") == [] == page.all("svg")
    assert [e for e in page.elements if any(key.startswith("on") for key in e[1])] == []
    assert {tag for tag, _ in page.elements} & {"iframe", "object", "embed", "form", "base", "foreignobject"} == set()
    assert all((a.get("src") or "data:").startswith("data:") for a in page.all("img"))
    everything = " ".join([page.text, *(a["alt"] or "" for a in page.all("img"))])
    assert [name for name in HOSTILE if " ".join(name.split()) not in everything] == []
    assert "Pool day <2> & more" in page.text


def test_links_lead_somewhere_and_ids_are_unique(page: Elements) -> None:
    ids = [a["id"] for _, a in page.elements if "id" in a]
    assert len(ids) == len(set(ids))
    for tag, attributes in page.elements:
        target = attributes.get("href") or "#"
        if tag == "a":
            assert target.startswith("#") and target[1:] in ids, (tag, target)


def test_every_figure_is_drawn_and_told_in_words(folder: Path, page: Elements) -> None:
    files = sorted(folder.glob("*/*.svg"))
    heads = [(one["src"] or "").partition(",") for one in page.all("img")]
    assert {head for head, _, _ in heads} == {"data:image/svg+xml;base64"}
    assert sorted(base64.b64decode(data) for _, _, data in heads) == sorted(one.read_bytes() for one in files)
    assert len(files) >= 9 and all(len(one["alt"] or "") > 2 for one in page.all("img"))
    assert all((one["style"] or "").startswith("max-width:") for one in page.all("img"))


def test_a_figure_of_another_program_stays_a_picture(tmp_path: Path) -> None:
    """What acts in an SVG does not inside an image element; none of it becomes a part of the page."""
    (tmp_path / "yaw").mkdir()
    (tmp_path / "yaw" / "drag.svg").write_text('<svg onload="alert(1)"><script>alert(2)</script></svg>')
    made = figure(tmp_path, "yaw/drag.png", 'say "hi" <now>')
    assert re.sub("base64,[A-Za-z0-9+/=]*", "", made) == (
        '<figure><img src="data:image/svg+xml;" alt="say &quot;hi&quot; &lt;now&gt;">'
        "<figcaption>say &quot;hi&quot; &lt;now&gt;</figcaption></figure>"
    )
    assert "is not in its folder" in figure(tmp_path / "yaw", "../yaw/drag.png", "")


def test_png_serves_where_no_svg_was_drawn(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder / "thrusters", tmp_path / "thrusters")
    (tmp_path / "thrusters" / "thrusters.svg").unlink()
    text = make_report(tmp_path).files["report.html"]
    (image,) = Elements(text).all("img")
    assert (image["src"] or "").startswith("data:image/png;base64,") and "Thrust of one thruster" in (
        image["alt"] or ""
    )
    assert '<th scope="row">fit-yaw</th><td>not run</td>' in text


def test_refusals_say_what_to_do(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"none of the folders check, thrusters, .* is here; give a folder that"):
        make_report(tmp_path)
    shutil.copytree(folder / "yaw", tmp_path / "yaw")
    model = tmp_path / "yaw" / "yaw_model.json"
    model.write_text('{"schema": "automarine/yaw-model/1"}')
    with pytest.raises(
        OutputError, match=r'yaw/yaw_model.json: key "models" is missing; give a file as `automarine fit-yaw`'
    ):
        make_report(tmp_path)
    model.write_text('{"schema": "other"}')
    with pytest.raises(
        OutputError, match=r'yaw/yaw_model.json: schema: found "other", expected "automarine/yaw-model/1"'
    ):
        make_report(tmp_path)


def test_command_writes_beside_the_steps(folder: Path, tmp_path: Path, run: Callable[..., Result]) -> None:
    shutil.copytree(folder / "thrusters", tmp_path / "thrusters")
    done = run("report", tmp_path, "--json")
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["steps"] == ["thrusters"]
    assert {path.name for path in tmp_path.iterdir()} == {"thrusters", "report.html", "report.md"}
    again = run("report", tmp_path)
    assert again.exit_code == 1 and "give --overwrite to replace it" in again.stderr
    assert report(tmp_path, overwrite=True).files["report.md"] == (tmp_path / "report.md").read_text(encoding="utf-8")


def _written(folder: Path, name: str, content: dict[str, object]) -> None:
    (folder / name).parent.mkdir()
    (folder / name).write_text(json.dumps({"runs": {"used": 9, "set_aside": []}} | content))


def _estimate(value: float, half: float) -> dict[str, object]:
    return {"value": value, "stderr": half / 2, "ci95": [value - half, value + half], "unit": "nu s²"}


def _model(**more: object) -> dict[str, object]:
    entry = {"k_rr": _estimate(1.165, 0.02), "I_r": _estimate(1.059, 0.03)}
    return {"schema": "automarine/yaw-model/1", "models": {"3": entry}, "preferred": "3", **more}


def _named(folder: Path) -> None:
    """A fit, its validation, and a diagnosis that named what was missing."""
    gap = {"before_deg": 3.0, "after_deg": 1.0, "noise_floor_deg": 0.9}
    base = {
        key: {"before": _estimate(one, 0.02), "after": _estimate(two, 0.02)}
        for key, one, two in (("k_rr", 1.07, 1.247), ("I_r", 1.28, 1.017))
    }
    _written(folder, "yaw/yaw_model.json", _model())
    _written(folder, "validation/validation.json", {
        "schema": "automarine/validation/1", "models": {"3": {"heading_rmse_deg": 42.0}}, "best": "3",
    })  # fmt: skip
    _written(folder, "diagnosis/diagnosis.json", {
        "schema": "automarine/diagnosis/1", "verdict": "named", "effects": [{"name": "water-swirl"}], "base": base,
        "gap": {"fitted_runs": gap},
    })  # fmt: skip


def test_the_first_numbers_are_those_of_the_final_model(tmp_path: Path) -> None:
    _named(tmp_path)
    text = make_report(tmp_path).files["report.md"]
    lines = headlines(read_steps(tmp_path))
    assert lines["fit-yaw"] == (
        "model 3 with water-swirl: k_r|r| 1.247 [1.227, 1.267] nu s², I_r 1.017 [0.997, 1.037] nu s² "
        "(without: 1.165, 1.059)"
    )
    assert lines["validate"].startswith("without water-swirl, model 3: 42.0 deg free run")
    assert "k_r\\|r\\| 1.247 " in text.partition("## ")[0]
    assert "This is the model without water-swirl" in text.partition("## Yaw model")[2]


def test_what_must_not_be_used_stands_first(tmp_path: Path) -> None:
    says = "This model is not usable: it predicts less than nothing; `automarine diagnose` looks for what it lacks."
    _written(tmp_path, "yaw/yaw_model.json", _model(prediction={"of_use": False, "says": says}, warnings=[says]))
    text = make_report(tmp_path).files
    assert text["report.md"].splitlines()[2].startswith("**This model is not usable: ")
    assert "`" not in Elements(text["report.html"]).text and "<code>automarine diagnose</code>" in text["report.html"]
    assert headlines(read_steps(tmp_path))["fit-yaw"].startswith("not usable: model 3: k_r|r| 1.165 [1.145, 1.185]")


def test_markdown_is_text_whatever_it_holds() -> None:
    body = to_html(
        "# A <b>\n\nx \\*y\\* **z** `a<b` k_r\\|r\\| &lt; <i>\n\n| a | b |\n| --- | ---: |\n| \\| | 1 |\n", str
    )
    assert '<h1 id="a-b">A &lt;b&gt;' in body
    assert "<p>x *y* <strong>z</strong> <code>a&lt;b</code> <var>k</var><sub>r|r|</sub> &lt; &lt;i&gt;</p>" in body
    assert '<th scope="row">|</th><td class="n">1</td>' in body


@pytest.fixture(scope="module")
def tab(files: dict[str, str], tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Tab, Path]]:
    """The page's file and a browser to open it with."""
    program = chromium()
    if program is None:
        pytest.skip("no Chromium is installed (Debian: apt-get install chromium)")
    path = tmp_path_factory.mktemp("page") / "report.html"
    path.write_text(files["report.html"], encoding="utf-8")
    with browser(program) as opened:
        yield opened, path


@pytest.mark.parametrize("width", [1200, 390])
@pytest.mark.parametrize("dark", [False, True])
def test_a_browser_shows_it_without_a_word_to_anybody(tab: tuple[Tab, Path], width: int, dark: bool) -> None:
    shown, path = tab
    shown.asked.clear()
    shown.open(path, width=width, dark=dark, touch=width < 400)
    assert shown.problems == []
    assert {address.partition(":")[0] for address in shown.asked} <= {"file", "data"}
    assert shown.asked.count(path.as_uri()) == sum(address.startswith("file:") for address in shown.asked) == 1
    assert shown.value("document.scrollingElement.scrollWidth") <= width
    said = shown.value("document.querySelectorAll('details').forEach(d => { d.open = true }), document.body.innerText")
    for words in ("Thruster map", "Table 1. Identified yaw models: drag", "never moved", HOSTILE[0], HOSTILE[4]):
        assert words in said
    paper, ink = (
        sum(map(int, re.findall(r"\d+", shown.value(f"getComputedStyle(document.body).{one}"))))
        for one in ("backgroundColor", "color")
    )
    assert (paper < 100 and ink > 600) if dark else (paper > 700 and ink < 150)


def test_very_long_tables_stay_in_their_folder(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("automarine_cli.report.campaign.MOST_ROWS", 3)
    text = make_report(folder).files["report.md"]
    assert "Every run: see `check/check.md`." in text and "see `manifest.json`" in text
    assert "<details>" not in text
