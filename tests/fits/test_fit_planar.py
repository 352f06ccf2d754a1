"""fit-planar: channels, structures, ties, the search, what the result says, with an estimator that is least squares of
the free run, or scripted, on made runs; then its own estimator, by innovations, on runs of an independent solver."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from figures import drawn
from made_planar import NOISE, Craft, driven, log, solved
from numpy.typing import NDArray
from scipy.optimize import least_squares

from automarine_cli.commands import automarine
from automarine_cli.commands.fit_planar import fit_planar
from automarine_cli.diagnosis.planar import base_of, candidates
from automarine_cli.dofs import SURGE, SWAY, YAW
from automarine_cli.dofs.motion import PLANAR
from automarine_cli.errors import FitError, RunError
from automarine_cli.fits.planar_fit import Choice, Estimated, PlanarFit, PlanarLikelihood, Promise, Tried, search
from automarine_cli.fits.planar_structure import LAWS, Observed, Structure, observed, rough_sizes
from automarine_cli.logs import ColumnMap
from automarine_cli.models.planar import Inertia, PlanarModel, Tied
from automarine_cli.models.store import StoredPlanar, load_planar_model, planar_from_json
from automarine_cli.models.yaw_model import Term
from automarine_cli.report import fit_report
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import make_batch
from automarine_cli.simulation.rollout import Start, simulate
from automarine_cli.thrusters.map import driven as driven_run
from automarine_cli.thrusters.map import load_planar

Floats = NDArray[np.float64]
CRAFT = Craft(
    np.diag([20.0, 32.0, 2.6]), linear=np.array([[0, 0, 0], [0, 0, 4.0], [0, 0, 0]]), by_own=np.diag([18.0, 60.0, 4.0])
)
"""Quadratic drag and a sway force by turning, Y_r."""


TRUTH = {
    "surge.m_u": 20.0, "sway.m_v": 32.0, "yaw.I_r": 2.6, "surge.X_uu": 18.0, "sway.Y_vv": 60.0, "yaw.k_rr": 4.0,
    "sway.Y_r": 4.0,
}  # fmt: skip
ALL = ("heading", "surge", "sway", "north", "east")


def made(seed: int, channels: Sequence[str] = ALL, length: float = 16.0) -> Run:
    """A run of the craft with these channels, from rest."""
    run, rng = driven(seed, length, 0.2), np.random.default_rng(100 + seed)
    positions, velocities = solved(CRAFT, run, (0, 0, 0.3), (0, 0, 0))
    columns = dict(zip(("north", "east", "heading", "surge", "sway"), [*positions.T, *velocities.T[:2]]))
    noisy = {name: columns[name] + NOISE[name] * rng.standard_normal(len(run)) for name in channels}
    return replace(run, position=noisy.pop("heading"), extras={**run.extras, **noisy})


def least_squares_of(model: Tied, runs: Sequence[Run], seen: Observed) -> Estimated:
    """Free runs from the known start, by least squares."""
    batch = make_batch(list(runs), 0.1, motion=PLANAR, channels=seen.channels)
    start = Start(np.array([0, 0, 0.3]).reshape(3, 1, 1))

    def misfit(theta: Floats) -> Floats:
        found = simulate(model, batch, theta[None], start)
        counted = [one for one in batch.channels if one.counts]
        off = [((found.reading(c)[0] - c.values) / NOISE[c.quantity])[c.seen] for c in counted]
        return np.nan_to_num(np.concatenate(off), nan=1e3, posinf=1e3, neginf=-1e3)

    fit = least_squares(misfit, model.theta, x_scale=np.maximum(np.abs(model.theta), 1.0))
    covariance = np.linalg.inv(fit.jac.T @ fit.jac)
    return Estimated(model.with_theta(fit.x), covariance, -fit.cost, len(fit.fun), NOISE)


class Scripted:
    """An estimator without physics: what is named in WORTH explains so much, anything else explains nothing."""

    def __init__(self, *_: object) -> None:
        pass

    def estimate(self, model: Tied, near: Estimated | None = None, brief: bool = False) -> Estimated:
        return Estimated(model, 0.01 * np.eye(len(model.free)), self.worth(model.free), 1000, NOISE)

    def promises(self, wide: Tied, near: Estimated, added: Sequence[tuple[str, ...]]) -> list[Promise]:
        return [Promise(self.worth(names), {}) for names in added]

    def choose(self, tried: Sequence[Tried]) -> Choice:
        return Choice(tried[0])

    @staticmethod
    def worth(names: Sequence[str]) -> float:
        return sum(WORTH.get(name, 0.0) for name in names)


WORTH = {"sway.Y_r": 30.0, "surge.X_u": 12.0, "yaw.N_v": 2.0, "current.north": 3.0}
"""Log likelihood; a parameter costs half of ln 1000 = 6.9."""


@pytest.fixture(scope="module")
def fit() -> PlanarFit:
    """The structure that made three runs, fitted by least squares."""
    runs = tuple(made(seed) for seed in range(3))
    seen = observed(runs)
    structure = replace(Structure.simplest(seen), couplings=("Y_r",))
    found = least_squares_of(structure.model(rough_sizes(runs)), runs, seen)
    tried = Tried(structure, found)
    return PlanarFit((tried,), Choice(tried), runs, seen)


def test_a_structure_is_fitted_from_its_rough_sizes(fit: PlanarFit) -> None:
    assert fit.estimates.keys() == TRUTH.keys()
    for name, estimate in fit.estimates.items():
        assert abs(estimate.value - TRUTH[name]) < 4 * estimate.stderr < 0.2 * TRUTH[name], name
    assert fit.because == "No other structure was tried." and fit.warnings == ()


def test_the_search_ends_where_nothing_more_is_worth_its_price() -> None:
    """Linear drag explains as much as both together."""
    runs = (made(0),)
    seen = observed(runs)
    simplest, tried = Structure.simplest(seen), search(runs, seen, Scripted())
    assert tried[0].structure == replace(simplest, laws={**simplest.laws, "surge": LAWS[1]}, couplings=("Y_r",))
    criteria = [each.estimated.criterion for each in tried]
    assert criteria == sorted(criteria) and len({str(each.structure) for each in tried}) == len(tried)
    because = PlanarFit(tried, Choice(tried[0]), runs, seen).because
    assert because.startswith(f"Of {len(tried)} structures this one has the best evidence")


def test_the_result_is_a_model_that_is_read_back(fit: PlanarFit) -> None:
    data = json.loads(json.dumps(fit.to_json()))
    assert planar_from_json(data).model == fit.model
    assert data["parameters"]["surge.m_u"]["unit"] == "kg" and data["parameters"]["planar.m_vr"] == 0.0
    assert data["covariance"]["parameters"] == list(fit.found.model.free)
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
    structure = Structure.simplest(seen)
    assert [each.parameter for each in structure.assumptions][:2] == ["sway.m_v", "sway.Y_v"]
    assert str(structure.assumptions[1]) == "sway.Y_v = surge.m_u / 1 s: sway is taken to die out in 1 s"
    model = structure.model(rough_sizes(runs))
    assert model.free == ("surge.m_u", "yaw.I_r", "surge.X_uu", "yaw.k_rr")
    planar = model.with_theta([20.0, 3.0, 18.0, 4.0]).model
    assert planar.inertia == Inertia(20.0, 20.0, 3.0) and planar.sway == (Term("linear-drag", (20.0,)),)
    near = list(structure.neighbours())
    assert {each.couplings for each in near} == {(), ("N_ur",)} and not any(n.current or n.skewed for n in near)
    tried = search(runs, seen, Scripted())
    masses = PlanarFit(tried, Choice(tried[0]), tuple(runs), seen).estimates
    assert masses["sway.m_v"].value == masses["surge.m_u"].value
    assert masses["sway.m_v"].stderr == masses["surge.m_u"].stderr > 0
    abeam = observed([made(0, ("heading", "sway"))])
    assert abeam.dofs == (SWAY, YAW)
    assert str(Structure.simplest(abeam).assumptions[0]).startswith("surge.m_u = sway.m_v: the logs hold no surge")
    with pytest.raises(FitError, match=r"no surge or sway speed .* and no position on the water .* fit-yaw"):
        observed([made(0, ("heading",))])


def test_places_show_both_and_allow_a_current() -> None:
    seen = observed([made(0, ("heading", "north", "east"))])
    assert seen.dofs == PLANAR.dofs and seen.over_ground
    simplest = Structure.simplest(seen)
    near = list(simplest.neighbours())
    assert len({str(each) for each in near}) == len(near) == 3 * 2 + 4 + 2
    drifting = next(each for each in near if each.current).model(rough_sizes([made(0)]))
    assert drifting.free[-2:] == ("current.north", "current.east")
    both = replace(simplest, laws={**simplest.laws, "surge": LAWS[2]})
    assert not any("surge drag" in str(each) and each.laws["surge"] != LAWS[2] for each in both.neighbours())


def test_tied_models_simulate_as_what_they_stand_for() -> None:
    def planar(mass: float, drag: float) -> PlanarModel:
        ahead, abeam = (Term("linear-drag", (size,)) for size in (drag, mass))
        return PlanarModel(Inertia(mass, mass, 3.0), surge=(ahead,), sway=(abeam,))

    model, other = planar(20.0, 4.0), planar(30.0, 5.0)
    tied = Tied(model, ("surge.m_u", "surge.X_u"), {"sway.m_v": ("surge.m_u", 1.0), "sway.Y_v": ("surge.m_u", 1.0)})
    batch = make_batch([driven(1)], 0.05, motion=PLANAR)
    both = simulate(tied, batch, np.array([tied.theta, [30.0, 5.0]]))
    for p, planar_model in enumerate((model, other)):
        np.testing.assert_array_equal(both.positions[p], simulate(planar_model, batch).positions[0])
    assert tied.with_theta([30.0, 5.0]).model == other
    with pytest.raises(KeyError, match=r"no parameter surge.X_uu"):
        Tied(model, ("surge.X_uu",), {})


def test_logs_to_a_folder_of_results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("automarine_cli.fits.planar_fit.PlanarLikelihood", Scripted)
    for seed in range(2):
        log(made(seed), tmp_path)
    fit = fit_planar([tmp_path], out=tmp_path / "out")
    assert load_planar_model(tmp_path / "out" / "planar_model.json").model == fit.model
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "planar_model.json", "planar.csv", "planar.md", "planar.tex", "manifest.json",
    }  # fmt: skip
    assert "surge.m_u" in (tmp_path / "out" / "planar.md").read_text()


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
    structure = replace(Structure.simplest(likelihood.observed), couplings=("Y_r",))
    found = likelihood.estimate(structure.model(rough_sizes(runs)))
    for name, value, deviation in zip(found.model.free, found.model.theta, np.sqrt(np.diagonal(found.covariance))):
        assert abs(value - TRUTH[name]) < 3.0 * deviation < 0.3 * TRUTH[name], (name, value, deviation)
    assert set(found.model.free) == set(TRUTH) and set(found.disturbance) == {"surge", "sway", "yaw"}
    for name, noise in found.noises.items():
        assert noise == pytest.approx(NOISE[name], rel=0.3), name


def test_the_mirrored_campaign_gives_the_mirrored_model() -> None:
    runs = (made(0, ("heading", "north", "east")),)
    found = []
    for own in (runs, tuple(mirrored(run) for run in runs)):
        likelihood = PlanarLikelihood(own, observed(own))
        structure = replace(Structure.simplest(likelihood.observed), couplings=("Y_r",), current=True)
        model = structure.model({**rough_sizes(own), "current.east": 0.0})
        problem = likelihood.problem(model)
        (start,) = problem.search(likelihood.starts(problem, None)[:1])
        found.append((problem.value(start[None])[0], problem.slopes(start[None])[0].gradient.sum(axis=0)))
    names = [problem.names[i] for i in problem.free]
    sides = np.where(np.array(names) == "current.east", -1.0, 1.0)
    assert found[0][0] == pytest.approx(found[1][0], rel=1e-9)
    np.testing.assert_allclose(found[0][1], sides * found[1][1], rtol=1e-3, atol=1e-2)


@pytest.mark.parametrize("channels", [ALL, ("heading", "surge")])
def test_gradients_are_those_of_differences(channels: Sequence[str]) -> None:
    runs = tuple(made(seed, channels, 8.0) for seed in range(2))
    likelihood = PlanarLikelihood(runs, observed(runs))
    model = Structure.simplest(likelihood.observed).widest.beside({}, rough_sizes(runs))
    problem = likelihood.problem(model)
    (phi,) = problem.search(likelihood.starts(problem, None)[:1])
    phi[problem.names.index("switch-instant")] = -0.1  # at zero nodes lie on edges of commands, where slopes jump
    gradient = problem.slopes(phi[None])[0].gradient.sum(axis=0)
    steps = np.zeros((len(problem.free), len(phi)))
    steps[np.arange(len(steps)), problem.free] = 10.0 * problem.steps(phi)

    def density(at: Floats) -> Floats:
        return np.asarray(problem.follow(at).log_density.sum(axis=1))

    brute = (density(phi + steps) - density(phi - steps)) / (20.0 * problem.steps(phi))
    np.testing.assert_allclose(gradient, brute, rtol=2e-2, atol=0.5)


@pytest.mark.slow
def test_a_promise_is_the_gain_of_the_fit() -> None:
    """Y_r, which is there, promises much; what is not there promises no more than chance."""
    runs = (made(0, ("heading", "surge", "sway")),)
    likelihood = PlanarLikelihood(runs, observed(runs))
    simplest, rough = Structure.simplest(likelihood.observed), rough_sizes(runs)
    found = likelihood.estimate(replace(simplest, couplings=("Y_r",)).model(rough))
    wide = simplest.widest.beside(found.known, rough)
    added = [("surge.X_u",), ("yaw.N_v",), ("planar.m_vr",)]
    gains = [one.gain for one in likelihood.promises(wide, found, added)]
    assert all(0 <= gain < 6 for gain in gains)
    without = likelihood.estimate(simplest.model(rough))
    (promised,) = likelihood.promises(simplest.widest.beside(without.known, rough), without, [("sway.Y_r",)])
    assert promised.gain > 10 and found.log_likelihood - without.log_likelihood > 10


@pytest.mark.slow
def test_the_command_says_of_what_use_the_model_is(tmp_path: Path) -> None:
    for seed in range(2):
        log(made(seed, ("heading", "surge"), 10.0), tmp_path)
    with drawn():
        done = CliRunner().invoke(automarine, ["fit-planar", str(tmp_path), "-o", str(tmp_path / "out")])
    assert done.exit_code == 0, done.output
    assert "the heading 5 s ahead to" in done.output and "yaw alone" in done.output.lower()
    written = json.loads((tmp_path / "out" / "planar_model.json").read_text())
    horizons = [one["horizon_s"] for one in written["prediction"]["left_out_runs"]]
    assert horizons == [2.0, 5.0] and "surge.disturbance" in written["random"]
    assert (tmp_path / "out" / "planar_runs.png").stat().st_size > 10_000
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert "warnings" not in manifest and manifest["command"] == "fit-planar"


def test_what_may_be_missing_of_a_planar_model() -> None:
    """The candidates that the logs can tell; a mass abeam that equals that ahead is tied, and may be freed."""
    ahead, abeam, turn = Term("quadratic-drag", (18.0,)), Term("linear-drag", (20.0,)), Term("quadratic-drag", (4.0,))
    stored = StoredPlanar(PlanarModel(Inertia(20.0, 20.0, 2.6), (ahead,), (abeam,), (turn,)), "by hand")
    speed, every = Observed(("heading", "surge")), Observed(ALL)
    base = base_of(stored, speed)
    assert base.free == ("surge.m_u", "yaw.I_r", "surge.X_uu", "yaw.k_rr")
    by_name = {each.name: each for each in candidates(base, speed, 3.0)}
    assert list(by_name) == [
        "cross-coupling", "linear-drag", "munk-moment", "input-delay", "thruster-lag", "dead-band",
    ]  # fmt: skip
    assert by_name["cross-coupling"].added == ("yaw.N_ur",) and by_name["munk-moment"].added == ("sway.m_v",)
    assert all(set(each.model.free) == {*base.free, *each.added} for each in by_name.values())
    names = [each.name for each in candidates(base_of(stored, every), every, 3.0)]
    assert names.count("cross-coupling") == 5 and "current" in names
