"""Every effect of the library through the same checks, and the command that shows the library."""

import inspect
import json
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from effect_contract import (
    MIRRORED_SIGNS,
    PERIOD,
    SIZES,
    Floats,
    base_for,
    law_names,
    laws_of,
    long_plans,
    measured,
    mirrored,
    mirrored_signs,
    of_law,
    planted,
    short_plans,
    sizes_of,
    unmeasured,
)  # fmt: skip

from automarine_cli import effects
from automarine_cli.diagnosis.diagnose import parameter_estimates
from automarine_cli.diagnosis.study import study_of
from automarine_cli.diagnosis.trials import CandidateFit
from automarine_cli.dofs import DOFS, ROLL, YAW, Dof
from automarine_cli.effects import Effect, Parameter, Place, State
from automarine_cli.effects.base import EVEN, MIXED, ODD
from automarine_cli.effects.thruster_imbalance import PARTS
from automarine_cli.errors import ModelError
from automarine_cli.filters.course import make_course
from automarine_cli.fits.driven import THRUSTER_LAG, driven_problem, starts_near
from automarine_cli.logs.columns import SIGNALS
from automarine_cli.models.model import Model
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import make_batch
from automarine_cli.simulation.rollout import Start, simulate

EVERY_EFFECT = pytest.mark.parametrize("name", effects.names())
EVERY_LAW = pytest.mark.parametrize("name", law_names())
CONTRACT = (
    "linear-drag", "quadratic-drag", "cubic-drag", "bias-moment", "tether-spring", "dead-band", "saturation",
    "thrust-asymmetry", "drag-asymmetry", "thruster-lag", "input-delay", "thrust-loss", "battery-sag",
    "water-swirl", "coulomb-drag", "compass-deviation", "sensor-lag", "gyro-drift", "periodic-disturbance",
    "heading-moment", "cross-coupling", "thrust-exponent",
)  # fmt: skip
EVERY_MOTION = pytest.mark.parametrize("dof", DOFS.values(), ids=list(DOFS))
UNITS = ("nu", "N m")
CUTS = ("dead-band 1", "dead-band 2")
"""Where a cut lies between two moments nobody can tell: test_effects_laws judges them."""
STARTS = (0.4, -1.1, 2.0)  # rad

RUNS = [unmeasured(plan, i) for i, plan in enumerate([long_plans()[7], long_plans()[10], long_plans()[-1]])]
"""Three runs of different lengths: a step to port, a coast-down, a manoeuvre."""


def signals_for(effect: Effect) -> tuple[str, ...]:
    """Signals that an effect reads in any of its laws."""
    return effect.needs or (PARTS if effect.name == THRUSTER_LAG else ())


def headings(model: Model, runs: Sequence[Run] = RUNS, theta: Floats | None = None, sign: int = 1) -> Floats:
    batch = make_batch(runs, PERIOD, sorted({need for term in model.terms for need in signals_for(term.effect)}))
    start = Start(position=sign * np.array([STARTS[: len(runs)]]))
    return simulate(model, batch, theta, start).position


def with_effect(name: str, values: Sequence[float] | None = None) -> Model:
    """The base vehicle with a law of an effect at these values, by default at its planted sizes."""
    effect, law = of_law(name)
    return base_for(effect.name).with_effect(effect.name, sizes_of(effect, law) if values is None else values)


@cache
def of_base(name: str) -> Floats:
    return headings(base_for(name))


@cache
def of_planted(name: str) -> Floats:
    return headings(with_effect(name))


def test_the_contracts_names_are_there() -> None:
    assert set(CONTRACT) <= set(effects.names())
    assert {*SIZES, *MIRRORED_SIGNS} <= {*effects.names(), *law_names()}


