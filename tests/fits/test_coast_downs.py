"""Logs without a command: coast-downs that scipy integrated show drag over inertia, in any motion and both ways; with
one driven run they show all; what does not slow down is refused."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.integrate import solve_ivp

from automarine_cli import fit_yaw
from automarine_cli.commands import automarine
from automarine_cli.commands.fit_motion import FITS
from automarine_cli.dofs import DOFS, HEAVE, YAW, Dof
from automarine_cli.quantities import Floats

LINEAR, QUADRATIC, INERTIA, BUOYANCY = 0.3, 1.2, 2.0, 0.05  # all but the inertia are over it
PERIOD = 0.1


def motion(speed: float, push: Callable[[float], float], seconds: float) -> Floats:
    """Positions under a push over the inertia, from a speed on."""

    def slope(time: float, state: Floats) -> list[float]:
        return [state[1], push(time) - (LINEAR + QUADRATIC * abs(state[1])) * state[1]]

    clock = np.arange(0.0, seconds, PERIOD)
    return np.asarray(solve_ivp(slope, (0.0, seconds), [0.0, speed], t_eval=clock, rtol=1e-9, max_step=0.05).y[0])


def write(path: Path, dof: Dof, position: Floats, rng: np.random.Generator, more: str = "") -> None:
    noisy = dof.logged(position + (0.017 if dof.angular else 0.005) * rng.standard_normal(len(position)))
    rows = [f"{PERIOD * i:.1f},{value:.5f}{more and ',0'}" for i, value in enumerate(noisy)]
    path.write_text("\n".join([f"time_s,{dof.column(dof.position, dof.units.log)}{more}", *rows]) + "\n")


def coasts(folder: Path, dof: Dof, seed: int, side: float = 1.0, count: int = 6) -> None:
    """Logs without a command; in the last ones a hand pushes the vehicle first."""
    rng, constant = np.random.default_rng(seed), BUOYANCY * dof.has_constant
    for i in range(count):
        first, way = rng.uniform(0.8, 2.0), side * (-1.0) ** i
        by_hand = i >= 4 and not dof.has_constant

        def push(time: float, size: float = way * first * by_hand) -> float:
            return constant + size * (3.0 < time < 4.5)

        path = motion(0.0 if by_hand else way * first, push, 20.0)
        write(folder / f"coast_{i}.csv", dof, path, rng)


@pytest.mark.parametrize(
    ("seed", "side"), [(1, -1.0), *(pytest.param(seed, 1.0, marks=pytest.mark.slow) for seed in (2, 3, 4, 5))]
)
def test_coast_downs_alone_give_ratios(tmp_path: Path, seed: int, side: float) -> None:
    coasts(tmp_path, YAW, seed, side)
    out = tmp_path / "out"
    done = CliRunner().invoke(automarine, ["fit-yaw", f"{tmp_path}/coast*.csv", "-o", str(out), "--figures", "none"])
    assert done.exit_code == 0, done.output
    first = done.stdout.splitlines()[0]
    assert first.startswith("Yaw: k_rr/I_r 1.") and "6 of 6 runs) without a moment" in first
    model = json.loads((out / "yaw_model.json").read_text())
    for name, truth, unit in (("k_r", LINEAR, "1/s"), ("k_rr", QUADRATIC, "1/rad")):
        ratio = model["ratios"][f"{name}_over_I_r"]
        assert abs(ratio["value"] - truth) < 3.5 * ratio["stderr"] < 0.25 * truth
        assert ratio["unit"] == unit and ratio["ci95"][0] < truth < ratio["ci95"][1]
    assert model["preferred"] == "2" and model["moment_unit"] == "nu" and model["models"]["2"]["I_r"]["known"] is True
    log, stored = f"{tmp_path}/coast_0.csv", str(out / "yaw_model.json")
    read = CliRunner().invoke(automarine, ["validate", log, "--model", stored, "--json"])
    assert read.exit_code == 0 and json.loads(read.stdout)["models"]["2"]["rmse_deg"] < 3.0  # of 100 degrees


@pytest.mark.slow
@pytest.mark.parametrize("dof", [dof for dof in DOFS.values() if not (dof.restoring or dof is YAW)])
def test_coast_downs_of_every_motion(tmp_path: Path, dof: Dof) -> None:
    coasts(tmp_path, dof, 4)
    fit = FITS[dof.name](tmp_path)
    symbols = dof.symbols
    truths = {symbols.linear: LINEAR, symbols.quadratic: QUADRATIC}
    truths |= {symbols.constant: BUOYANCY} if dof is HEAVE else {}
    assert fit.of_ratios and fit.preference.number == "2"
    for name, truth in truths.items():
        assert abs(fit.ratios[name].value - truth) < 3.5 * fit.ratios[name].stderr < 0.4 * truth


@pytest.mark.slow
def test_one_driven_run_gives_the_rest(tmp_path: Path) -> None:
    coasts(tmp_path, YAW, 5, count=3)
    levels = np.repeat([0.0, 3.0, 0.0, -2.0, 0.0, 1.0, 0.0], [20, 80, 20, 80, 20, 40, 40])
    path = motion(0.0, lambda time: levels[min(int(time / PERIOD + 1e-9), 299)] / INERTIA, 30.0)
    log = tmp_path / "driven.csv"
    write(log, YAW, path, np.random.default_rng(6), ",tau_Nm")
    rows = [line.rpartition(",")[0] for line in log.read_text().splitlines()[1:]]
    log.write_text("\n".join(["time_s,heading_deg,tau_Nm", *(f"{r},{n}" for r, n in zip(rows, levels))]) + "\n")
    fit = fit_yaw(tmp_path)
    assert not (fit.of_ratios or fit.ratios) and fit.moment_unit == "N m" and fit.preference.number == "2"
    for name, truth in {"I_r": INERTIA, "k_r": INERTIA * LINEAR, "k_rr": INERTIA * QUADRATIC}.items():
        estimate = fit.preferred.estimates[name]
        assert abs(estimate.value - truth) < 3.5 * estimate.stderr < 0.1 * truth
    of_known = fit_yaw(sorted(tmp_path.glob("coast*.csv")), known={"I_r": INERTIA}).preferred.estimates["k_rr"]
    assert abs(of_known.value - INERTIA * QUADRATIC) < 3.5 * of_known.stderr


def test_a_campaign_may_hold_coast_downs_alone(tmp_path: Path) -> None:
    coasts(tmp_path, YAW, 8, count=2)
    done = CliRunner().invoke(automarine, ["init", str(tmp_path), "-o", f"{tmp_path}/campaign.toml"])
    assert done.exit_code == 0 and "No open questions" in done.stdout, done.output
    assert 'manoeuvres = ["*.csv"]' in (tmp_path / "campaign.toml").read_text()


def test_what_does_not_slow_down_is_refused(tmp_path: Path) -> None:
    """Steps whose command was not logged, and one whose column has another name."""
    log, rng = tmp_path / "step.csv", np.random.default_rng(7)
    path = motion(0.0, lambda time: (1.0 if time < 10.0 else -1.0) * (time > 2.0), 20.0)
    write(log, YAW, path, rng)
    done = CliRunner().invoke(automarine, ["fit-yaw", str(log)])
    says = (
        "no yaw moment; found the columns time_s, heading_deg; expected tau or tau_Nm or both n_port and n_stbd. A log "
    )
    says += "without a moment serves if the vehicle slows down in it; here it does not. If a column of another name is"
    assert done.exit_code == 1 and says in " ".join(done.stderr.split())
    write(log, YAW, motion(1.5, lambda time: 0.0, 20.0), rng, ",torque")
    done = CliRunner().invoke(automarine, ["fit-yaw", str(log)])
    assert done.exit_code == 1 and 'write tau = "torque"' in " ".join(done.stderr.split())
