"""What the user knows beforehand is a prior of every estimator: known truth, and the amounts of the textbook."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from made_campaigns import PAPER, campaign
from made_driven import Sea, steered
from made_planar import BARE
from made_planar import campaign as planar_campaign
from repository import SAMPLE_RUNS

from automarine_cli.commands import automarine
from automarine_cli.commands.campaign import read_campaign
from automarine_cli.commands.fit_motion import fit_yaw
from automarine_cli.dofs import SURGE, YAW
from automarine_cli.errors import SettingError
from automarine_cli.filters.course import make_course
from automarine_cli.fits.driven import fit_driven
from automarine_cli.fits.half_turns import half_turn_data
from automarine_cli.fits.known import Known, Prior, names_in
from automarine_cli.fits.planar_fit import PlanarLikelihood
from automarine_cli.fits.planar_structure import OWN, Structure, observed, rough_sizes
from automarine_cli.fits.whole_runs import OutputErrorFit, fit_half_turns, fit_whole_runs, rough_model
from automarine_cli.runs.half_turn import half_turns
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import make_batch


def inertia_known(value: float, stderr: float | None = None) -> Known:
    return Known(parameters={"yaw.I_r": Prior(value, stderr)})


def with_moments(runs: list[Run], factor: float) -> list[Run]:
    """The runs whose logs tell so many times the moments that acted."""
    return [replace(run, moment=factor * run.command) for run in runs]


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ("I_r=915", {"I_r": Prior(915.0)}),
        (("I_r=915±50", "k_r = 1e2 +- 5"), {"I_r": Prior(915.0, 50.0), "k_r": Prior(100.0, 5.0)}),
        ("I_r=915+/-50,sway.Y_v=.5", {"I_r": Prior(915.0, 50.0), "sway.Y_v": Prior(0.5)}),
        ({"I_r": 915, "k_r": [100, 5]}, {"I_r": Prior(915.0), "k_r": Prior(100.0, 5.0)}),
    ],
)
def test_it_is_read_as_people_write_it(given: object, expected: dict[str, Prior]) -> None:
    assert Known.of(given).parameters == expected


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("I_r=915kg", "known is 'I_r=915kg'; expected a name, a number and perhaps its standard error"),
        ("I_r=915±0", "the standard error of I_r is 0; expected a number above 0"),
        ("I_r=1,I_r=2", "I_r is given twice"),
        ({"I_r": [1, 2, 3]}, "expected a finite number, or one and its standard error"),
        ({"I_r": "heavy"}, "I_r is 'heavy'; expected a number"),
        ("I_r=-3", "I_r is -3; expected a number above 0"),
        ("I_z=3", "'I_z' is no parameter of this fit; it has I_r, k_r, k_rr; did you mean I_r?"),
        ("I_r=1,yaw.I_r=2", "yaw.I_r is given twice"),
    ],
)
def test_what_makes_no_sense_is_one_sentence(given: object, said: str) -> None:
    with pytest.raises(SettingError) as refused:
        Known.of(given).named(names_in(YAW))
    assert said in str(refused.value)


def fitted(runs: list[Run], kind: str, known: Known) -> OutputErrorFit:
    """Model 3 by one of the estimators."""
    rest = np.ones(len(runs), dtype=bool)
    if kind == "half-turns":
        turns, _ = half_turns(runs)
        return fit_half_turns(half_turn_data(turns), "3", (1.2, 1.0, 1.0), "nu", known)
    if kind == "whole-runs":
        return fit_whole_runs(make_batch(runs, 0.1), "3", rest, prior=known)
    course = make_course(runs, rest)
    return fit_driven(course, rough_model("3", make_batch(runs, 0.1)), "3", priors=known.parameters)


@pytest.mark.parametrize(("kind", "within"), [("half-turns", 0.03), ("whole-runs", 0.06)])
def test_a_known_inertia_sets_the_scale_of_the_drag(kind: str, within: float) -> None:
    """Logs that tell 1.15 times the moments that acted: inertia and drag come out too large, but not their ratio."""
    runs = with_moments(campaign((0.4, -0.6, 0.8, -1.0), seed=3), 1.15)
    free, told = (fitted(runs, kind, known) for known in (Known(), inertia_known(PAPER.inertia)))
    assert free.estimates["k_rr"].value == pytest.approx(1.15 * PAPER.k_rr, rel=0.04)
    assert told.estimates["k_rr"].value == pytest.approx(PAPER.k_rr, rel=within)
    assert told.estimates["I_r"].value == PAPER.inertia and told.estimates["I_r"].stderr == 0.0
    assert told.estimates["I_r"].known and not told.estimates["k_rr"].known


def test_a_known_inertia_sets_the_scale_of_driven_runs() -> None:
    runs = with_moments(steered(3, 2, Sea(size=0.05), length=20.0), 1.15)
    free, told = (fitted(runs, "driven", known) for known in (Known(), inertia_known(1.0)))
    assert free.estimates["k_rr"].value > 1.07 * Sea.k_rr
    assert told.estimates["k_rr"].value == pytest.approx(Sea.k_rr, rel=0.06)
    assert told.estimates["I_r"].value == 1.0 and told.estimates["I_r"].known


def information(fit: OutputErrorFit) -> float:
    """What the runs say of the logarithm of the inertia."""
    return 1.0 / float(fit.mixed.covariance[0, 0])


@pytest.mark.parametrize("kind", ["half-turns", "whole-runs", "driven"])
def test_a_prior_moves_the_estimate_by_the_textbook_amount(kind: str) -> None:
    """Means weigh by their precisions, and precisions add; of a positive parameter on the logarithm."""
    runs = steered(3, 4, length=20.0) if kind == "driven" else campaign(seed=1, gain_scatter=0.03)
    free = fitted(runs, kind, Known())
    there, own = np.log(free.estimates["I_r"].value), information(free)
    error = 1.0 / np.sqrt(own)
    prior = Prior(float(np.exp(there + error)), float(np.exp(there + error) * error))
    told = fitted(runs, kind, Known(parameters={"yaw.I_r": prior}))
    assert np.log(told.estimates["I_r"].value) == pytest.approx(there + 0.5 * error, abs=0.12 * error)
    assert information(told) == pytest.approx(2.0 * own, rel=0.2)
    assert told.estimates["I_r"].known


def test_the_interval_holds_the_error_of_what_was_known() -> None:
    """Runs that say next to nothing beside the prior: the standard error is the prior's, whatever leaving runs out
    shows."""
    runs = campaign(seed=5, gain_scatter=0.05)
    value = fitted(runs, "half-turns", Known()).estimates["I_r"].value
    found = fitted(runs, "half-turns", inertia_known(value, 1e-3 * value)).estimates["I_r"]
    assert found.stderr == pytest.approx(1e-3 * value, rel=0.1)


def test_surge_knows_its_mass() -> None:
    assert set(names_in(SURGE)) == {"m_u", "X_u", "X_uu"}


def test_the_plane_takes_what_is_known() -> None:
    runs = tuple(planar_campaign(BARE, 1, 1, 8.0, ("heading", "surge", "sway")))
    seen = observed(runs)
    structure = Structure.simplest(seen)
    known = Known.of("I_r=2.0,m_u=20±0.001").named(structure.names, sorted({*structure.names.values()} - {*OWN}))
    model = structure.model(rough_sizes(runs))
    found = PlanarLikelihood(runs, seen, known.parameters).estimate(model)
    values = dict(zip(model.free, found.model.theta))
    assert values["yaw.I_r"] == 2.0
    assert values["surge.m_u"] == pytest.approx(20.0, abs=0.005)
    assert np.sqrt(found.covariance[0, 0]) == pytest.approx(0.001, rel=0.1)
    with pytest.raises(SettingError, match="'X_uuu' is no parameter of this fit"):
        Known.of("X_uuu=3").named(structure.names)


def test_the_command_tells_it_everywhere(tmp_path: Path) -> None:
    logs = sorted((SAMPLE_RUNS / "steps").glob("tau_*_a.csv"))
    arguments = ["fit-yaw", *map(str, logs), "--known", "I_r=1.0±0.05,k_r=0.1", "-o", str(tmp_path / "out")]
    done = CliRunner().invoke(automarine, arguments)
    assert done.exit_code == 0, done.output
    assert "(known)" in done.output
    assert "Known beforehand: I_r = 1 ± 0.05 nu s², k_r = 0.1 nu s." in done.output
    assert "The preferred model has no k_r; it was not used there." in done.output
    assert "The velocity errors of the paper do not use it." in done.output
    model = json.loads((tmp_path / "out" / "yaw_model.json").read_text())["models"]
    assert model["3"]["I_r"]["known"] is True and "known" not in model["3"]["k_rr"]
    assert model["2"]["k_r"]["value"] == 0.1 and model["2"]["k_r"]["known"] is True
    options = json.loads((tmp_path / "out" / "manifest.json").read_text())["options"]
    assert options["known"] == ["I_r=1.0±0.05,k_r=0.1"]


def test_python_takes_a_mapping() -> None:
    logs = [str(path) for path in sorted((SAMPLE_RUNS / "steps").glob("tau_*_[ab].csv"))]
    fit = fit_yaw(logs, known={"I_r": (1.0, 1e-4)})
    assert fit.preferred.estimates["I_r"].value == pytest.approx(1.0, abs=1e-3)


def test_a_campaign_file_takes_it(tmp_path: Path) -> None:
    file = tmp_path / "campaign.toml"
    head = 'schema = "automarine/campaign/1"\n[logs]\nsteps = ["x"]\n[yaw]\n'
    file.write_text(f"{head}known = {{ I_r = [915, 50], k_r = 3 }}\n")
    assert Known.of(read_campaign(file).sections["yaw"]["known"]).parameters == {
        "I_r": Prior(915.0, 50.0),
        "k_r": Prior(3.0),
    }
    file.write_text(f"{head}known = {{ I_r = [915, -50] }}\n")
    with pytest.raises(SettingError, match=r"yaw\.known: the standard error of I_r is -50; expected a number above 0"):
        read_campaign(file)