@EVERY_EFFECT
def test_is_complete(name: str) -> None:
    effect = effects.get(name)
    assert effect.name == name and isinstance(effect.place, Place) and effect.parity in (EVEN, ODD, MIXED)
    assert Path(inspect.getfile(type(effect))).stem == name.replace("-", "_")
    assert effect.source.strip() == effect.source and effect.source and not effect.source.endswith(".")
    assert effect.mistaken_for and set(effect.mistaken_for) <= set(effects.names()) - {name}
    assert effect.parameters and set(effect.motions) <= set(DOFS) and effect.motions
    assert effect.role in ("", *ROLL.parameters) and (not effect.role or len(effect.parameters) == 1)
    module = inspect.getmodule(type(effect))
    assert module and module.__doc__ and '"' not in module.__doc__


@EVERY_EFFECT
@EVERY_MOTION
def test_card_is_complete(name: str, dof: Dof) -> None:
    effect = effects.get(name)
    if not effect.acts_in(dof):
        return
    card = effect.card(dof)
    assert card.name == name and re.fullmatch(r"[A-Z].*\.", card.says), card.says
    for text in (card.equation, card.reveals, card.separated_by):
        assert text.strip() == text and text and not text.endswith("."), text
    assert not re.search(r"[{}]", str(card))
    assert len({p.name for p in card.parameters}) == len(effect.parameters) == len(card.parameters)
    assert tuple(p.name for p in card.parameters) == effect.names_in(dof)


@EVERY_EFFECT
def test_parameters_have_units_and_bounds_that_hold_their_start(name: str) -> None:
    effect = effects.get(name)
    for p in effect.parameters:
        assert p.name and p.meaning and p.unit
        assert p.lower < p.upper and p.lower <= p.start <= p.upper and np.isfinite(p.start)
        assert all(p.lower <= value <= p.upper for value in p.scan)
        assert p.reference in ("", "moment", "clock", *SIGNALS)
        assert not p.log or p.lower > 0.0
    for dof in DOFS.values():
        for unit in {*UNITS, *dof.units.forces} - {dof.units.base}:
            for p, filled in zip(effect.parameters, effect.card(dof, unit).parameters):
                assert ("{force}" in p.unit) == (unit in filled.unit)


@EVERY_EFFECT
def test_methods_are_those_of_its_place_and_laws_are_declared(name: str) -> None:
    effect = effects.get(name)
    methods = {method for method in ("deliver", "moment", "water_rate", "read") if method in vars(type(effect))}
    wanted = {Place.ACTUATOR: "deliver", Place.MOMENT: "moment", Place.WATER: "water_rate", Place.SENSOR: "read"}
    assert methods == {wanted[effect.place]}
    assert bool(effect.states) == ("derivatives" in vars(type(effect)))
    choices = [p for p in effect.parameters if p.choices]
    assert all(p.upper == len(p.choices) - 1 and p.start == p.lower == 0.0 for p in choices)
    last = len(choices[0].choices) if choices else 0
    assert len(choices) <= 1 and len(effect.laws) == max(last - 1, 0)
    for law in effect.laws:
        assert law.source and not law.source.endswith(".") and set(law.mistaken_for) <= set(effects.names()) - {name}
    assert all(0 < law < last for p in effect.parameters for law in p.laws), "the first law is what it always was"


@EVERY_LAW
def test_says_whether_it_asks_for_the_heading(name: str) -> None:
    """Without `uses_position` the simulator gives no heading: who asks for one all the same must not pass unseen."""
    (effect, law), one = of_law(name), np.ones((1, 1))
    values = (*(np.full((1, 1), value) for value in sizes_of(effect, law)), *np.zeros((effect.per_run, 1, 1)))
    needs, stored = dict.fromkeys(effect.needs, one), [one] * len(effect.states)
    unknown = State(one * np.nan, one * np.nan, one, 0.5 * one, one, one, needs, stored=stored)
    assert np.isnan(effect.moment(unknown, values)).any() == effect.uses_position


