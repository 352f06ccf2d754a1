"""What a search is entitled to say: names need more than chance, and runs held out."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from effect_contract import Plan, base_for, long_plans, measured, planted, short_plans, unmeasured
from few_candidates import few_candidates
from made_driven import Sea, steered, turned
from scipy import signal, special

from automarine_cli import effects
from automarine_cli.diagnosis import diagnose, search, verdict
from automarine_cli.diagnosis.diagnose import Diagnosis, NamedRival, diagnose_runs, split_by
from automarine_cli.diagnosis.residual_regions import Gap, Region, gap_ahead
from automarine_cli.diagnosis.scores import Scores, score
from automarine_cli.diagnosis.search import SearchResult, SearchStep, compensating
from automarine_cli.diagnosis.study import DiagnosisProblem, study_of
from automarine_cli.diagnosis.trials import CandidateFit, all_refitted, attempt_with, candidate_fit, refitted
from automarine_cli.diagnosis.verdict import CONFIRMED, Share, confirmed, shares, support
from automarine_cli.dofs import YAW
from automarine_cli.filters.kalman import Predicted
from automarine_cli.fits.innovations import whitening_gain
from automarine_cli.models.model import Model
from automarine_cli.report.diagnosis_report import verdict_sentence
from automarine_cli.runs.run import Run

NAME, SMALL = "thrust-asymmetry", "gyro-drift"


Judge = Callable[..., Diagnosis]


def campaign(*names: str, seed: int = 1, wave: tuple[float, float] = (0.0, 0.0)) -> list[Run]:
    """Runs with these effects, and with a wave of so many degrees and rad/s on their headings."""
    runs = planted(base_for(NAME), *names, seed=seed, plans=short_plans())
    size, rate = np.radians(wave[0]), wave[1]
    return [replace(run, position=run.position + size * np.sin(rate * (run.time - run.time[0]))) for run in runs]


SEARCHES = dict[bytes, SearchResult]()


@pytest.fixture
def diagnosed(monkeypatch: pytest.MonkeyPatch) -> Iterator[Judge]:
    """Judged against few candidates, to be quick, and without curves, which explain what no law does; runs that several
    tests judge are searched once, unless the search itself is another one."""
    every, compared = search.search, search.compensating

    def once(study: DiagnosisProblem, *how: Any) -> SearchResult:
        key = b"".join(run.position.tobytes() for run in study.runs)
        if search.compensating is not compared:
            return every(study, *how)
        if key not in SEARCHES:
            SEARCHES[key] = every(study, *how)
        return SEARCHES[key]

    monkeypatch.setattr(diagnose, "search", once)
    with few_candidates({NAME, SMALL}, curves=False):
        yield lambda runs, hold_out=(): diagnose_runs(runs, base_for(NAME), hold_out=hold_out)


@pytest.mark.slow
@pytest.mark.parametrize(("steadier", "expected"), [(-1.0, "named"), (1.0, "suspected")])
def test_a_name_that_changes_nothing_is_only_suspected(
    steadier: float, expected: str, diagnosed: Judge, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Held-out errors that do not fall, with a thrust that scatters as before: more likely runs alone make no name."""
    gap = verdict.gap
    monkeypatch.setattr(verdict, "gap", lambda *of, **how: replace(gap(*of, **how), before=1e-4, after=1e-4))
    monkeypatch.setattr(verdict, "STEADIER", steadier)
    assert diagnosed(campaign(NAME), campaign(NAME, seed=2)[:6]).verdict == expected


def test_what_chance_reaches_now_and_then_is_only_suspected(diagnosed: Judge, monkeypatch: pytest.MonkeyPatch) -> None:
    bar = Scores.threshold
    monkeypatch.setattr(Scores, "threshold", lambda self, at: bar(self, at) if at >= search.WEAK else np.inf)
    found = diagnosed(campaign(SMALL))
    assert found.verdict == "suspected" and [effect.name for effect in found.effects] == [SMALL]
    assert not found.extended["effects"] and "Chance would gain as much" in found.why
    assert found.why in verdict_sentence(found)


@pytest.mark.slow
def test_runs_that_contradict_a_name_take_it_back(diagnosed: Judge) -> None:
    kept = [turned(run) for run in campaign(NAME, seed=2)[:6]]  # of a vehicle with the other side the weaker one
    found = diagnosed(campaign(NAME), kept)
    assert found.verdict == "unexplained" and found.effects == () and found.search.final is found.search.base
    assert "makes the held-out runs worse" in found.why and NAME in found.why
    assert found.fitted.gap.after == found.fitted.gap.before and found.why in verdict_sentence(found)


