"""fit-planar: channels, structures, ties, the search, what the result says, with an estimator that is scripted, on
made runs; then its own estimator, by innovations, on runs of an independent solver."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import made_ship
import numpy as np
import pytest
from made_planar import (
    ARM_M,
    BARE,
    NOISE,
    Craft,
    campaign,
    delivered,
    driven,
    log,
    of_two_thrusters,
    planar_run,
    solved,
    spinning_up,
    turned,
)  # fmt: skip
from scipy import special

from automarine_cli.dofs import PLANAR, SURGE, SWAY, YAW
from automarine_cli.errors import FitError, RunError, SettingError
from automarine_cli.fits import planar_fit
from automarine_cli.fits.driven import ForecastScore, Judgement, parse_effects
from automarine_cli.fits.innovations import InnovationsFit
from automarine_cli.fits.planar_fit import PlanarFit, PlanarLikelihood, Promise, forecasts_of, search
from automarine_cli.fits.planar_start import by_momentum, rough_sizes, usual_gyration
from automarine_cli.fits.planar_structure import (
    OWN,
    Candidate,
    Observed,
    candidates,
    inertia_tied,
    observed,
    structure_of,
    widest,
)
from automarine_cli.fits.whole_runs import OutputErrorFit, result_of
from automarine_cli.logs import ColumnMap
from automarine_cli.models.model import COMMAND_DELAY, Model
from automarine_cli.models.parameter import NUISANCE, Parameter, Parameters, Prior
from automarine_cli.models.store import models_of
from automarine_cli.quantities import Floats
from automarine_cli.report import fit_report
from automarine_cli.report.figures.runs import tracks_figure
from automarine_cli.runs.run import Run
from automarine_cli.thrusters.map import driven as driven_run
from automarine_cli.thrusters.map import load_planar

CRAFT = Craft(
    np.diag([20.0, 32.0, 2.6]), linear=np.array([[0, 0, 0], [0, 0, 4.0], [0, 0, 0]]), by_own=np.diag([18.0, 60.0, 4.0])
)
"""Quadratic drag and a sway force by turning, Y_r."""


TRUTH = {
    "surge.m_u": 20.0, "sway.m_v": 32.0, "yaw.I_r": 2.6, "surge.X_uu": 18.0, "sway.Y_vv": 60.0, "yaw.k_rr": 4.0,
    "sway.Y_r": 4.0,
}  # fmt: skip
ALL = ("heading", "surge", "sway", "north", "east")


RANDOM = ("disturbance", "disturbance-time", "thrust-noise")


def made(seed: int, channels: Sequence[str] = ALL, length: float = 16.0) -> Run:
    """A run of the craft with these channels, from rest."""
    run, rng = driven(seed, length, 0.2), np.random.default_rng(100 + seed)
    positions, velocities = solved(CRAFT, run, (0, 0, 0.3), (0, 0, 0))
    columns = dict(zip(("north", "east", "heading", "surge", "sway"), [*positions.T, *velocities.T[:2]]))
    noisy = {name: columns[name] + NOISE[name] * rng.standard_normal(len(run)) for name in channels}
    return replace(run, position=noisy.pop("heading"), extras={**run.extras, **noisy})


def fit_of(model: Model, runs: int = 3, log_likelihood: float = 0.0) -> InnovationsFit:
    """A fit of a model, whose last parameter stands at a bound; runs left out move the second by a tenth."""
    last = model.index(model.free[-1])
    random = (*(f"{dof.name}.{kind}" for dof in PLANAR.dofs for kind in RANDOM), COMMAND_DELAY)
    parameters = Parameters((*model.parameters(), *(Parameter(name, 0.01, role=NUISANCE) for name in random)))
    theta, phi = parameters.theta, parameters.search(parameters.theta)
    left_out = np.tile(phi, (runs, 1))
    left_out[:, 1] += 0.1 * np.arange(runs)
    return InnovationsFit(
        parameters, theta, phi, 1e-6 * np.eye(len(phi)), np.zeros((len(phi), len(phi))), left_out, log_likelihood,
        np.zeros(runs), (last,), 1, True, np.tile(np.eye(len(phi)), (runs, 1, 1)), NOISE,
        {"heading": 1000}, np.zeros(runs), np.zeros(runs),
    )  # fmt: skip


def use_of(large: str = "", **errors: float) -> Judgement:
    """What a model is worth that misses by these errors, at any horizon."""
    worth = {
        name: tuple(ForecastScore(h, error, 2.0, 1.0, 100) for h in (2.0, 5.0, 15.0)) for name, error in errors.items()
    }
    return Judgement(worth, 2, large=large)


def fit_to(runs: Sequence[Run], observed: Observed, *tried: OutputErrorFit) -> PlanarFit:
    return PlanarFit(tried, tried[0], use_of(heading=0.5), "", tuple(runs), observed)


def model_of(runs: Sequence[Run], *added: str) -> Model:
    """The simplest model of these runs, and what is added."""
    seen = observed(runs)
    model = seen.simplest(rough_sizes(runs))
    for name in added:
        model = next(one.model for one in candidates(model, seen) if name in one.added)
    return model


class Scripted(PlanarLikelihood):
    """An estimator without physics: what is named in WORTH explains so much, anything else explains nothing. Of drags
    so much is `left` where others are promised beside them."""

    left = 0.0

    def estimate(
        self, model: Model, random: Mapping[str, float] | None = None, iterations: int = 60, settled: float = 0.0
    ) -> OutputErrorFit:
        return result_of("", model, fit_of(model, log_likelihood=self.worth(model.free)))

    def promises(self, wide: Model, near: OutputErrorFit, added: Sequence[tuple[str, ...]]) -> list[Promise]:
        return [Promise(self.worth(names), dict.fromkeys(OWN, self.left)) for names in added]

    def toward(self, model: Model, random: Mapping[str, float], promised: Promise) -> tuple[Model, Mapping[str, float]]:
        return model, random

    def actuated(self, fit: OutputErrorFit, iterations: int) -> list[tuple[Candidate, OutputErrorFit]]:
        return []

    @staticmethod
    def worth(names: Sequence[str]) -> float:
        return sum(WORTH.get(name, 0.0) for name in names)


WORTH = {"sway.Y_r": 30.0, "surge.X_u": 12.0, "yaw.N_v": 2.0, "current.north": 3.0}
"""Log likelihood; a parameter costs half of ln 1000 = 6.9."""


@pytest.fixture(scope="module")
def fit() -> PlanarFit:
    """The structure that made three runs, with its truth."""
    runs = tuple(made(seed) for seed in range(3))
    seen = observed(runs)
    model = model_of(runs, "sway.Y_r")
    model = model.with_theta([TRUTH.get(name, 0.0) for name in model.parameter_names])
    return fit_to(runs, seen, result_of("", model, fit_of(model)))


def test_the_search_ends_where_nothing_more_is_worth_its_price() -> None:
    """Linear drag explains as much as both together."""
    runs = (made(0),)
    seen = observed(runs)
    tried = search(Scripted(runs, seen))
    names = [structure_of(each.model, seen) for each in tried]
    assert names[0] == "surge drag linear, sway drag quadratic, yaw drag quadratic, Y_r"
    criteria = [planar_fit.criterion(each) for each in tried]
    assert criteria == sorted(criteria) and len({*names}) == len(tried)
    because = fit_to(runs, seen, *tried).because
    assert because.startswith(f"Of {len(tried)} structures this one has the best evidence")


@pytest.mark.slow
def test_linear_drag_is_fitted_as_its_promise_has_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """In place of a quadratic one of which nothing would be left, else beside it."""
    runs = (made(0),)
    for left, drag in ((0.0, "linear"), (1e9, "linear and quadratic")):
        monkeypatch.setattr(Scripted, "left", left)
        names = [structure_of(each.model, observed(runs)) for each in search(Scripted(runs, observed(runs)))]
        assert {name.split(", ")[0] for name in names} == {"surge drag quadratic", f"surge drag {drag}"}


def test_the_result_is_a_model_that_is_read_back(fit: PlanarFit) -> None:
    data = json.loads(json.dumps(fit.to_json()))
    assert models_of(data, "").undelayed == fit.model
    assert data["parameters"]["surge.m_u"]["unit"] == "kg" and data["parameters"]["planar.m_vr"] == 0.0
    assert data["covariance"]["parameters"] == list(fit.best.model.free)
    assert [each["parameter"] for each in data["assumptions"]] == ["planar.m_vr", "planar.m_ur, planar.m_uv"]
    low, high = data["valid_range"]["surge_m_s"]
    assert -2 < low < 0 < high < 2 and data["valid_range"]["force_X_N"][1] <= 30
    structure = "Structure: surge drag quadratic, sway drag quadratic, yaw drag quadratic, Y_r. No"
    assert next(iter(fit_report.planar_sentences(fit))).startswith(structure) and structure[:30] in repr(fit)
    assert [row[0] for row in fit_report.parameter_table(fit).rows] == list(fit.estimates)
    assert len(fit_report.structure_table(fit).rows) == len(fit.tried)
    frame = fit.to_frame()
    assert list(frame["parameter"]) == list(fit.estimates) and list(frame["unit"])[:3] == ["kg", "kg", "N m s²"]


def test_what_is_not_measured_is_tied_and_said() -> None:
    """A boat with a log of its speed ahead; then one of its speed abeam, and one of heading alone."""
    runs = [made(seed, ("heading", "surge")) for seed in range(2)]
    seen = observed(runs)
    assert seen == Observed(("heading", "surge")) and seen.dofs == (SURGE, YAW)
    model = model_of(runs)
    assumptions = seen.assumptions(model)
    assert [each.parameter for each in assumptions][:2] == ["sway.m_v", "sway.Y_v"]
    assert str(assumptions[1]) == "sway.Y_v = surge.m_u / 1 s: sway is taken to die out in 1 s"
    assert model.free == ("surge.m_u", "yaw.I_r", "surge.X_uu", "yaw.k_rr")
    phi = model.parameters().search([20.0, 1.0, 3.0, 0.0, 0.0, 0.0, 18.0, 1.0, 4.0])
    values = dict(zip(model.parameter_names, model.parameters().natural(phi)))
    assert values["sway.m_v"] == pytest.approx(20.0) and values["sway.Y_v"] == pytest.approx(20.0)
    near = [each.added for each in candidates(model, seen, rough_sizes(runs))]
    assert near == [("yaw.N_ur",), ("surge.X_u",), ("surge.X_u",), ("yaw.k_r",), ("yaw.k_r",)]
    tried = search(Scripted(tuple(runs), seen))
    masses = fit_to(runs, seen, *tried).estimates
    assert masses["sway.m_v"].value == masses["surge.m_u"].value
    assert masses["sway.m_v"].stderr == masses["surge.m_u"].stderr > 0
    abeam = observed([made(0, ("heading", "sway"))])
    assert abeam.dofs == (SWAY, YAW)
    first = abeam.assumptions(model_of([made(0, ("heading", "sway"))]))[0]
    assert str(first).startswith("surge.m_u = sway.m_v: the logs hold no surge")
    with pytest.raises(FitError, match=r"no surge or sway speed .* and no position on the water .* fit-yaw"):
        observed([made(0, ("heading",))])


def test_a_force_that_no_log_holds_is_none_and_one_that_is_never_there_is_refused(tmp_path: Path) -> None:
    path = log(made(0), tmp_path, force_Y_N=None)
    (run,) = load_planar([path], columns=ColumnMap()).runs
    assert not run.extras["force_Y"].any()
    assert "no sway force in the log: none is taken to act" in run.reading
    zero = np.zeros(len(run))
    with pytest.raises(RunError, match="every command is zero: something that is not logged steers the vehicle"):
        driven_run(replace(run, moment=zero, extras={"force_X": zero, "force_Y": zero}))


def mirrored(run: Run) -> Run:
    changed = {name: -run.extras[name] for name in ("force_Y", "sway", "east") if name in run.extras}
    return replace(run, position=-run.position, moment=-run.command, extras={**run.extras, **changed})


@pytest.mark.slow
@pytest.mark.parametrize("channels", [ALL, ("heading", "north", "east")])
def test_innovations_find_the_truth(channels: Sequence[str]) -> None:
    runs = tuple(made(seed, channels, 12.0) for seed in range(2))
    likelihood = PlanarLikelihood(runs, observed(runs))
    found = likelihood.estimate(model_of(runs, "sway.Y_r"))
    for name in found.model.free:
        value, deviation = found.by_name[name].value, found.by_name[name].stderr
        assert abs(value - TRUTH[name]) < 3.0 * deviation < 0.3 * TRUTH[name], (name, value, deviation)
    assert set(found.model.free) == set(TRUTH) and set(found.mixed.of_chance) > {
        "surge.disturbance",
        "yaw.thrust-noise",
    }
    for name, noise in found.mixed.noise_of.items():
        assert noise == pytest.approx(NOISE[name], rel=0.3), name


def test_the_mirrored_campaign_gives_the_mirrored_model() -> None:
    runs = (made(0, ("heading", "north", "east")),)
    found = []
    for own in (runs, tuple(mirrored(run) for run in runs)):
        likelihood = PlanarLikelihood(own, observed(own))
        model = model_of(own, "sway.Y_r", "current.north")
        problem = likelihood.problem(model)
        (start,) = problem.parameters.search(likelihood.starts(problem, None)[:1])
        found.append((problem.value(start[None])[0], problem.slopes(start[None])[0].gradient.sum(axis=0)))
    names = [problem.parameters.names[i] for i in problem.free]
    sides = np.where(np.array(names) == "current.east", -1.0, 1.0)
    assert found[0][0] == pytest.approx(found[1][0], rel=1e-9)
    np.testing.assert_allclose(found[0][1], sides * found[1][1], rtol=1e-3, atol=1e-2)


@pytest.mark.parametrize("channels", [ALL, ("heading", "surge")])
def test_gradients_are_those_of_differences(channels: Sequence[str]) -> None:
    runs = tuple(made(seed, channels, 8.0) for seed in range(2))
    likelihood = PlanarLikelihood(runs, observed(runs))
    model = widest(model_of(runs), partial(candidates, observed=likelihood.observed))
    problem = likelihood.problem(model)
    (phi,) = problem.parameters.search(likelihood.starts(problem, None)[:1])
    delay = problem.parameters.names.index(COMMAND_DELAY)
    phi[delay] = -0.01  # at zero nodes lie on edges of commands, where slopes jump
    gradient = problem.slopes(phi[None])[0].gradient.sum(axis=0)
    steps = np.zeros((len(problem.free), len(phi)))
    steps[np.arange(len(steps)), problem.free] = 10.0 * problem.steps(phi)

    def density(at: Floats) -> Floats:
        return np.asarray(problem.follow(at).log_density.sum(axis=1))

    brute = (density(phi + steps) - density(phi - steps)) / (20.0 * problem.steps(phi))
    np.testing.assert_allclose(gradient, brute, rtol=2e-2, atol=0.5)


def test_fits_start_from_what_momentum_says() -> None:
    sizes = by_momentum([made(seed) for seed in range(2)], tuple(TRUTH))
    for name in ("surge.m_u", "sway.m_v", "surge.X_uu", "sway.Y_vv"):
        assert sizes[name] == pytest.approx(TRUTH[name], rel=0.2), name
    for name in ("yaw.I_r", "yaw.k_rr"):
        assert sizes[name] == pytest.approx(TRUTH[name], rel=0.7), name
    still = replace(made(0, ("heading",)), position=np.zeros(len(made(0))))
    assert by_momentum([still], tuple(TRUTH)) == {}
    steered = made(0, ("heading", "surge"))
    steered = replace(steered, moment=np.zeros(len(steered)))
    sizes = by_momentum([steered], tuple(TRUTH))
    assert sizes["yaw.I_r"] == pytest.approx(sizes["surge.m_u"] * usual_gyration(sizes["surge.m_u"]))


def test_a_rudder_alone_tells_no_inertia() -> None:
    """It takes what hulls of that mass have, and nothing that only a moment of known size could tell."""
    ship = made_ship.MASS_ABEAM * usual_gyration(made_ship.MASS_AHEAD)
    assert ship == pytest.approx(made_ship.INERTIA, rel=0.2)
    runs = [made(0)]
    rudder = 0.3 * np.sign(np.sin(runs[0].time))
    none = np.zeros(len(runs[0]))
    extras = {**runs[0].extras, "rudder": rudder, "force_Y": none}
    steered_runs = (replace(runs[0], moment=none, extras=extras),)
    seen = observed(steered_runs)
    assert seen.rudder_alone and not observed(runs).rudder_alone
    likelihood = PlanarLikelihood(steered_runs, seen, with_effects=("rudder",))
    model = likelihood.simplest
    assert {"yaw.N_uv", "yaw.N_ur"} <= {*model.free}
    offered = {name for candidate in likelihood.family(model) for name in candidate.added}
    assert {"sway.Y_ur", "sway.Y_uv", "yaw.rudder-race.N_deltaX", "sway.rudder-race.Y_deltaX"} <= offered
    assert not offered & {"planar.m_vr", "yaw.N_v", "sway.Y_r"}
    driven = PlanarLikelihood(tuple(runs), observed(runs))
    assert "planar.m_vr" in {name for candidate in driven.family(driven.simplest) for name in candidate.added}
    assert "yaw.I_r" not in model.free
    assert model.values["yaw.I_r"] == pytest.approx(
        model.values["sway.m_v"] * usual_gyration(model.values["surge.m_u"])
    )
    assumed = seen.assumptions(model)
    assert [each.parameter for each in assumed][:2] == ["planar.m_vr", "yaw.I_r"]
    assert assumed[1].equals.endswith(" m² sway.m_v")
    weighed = {"yaw.I_r": Prior(3.0, 0.1), "planar.m_vr": Prior(1.5)}
    assert {*weighed} <= {*seen.names().values()}
    known = replace(likelihood, priors=weighed)
    parameters = known.problem(known.simplest).parameters
    assert "yaw.I_r" in known.simplest.free
    skew = parameters[parameters.names.index("planar.m_vr")]
    assert skew.lower == skew.upper == 1.5
    tied_abeam = replace(model, ties=(("sway.m_v", "surge.m_u", 1.0),))
    assert inertia_tied(tied_abeam, 2.0).values["yaw.I_r"] == 2.0 * model.values["surge.m_u"]


def test_what_makes_sides_differ_may_be_asked_for_in_the_plane() -> None:
    names = ("bias-moment", "drag-asymmetry")
    assert parse_effects(names, *PLANAR.dofs) == names
    for refused, dofs in (("bias-moment", (YAW,)), ("linear-drag", PLANAR.dofs)):
        with pytest.raises(SettingError, match=f"with is '{refused}'"):
            parse_effects((refused,), *dofs)


def test_what_acts_on_commands_is_fitted_where_commands_change() -> None:
    """Two thrusters give nothing abeam; drag that is asked for acts there all the same."""
    run = made(0)
    twin = replace(run, extras={**run.extras, "force_Y": np.zeros(len(run))})
    for runs, motions in (([run], 3), ([twin], 2)):
        simplest = PlanarLikelihood(tuple(runs), observed(runs), with_effects=("thruster-lag", "cubic-drag")).simplest
        names = [term.name for term in simplest.terms]
        assert (names.count("thruster-lag"), names.count("cubic-drag")) == (motions, 3)


def test_what_is_random_has_the_same_bounds_in_all_models() -> None:
    """Else a model with one term more, of a larger inertia, could explain less than the one without."""
    runs = (made(0),)
    likelihood = PlanarLikelihood(runs, observed(runs))
    heavy = likelihood.simplest.with_theta(100.0 * likelihood.simplest.theta)
    light, other = (likelihood.problem(model).parameters for model in (likelihood.simplest, heavy))
    assert light.nuisance == other.nuisance and light.nuisance[0].upper > 0.0


@pytest.mark.parametrize("every", [1, 10])
def test_a_vehicle_under_way_may_be_as_fast_as_its_speeds_say(every: int) -> None:
    """Where no position is logged: else a filter holds that it begins at rest."""
    time, read = 0.1 * np.arange(200), np.arange(200) % every == 0
    run = planar_run(time, *np.ones((3, 200)), "under way")
    speeds = {"surge": np.where(read, 1.2, np.nan), "sway": np.where(read, -0.3 * np.sin(time), np.nan)}
    run = replace(run, extras={**{k: v for k, v in run.extras.items() if k not in ("north", "east")}, **speeds})
    fastest = PlanarLikelihood((run,), observed([run])).course.fastest
    assert fastest[0] == pytest.approx(1.2) and fastest[1] == pytest.approx(0.3, rel=0.15)


def test_a_promise_that_runs_away_is_not_followed() -> None:
    likelihood = PlanarLikelihood((made(0),), observed([made(0)]))
    model = likelihood.simplest
    assert likelihood.toward(model, {}, Promise(1.0, {COMMAND_DELAY: np.nan}))[0] == model


@pytest.mark.slow
@pytest.mark.parametrize("unlogged", [[], ["north_m", "east_m"]])
def test_a_ship_steered_by_its_rudder_has_its_masses(unlogged: list[str], tmp_path: Path) -> None:
    """Zigzags of a tanker by other equations, of which only the propeller's thrust is a logged force."""
    for i, (rudder, turn) in enumerate([(10, 10), (-10, 10), (20, 20), (-20, 20)]):
        log = made_ship.log(made_ship.zigzag(rudder, turn), 60.0, i).drop(columns=unlogged)
        log.to_csv(tmp_path / f"zigzag_{i}.csv", index=False)
    runs = load_planar([tmp_path], ColumnMap()).runs
    likelihood = PlanarLikelihood(runs, observed(runs), with_effects=("rudder", "rudder-drag"))
    fit = likelihood.estimate(likelihood.simplest)
    value = fit.model.values
    assert value["surge.m_u"] == pytest.approx(made_ship.MASS_AHEAD, rel=0.3)
    assert value["sway.m_v"] == pytest.approx(made_ship.MASS_ABEAM, rel=0.3)
    assert 0.7 < value["yaw.I_r"] / made_ship.INERTIA < 1.2
    assert value["yaw.rudder.N_delta"] > 0 > value["sway.rudder.Y_delta"]
    use = forecasts_of(likelihood.problem(fit.model), fit.mixed)
    judged = next(score for score in use.worth["heading"] if score.horizon == 5.0)
    assert judged.error < 0.25 * judged.constant_rate < judged.constant
    gains = {candidate.name: promise.gain for candidate, promise in likelihood.promised(fit, likelihood.family)}
    assert gains["rudder-race"] > 30  # its propeller's race passes the rudder