@EVERY_LAW
def test_vectorised_over_parameter_sets_and_runs(name: str) -> None:
    """Each parameter set and each run comes out as if it were alone, whatever the company and the padding; so do runs
    with parameters of their own."""
    model = with_effect(name)
    effect, law = of_law(name)
    other = [v if p.choices else 1.1 * v for p, v in zip(effect.parameters, sizes_of(effect, law))]
    theta = np.stack([model.theta, with_effect(name, effect.off).theta, with_effect(name, other).theta])
    together = headings(model, theta=theta)
    assert together.shape == (3, len(RUNS), max(len(run) for run in RUNS)) and np.isfinite(together).all()
    for i, (values, run) in enumerate(zip(theta, RUNS)):
        batch = make_batch([run], PERIOD, signals_for(effect))
        alone = simulate(model, batch, values, Start(position=np.array([[STARTS[i]]]))).position[0, 0]
        np.testing.assert_allclose(together[i, i, : len(run)], alone, rtol=0, atol=1e-12)
    sets, rows = np.tile([2, 0], len(RUNS)), np.repeat(np.arange(len(RUNS)), 2)
    batch = make_batch(RUNS, PERIOD, signals_for(effect)).of_runs(rows)
    own = simulate(model, batch, theta[sets], Start(position=np.take(STARTS, rows)[None]), own=True).position[0]
    np.testing.assert_allclose(own, together[sets, rows], rtol=0, atol=1e-12)


@EVERY_LAW
def test_off_is_exactly_the_base_model_and_on_is_not(name: str) -> None:
    effect, law = of_law(name)
    off = [float(law) if p.choices else value for p, value in zip(effect.parameters, effect.off)]
    close = 1e-5 if "lag" in name else 1e-9
    np.testing.assert_allclose(headings(with_effect(name, off)), of_base(effect.name), rtol=0, atol=close)
    assert np.rad2deg(np.abs(of_planted(name) - of_base(effect.name)).max()) > 1.0


@EVERY_LAW
def test_mirrored_runs_have_the_declared_parity(name: str) -> None:
    effect, law = of_law(name)
    runs = [mirrored(run) for run in RUNS]
    values = sizes_of(effect, law)
    found = headings(with_effect(name, [s * v for s, v in zip(mirrored_signs(effect), values)]), runs, sign=-1)
    np.testing.assert_allclose(found, -of_planted(name), rtol=0, atol=1e-10)
    if effect.parity != EVEN:  # and it is no idle word
        assert np.abs(headings(with_effect(name), runs, sign=-1) + of_planted(name)).max() > 1e-3


@EVERY_LAW
def test_other_units_of_moment_give_the_same_headings(name: str) -> None:
    (effect, law), ten = of_law(name), 10.0
    scaled = [p.scaled(value, ten) for p, value in zip(effect.parameters, sizes_of(effect, law))]
    model = base_for(effect.name, ten, "N m").with_effect(effect.name, scaled)
    parts = [{part: ten * run.extras[part] for part in PARTS} for run in RUNS]
    runs = [run.with_moment(ten * run.command, "N m", own) for run, own in zip(RUNS, parts)]
    np.testing.assert_allclose(headings(model, runs), of_planted(name), rtol=0, atol=1e-10)


