"""Effects hidden in small campaigns, and what a diagnosis makes of them.

Judging one effect against the whole library takes seconds, which twenty-three times are too many here: each is judged
against the effects that it is mistaken for, on either card, and a few campaigns against the whole library. `make blind`
does all of it on large campaigns, with equations of its own.
"""

from collections.abc import Sequence
from functools import cache

import numpy as np
import pytest
from effect_contract import base_for, measured, mirrored_signs, planted, short_plans, unmeasured
from few_candidates import few_candidates
from made_campaigns import rescaled, shifted
from made_driven import turned

from automarine_cli import effects
from automarine_cli.diagnosis.diagnose import Diagnosis, diagnose_runs
from automarine_cli.dofs import YAW
from automarine_cli.models.model import Model
from automarine_cli.runs.run import Run

pytestmark = pytest.mark.slow
IN_YAW = [name for name in effects.names() if effects.get(name).acts_in(YAW)]


def look_alikes(name: str) -> set[str]:
    """The effect, those that it is mistaken for, and those that are mistaken for it."""
    return {name, *effects.get(name).mistaken_for} | {
        other for other in effects.names() if name in effects.get(other).mistaken_for
    }


def judge(runs: Sequence[Run], base: Model, among: set[str] | None = None) -> Diagnosis:
    """A diagnosis that fits all runs and tries the candidates `among`, or all and curves."""
    with few_candidates(effects.names() if among is None else among, curves=among is None):
        return diagnose_runs(runs, base, hold_out=[])


def campaign(*names: str, seed: int = 1) -> list[Run]:
    """A small campaign with these effects in it: 14 runs of 6 to 12 s."""
    return planted(base_of(names[0] if names else ""), *names, seed=seed, plans=short_plans())


def base_of(name: str) -> Model:
    """The vehicle in which an effect is hidden, with a rudder beside its thrusters for what needs one there."""
    beside = name != "" and effects.get(name).steered is False
    return base_for("").with_effect("rudder", (0.5, 2.0, 0.5)) if beside else base_for(name)


def held(found: Diagnosis) -> list[set[str]]:
    """For each effect named, its name and those of its rivals."""
    return [{one.name, *(rival.name for rival in one.rivals)} for one in found.effects]


@pytest.mark.parametrize("name", IN_YAW)
def test_planted_effect_gives_its_name_or_a_tie_that_holds_it(name: str) -> None:
    found = judge(campaign(name), base_of(name), look_alikes(name))
    assert found.verdict == "named"
    assert [name in tie for tie in held(found)] == [True], held(found)
    assert found.fitted.gap.after < found.fitted.gap.before and found.fitted.gap.after < 1.05 * found.fitted.gap.floor


@pytest.mark.parametrize("seed", [1, 2])
def test_nothing_planted_nothing_named(seed: int) -> None:
    found = judge(campaign(seed=seed), base_for(""))
    assert (found.verdict, found.effects) == ("nothing-missing", ())
    assert set(found.detectable) == set(IN_YAW) - {"quadratic-drag"}
    assert all(0 < size < np.inf for size in found.detectable.values())


def test_a_tether_that_snags_is_not_in_the_library() -> None:
    """Now and then something holds the vehicle for a few seconds: no name fits, and none is given."""
    random = np.random.default_rng(5)
    plans = (*short_plans()[:4], *short_plans()[8:12])  # half of the runs: curves over every column take their time
    runs = [unmeasured(plan, i) for i, plan in enumerate(plans)]
    snagged = measured(base_for(""), runs, seed=5, snag=lambda shape: -0.25 * (random.uniform(size=shape) < 0.3))
    found = judge(snagged, base_for(""))
    assert (found.verdict, found.effects) == (
        "unexplained",
        (),
    ) and found.fitted.gap.after > 1.5 * found.fitted.gap.floor


@cache
def of_bias() -> Diagnosis:
    """The diagnosis of the logs as they were made."""
    return judge(campaign("bias-moment"), base_for(""), look_alikes("bias-moment"))


@pytest.mark.parametrize("units", [False, True], ids=["mirrored, in another order", "by another clock, in other units"])
def test_the_same_data_told_otherwise_give_the_same(units: bool) -> None:
    runs, effect, there, ten = campaign("bias-moment"), effects.get("bias-moment"), of_bias(), 10.0 if units else 1.0
    if units:
        told, signs = rescaled(shifted(runs, 4000.0), ten, "N m"), (1,) * len(effect.parameters)
    else:
        told, signs = [turned(run) for run in (*runs[1::2], *runs[::2])], mirrored_signs(effect)
    back = judge(told, base_for("", ten, "N m" if units else "nu"), look_alikes("bias-moment"))
    assert back.verdict == there.verdict == "named"
    assert [one.name for one in back.effects] == [one.name for one in there.effects] == ["bias-moment"]
    assert held(back) == held(there)
    for parameter, sign in zip(effect.parameters, signs):
        here, other = (found.effects[0].parameters[parameter.name] for found in (there, back))
        assert other.value == pytest.approx(sign * parameter.scaled(here.value, ten), rel=1e-6)
        assert other.stderr == pytest.approx(parameter.scaled(here.stderr, ten), rel=1e-4)
    models = [found.search.final.model.theta[:2] for found in (there, back)]
    np.testing.assert_allclose(models[1], ten * models[0], rtol=1e-6)
    assert back.effects[0].confidence == pytest.approx(there.effects[0].confidence, abs=1e-3)


@pytest.mark.parametrize(("law", "seed"), [(1.0, 1), (2.0, 1), (2.0, 2)])
def test_an_edge_lies_between_two_commands(law: float, seed: int) -> None:
    """A cut was smoothed over a fifth of its width, and a propeller that stalls got an exponent or a friction beside
    it: one that starts at 0.35 and stalls at 0.16 ran at 0.5 and not at 0.3, stopped at 0.12 and ran on at 0.2."""
    plans = [[(size, 6.0 + 3.0 / size**0.5)] for size in (0.3, 0.5, 0.8, 1.2)]
    plans += [[(1.0, 4.0), (0.2, 6.0)], [(0.8, 4.0), (0.12, 6.0)], [(0.5, 4.0), (-0.5, 3.0), (0.2, 4.0)]]
    both = [[(sign * size, seconds) for size, seconds in plan] for plan in plans for sign in (1.0, -1.0)]
    base = base_for("")
    runs = [unmeasured(plan, number, base.moment_unit) for number, plan in enumerate(both)]
    found = judge(measured(base.with_effect("dead-band", (0.35, law, 0.16)), runs, seed=seed), base)
    (named,) = found.effects
    assert (found.verdict, named.name) == ("named", "dead-band")
    assert named.law == ("all" if law == 1.0 else "all, until it stalls")
    width, stall = named.parameters["width"], named.parameters["stall"]
    assert 0.28 < width.ci95[0] < 0.31 < 0.49 < width.ci95[1] < 0.53
    if law == 2.0:
        assert 0.11 < stall.ci95[0] < 0.125 < 0.19 < stall.ci95[1] < 0.21
