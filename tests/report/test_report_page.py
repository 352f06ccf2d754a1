"""`report`: one page of a campaign that stands alone, whatever the names in the logs; and its Markdown."""

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
from automarine_cli.errors import OutputError
from automarine_cli.report.campaign_steps import read_steps
from automarine_cli.report.campaign_summary import summary
from automarine_cli.report.html.markdown import to_html
from automarine_cli.report.html.svg import inline
from automarine_cli.workflows.report import report, report_files

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
    am.diagnose(
        logs / "thrusters",
        model=thrusters,
        thrusters_per_test=2,
        out=made / "diagnosis",
        figure_formats=figures,
    )
    return made


@pytest.fixture(scope="module")
def files(folder: Path) -> dict[str, str]:
    return report_files(folder, title="Pool day <2> & more")


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
    assert report_files(Path("elsewhere"), title="Pool day <2> & more") == files
    assert not [name for name, text in files.items() if str(folder.parent) in text or "elsewhere" in text]


def test_sections_stand_in_order_and_hold_what_was_found(
    folder: Path, files: dict[str, str], page: Elements
) -> None:
    headings = re.findall(r"^## (.*)$", files["report.md"], flags=re.MULTILINE)
    assert headings == [
        "Thruster map", "Yaw model", "Validation", "Diagnosis", "Logs", "Runs set aside", "What to run next",
        "How this was made",
    ]  # fmt: skip
    model = json.loads((folder / "yaw" / "yaw_model.json").read_text(encoding="utf-8"))
    low, high = model["models"][model["preferred"]]["I_r"]["ci95"]
    first = page.text.partition("Thruster map")[2]
    said = re.search(r"I\s*r = ([\d.]+) \[([\d.]+), ([\d.]+)\]", first)
    assert (
        said
        and float(said[2]) == pytest.approx(low, abs=0.01)
        and float(said[3]) == pytest.approx(high, abs=0.01)
    )
    for words in (
        "Table 1. Identified yaw models: drag",
        "Table 2. Identified yaw models: inertia",
        "never moved",
    ):
        assert words in page.text
    assert "the commands of 1 run that was not fitted" in page.text
    assert "newtons" in page.text  # this diagnosis is of the thruster map


def test_no_name_becomes_markup(files: dict[str, str], page: Elements) -> None:
    assert len(page.all("script")) == 1 and page.all("script") == [{}]
    assert [e for e in page.elements if any(key.startswith("on") for key in e[1])] == []
    assert {tag for tag, _ in page.elements} & {
        "iframe",
        "object",
        "embed",
        "form",
        "base",
        "foreignobject",
    } == set()
    assert all((a.get("src") or "data:").startswith("data:") for a in page.all("img"))
    everything = " ".join([page.text, *(a.get("aria-label") or "" for a in page.all("svg"))])
    assert [name for name in HOSTILE if " ".join(name.split()) not in everything] == []
    assert "Pool day <2> & more" in page.text


def test_links_lead_somewhere_and_ids_are_unique(page: Elements) -> None:
    ids = [a["id"] for _, a in page.elements if "id" in a]
    assert len(ids) == len(set(ids))
    for tag, attributes in page.elements:
        target = attributes.get("href") or "#"
        if tag in ("a", "use"):
            assert target.startswith("#") and target[1:] in ids, (tag, target)
        for one in re.findall(r"url\(#([^)]*)\)", " ".join(value or "" for value in attributes.values())):
            assert one in ids


def test_every_figure_is_drawn_with_text_as_text_and_told_in_words(folder: Path, page: Elements) -> None:
    drawn = page.all("svg")
    assert len(drawn) == len(list(folder.glob("*/*.svg"))) >= 9
    assert all(a["role"] == "img" and len(a["aria-label"] or "") > 15 for a in drawn)
    assert "Steady yaw rate r [deg/s]" in page.text and "Time from the start of the run [s]" in page.text