@pytest.mark.slow
def test_a_promise_is_the_gain_of_the_fit() -> None:
    """Y_r, which is there, promises much; what is not there promises no more than chance."""
    runs = (made(0, ("heading", "surge", "sway")),)
    likelihood = PlanarLikelihood(runs, observed(runs))
    found = likelihood.estimate(model_of(runs, "sway.Y_r"))
    assert all(-1e-9 < promise.gain < 6 for _, promise in likelihood.promised(found, likelihood.family))
    without = likelihood.estimate(model_of(runs))
    promises = likelihood.promised(without, likelihood.family)
    assert next(promise.gain for one, promise in promises if one.added == ("sway.Y_r",)) > 10
    assert found.mixed.log_likelihood - without.mixed.log_likelihood > 10


# Which fit is preferred, and what its intervals hold

PERIOD = 0.05


SPEEDS = ("heading", "surge", "sway")


def smoothed_run(seed: int, length: float, share: float, craft: Craft = BARE) -> Run:
    """A run pushed by a process of a `share` of the commands, with speeds that are slopes of places over 0.6 s."""
    rng, n = np.random.default_rng(seed), round(length / PERIOD) + 1
    time = PERIOD * np.arange(n)
    levels = np.array([[30.0], [15.0], [8.0]]) * rng.uniform(-1, 1, (3, n))
    command = levels[:, np.searchsorted(np.cumsum(rng.uniform(1.0, 3.0, n)), time)]
    pushed, keep = rng.standard_normal((3, n)), np.exp(-PERIOD / 2.0)
    for k in range(1, n):
        pushed[:, k] = keep * pushed[:, k - 1] + np.sqrt(1.0 - keep**2) * pushed[:, k]
    force = command + share * np.sqrt(np.mean(command**2, axis=1, keepdims=True)) * pushed
    inverse, state, states = np.linalg.inv(craft.inertia), np.zeros(6), np.zeros((n, 6))

    def rates(state: Floats, force: Floats) -> Floats:
        v = state[3:]
        p = craft.inertia @ v
        swung = np.array([-p[1] * v[2], p[0] * v[2], v[0] * p[1] - v[1] * p[0]])
        return np.array([*(turned(state[2]) @ v[:2]), v[2], *(inverse @ (force - craft.drag(v) - swung))])

    for k in range(n - 1):
        half = state + 0.5 * PERIOD * rates(state, force[:, k])
        state = state + PERIOD * rates(half, force[:, k])
        states[k + 1] = state
    places = states[:, :2] + 0.001 * rng.standard_normal((n, 2))
    kernel = np.arange(-6, 7) / (PERIOD * float(np.sum(np.arange(-6, 7) ** 2)))
    slopes = np.stack([np.convolve(np.pad(one, 6, "edge"), kernel[::-1], "valid") for one in places.T], axis=1)
    speeds = np.round([turned(psi).T @ slope for psi, slope in zip(states[:, 2], slopes)], 3)
    run = planar_run(time, *command, f"smoothed_{seed}")
    heading = states[:, 2] + 0.002 * rng.standard_normal(n)
    return replace(run, position=heading, extras={**run.extras, "surge": speeds[:, 0], "sway": speeds[:, 1]})