@pytest.mark.parametrize("name", [name for name in law_names() if name != "quadratic-drag"])
def test_the_filter_of_driven_runs_knows_each_law(name: str) -> None:
    """One run that starts, turns round, eases off and stops is likelier under the law that made it than without."""
    effect, law = of_law(name)
    truth = base_for(name).with_effect(effect.name, sizes_of(effect, law))
    plan = [(0.9, 4.0), (-0.5, 3.0), (0.3, 2.0), (0.0, 2.0)]
    runs = measured(truth, [unmeasured(plan, 0)], seed=1, noise_deg=0.3, gain=0.0)
    density = []
    for model in (truth, base_for(name)):
        problem = driven_problem(model, make_course(runs, np.array([True]), signals_for(effect)))
        start = problem.parameters.search(starts_near(problem, [model.theta], {}))
        density.append(float(problem.follow(start).log_density.sum()))
    assert np.isfinite(density).all() and density[0] > density[1]


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in law_names() if name not in CUTS])
def test_recovered_from_data_made_with_it(name: str) -> None:
    effect, law = of_law(name)
    base = base_for(effect.name)
    truth = sizes_of(effect, law)
    study = study_of(planted(base, name, seed=1), base)
    model = base.with_theta(1.1 * base.theta).with_effect(effect.name, _off_the_truth(effect, truth))
    fit = study.fit(model)
    trial = CandidateFit((effect.name,), model.with_theta(fit.theta[:-1]), fit, 0.0)
    found = parameter_estimates(study, trial, effect.name)
    every = zip(effect.parameters, effect.card(YAW, base.moment_unit).parameters, truth, effect.held(truth))
    for parameter, filled, value, held in every:
        estimate = found[filled.name]
        assert estimate.unit == filled.unit
        if held:
            assert estimate.value == pytest.approx(value)
        else:
            assert 0 < estimate.stderr < 0.25 * max(abs(v) for v in truth), parameter.name
            assert abs(estimate.value - value) < 4.0 * estimate.stderr, f"{parameter.name}: {estimate}"
    np.testing.assert_allclose(fit.theta[: len(base.theta)], base.theta, rtol=0.05)
    assert np.rad2deg(fit.noise) == pytest.approx(0.5, rel=0.1)


def _off_the_truth(effect: Effect, truth: Sequence[float]) -> list[float]:
    """Where a diagnosis would start: sizes a good way off, shapes at the nearest value that is scanned."""
    return [
        value if held else min(scan, key=lambda s: abs(np.log(s / value))) if scan else 0.7 * value
        for p, value, held in zip(effect.parameters, truth, effect.held(tuple(truth)))
        for scan in (effect.scan(p, tuple(truth)),)
    ]


@EVERY_EFFECT
def test_laws_together_are_as_each_alone(name: str) -> None:
    """Parameter sets of different laws in one simulation do not touch each other."""
    effect = effects.get(name)
    if (laws := laws_of(effect)) < 2:
        return
    models = [base_for(name).with_effect(name, sizes_of(effect, law)) for law in range(laws)]
    together = headings(models[0], theta=np.stack([model.theta for model in models]))
    for found, model in zip(together, models):
        np.testing.assert_allclose(found, headings(model)[0], rtol=0, atol=1e-12)
    assert all(np.rad2deg(np.abs(other - together[0]).max()) > 0.5 for other in together[1:])


@EVERY_MOTION
def test_the_list_and_the_cards_of_a_motion(dof: Dof, run: Callable[..., Result]) -> None:
    names = [name for name in effects.names() if effects.get(name).acts_in(dof)]
    lines = run("effects", "--motion", dof.name).stdout.splitlines()
    assert {line.split(" ")[0] for line in lines} & set(effects.names()) == set(names)
    text = run("effects", "--motion", dof.name, "--json").stdout
    library = json.loads(text, parse_constant=lambda word: pytest.fail(word))  # without infinities
    assert [card["name"] for card in library["effects"]] == names
    assert library["schema"] == "automarine/effects/1" and library.get("motion", YAW.name) == dof.name
    (card,) = (card for card in library["effects"] if card["name"] == "saturation")
    limit = card["parameters"][0]
    assert (limit["lower"], limit["upper"], limit["off"], limit["any_when_off"]) == (0.0, None, None, False)
    text = run("effects", "saturation", "--motion", dof.name).stdout
    assert effects.get("saturation").card(dof).equation in text


def test_effects_that_are_not_there_are_refused(run: Callable[..., Result]) -> None:
    for words, start, end in (
        (["compass-deviation", "--motion", "surge"], "compass-deviation does not act in surge", "give --motion yaw\n"),
        (["Dead_bnd"], "effect 'Dead_bnd' is not in the library;", "Did you mean dead-band or thruster-dead-band?\n"),
        (["quux"], "effect 'quux' is not in the library; known are backlash, battery-sag, ", "water-swirl\n"),
    ):
        refused = run("effects", *words)
        assert (refused.exit_code, refused.stdout) == (1, "")
        assert refused.stderr.startswith(f"Error: {start}") and refused.stderr.endswith(end)