def test_png_serves_where_no_svg_was_drawn(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder / "thrusters", tmp_path / "thrusters")
    (tmp_path / "thrusters" / "thrusters.svg").unlink()
    text = report_files(tmp_path)["report.html"]
    (image,) = Elements(text).all("img")
    assert (image["src"] or "").startswith("data:image/png;base64,") and "Thrust of one thruster" in (
        image["alt"] or ""
    )
    assert "Not in this report, for want of results: a look at the logs, a yaw model" in text


def test_refusals_say_what_to_do(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(
        OutputError, match=r"none of the folders check, thrusters, .* is here; give a folder that"
    ):
        report_files(tmp_path)
    shutil.copytree(folder / "yaw", tmp_path / "yaw")
    model = tmp_path / "yaw" / "yaw_model.json"
    model.write_text('{"schema": "automarine/yaw-model/1"}')
    with pytest.raises(OutputError, match=r"yaw/yaw_model.json: \w+ is missing; .* Run that step again"):
        report_files(tmp_path)
    model.write_text('{"schema": "other"}')
    with pytest.raises(
        OutputError, match=r"yaw/yaw_model.json: schema is 'other'; expected automarine/yaw-model/1"
    ):
        report_files(tmp_path)


def test_command_writes_beside_the_steps(folder: Path, tmp_path: Path, run: Callable[..., Result]) -> None:
    shutil.copytree(folder / "thrusters", tmp_path / "thrusters")
    done = run("report", tmp_path, "--json")
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["steps"] == ["thrusters"]
    assert {path.name for path in tmp_path.iterdir()} == {"thrusters", "report.html", "report.md"}
    again = run("report", tmp_path)
    assert again.exit_code == 1 and "give --overwrite to replace it" in again.stderr
    assert report(tmp_path, overwrite=True).files["report.md"] == (tmp_path / "report.md").read_text(
        encoding="utf-8"
    )


@pytest.mark.parametrize(
    ("verdict", "says"),
    [
        (
            "named",
            "The model lacks <strong>dead-band</strong>: with it the gap falls from 3.00 to 1.00 degrees (from 4.00",
        ),
        (
            "nothing-missing",
            "Nothing is missing that these runs could show: the gap is 3.00 degrees, the noise 0.90.",
        ),
        (
            "unexplained",
            "Something is missing that no effect of the library explains: the gap is 1.00 degrees",
        ),
    ],
)
def test_the_third_sentence_is_the_verdict(tmp_path: Path, verdict: str, says: str) -> None:
    gap = {"before_deg": 3.0, "after_deg": 1.0, "noise_floor_deg": 0.9}
    content = {
        "schema": "automarine/diagnosis/1", "verdict": verdict, "effects": [{"name": "dead-band"}],
        "gap": {"fitted_runs": gap, "held_out_runs": gap | {"before_deg": 4.0}}, "runs": {"used": 3, "set_aside": []},
    }  # fmt: skip
    (tmp_path / "diagnosis").mkdir()
    (tmp_path / "diagnosis" / "diagnosis.json").write_text(json.dumps(content))
    (paragraph,) = summary(read_steps(tmp_path))
    assert says in to_html(paragraph, lambda place, said: "").html


def test_markdown_is_text_whatever_it_holds() -> None:
    body = to_html(
        "# A <b>\n\nx \\*y\\* **z** `a<b` k_r\\|r\\| &lt; <i>\n\n| a | b |\n| --- | ---: |\n| \\| | 1 |\n",
        str,
    )
    assert '<h1 id="a-b">A &lt;b&gt;' in body.html
    assert (
        "<p>x *y* <strong>z</strong> <code>a&lt;b</code> <var>k</var><sub>r|r|</sub> &lt; &lt;i&gt;</p>"
        in body.html
    )
    assert '<th scope="row">|</th><td class="n">1</td>' in body.html


def test_an_svg_is_only_what_draws() -> None:
    text = (
        '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" viewBox="0 0 10 10" '
        'onload="alert(1)"><script>alert(2)</script><foreignObject><p/></foreignObject><style>*{}</style>'
        '<path id="p" d="M 0.123456 1" onclick="x()" style="fill: url(http://a.b/c)"/><a href="javascript:x()"><g/></a>'
        '<use xlink:href="#p" clip-path="url(#c)"/><use xlink:href="http://a.b/c#p"/><image href="http://a.b/c.png"/>'
        "<text>a &lt;script> b</text></svg>"
    )
    assert inline(text, "one-", 'say "hi" <now>') == (
        '<svg role="img" aria-label="say &quot;hi&quot; &lt;now&gt;" style="max-width:17px" viewBox="0 0 10 10">'
        '<path id="one-p" d="M 0.12 1"/><use href="#one-p" clip-path="url(#one-c)"/><use/>'
        "<image/>"
        "<text>a &lt;script&gt; b</text></svg>"
    )
    for bad in ("<html/>", "no", '<!DOCTYPE svg [<!ENTITY a "b">]><svg/>'):
        with pytest.raises(ValueError, match="SVG"):
            inline(bad, "", "")


def test_what_the_page_brings_is_small() -> None:
    folder = Path(am.__file__).parent / "report" / "html"
    assert (folder / "page.js").stat().st_size < 20_000 and (folder / "page.css").stat().st_size < 10_000
    assert "http" not in (folder / "page.js").read_text(encoding="utf-8").replace(
        "http://www.w3.org/2000/svg", ""
    )


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
    assert (
        shown.asked.count(path.as_uri()) == sum(address.startswith("file:") for address in shown.asked) == 1
    )
    assert shown.value("document.scrollingElement.scrollWidth") <= width
    said = shown.value(
        "document.querySelectorAll('details').forEach(d => { d.open = true }), document.body.innerText"
    )
    for words in (
        "Thruster map",
        "Table 1. Identified yaw models: drag",
        "never moved",
        HOSTILE[0],
        HOSTILE[4],
    ):
        assert words in said
    paper, ink = (
        sum(map(int, re.findall(r"\d+", shown.value(f"getComputedStyle(document.body).{one}"))))
        for one in ("backgroundColor", "color")
    )
    assert (paper < 100 and ink > 600) if dark else (paper > 700 and ink < 150)


class FirstFigure:
    """The first figure of the page in the middle of the window, and where its values stand on the screen."""

    def __init__(self, shown: Tab) -> None:
        figure = "document.querySelector('figure svg')"
        shown.value(f"{figure}.scrollIntoView({{block: 'center', behavior: 'instant'}})")
        self.shown = shown
        self.box = shown.value(
            f"(({{left, top, width, height}}) => [left, top, width, height])({figure}.getBoundingClientRect())"
        )
        self.panel = shown.value(f"JSON.parse({figure}.dataset.panels)[0]")
        self.size = [float(x) for x in shown.value(f"{figure}.getAttribute('viewBox')").split()[2:]]

    def place(self, x: float, y: float) -> tuple[float, float]:
        """Where a value stands on the screen."""
        left, top, right, bottom = self.panel["box"]
        (x0, x1), (y0, y1) = self.panel["x"], self.panel["y"]
        across, down = (
            left + (x - x0) / (x1 - x0) * (right - left),
            bottom - (y - y0) / (y1 - y0) * (bottom - top),
        )
        return self.box[0] + across / self.size[0] * self.box[2], self.box[1] + down / self.size[
            1
        ] * self.box[3]

    def said(self) -> list[float]:
        """The values that are shown beside the pointer; none where nothing is shown."""
        text = self.shown.value(
            "[...document.querySelectorAll('.says')].find(e => !e.hidden)?.textContent ?? ''"
        )
        lines = text.split("\n") if text else []
        assert [line.rpartition(": ")[0] for line in lines] in ([], self.panel["says"])
        return [float(line.rpartition(": ")[2].replace("−", "-")) for line in lines]

    def ticks(self) -> list[str]:
        """The ticks that a zoom has drawn."""
        return self.shown.value("[...document.querySelectorAll('.zoomed text')].map(e => e.textContent)")


def test_a_pointer_finds_values_and_draws_closer(tab: tuple[Tab, Path]) -> None:
    shown, path = tab
    shown.open(path)
    figure = FirstFigure(shown)
    shown.mouse("mouseMoved", *figure.place(-40.0, 4.0))
    assert figure.said() == pytest.approx([-40.0, 4.0], abs=0.5)
    start, end = figure.place(18.0, 1.0), figure.place(102.0, 1.0)
    shown.mouse("mousePressed", *start, button="left", buttons=1, clickCount=1)
    shown.mouse("mouseMoved", *end, button="left", buttons=1)
    shown.mouse("mouseReleased", *end, button="left", clickCount=1)
    assert figure.ticks() == ["20", "40", "60", "80", "100"]
    shown.value("[...document.querySelectorAll('figcaption button')].find(e => !e.hidden).click()")
    assert figure.ticks() == [] and shown.problems == []
    assert "point for values" in shown.value("document.querySelector('.hint').textContent")


@pytest.mark.parametrize("width", [820, 390])
def test_a_finger_finds_values_and_draws_closer_and_a_swipe_scrolls(
    tab: tuple[Tab, Path], width: int
) -> None:
    shown, path = tab
    shown.open(path, width=width, height=800, touch=True)
    figure = FirstFigure(shown)
    assert "tap for values" in shown.value("document.querySelector('.hint').textContent")

    def tap(x: float, y: float) -> None:
        shown.finger("touchStart", (x, y))
        shown.finger("touchEnd")

    tap(*figure.place(-40.0, 4.0))
    assert figure.said() == pytest.approx([-40.0, 4.0], abs=1.0)  # and it stays when the finger is gone
    assert (
        shown.value(
            "[...document.querySelectorAll('.says')].find(e => !e.hidden).getBoundingClientRect().left"
        )
        >= 0
    )

    across = "document.querySelector('figure').scrollLeft"
    scrolled, aside = shown.value("scrollY"), shown.value(across)
    shown.swipe(figure.place(-110.0, 1.0), figure.place(-26.0, 1.0), hold_s=0.6)
    assert figure.ticks() == ["−100", "−80", "−60", "−40"]
    # the page stays under a finger that has been held
    assert (shown.value("scrollY"), shown.value(across)) == (scrolled, aside)
    for _ in range(2):
        tap(*figure.place(0.0, 4.0))
    assert figure.ticks() == []

    before = figure.place(0.0, 1.0)
    shown.swipe(before, (before[0] + 3, before[1] - 200))
    assert figure.ticks() == []
    assert shown.value("new Promise(done => setTimeout(() => done(scrollY), 300))") > scrolled + 100
    tap(width / 2, 5.0)  # anywhere else takes the values away
    assert figure.said() == [] and shown.problems == []


def test_tables_are_copied_with_the_names_that_they_show(tab: tuple[Tab, Path]) -> None:
    shown, path = tab
    shown.open(path)
    shown("Browser.grantPermissions", permissions=["clipboardReadWrite", "clipboardSanitizedWrite"])
    shown.value(
        "[...document.querySelectorAll('.table')].find(e => /SSE/.test(e.textContent)).querySelector('button').click()"
    )
    assert shown.value(
        "new Promise(done => setTimeout(() => done(document.querySelectorAll('.table button').length), 300))"
    )
    copied = shown.value("navigator.clipboard.readText()")
    assert copied.splitlines()[0] == "Model\t1\t2\t3" and copied.splitlines()[1].startswith("k_r|r|\t–\t")


def test_very_long_tables_stay_in_their_folder(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("automarine_cli.report.campaign_page.MOST_ROWS", 3)
    text = report_files(folder)["report.md"]
    assert "Every run: see `check/check.md`." in text and "see `manifest.json`" in text
    assert "<details>" not in text
