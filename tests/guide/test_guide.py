"""The guide: every page is listed and shown, options come from the commands, and terminals page them."""

import json
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.shell_completion import ShellComplete
from click.testing import Result
from golden import OUTPUTS, read
from pseudo_terminal import ESCAPE, on_terminal
from test_readme import commands, flags_of

import automarine_cli as am
from automarine_cli import guide
from automarine_cli.commands import automarine
from automarine_cli.guide.search import Index, Section, alternatives, stems

Run = Callable[..., Result]
TOPICS = (*guide.commands(), *guide.pages())
BEST = {
    "6 DOF": "faq", "cite": "references", "confidence interval": "glossary", "dead band": "effects-gallery",
    "how many runs": "pool-day", "hydrodynamic coefficients": "published", "install": "install",
    "metacentric": "fit-roll", "never moved": "troubleshooting", "PyPI": "faq", "RMSE": "symbols", "rudder": "rudder",
    "simulink": "matlab", "swirl": "hidden-walk", "torque": "faq", "wrong sign": "units-and-signs",
}  # fmt: skip
"""What people search for, and the page that answers it."""


def test_the_list_has_every_page_and_each_says_what_it_is_about(run: Run) -> None:
    found = run("guide")
    on_disk = {path.stem for path in guide.FOLDER.rglob("*.md")}
    assert set(TOPICS) == on_disk | guide.ON_PAGE_OF.keys() and len(TOPICS) == len(set(TOPICS))
    for topic in TOPICS:
        (about,) = re.findall(rf"^{topic}  +(.+)$", found.stdout, flags=re.MULTILINE)
        assert len(about) >= 20
    assert [one["topic"] for one in json.loads(run("guide", "--json").stdout)["topics"]] == list(TOPICS)


@pytest.mark.parametrize("topic", TOPICS)
def test_every_page_is_plain_text_in_a_pipe(topic: str, run: Run) -> None:
    found = run("guide", topic)
    assert (found.exit_code, found.stderr) == (0, "")
    assert not re.search(r"\x1b|\*\*|\]\(|<img|^```", found.stdout, flags=re.MULTILINE)
    assert not re.search(r"(?<![\w.])\\[a-z]{2,}", found.stdout)  # no command of TeX is left
    prose = [line for line in found.stdout.splitlines() if not line.startswith("  ")]
    assert max(map(len, prose)) <= 100


@pytest.mark.parametrize("name", guide.commands())
def test_options_on_a_command_s_page_are_those_of_the_command(name: str, run: Run) -> None:
    section = run("guide", name).stdout.partition("\nOptions\n-------\n")[2]
    listed = section[: section.index("Show this message and exit.")]
    assert set(re.findall(r"(?<=[ ,])--[a-z][a-z-]*", listed)) <= flags_of(commands()[name]) | {"--help"}
    for param in commands()[name].params:
        if getattr(param, "hidden", False):
            continue
        shown = [flag for flag in (*param.opts, *param.secondary_opts) if flag.startswith("--")]
        assert all(flag in listed for flag in shown)
    pointer = guide.OPTIONS.format(command=guide.ON_PAGE_OF.get(name, name))
    assert guide.page(name).markdown.count(pointer) == 1


def test_a_wrong_topic_is_answered_with_near_ones(run: Run) -> None:
    found = run("guide", "fit_yew")
    assert found.exit_code == 1
    assert found.stderr.startswith("Error: the guide has no page 'fit_yew'; did you mean fit-yaw")
    assert len(found.stderr.splitlines()) == 1
    assert "try automarine guide --find qqq" in run("guide", "qqq").stderr
    assert "look at automarine effects dead-band" in run("guide", "dead-band").stderr


@pytest.mark.parametrize(("words", "page"), BEST.items())
def test_a_search_shows_the_best_page_first(words: str, page: str, run: Run) -> None:
    found = json.loads(run("guide", "--find", words, "--json").stdout)
    assert found["places"][0]["topic"] == page
    assert page in run("guide", "--find", words).stdout
    beginnings = {stem for term in found["words"] for stem in stems(term)}
    for place in found["places"]:
        assert any(stem in (place["line"] + place["heading"] + place["topic"]).lower() for stem in beginnings)


def test_a_search_knows_words_of_other_fields_and_beginnings() -> None:
    assert guide.find("torques").words == ("torques", "moment")
    assert guide.find("torque").places[1].topic == "units-and-signs"
    assert alternatives("RMSE of yaw") == ["rmse of yaw", "root mean square of yaw"]
    assert guide.find("metacent").places[0].topic == "fit-roll"


def test_a_rare_word_a_heading_and_a_phrase_are_worth_more() -> None:
    filler = "drag of the hull in water " * 9
    pages = [("a", "Drag", filler), ("b", "Hull", f"swirl drag {filler}"), ("c", "Water", f"{filler} water swirl")]
    index = Index([Section(page, heading, text) for page, heading, text in pages])
    assert [index.ranked(words)[0].page for words in ("drag", "swirl drag", "water swirl", "hull")] == [*"abcb"]
    assert index.ranked("zeppelin") == []


def test_a_search_without_a_page_says_so(run: Run) -> None:
    found = run("guide", "--find", "zeppelin")
    assert found.exit_code == 1 and found.stderr.startswith("Error: no page of the guide has 'zeppelin'; try another")
    assert run("guide", "logs", "--find", "torque").exit_code == 2


def test_the_shell_completes_topics() -> None:
    offered = ShellComplete(automarine, {}, "automarine", "_X").get_completions(["guide"], "fit-")
    assert [one.value for one in offered] == [name for name in TOPICS if name.startswith("fit-")]


def test_a_terminal_shows_a_page_in_the_pager(tmp_path: Path) -> None:
    pager = tmp_path / "pager"
    pager.write_text(f"#!{sys.executable}\nimport sys\nsys.stdout.write('PAGED ' + sys.stdin.read())\n")
    pager.chmod(0o755)
    status, said = on_terminal("guide", "verify", columns=60, PAGER=str(pager))
    assert status == 0
    assert said.startswith("PAGED ") and ESCAPE not in said  # an unknown pager gets no colours
    assert max(len(line) for line in said.splitlines() if not line.startswith("  ")) <= 60


def part(of: dict[str, Any], whole: dict[str, Any]) -> dict[str, Any]:
    """What `whole` has for the keys of `of`."""
    return {key: part(value, whole[key]) if isinstance(value, dict) else whole[key] for key, value in of.items()}


def test_the_model_to_copy_is_that_of_the_first_walk_and_predicts(tmp_path: Path) -> None:
    (text,) = re.findall(r"^```json\n(.*?)^```$", guide.page("results").markdown, flags=re.MULTILINE | re.DOTALL)
    model, path = json.loads(text), tmp_path / "yaw_model.json"
    assert part(model, json.loads(read(OUTPUTS / "fit-yaw.txt")["out/yaw/yaw_model.json"])) == model
    path.write_text(text, encoding="utf-8")
    end = am.predict(path, commands={"time_s": [0.0, 9.0], "tau": [0.6, 0.6]}).to_frame().iloc[-1]
    assert 0.0 < end.heading_deg_low < end.heading_deg < end.heading_deg_high