@pytest.mark.slow
def test_runs_that_agree_let_it_stand(diagnosed: Judge) -> None:
    found = diagnosed(campaign(NAME), campaign(NAME, seed=2)[:6])
    assert found.verdict == "named" and found.why == found.remainder == "" and found.extended["effects"]


def test_what_stays_beside_a_name_is_said(diagnosed: Judge) -> None:
    found = diagnosed(campaign(NAME), campaign(NAME, seed=2, wave=(1.2, 0.9))[:6])
    assert found.verdict == "named" and "A residual remains" in found.remainder
    assert f"{found.held_out.gap.after / found.held_out.gap.floor:.1f} times" in verdict_sentence(found)
    rivals = NamedRival("thruster-lag", 0.46, ""), NamedRival(SMALL, 0.01, "")
    close = replace(found, effects=(replace(found.effects[0], confidence=0.53, rivals=rivals),))
    assert verdict_sentence(close).startswith(f"Named: {NAME} (53 %) or thruster-lag (46 %). ")
    doubted = replace(found, effects=(replace(found.effects[0], confidence=0.62),))
    assert verdict_sentence(doubted).startswith(f"Named: {NAME} (62 %). ")
    assert verdict_sentence(found).startswith(f"Named: {NAME}. ")
    assert verdict_sentence(replace(close, verdict="suspected")).startswith(f"Suspected, not named: {NAME}.")


