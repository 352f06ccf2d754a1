"""Which planar fit is preferred, what it is worth, and what its intervals hold."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from made_planar import BARE, Craft, planar_run, turned
from scipy import special

from automarine_cli.dofs.motion import PLANAR
from automarine_cli.filters.course import make_course
from automarine_cli.fits import planar_fit
from automarine_cli.fits.driven import ForecastScore
from automarine_cli.fits.innovations import InnovationsFit
from automarine_cli.fits.mixed_model import search_of
from automarine_cli.fits.planar_fit import (
    FORECASTS,
    LIKELIHOOD,
    Choice,
    Estimated,
    PlanarFit,
    PlanarLikelihood,
    PlanarUse,
    Tried,
)
from automarine_cli.fits.planar_structure import Observed, Structure, observed, rough_sizes
from automarine_cli.fits.whole_runs import run_covariance
from automarine_cli.models.planar import Tied
from automarine_cli.quantities import Floats
from automarine_cli.report import fit_report
from automarine_cli.runs.run import Run

PERIOD = 0.05


def use_of(**errors: float) -> PlanarUse:
    """What a model is worth that misses by these errors, at any horizon."""
    worth = {
        name: tuple(ForecastScore(h, error, 2.0, 1.0, 100) for h in (2.0, 5.0, 15.0)) for name, error in errors.items()
    }
    return PlanarUse(worth, 2, (), None)  # type: ignore[arg-type]


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


def test_speeds_smoother_than_any_sensor_hang_together() -> None:
    """Derived speeds are read every half second, noisy ones every time."""
    run, rng = smoothed_run(1, 20.0, 0.1), np.random.default_rng(0)
    rough = {**run.extras, **{name: run.extras[name] + 0.01 * rng.standard_normal(len(run)) for name in SPEEDS[1:]}}
    smooth, noisy = (
        make_course([each], np.zeros(1, dtype=bool), motion=PLANAR, channels=SPEEDS).channels
        for each in (run, replace(run, extras=rough))
    )
    assert max(channel.seen.sum() for channel in smooth if channel.velocity) <= 41
    assert min(channel.seen.sum() for channel in noisy if channel.velocity) > 150


@pytest.mark.slow
def test_derived_speeds_do_not_make_the_masses_too_large() -> None:
    """A mass of 20 kg; read at every sample, these speeds gave 58 kg with a standard error of 3."""
    runs = tuple(smoothed_run(seed, 25.0, 0.1) for seed in range(2))
    likelihood = PlanarLikelihood(runs, observed(runs))
    likely = likelihood.estimate(Structure.simplest(likelihood.observed).model(rough_sizes(runs)))
    for estimated in (likely, likelihood.by_forecasts(likely)):
        values = dict(zip(estimated.model.free, estimated.model.theta))
        assert 14.0 < values["surge.m_u"] < 29.0 and 14.0 < values["sway.m_v"] < 29.0


def fake(model: Tied, count: int = 3) -> Estimated:
    """An estimate with a fit in it, whose last parameter stands at a bound; runs left out move it by a tenth."""
    theta = np.asarray(model.theta)
    names, positive = model.free, np.array([name.endswith(("m_u", "m_v", "I_r")) for name in model.free])
    phi = search_of(theta, positive)
    left_out = np.tile(phi, (count, 1))
    left_out[:, 1] += 0.1 * np.arange(count)
    covariance = 1e-6 * np.eye(len(phi))
    fit = InnovationsFit(
        names, theta, phi, positive, covariance, left_out, 0.0, np.zeros(count), (len(phi) - 1,), 1, True,
        np.tile(np.eye(len(phi)), (count, 1, 1)), {}, {}, np.zeros(count), np.zeros(count), len(phi),
    )  # fmt: skip
    return Estimated(model, covariance, 0.0, 1000, fit=fit, disturbance={"surge": {"size": 1.0}})


def chosen(monkeypatch: pytest.MonkeyPatch, errors: Sequence[float]) -> Choice:
    """What is preferred of the best structure by both ways and the simplest one by both, which miss by `errors`."""
    runs = (smoothed_run(0, 5.0, 0.1),)
    seen = observed(runs)
    simplest = Structure.simplest(seen)
    structures = (replace(simplest, couplings=("Y_r",)), simplest)
    tried, missed = [Tried(each, fake(each.model(rough_sizes(runs)))) for each in structures], iter(errors)
    monkeypatch.setattr(planar_fit, "forecasts_of", lambda *_: use_of(heading=next(missed)))
    monkeypatch.setattr(planar_fit, "planar_use", lambda *_: None)
    monkeypatch.setattr(PlanarLikelihood, "problem", lambda *_: None)
    monkeypatch.setattr(PlanarLikelihood, "by_forecasts", lambda self, near: replace(near))
    return PlanarLikelihood(runs, seen).choose(tried)


def test_the_fit_that_predicts_best_is_preferred(monkeypatch: pytest.MonkeyPatch) -> None:
    best = chosen(monkeypatch, (0.5, 0.4, 0.6, float("nan")))
    assert best.way == FORECASTS and best.best.structure.couplings == ("Y_r",)
    assert "other fits miss: one by the innovations of a filter by 25 % more;" in best.because
    assert chosen(monkeypatch, (0.5, 0.495, 0.6, 0.6)).way == LIKELIHOOD  # too little to leave it
    assert not chosen(monkeypatch, (0.5, 0.6, 0.7, 0.4)).best.structure.couplings


def test_a_speed_that_a_constant_predicts_better_makes_a_model_useless() -> None:
    good, bad = use_of(heading=0.5, surge=0.5), use_of(heading=0.5, surge=1.1)
    assert good.of_use and good.sentences[0].startswith("The model predicts the heading 5 s ahead to 28.6 deg")
    assert not bad.of_use and bad.sentences[0].startswith("This model is not usable: it predicts the surge speed 5 s")


def test_intervals_rest_on_runs_and_a_bound_has_none() -> None:
    runs = tuple(smoothed_run(seed, 5.0, 0.1) for seed in range(3))
    structure = Structure.simplest(Observed(SPEEDS))
    estimated = fake(structure.model(rough_sizes(runs)))
    assert estimated.fit is not None
    slopes = np.where(estimated.fit.positive, estimated.fit.theta, 1.0)
    covariance = run_covariance(estimated.fit) * np.outer(slopes, slopes)
    tried = Tried(structure, replace(estimated, covariance=covariance, disturbance={"surge": {"size": 1e3}}))
    fit = PlanarFit((tried,), Choice(tried), runs, Observed(SPEEDS))
    mass = fit.estimates["sway.m_v"]
    spread = np.sqrt(2.0 / 3.0 * np.sum((0.1 * np.arange(3) - 0.1) ** 2))  # the jackknife of three runs
    assert mass.stderr == pytest.approx(mass.value * spread, rel=1e-6)
    assert mass.ci95[1] / mass.value == pytest.approx(np.exp(special.stdtrit(2.0, 0.975) * spread), rel=1e-6)
    assert fit.estimates["yaw.k_rr"].at_bound and fit.estimates["yaw.k_rr"].to_json()["at_bound"] is True
    assert "at its bound" in fit_report.parameter_table(fit).to_markdown()
    assert fit.warnings[0].startswith("The disturbance is more than half as large as the commands: surge")