@pytest.mark.slow
def test_derived_speeds_do_not_make_the_masses_too_large() -> None:
    """A mass of 20 kg; read at every sample, these speeds gave 58 kg with a standard error of 3."""
    runs = tuple(smoothed_run(seed, 25.0, 0.1) for seed in range(2))
    likelihood = PlanarLikelihood(runs, observed(runs))
    likely = likelihood.estimate(model_of(runs))
    assert 14.0 < likely.model.values["surge.m_u"] < 29.0 and 14.0 < likely.model.values["sway.m_v"] < 29.0


def chosen(
    monkeypatch: pytest.MonkeyPatch, errors: Sequence[float], large: str = "The disturbance is large."
) -> tuple[OutputErrorFit, str, str]:
    """What is preferred of the likeliest structure and another, which miss by `errors`, under a `large` disturbance; if
    there is a third one, the other misses by that when it is fitted to the end."""
    runs = (smoothed_run(0, 5.0, 0.1),)
    seen = observed(runs)
    tried, missed = [], iter(errors)
    for model in (model_of(runs, "sway.Y_r"), model_of(runs)):
        tried.append(result_of("", model, fit_of(model)))
    monkeypatch.setattr(planar_fit, "forecasts_of", lambda *_: use_of(large, heading=next(missed)))
    monkeypatch.setattr(PlanarLikelihood, "problem", lambda *_: None)
    monkeypatch.setattr(PlanarLikelihood, "estimate", lambda _, model, *__: tried[model is not tried[0].model])
    best, _, because = PlanarLikelihood(runs, seen).choose(tried)
    return best, structure_of(best.model, seen), because