def test_a_drift_of_thrust_hides_an_effect_only_where_it_is_no_trifle(
    diagnosed: Judge, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(verdict, "gains_drift", lambda *of: True)
    monkeypatch.setattr(verdict, "LEFT_OVER", 0.0)  # the effect leaves the scatter of thrust as it was
    kept = campaign(NAME, seed=2, wave=(1.2, 0.9))[:6]
    named = diagnosed(campaign(NAME), kept)
    assert named.verdict == "named" and "drifts over the campaign more than chance allows" in named.remainder
    monkeypatch.setattr(verdict, "MIN_DRIFTING_SCATTER", 0.0)
    hidden = diagnosed(campaign(NAME), kept)
    assert hidden.verdict == "unexplained" and "drifts over the campaign" in hidden.why and NAME in hidden.why


def test_a_variable_that_stands_out_is_named_where_no_effect_gains(diagnosed: Judge) -> None:
    found = diagnosed(campaign(seed=1, wave=(1.5, 2.0)))
    assert found.verdict == "unexplained" and found.where.regions
    assert found.where.regions[0].variable in found.why and "No effect of the library" in found.why


@pytest.mark.slow
@pytest.mark.parametrize("followed", [False, True])
def test_effects_that_undo_each_other_keep_their_names_only_where_runs_held_out_are_followed(
    followed: bool, diagnosed: Judge, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(search, "compensating", lambda *of: {(NAME, SMALL): "They undo each other."})
    found = diagnosed(campaign(NAME), campaign(NAME, seed=2)[:6] if followed else [])
    assert (found.verdict, found.why) == (("named", "") if followed else ("suspected", "They undo each other."))
    assert bool(found.extended["effects"]) == followed


def test_nothing_is_missing_only_where_nothing_stands_out(diagnosed: Judge, monkeypatch: pytest.MonkeyPatch) -> None:
    runs, look = campaign(), diagnose.find_where
    assert diagnosed(runs).verdict == "nothing-missing"
    region = Region("voltage", 12.0, 13.0, "V", 0.01, 0.009, ("run_00",), 0.2, "thrust")
    monkeypatch.setattr(diagnose, "find_where", lambda *of: replace(look(*of), regions=(region,)))
    found = diagnosed(runs)
    assert found.verdict == "unexplained" and "voltage is 12 to 13 V" in found.why


@pytest.mark.parametrize(("behind", "tied"), [((0.5, 1.0), True), ((3.0, 8.0), False)])
def test_a_name_that_its_rivals_outweigh_is_a_tie(behind: tuple[float, ...], tied: bool) -> None:
    blank: Any = SimpleNamespace(counted=(NAME,), feigned=0.0)
    rivals = {NAME: {f"other-{far:g}": far for far in behind}}
    why = verdict._no_name(SearchResult(blank, blank, blank, (), {}, rivals), None)
    assert ("A tie" in why) == tied and all((rival in why) == tied for rival in rivals[NAME])


@pytest.mark.parametrize(("name", "rival", "text_of"), [
    ("dead-band", "coulomb-drag", "dead-band"),  # lists its rival among its look-alikes
    ("water-swirl", "wall", "wall"),
])  # fmt: skip
def test_the_card_of_the_look_alike_says_what_tells_two_effects_apart(name: str, rival: str, text_of: str) -> None:
    assert (rival in effects.get(name).mistaken_for) == (text_of == name)
    assert split_by(name, rival, YAW) == effects.get(text_of).card(YAW).separated_by


def chance_over_odds(random: np.random.Generator, size: float) -> float:
    """The p-value of the best of 30 effects, of which the first is there in a size, in 24 runs of unit noise, over its
    odds in 8 runs held out."""
    fitted, held_out = random.standard_normal((24, 30)), random.standard_normal((8, 30))
    fitted[:, 0] += size
    held_out[:, 0] += size
    z = np.sqrt(24) * fitted.mean(axis=0)
    best = int(np.argmax(np.abs(z)))
    gained = 0.5 * (held_out[:, best] ** 2 - (held_out[:, best] - fitted[:, best].mean()) ** 2)
    p_value = -np.expm1(30 * np.log1p(-2.0 * special.ndtr(-abs(z[best]))))
    return float(p_value / np.exp(support(gained)))


def test_runs_held_out_bear_out_what_is_there_and_chance_at_most_at_the_rate_stated() -> None:
    draws = {size: np.empty(2000) for size in (0.0, 1.5)}
    for seed in range(4):
        random = np.random.default_rng(seed)
        for size, ratios in draws.items():
            ratios[500 * seed : 500 * (seed + 1)] = [chance_over_odds(random, size) for _ in range(500)]
    for level in (0.05, 0.01, CONFIRMED):
        assert np.mean(draws[0.0] <= level) <= level + 2.0 * np.sqrt(level / 2000)
    assert np.mean(draws[1.5] <= CONFIRMED) > 0.99


@pytest.mark.parametrize(
    ("part", "doubt"),
    [
        ({"support": 10.0, "gap": Gap(3.0, 2.0, 1.0)}, ""),
        (
            {"support": 1.9, "gap": Gap(3.0, 2.5, 1.0)},
            "6.7 times as likely with it as without it: a name takes at least 9.",
        ),
        ({"support": 0.1, "gap": Gap(3.0, 2.5, 1.0), "p_value": CONFIRMED}, ""),
        ({"support": -3.0, "gap": Gap(3.0, 1.5, 1.0)}, ""),  # some runs hold something else: most of the error is gone
        ({"support": 10.0, "gap": Gap(3.0, 2.95, 1.0)}, "closes 4 % of the held-out error above the noise"),
        ({"support": 10.0, "gap": Gap(3.0, 2.95, 1.0), "unexplained": 12.0}, "closes 4 %"),
        ({"support": 10.0, "gap": Gap(3.0, 2.95, 1.0), "unexplained": 3.0}, ""),  # what is left is chance
        ({"support": 10.0, "gap": Gap(3.0, 2.95, 1.0), "steadier": 0.01}, ""),  # the gains of single runs had hidden it
        ({"support": 10.0, "gap": Gap(1.2, 1.19, 1.0)}, ""),  # so near the noise no share is known
        ({"support": 10.0, "gap": Gap(3.0, 2.0, 1.0), "may_be_nothing": True}, "holds zero"),
        ({}, ""),
    ],
)
def test_a_name_is_borne_out_by_itself_or_says_what_it_lacks(part: dict[str, Any], doubt: str) -> None:
    blank: Any = None
    says = Share(blank, 30.0, **{"p_value": 0.0045, **part}).doubt("it")
    assert doubt in says and bool(doubt) == bool(says)


def test_innovations_that_foretell_each_other_leave_something_unexplained_and_white_ones_do_not() -> None:
    """An autoregression with a share of 0.3 gains 0.5 log(1 / (1 - 0.3²)) for each reading."""
    white = np.random.default_rng(0).standard_normal((4, 800))
    variance, time = np.full(white.shape, 4.0), np.tile(0.5 * np.arange(800), (4, 1))
    variance[:, ::7] = 0.0  # nothing was read
    assert -4.0 <= whitening_gain(2.0 * white, variance, time) < 4.0
    coloured = signal.lfilter([1.0], [1.0, -0.3], white)
    gained = 0.5 * white.size * np.log(1.0 / (1.0 - 0.3**2))
    assert whitening_gain(coloured, np.ones(white.shape), time) == pytest.approx(gained, rel=0.2)


def test_an_effect_below_the_noise_is_said_to_be_small_unless_thrust_is_steadier_with_it() -> None:
    blank: Any = None
    noise = np.radians(np.random.default_rng(0).standard_normal((4, 200)))
    for change_deg, steadier, small in ((0.3, 0.0, True), (0.3, 0.01, False), (1.5, 0.0, False)):
        runs = Gap(1.1, 1.0, np.radians(1.0), residuals=(noise + np.radians(change_deg), noise))
        says = verdict.smallness(YAW, runs, Share(blank, 30.0, 0.0, steadier))
        assert says == ("It is small: it changes the heading by 0.3 deg, and the noise is 1 deg." if small else "")
    none = Gap(np.nan, np.nan, np.radians(1.0), residuals=(noise[0, :0], noise[0, :0]))  # no run is long enough
    assert not verdict.smallness(YAW, none, Share(blank, 30.0, 0.0, 0.0))


@pytest.mark.parametrize(("length", "horizon"), [(9, 5.0), (4, 2.0), (1, 2.0)])
def test_the_gap_of_driven_runs_is_that_of_their_predictions(length: int, horizon: float) -> None:
    """Over 5 s, over 2 s where no run is longer, not a number where none is as long as that; nodes a second apart."""

    def predicted(size: float) -> list[Predicted]:
        every = []
        for h in (2, 5, 15):
            origin = np.arange(max(length - h, 0))
            error = size * np.cos(origin + 1.0)
            every.append(Predicted(float(h), 0 * origin, origin, origin + h, error, error, error))
        return every

    course: Any = SimpleNamespace(time=np.arange(float(length))[None])
    runs = gap_ahead(course, predicted(3.0), predicted(1.0), 0.1)
    count = max(length - int(horizon), 0)
    assert runs.horizon == horizon and [len(off) for off in runs.residuals] == [count, count]
    assert runs.targets is not None and runs.targets[1].tolist() == [*range(int(horizon), length)]
    sizes = [float(np.sqrt((off**2).sum() / count)) if count else np.nan for off in runs.residuals]
    assert [runs.before, runs.after] == pytest.approx(sizes, nan_ok=True)
    assert runs.exceeds_noise == bool(count) and not runs.little(0.1)
    assert runs.to_json("deg")["horizon_s"] == horizon and (runs.to_json("deg")["before_deg"] is None) == (not count)


@pytest.mark.parametrize(
    ("after", "doubt"), [(4.0, ""), (5.3, "closes 4 % of the error of the fitted runs"), (5.5, " 0 %")]
)
def test_where_no_run_is_held_out_a_name_predicts_the_fitted_ones_better(
    after: float, doubt: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A learned curve was named with which the heading was predicted worse than without it."""
    judged = SimpleNamespace(gap=Gap(5.4, after, 0.1))
    monkeypatch.setattr(verdict, "judged_runs", lambda *_, fitted: judged)
    result: Any = SimpleNamespace(study=SimpleNamespace(driven=True), base=None, final=None)
    why = verdict._borne_out(result, None, None)
    assert why.startswith("No run is held out, and what was added") == bool(doubt) and doubt in why


@pytest.mark.parametrize(
    ("gained", "feigned", "doubted"), [(30.0, 108.0, True), (1060.0, 108.0, False), (30.0, 0.0, False)]
)
def test_what_a_loop_of_an_unlogged_gyro_feigns_is_only_suspected(gained: float, feigned: float, doubted: bool) -> None:
    """Together, effects that gain little alone gained 230: each counts by itself."""
    alone, pair = (SimpleNamespace(added=names, evidence=0.0) for names in ((NAME,), (NAME, SMALL)))
    first = SimpleNamespace(trials=[pair, alone], gain=lambda trial: gained if trial is alone else 1e9)
    base = SimpleNamespace(evidence=1e9)
    result: Any = SimpleNamespace(rounds=[first], study=SimpleNamespace(feigned=feigned), base=base, final=pair)
    why = verdict._feigned(result, NAME)
    assert bool(why) == doubted and (f"{NAME} by itself gains 30. Log all" in why) == doubted
    part = Share(result, gained, 1e-9, support=100.0, gap=Gap(5.0, 1.0, 0.1), feigned=why)
    assert part.doubt(NAME) == why


def test_names_stand_in_the_order_of_what_they_explain_and_each_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three effects found in one order, of which the second is the largest, and runs held out know nothing of the
    first."""
    lost, odds = {NAME: 25.0, "dead-band": 900.0, SMALL: 40.0}, {NAME: 0.2, "dead-band": 5.0, SMALL: 0.5}
    blank: Any = SimpleNamespace(driven=False, feigned=0.0)

    def trial(*names: str) -> CandidateFit:
        fit: Any = SimpleNamespace(density=np.full(8, sum(odds[name] for name in names)), factor=lambda _: 0.0)
        return CandidateFit(names, blank, fit, 1000.0 - sum(lost[name] for name in names))

    monkeypatch.setattr(verdict, "without", lambda _, final, out: trial(*(name for name in final.added if name != out)))
    monkeypatch.setattr(verdict, "log_density", lambda _, __, fit: fit.density)
    monkeypatch.setattr(verdict, "gap", lambda *_: Gap(1.0, 1.0, 1.0))
    found = SearchResult(blank, trial(), trial(*lost), (), dict.fromkeys(lost, 0.0045), {NAME: {"wall": 1.0}})
    assert list(shares(found, None)) == ["dead-band", SMALL, NAME]
    result, parts, suspected = confirmed(found, blank)
    assert result.final.added == ("dead-band", SMALL) and list(parts) == ["dead-band", SMALL]
    assert list(suspected) == [NAME] and NAME not in result.rivals


@pytest.mark.parametrize(("evidence", "moved", "mends"), [(6.0, 0.1, True), (6.0, 3.0, False), (60.0, 0.1, False)])
def test_a_small_effect_beside_a_large_one_may_only_mend_its_law(
    evidence: float, moved: float, mends: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One within the noise that brings under a fiftieth of what both gain: a law a seventh off leaves as much."""
    fit: Any = SimpleNamespace(density=np.zeros(8), factor=lambda _: 0.0)
    blank: Any = SimpleNamespace(driven=False, feigned=0.0, base=SimpleNamespace(dof=YAW))
    least = {"dead-band": 900.0, SMALL: evidence}
    both = CandidateFit(tuple(least), blank, fit, 0.0)
    monkeypatch.setattr(verdict, "without", lambda _, __, out: CandidateFit((out,), blank, fit, least[out]))
    monkeypatch.setattr(verdict, "log_density", lambda _, __, fit: fit.density)
    gap = Gap(1.0, 1.0, 1.0, (np.full((1, 9), 1.0 + moved), np.ones((1, 9))))
    monkeypatch.setattr(verdict, "gap", lambda *_: gap)
    base = CandidateFit((), blank, fit, 900.0 + evidence)
    parts = shares(SearchResult(blank, base, both, (), dict.fromkeys(least, 0.0), {}), blank)
    assert bool(parts[SMALL].mends) == mends and not parts["dead-band"].mends
    assert parts[SMALL].doubt(SMALL).endswith("perhaps the law of dead-band is a little off.") == mends


# Several effects that are one in disguise, and effects that undo each other

BASE = base_for("")


def each(function: Callable[[Any], Any], work: Sequence[Any], label: str) -> list[Any]:
    return [function(one) for one in work]


def study_with(truth: Model, plans: Sequence[Plan]) -> tuple[DiagnosisProblem, CandidateFit]:
    """Runs of a vehicle of that truth, and the base fitted to them."""
    runs = [unmeasured(plan, i) for i, plan in enumerate(plans)]
    study = study_of(measured(truth, runs, seed=4, gain=0.005), BASE)
    return study, candidate_fit(study, BASE, (), study.fit(BASE))


def first_step(study: DiagnosisProblem, base: CandidateFit, names: list[str], *trials: CandidateFit) -> SearchStep:
    return SearchStep(base, score(study, BASE, base.fit, names, 0), trials, 0.0)


def grown(study: DiagnosisProblem, base: CandidateFit, *added: tuple[str, tuple[float, ...]]) -> CandidateFit:
    trial: CandidateFit | None = base
    for name, start in added:
        assert trial is not None
        trial = refitted(study, *attempt_with(trial, (name, np.array(start))))
    assert trial is not None
    return trial


@pytest.mark.slow
def test_a_lag_of_the_thrust_takes_the_place_of_what_imitates_it() -> None:
    plans = [[(-m, s) for m, s in plan] for plan in long_plans()[::2]]
    study, base = study_with(BASE.with_effect("thruster-lag", (0.4, 1.0)), plans)
    delay, slow = ("input-delay", (0.2, 0.0, 0.1)), ("sensor-lag", (0.2,))
    several, trials = grown(study, base, delay, slow), (grown(study, base, delay), grown(study, base, slow))
    first = first_step(study, base, ["input-delay", "sensor-lag", "thruster-lag"], *trials)
    found = search.single_effect_alternative(study, several, first, each)
    assert found.added == ("thruster-lag",) and found.model.terms[-1].values[1] == 1.0
    assert found.model.terms[-1].values[0] == pytest.approx(0.4, abs=0.05)
    assert search.single_effect_alternative(study, found, first, each) is found


@pytest.mark.slow
def test_two_that_are_both_there_stay() -> None:
    truth = BASE.with_effect("thruster-lag", (0.4,)).with_effect("bias-moment", (0.08,))
    study, base = study_with(truth, long_plans()[1::4])
    lag, bias = ("thruster-lag", (0.2, 0.0, 1.2, 1.0)), ("bias-moment", (0.03,))
    both, trials = grown(study, base, lag, bias), (grown(study, base, lag), grown(study, base, bias))
    first = first_step(study, base, ["bias-moment", "thruster-lag", "input-delay"], *trials)
    assert search.single_effect_alternative(study, both, first, each) is both
    assert compensating(study, base, both) == {}


@pytest.mark.parametrize("sign", [1, -1])
def test_effects_that_undo_each_other_are_told(sign: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Sizes of opposite pull, 100 in deviance gained together: told where neither gains half of it alone."""
    study, base = study_with(BASE, long_plans()[:2])
    model = BASE.with_effect("bias-moment", (0.1 * sign,)).with_effect("gyro-drift", (-0.05 * sign,))
    both = CandidateFit(("bias-moment", "gyro-drift"), model, base.fit, base.evidence - 100.0)
    covariance = np.eye(4)
    monkeypatch.setattr(DiagnosisProblem, "covariance", lambda *_: covariance)
    for correlation, gain, told in ((0.95, 20.0, True), (0.3, 20.0, False), (0.95, 70.0, False)):
        covariance[2, 3] = covariance[3, 2] = -correlation  # the more bias, the more drift has to hide it
        alone = replace(both, evidence=base.evidence - gain)
        monkeypatch.setattr(search, "without", lambda *_, alone=alone: alone)
        pairs = compensating(study, base, both)
        assert bool(pairs) == told
        assert not told or "undo each other (correlation 0.95; alone either gains at most 20 % of" in pairs[both.added]
    assert compensating(study, base, replace(both, added=("bias-moment",))) == {}


def test_attempts_on_driven_runs_are_fitted_side_by_side_as_each_alone() -> None:
    """Those that differ in what acts on commands or in drag together; an attempt that leads nowhere keeps no other from
    it."""
    study = DiagnosisProblem(tuple(steered(3, 1, Sea(delay=0.3), length=12.0)), BASE, True, ())
    base = candidate_fit(study, BASE, (), study.fit(BASE))
    starts = {"input-delay": (0.2, 0.0, 0.1), "linear-drag": (0.1,), "sensor-lag": (0.1,)}
    attempts = [attempt_with(base, (name, np.array(start))) for name, start in starts.items()]
    model, added, values, fit = attempts[0]
    attempts.append((model, added, np.array([np.nan, *values[1:]]), fit))
    batches: list[int] = []

    def counted(function: Callable[[Any], Any], work: Sequence[Any], label: str) -> list[Any]:
        batches.extend(map(len, work))
        return each(function, work, label)

    together = all_refitted(study, attempts, 2, counted, "")
    assert batches == [3, 1] and together[3] is None
    alone = DiagnosisProblem(study.runs, BASE, True, ())
    for attempt, trial in zip(attempts[:3], together):
        same = refitted(alone, *attempt, 2)
        assert trial is not None and same is not None and trial.added == attempt[1]
        assert trial.evidence == same.evidence and trial.model == same.model
