"""`fit-roll` and `fit-pitch`: free decays that scipy integrated; period, damping, stability are in their intervals."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from made_swings import TRUTH, decay, decays, write_swings
from scipy.integrate import solve_ivp

from automarine_cli.commands import automarine
from automarine_cli.dofs import PITCH
from automarine_cli.fits.identify import YawFit, identify_turns
from automarine_cli.models.parameter import Prior
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import Run

PERIOD = 2.0 * np.pi * np.sqrt(TRUTH["inertia"] / TRUTH["restoring"])
DAMPING = TRUTH["linear"] / (2.0 * np.sqrt(TRUTH["inertia"] * TRUTH["restoring"]))


def fitted(runs: list[Run], known: float | None = 1.9, mass: float | None = None) -> YawFit:
    dof = runs[0].dof
    priors = {} if known is None else {dof.parameter("inertia"): Prior(known)}
    return identify_turns(dof, (), (), runs, priors=priors, mass=mass)


@pytest.mark.slow
def test_truth_is_recovered_within_standard_errors() -> None:
    truth = {
        "natural_period_s": PERIOD, "damping_ratio": DAMPING,
        "GM_over_radius_of_gyration_squared_per_m": 12.0 / 1.9 / 9.81, "quadratic_damping_per_rad": 0.9 / 1.9,
        "rest_angle_deg": np.degrees(np.arcsin(0.2 / 12.0)),
        "damping_ratio_at_10_deg": DAMPING + 4.0 * np.radians(10.0) * 0.9 / (3.0 * np.pi * 1.9),
    }  # fmt: skip
    scores, covered = [], []
    for seed in range(12):
        swing = fitted(decays(seed)).swing_of("2")
        assert swing["GM_m"] is None
        estimates = [swing[name] for name in truth]
        scores.append([(e.value - value) / e.stderr for e, value in zip(estimates, truth.values())])
        covered.append([e.ci95[0] <= value <= e.ci95[1] for e, value in zip(estimates, truth.values())])
    z = np.array(scores)
    assert np.abs(z.mean(axis=0)).max() < 3.0 / np.sqrt(len(z))
    assert 0.4 < np.sqrt((z**2).mean()) < 1.6 and np.mean(covered) > 0.85


@pytest.fixture(scope="module")
def of_known() -> YawFit:
    return fitted(decays(1, count=3), mass=38.0)


def test_the_right_model_is_preferred_and_gm_is_in_metres(of_known: YawFit) -> None:
    swing = of_known.swing
    assert of_known.preference.number == "2"
    assert abs(swing["natural_period_s"].value - PERIOD) < 3.0 * swing["natural_period_s"].stderr
    height = swing["GM_m"]
    assert height.ci95[0] < 12.0 / (38.0 * 9.81) < height.ci95[1] and height.unit == "m"
    assert swing["damped_period_s"].value == pytest.approx(PERIOD / np.sqrt(1.0 - DAMPING**2), rel=1e-3)


@pytest.mark.slow
def test_decays_alone_give_the_same_ratios(of_known: YawFit) -> None:
    fit = fitted(decays(1, count=3), known=None, mass=38.0)
    swing, same = fit.swing, of_known.swing
    assert fit.of_ratios and swing["GM_m"] is None
    for name in ("natural_period_s", "damping_ratio", "quadratic_damping_per_rad", "rest_angle_deg"):
        ratio, with_inertia = swing[name], same[name]
        assert ratio.value == pytest.approx(with_inertia.value, rel=1e-3, abs=0.05 * with_inertia.stderr)
        assert ratio.stderr == pytest.approx(with_inertia.stderr, rel=0.05)
    assert fit.preferred.estimates["I_p"].value == 1.0


@pytest.mark.slow
def test_mirrored_decays_of_pitch_give_the_same(of_known: YawFit) -> None:
    pitch = fitted([replace(run, position=-run.position) for run in decays(1, PITCH, 3)])
    swing, other = of_known.swing, pitch.swing
    assert other["natural_period_s"].value == pytest.approx(swing["natural_period_s"].value, rel=1e-6)
    assert other["rest_angle_deg"].value == pytest.approx(-swing["rest_angle_deg"].value, rel=1e-3)
    assert {"I_q", "k_q", "k_qq", "restoring"} <= set(pitch.preferred.estimates)


@pytest.mark.slow
def test_a_run_that_starts_moving_and_one_run_alone() -> None:
    fit = fitted([decay(0.1, 3, rate=0.8)])
    swing = fit.swing
    assert abs(swing["natural_period_s"].value - PERIOD) < 3.5 * swing["natural_period_s"].stderr


@pytest.mark.slow
def test_moments_that_act_show_the_inertia() -> None:
    pushes = (3.0, -3.0, 5.0, -5.0, 2.0, -4.0)
    fit = fitted([decay(0.017, 40 + i, moment=push) for i, push in enumerate(pushes)], known=None)
    inertia, restoring = fit.output_error["2"].estimates["I_p"], fit.output_error["2"].estimates["restoring"]
    assert not fit.of_ratios and abs(inertia.value - 1.9) < 3.5 * inertia.stderr
    assert abs(restoring.value - 12.0) < 3.5 * restoring.stderr


def test_from_files_without_a_command_to_the_model(tmp_path: Path) -> None:
    for run in decays(2, count=3):
        write_swings(tmp_path / run.source, run.position)
    out = tmp_path / "out"
    result = CliRunner().invoke(automarine, ["fit-roll", str(tmp_path), "-o", str(out)])
    assert result.exit_code == 0, result.output
    first = " ".join(result.stdout.splitlines()[:3])
    assert first.startswith("Roll: natural period 2.5") and "I_p fixed at 1." in first
    stored = json.loads((out / "roll_model.json").read_text())
    assert stored["schema"] == "automarine/roll-model/1" and stored["moment_unit"] == "N m"
    low, high = stored["swing"]["natural_period_s"]["ci95"]
    assert low < PERIOD < high and stored["swing"]["GM_m"] is None
    log, model = str(tmp_path / "run_20.csv"), str(out / "roll_model.json")
    read = CliRunner().invoke(automarine, ["validate", log, "--model", model, "--json"])
    assert read.exit_code == 0 and json.loads(read.stdout)["models"]["2"]["rmse_deg"] < 0.25


def write_torpedo(path: Path, seed: int, column: str, gear: float = 1e3) -> None:
    """A log of 40 s under way at 1.2 to 1.8 m/s: the elevator goes to both sides at a rate of `gear` [rad/s], a rudder
    beside it means nothing."""
    rng, clock = np.random.default_rng(seed), 0.1 * np.arange(400)
    angle = np.repeat(rng.choice([-0.25, -0.1, 0.0, 0.1, 0.25], 10), 40)
    fine = np.arange(0.0, 40.0, 0.01)
    there, wanted = 0.0 * fine, angle[np.minimum((10.0 * fine).astype(int), 399)]
    for i in range(1, len(fine)):
        there[i] = there[i - 1] + np.clip(wanted[i] - there[i - 1], -0.01 * gear, 0.01 * gear)
    speed = rng.uniform(1.2, 1.6) + 0.2 * np.sin(clock / 7.0)

    def slope(time: float, state: Floats) -> list[float]:
        u, delta = np.interp(time, clock, speed), np.interp(time, fine, there)
        theta, q = state
        return [q, (-18.0 * delta * u**2 - 6.0 * q - 10.0 * q * abs(q) - 30.0 * np.sin(theta)) / 12.0]

    path_deg = np.degrees(solve_ivp(slope, (0.0, 40.0), [0.0, 0.0], t_eval=clock, max_step=0.02).y[0])
    columns = {"time_s": clock, "pitch_deg": path_deg + 0.1 * rng.standard_normal(400), column: np.degrees(angle)}
    columns |= {"rudder_deg": 5.0 * rng.standard_normal(400), "surge_m_s": speed}
    pd.DataFrame(columns).round(4).to_csv(path, index=False)


@pytest.mark.slow
def test_an_elevator_is_the_rudder_of_pitch_and_its_gear_is_found(tmp_path: Path) -> None:
    """What is logged is the command; the gear of another summit, a slow one of a strong fin, is not taken."""
    for seed in range(4):
        write_torpedo(tmp_path / f"run_{seed}.csv", seed, "elevator_deg", gear=0.3)
    out = tmp_path / "out"
    done = CliRunner().invoke(automarine, ["fit-pitch", str(tmp_path), "--with", "rudder-rate", "-o", str(out)])
    assert done.exit_code == 0, done.output
    stored = json.loads((out / "pitch_model.json").read_text())
    gear, elevator = stored["effects"]
    assert (gear["name"], elevator["name"]) == ("rudder-rate", "rudder")
    truth = {"restoring": 2.5, "M_delta": -1.5, "rate": 0.3}
    found = stored["models"][stored["preferred"]] | gear["parameters"] | elevator["parameters"]
    for name, estimate in found.items():
        if name in truth:
            assert abs(estimate["value"] - truth.pop(name)) < 3.5 * estimate["stderr"], name
    assert not truth


def test_a_fin_under_another_name_is_asked_about(tmp_path: Path) -> None:
    log = tmp_path / "run_0.csv"
    write_torpedo(log, 0, "Fin Angle (deg)")
    note = CliRunner().invoke(automarine, ["check", str(log)])
    assert 'write elevator_deg = "Fin Angle (deg)" under [columns]' in " ".join(note.output.split())
    made = CliRunner().invoke(automarine, ["init", str(tmp_path), "--figures", "none"])
    assert 'elevator_deg = "Fin Angle (deg)"' in (tmp_path / "campaign.toml").read_text(), made.output