def test_the_fit_that_predicts_best_is_preferred(monkeypatch: pytest.MonkeyPatch) -> None:
    _, structure, because = chosen(monkeypatch, (0.5, 0.4, 0.4))
    assert structure.endswith("yaw drag quadratic") and "the next best fit misses by 25 % more" in because
    for errors in ((0.5, 0.495), (0.5, float("nan")), (0.5, 0.4, 0.6)):  # too little to leave it, or none
        assert chosen(monkeypatch, errors)[1].endswith(", Y_r")
    assert chosen(monkeypatch, (1.5, 0.4, 0.4), large="")[1].endswith("yaw drag quadratic")  # of no use otherwise


def test_without_a_large_disturbance_the_likeliest_fit_is_preferred(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of nine runs one structure predicted 7 % better by chance, and its inertia was 7 standard errors too small."""
    _, structure, because = chosen(monkeypatch, (0.5, 0.4, 0.4), large="")
    assert structure.endswith(", Y_r") and "the next best fit misses by 20 % less" in because


def test_where_predictions_run_away_no_parameter_has_an_interval(monkeypatch: pytest.MonkeyPatch) -> None:
    known, unknown = (chosen(monkeypatch, (error, error))[0].by_name["sway.m_v"].to_json() for error in (0.5, np.inf))
    assert isinstance(known, dict) and known["ci95"] is not None
    assert unknown == {**known, "stderr": None, "ci95": None, "at_bound": "the runs do not determine it"}


def test_a_speed_that_a_constant_predicts_better_makes_a_model_useless() -> None:
    good, bad = use_of(heading=0.5, surge=0.5), use_of(heading=0.5, surge=1.1)
    assert bad.warnings(YAW) == (bad.sentence(YAW),) and good.warnings(YAW) == ()
    assert good.of_use and good.sentence(YAW).startswith("The model predicts the heading 5 s ahead to 28.6 deg")
    assert not bad.of_use and bad.sentence(YAW).startswith("This model is not usable (held out). It predicts the surge")


def test_intervals_rest_on_runs_and_a_bound_has_none() -> None:
    runs = tuple(smoothed_run(seed, 5.0, 0.1) for seed in range(3))
    model = model_of(runs)
    fit = fit_to(runs, Observed(SPEEDS), result_of("", model, fit_of(model)))
    mass = fit.estimates["sway.m_v"]
    spread = np.sqrt(2.0 / 3.0 * np.sum((0.1 * np.arange(3) - 0.1) ** 2))  # the jackknife of three runs
    assert mass.stderr == pytest.approx(mass.value * spread, rel=1e-6)
    assert mass.ci95[1] / mass.value == pytest.approx(np.exp(special.stdtrit(2.0, 0.975) * spread), rel=1e-6)
    assert fit.estimates["yaw.k_rr"].at_bound and fit.estimates["yaw.k_rr"].to_json()["at_bound"] is True
    assert "at its bound" in fit_report.parameter_table(fit).to_markdown()


def test_an_inertia_that_is_hardly_known_is_named() -> None:
    runs = [made(seed) for seed in (1, 2)]
    fit = fit_of(model := model_of(runs))
    spread = fit.covariance.copy()
    spread[2, 2] = 1.0
    result = fit_to(runs, observed(runs), replace(result_of("", model, fit), covariance=spread))
    (warning,) = [sentence for sentence in result.warnings if "hardly determine" in sentence]
    assert warning.startswith("The logs hardly determine yaw.I_r: the standard error")


def test_predictions_that_run_away_are_said_to() -> None:
    assert "predicts the place 5 s ahead without any bound. A constant" in use_of(heading=0.5, place=np.nan).sentence(
        YAW
    )


@pytest.mark.slow
def test_tracks_have_speeds_with_axes_below_each(fit: PlanarFit) -> None:
    """Also where the runs fill one row; panels without a run have none."""
    for runs, columns in ((3, 3), (6, 4)):
        figure = tracks_figure(replace(fit, runs=(fit.runs * 2)[:runs]))
        axes = np.array(figure.axes).reshape(-1, columns)
        with_runs = np.arange(axes.size // 2).reshape(-1, columns) < runs
        assert np.array_equal([[panel.axison for panel in row] for row in axes], np.repeat(with_runs, 2, axis=0))
        assert axes[0, 0].get_ylabel() == "North [m]" and axes[1, 0].get_ylabel() == "Speed [m/s]"


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "lag_s", "dead_Nm"), [(1, 0.4, 0.0), (2, 0.4, 0.0), (3, 0.0, 0.0), (4, 0.0, 1.5)])
def test_what_stands_between_command_and_force_leaves_masses_as_they_are(
    seed: int, lag_s: float, dead_Nm: float
) -> None:
    """A delay in place of a lag would make all masses too large, as would a dead band that nobody looks for."""
    runs = campaign(BARE, seed, 5, 20.0, ("heading", "surge", "sway"), lag_s=lag_s, dead_Nm=dead_Nm)
    likelihood = PlanarLikelihood(tuple(runs), observed(runs))
    fit, *_ = likelihood.choose(search(likelihood))
    for name, truth in (("surge.m_u", 20.0), ("sway.m_v", 20.0), ("yaw.I_r", 2.6)):
        mass = fit.by_name[name]
        assert abs(mass.value - truth) < 3.5 * mass.stderr < 0.15 * truth
    lags = [fit.by_name[name] for name in fit.model.parameter_names if name.endswith("thruster-lag.T")]
    assert len(lags) == (3 if lag_s else 0)
    for lag in lags:
        assert abs(lag.value - lag_s) < 3.5 * lag.stderr < 0.3 * lag_s
    width = fit.by_name.get("yaw.dead-band.width")
    assert (width is not None) == (dead_Nm > 0)
    assert width is None or abs(width.value - dead_Nm) < 3.5 * width.stderr < 0.15 * dead_Nm


@pytest.mark.slow
@pytest.mark.parametrize("compass_s", [0.4, 0.0])
def test_a_late_compass_beside_a_gyro_leaves_the_inertia_as_it_is(compass_s: float) -> None:
    """A lag of thrusters and a larger inertia stood for it."""
    channels = ("heading", "yaw_rate", "surge", "sway")
    runs = campaign(BARE, 7, 4, 16.0, channels, compass_s=compass_s)
    fit, *_ = search(PlanarLikelihood(tuple(runs), observed(runs)))
    expected = {"yaw.I_r": 2.6, **({"yaw.sensor-lag.T_s": compass_s} if compass_s else {})}
    assert [name for name in fit.model.parameter_names if "-lag" in name] == [*expected][1:]
    for name, value in expected.items():
        assert abs(fit.by_name[name].value - value) < 3.5 * fit.by_name[name].stderr < 0.1 * value, name


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "hidden", "truth"),
    [
        (1, {"gains": (1.1, 0.9, 0.9, 1.1)}, {"forward": 0.1, "backward": -0.1, "direction": 0.0}),
        (2, {"gains": (0.9, 1.1, 1.1, 0.9)}, {"forward": -0.1, "backward": 0.1, "direction": 0.0}),
        (3, {"dead_N": 4.0}, {"width": ARM_M * 4.0}),
        (4, {}, {}),
        (5, {"lag_s": 0.3}, {"T": 0.3, "law": 5.0}),
    ],
)
def test_what_single_thrusters_lack_is_found(seed: int, hidden: dict[str, Any], truth: dict[str, float]) -> None:
    """Of a propeller each also: a lag of the force ahead and one of the moment would be two, and neither right."""
    given, size = (spinning_up, (5, 20.0)) if "lag_s" in hidden else (delivered, (4, 16.0))
    made_runs = campaign(BARE, seed, *size, ("heading", "surge", "sway"), given=partial(given, **hidden))
    runs = [of_two_thrusters(run) for run in made_runs]
    fit, *_ = search(PlanarLikelihood(tuple(runs), observed(runs)))
    single = [name for name in fit.model.parameter_names if "thruster-" in name]
    assert [name.rpartition(".")[2] for name in single][: len(truth)] == list(truth)
    expected = {"surge.m_u": 20.0, "sway.m_v": 20.0, "yaw.I_r": 2.6, **dict(zip(single, truth.values()))}
    for name, value in expected.items():
        if name in fit.by_name:  # a law has no interval
            assert abs(fit.by_name[name].value - value) < 3.5 * fit.by_name[name].stderr, name
        else:
            assert fit.model.values[name] == value
    said = fit_report.parameter_table(fit_to(runs, observed(runs), fit)).to_markdown()
    assert ("yaw.thruster-lag, what is slow: speed of each propeller." in said) == ("T" in truth)