def test_actuators_act_in_the_order_of_the_vehicle_not_of_the_list() -> None:
    """A dead-band is one of the command, whether it was found before the lag of the propellers or after it."""
    base, runs = base_for(""), [unmeasured(plan, i) for i, plan in enumerate(short_plans())]
    batch = make_batch(runs, 0.05)
    one = base.with_effect("dead-band", [0.1, 0.0, 0.5]).with_effect("thruster-lag", [0.4, 0.0, 1.0, 1.0])
    other = base.with_effect("thruster-lag", [0.4, 0.0, 1.0, 1.0]).with_effect("dead-band", [0.1, 0.0, 0.5])
    assert np.array_equal(simulate(one, batch).position, simulate(other, batch).position)


# Effects that are not of the library: registered by a script, or brought by an installed package


class Push(Effect):
    """A push."""

    name = "push"
    place = Place.MOMENT
    parameters = (Parameter("k", "push", "{force}", 0.0, 9.0, 0.1),)
    equation, says, reveals = "k", "Something pushes.", "any run"
    mistaken_for, separated_by, source = ("bias-moment",), "nothing", "mine"

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats:
        return values[0] + 0.0 * state.velocity


@pytest.fixture
def registered(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The library with a push in it, for one test."""
    monkeypatch.setattr(effects, "_REGISTERED", {})
    effects.look_alikes("bias-moment")  # what was looked up before does not stay
    effects.register(Push)
    yield
    effects.look_alikes.cache_clear()


@pytest.fixture
def forgotten() -> Iterator[None]:
    """What is installed is looked up anew, in the test and after it."""
    looked_up = (effects._entry_points, effects._loaded, effects.look_alikes)
    for function in looked_up:
        function.cache_clear()
    yield
    for function in looked_up:
        function.cache_clear()
    sys.modules.pop("my_package", None)


@pytest.mark.usefixtures("registered")
def test_a_registered_effect_is_of_the_library() -> None:
    assert "push" in effects.names() and isinstance(effects.get("push"), Push)
    assert "push" in effects.look_alikes("bias-moment")
    for name in ("push", "dead-band", "learned:depth"):
        with pytest.raises(ModelError, match="is in the library already; give yours a new name"):
            effects.register(type("Again", (Push,), {"name": name}))


@pytest.mark.usefixtures("forgotten")
@pytest.mark.parametrize(
    ("old", "new", "error"),
    [
        ("", "", ""),
        ('"push"\n    place', '"pull"\n    place', "expected a subclass of Effect of that name"),
        ("class Push(Effect)", "class Push(", "SyntaxError"),
    ],
)
def test_a_package_brings_one(
    old: str, new: str, error: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, run: Callable[..., Result]
) -> None:
    imports = "from __future__ import annotations\nfrom automarine_cli.effects import Effect, Parameter, Place\n"
    (tmp_path / "my_package.py").write_text((imports + inspect.getsource(Push)).replace(old, new, 1))
    installed = tmp_path / "my_package-1.0.dist-info"
    installed.mkdir()
    (installed / "METADATA").write_text("Metadata-Version: 2.1\nName: my-package\nVersion: 1.0\n")
    (installed / "entry_points.txt").write_text("[automarine.effects]\npush = my_package:Push\n")
    monkeypatch.syspath_prepend(tmp_path)
    done = run("effects", "push")
    if error:
        assert done.exit_code == 1 and error in done.stderr and isinstance(done.exception, SystemExit)
        assert done.stderr.startswith("Error: effect 'push' of the entry point my_package:Push: ")
    else:
        assert (done.exit_code, done.stderr) == (0, "") and "Something pushes." in done.stdout
