"""What a search is entitled to say: names need more than chance, and runs that no fit saw."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from effect_contract import base_for, planted, short_plans

from automarine_cli import effects
from automarine_cli.diagnosis import diagnose, search
from automarine_cli.diagnosis import diagnose as verdicts
from automarine_cli.diagnosis.diagnose import Diagnosis, diagnose_runs, split_by
from automarine_cli.diagnosis.residual_regions import Region
from automarine_cli.diagnosis.scores import Scores
from automarine_cli.diagnosis.search import WEAK, AlternativeModel, CollinearPair, SearchResult
from automarine_cli.dofs import YAW
from automarine_cli.report.diagnosis_report import verdict_sentence
from automarine_cli.runs.run import Run

NAME, SMALL = "thrust-asymmetry", "gyro-drift"


def campaign(*names: str, seed: int = 1) -> list[Run]:
    return planted(base_for(NAME), *names, seed=seed, plans=short_plans())


def diagnosed(runs: list[Run], hold_out: list[Run], monkeypatch: pytest.MonkeyPatch, *among: str) -> Diagnosis:
    """Judged against few candidates, to be quick, and without curves, which explain what no law does."""
    monkeypatch.setattr(diagnose, "learn", lambda study, found, *rest: found)
    monkeypatch.setattr(
        search, "candidates",
        lambda study, model: [n for n in (NAME, SMALL) if n not in {t.name for t in model.terms}],
    )  # fmt: skip
    return diagnose_runs(runs, base_for(NAME), hold_out=hold_out)


def mirrored(run: Run) -> Run:
    return replace(run, position=-run.position, moment=-run.command)


def test_what_chance_reaches_now_and_then_is_suspected_and_not_added(monkeypatch: pytest.MonkeyPatch) -> None:
    bar = Scores.threshold
    monkeypatch.setattr(Scores, "threshold", lambda self, at: bar(self, at) if at >= WEAK else np.inf)
    found = diagnosed(campaign(SMALL), [], monkeypatch)
    assert found.verdict == "suspected" and [one.name for one in found.effects] == [SMALL]
    assert found.conclusion.leaves is found.result.base and "Chance would gain as much" in found.conclusion.why
    assert found.conclusion.why in verdict_sentence(found) and found.words == f"suspected {SMALL}"


def test_runs_that_contradict_a_name_take_it_back(monkeypatch: pytest.MonkeyPatch) -> None:
    held = [mirrored(run) for run in campaign(NAME, seed=2)[:6]]  # of a vehicle with the other side the weaker one
    found = diagnosed(campaign(NAME), held, monkeypatch)
    assert found.verdict == "unexplained" and found.effects == () and found.result.final is found.result.base
    assert "makes the held-out runs worse" in found.conclusion.why and NAME in found.conclusion.why
    assert found.gap.after == found.gap.before and found.conclusion.why in verdict_sentence(found)


def test_runs_that_agree_let_it_stand(monkeypatch: pytest.MonkeyPatch) -> None:
    found = diagnosed(campaign(NAME), campaign(NAME, seed=2)[:6], monkeypatch)
    assert found.verdict == "named" and found.conclusion.why == found.conclusion.remainder == ""
    assert found.conclusion.leaves is found.result.final


def test_what_stays_beside_a_name_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    tied = [
        replace(run, position=run.position + np.radians(1.2) * np.sin(0.9 * (run.time - run.time[0])))
        for run in campaign(NAME, seed=2)[:6]
    ]
    found = diagnosed(campaign(NAME), tied, monkeypatch)
    assert found.verdict == "named" and "A residual remains" in found.conclusion.remainder
    assert f"{found.held_out_gap.after / found.held_out_gap.floor:.1f} times" in verdict_sentence(found)  # type: ignore[union-attr]


def test_a_variable_that_stands_out_is_named_where_no_effect_gains(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = [
        replace(run, position=run.position + np.radians(1.5) * np.sin(2.0 * (run.time - run.time[0])))
        for run in campaign(seed=3)
    ]
    found = diagnosed(runs, [], monkeypatch)
    assert found.verdict == "unexplained" and found.where.regions
    why = found.conclusion.why
    assert found.where.regions[0].variable in why and "No effect of the library" in why


def test_effects_that_undo_each_other_are_only_suspected(monkeypatch: pytest.MonkeyPatch) -> None:
    pair = CollinearPair((NAME, SMALL), 0.93, 0.1)
    monkeypatch.setattr(search, "compensating", lambda *of: (pair,))
    found = diagnosed(campaign(NAME), [], monkeypatch)
    assert found.verdict == "suspected" and found.conclusion.why == pair.says and "93" in pair.says.replace(".", "")
    assert found.conclusion.leaves is found.result.base


@pytest.mark.slow
def test_effects_that_undo_each_other_keep_their_names_where_runs_held_out_are_followed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pair = CollinearPair((NAME, SMALL), 0.93, 0.1)
    monkeypatch.setattr(search, "compensating", lambda *of: (pair,))
    found = diagnosed(campaign(NAME), campaign(NAME, seed=2)[:6], monkeypatch)
    assert found.verdict == "named" and found.conclusion.leaves is found.result.final


def test_nothing_is_missing_only_where_nothing_stands_out(monkeypatch: pytest.MonkeyPatch) -> None:
    runs, look = campaign(), diagnose.find_where
    assert diagnosed(runs, [], monkeypatch).verdict == "nothing-missing"
    region = Region("voltage", 12.0, 13.0, "V", 0.01, 0.009, ("run_00",), 0.2, "thrust")
    monkeypatch.setattr(diagnose, "find_where", lambda *of: replace(look(*of), regions=(region,)))
    found = diagnosed(runs, [], monkeypatch)
    assert found.verdict == "unexplained" and "voltage is 12 to 13 V" in found.conclusion.why


@pytest.mark.parametrize(("behind", "tied"), [((0.5, 1.0), True), ((3.0, 8.0), False)])
def test_a_name_that_its_rivals_outweigh_is_a_tie(behind: tuple[float, ...], tied: bool) -> None:
    blank: Any = SimpleNamespace(counted=(NAME,))
    rivals = tuple(AlternativeModel(NAME, f"other-{far:g}", far, blank) for far in behind)
    said = verdicts._no_name(SearchResult(blank, blank, blank, (), {}, rivals), None)
    assert ("A tie" in said) == tied and all((rival.name in said) == tied for rival in rivals)


@pytest.mark.parametrize(
    ("name", "rival", "text_of"),
    [
        ("dead-band", "coulomb-drag", "dead-band"),  # lists its rival among its look-alikes
        ("water-swirl", "wall", "wall"),
    ],
)
def test_the_card_of_the_look_alike_says_what_tells_two_effects_apart(name: str, rival: str, text_of: str) -> None:
    assert (rival in effects.get(name).mistaken_for) == (text_of == name)
    assert split_by(name, rival, YAW) == effects.get(text_of).card(YAW).separated_by
