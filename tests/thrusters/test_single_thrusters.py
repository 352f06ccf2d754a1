"""Single thrusters in logs: what each gives, imbalances between them, and moments that they cannot give."""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import Result
from few_candidates import few_candidates
from numpy.typing import NDArray
from repository import DATA
from tank import pool_specification

from automarine_cli import effects
from automarine_cli.diagnosis import search
from automarine_cli.diagnosis.diagnose import diagnose_runs, parameter_estimates
from automarine_cli.diagnosis.study import study_of
from automarine_cli.diagnosis.trials import CandidateFit
from automarine_cli.dofs import HEAVE, SURGE, YAW
from automarine_cli.effects.thruster_imbalance import PARTS
from automarine_cli.errors import SettingError
from automarine_cli.estimate import Estimate
from automarine_cli.models.model import Model
from automarine_cli.runs.checks import within_limits
from automarine_cli.runs.load import load_runs
from automarine_cli.runs.run import LOGGED_COMMAND, Run
from automarine_cli.thrusters.curves import PowerCurve
from automarine_cli.thrusters.map import ThrusterMap, drive_run_by_thrusters, parts_of

Floats = NDArray[np.float64]
MAP = ThrusterMap("square", PowerCurve(4.0), PowerCurve(2.5))
ARM, INERTIA, K_RR = 0.25, 1.1, 1.3
FINE, EVERY = 0.01, 10  # s, of the integrator; samples of it to one of the log
NAMES = ("forward", "backward", "direction")
BASE = Model.base("3", INERTIA, (K_RR,), "N m", YAW)
NAME = "thruster-imbalance"
LOOK_ALIKES = {NAME, *effects.get(NAME).mistaken_for}
LIMIT = 1.0
SEA = DATA / "yaw" / "heavy_rov_sea"


# A vehicle with two thrusters whose commands are logged: its equations in fine steps


def gains_of(forward: float, backward: float, direction: float) -> tuple[float, float, float, float]:
    """Of port forward and backward, starboard forward and backward; written out apart from the library."""
    ahead, astern = 1 + direction, 1 - direction
    return ahead * (1 + forward), astern * (1 + backward), ahead * (1 - forward), astern * (1 - backward)


def plans(count: int, seed: int) -> list[Floats]:
    """Runs of stretches of (n_port, n_stbd, seconds): spins, single thrusters, way on, coasting."""
    random, runs = np.random.default_rng(seed), []
    for i in range(count):
        size = random.uniform(0.3, 1.0, 4) * np.where(random.random(4) < 0.5, 1.0, -1.0)
        kinds = ((1, -1), (1, 0), (0, 1), (1, 0.5), (0.4, 1), (1, -0.3))
        chosen = [kinds[k] for k in random.permutation(len(kinds))[:3]]
        run = [(p * s, q * s, random.uniform(3.0, 6.0)) for (p, q), s in zip(chosen, size)]
        runs.append(np.array([(0.0, 0.0, 1.5), *run, *([(0.0, 0.0, 4.0)] if i % 2 else [])]))
    return runs


def spins(count: int, seed: int) -> list[Floats]:
    """Runs in which both thrusters turn equally fast, opposite ways."""
    random = np.random.default_rng(seed)
    sizes = random.uniform(0.3, 1.0, (count, 2)) * np.where(random.random((count, 2)) < 0.5, 1.0, -1.0)
    return [np.array([(0.0, 0.0, 1.5), (a, -a, 6.0), (b, -b, 5.0)]) for a, b in sizes]


def twin(
    plans: Sequence[Floats], gains: Sequence[float] = (1.0, 1.0, 1.0, 1.0), *, seed: int = 0, scatter: float = 0.02,
    bias: float = 0.0, asymmetry: float = 0.0, width: float = 0.0, limit: float = np.inf,
) -> list[Run]:  # fmt: skip
    """The runs as logged, with headings and thruster commands, without a moment; `width` and `limit` [N m] are a
    dead-band and an end of each thruster by itself."""
    random, runs = np.random.default_rng(seed), []
    for number, plan in enumerate(plans):
        ends = np.cumsum(plan[:, 2])
        late = random.uniform(0.0, EVERY * FINE)  # the commands change somewhere between two samples
        fine = np.arange(0.0, ends[-1] - EVERY * FINE, FINE)
        n = plan[np.searchsorted(ends, fine + late, side="right"), :2].T
        pairs = np.reshape(gains, (2, 2, 1))
        thrust = np.where(n > 0, 4.0 * pairs[:, 0], -2.5 * pairs[:, 1]) * n**2
        thrust = np.sign(thrust) * np.minimum(np.maximum(np.abs(thrust) - width / ARM, 0.0), limit / ARM)
        tau = ARM * (thrust[0] - thrust[1]) * np.exp(scatter * random.standard_normal())
        tau = tau * (1.0 + asymmetry * np.sign(tau)) + bias
        heading, rate = np.zeros(len(fine)), 0.0
        for m in range(len(fine) - 1):
            middle = rate + 0.5 * FINE * (tau[m] - K_RR * abs(rate) * rate) / INERTIA
            heading[m + 1] = heading[m] + FINE * middle
            rate += FINE * (tau[m] - K_RR * abs(middle) * middle) / INERTIA
        logged = random.uniform(-3, 3) + heading[::EVERY]
        logged = logged + np.deg2rad(0.5) * random.standard_normal(len(logged))
        extras, name = {"n_port": n[0, ::EVERY], "n_stbd": n[1, ::EVERY]}, f"twin_{number:02d}"
        runs.append(Run(name, f"{name}.csv", 60.0 * number + fine[::EVERY], logged, None, "", extras, dof=YAW))
    return runs


def swapped(run: Run) -> Run:
    """The same run in the mirror: the thrusters change places."""
    extras = {"n_port": run.extras["n_stbd"], "n_stbd": run.extras["n_port"]}
    return replace(run, position=-run.position, extras=extras)


def driven(runs: list[Run]) -> list[Run]:
    return [drive_run_by_thrusters(run, MAP, ARM) for run in runs]


def test_the_parts_of_each_thruster_add_up() -> None:
    (run,) = driven(twin(plans(1, 3)))
    np.testing.assert_allclose(sum(run.extras[part] for part in PARTS), run.command, atol=1e-12)
    assert (run.extras["port_forward"] >= 0).all() and (run.extras["stbd_forward"] <= 0).all()
    port = run.extras["n_port"]
    np.testing.assert_allclose(run.extras["port_backward"], np.where(port < 0, -ARM * 2.5 * port**2, 0.0))
    thrust = [np.array([3.0, -2.0]), np.array([1.0, 4.0])]  # ahead both push the same way
    assert {name: part.tolist() for name, part in parts_of(thrust, SURGE).items()} == {
        "port_forward": [3, 0], "port_backward": [0, -2], "stbd_forward": [1, 4], "stbd_backward": [0, 0],
    }  # fmt: skip
    assert parts_of(thrust[:1], HEAVE) == {} and not effects.get(NAME).acts_in(HEAVE)


# Which effect it is


def estimates(runs: list[Run], name: str, start: tuple[float, ...]) -> dict[str, Estimate]:
    """Parameters of the effect fitted to the runs from `start`."""
    study, model = study_of(driven(runs), BASE), BASE.with_effect(name, start)
    fit = study.fit(model)
    return parameter_estimates(study, CandidateFit((name,), model.with_theta(fit.theta[:-1]), fit, 0.0), name)


@pytest.mark.parametrize(("seed", "truth"), [(1, (0.1, -0.06, 0.05)), (3, (0.0, 0.12, -0.1))])
def test_gains_are_recovered_and_their_mirror_is_mirrored(seed: int, truth: tuple[float, float, float]) -> None:
    runs = twin(plans(12, seed), gains_of(*truth), seed=seed)
    for logged, signs in ((runs, (1, 1, 1)), ([swapped(run) for run in runs], (-1, -1, 1))):
        fitted = estimates(logged, NAME, (0.0, 0.0, 0.0))
        for name, sign, gain in zip(NAMES, signs, truth):
            assert 0 < fitted[name].stderr < 0.01
            assert abs(fitted[name].value - sign * gain) < 3.5 * fitted[name].stderr, f"{name}: {fitted[name]}"


@pytest.mark.parametrize(
    ("name", "parameter", "truth"), [("thruster-dead-band", "width", 0.03), ("thruster-limit", "limit", 0.5)]
)
def test_dead_band_and_limit_of_each_are_recovered(name: str, parameter: str, truth: float) -> None:
    fitted = estimates(twin(plans(12, 6), seed=6, **{parameter: truth}), name, (0.8 * truth,))[parameter]
    assert 0 < fitted.stderr < 0.05 * truth and abs(fitted.value - truth) < 3.5 * fitted.stderr


@pytest.mark.slow
@pytest.mark.parametrize(
    ("planted", "name"),
    [
        ({"gains": gains_of(0.1, 0.1, 0.0)}, NAME),
        ({"bias": 0.05}, "bias-moment"),
        ({"asymmetry": 0.08}, "thrust-asymmetry"),
    ],
)
def test_each_has_its_own_name(planted: dict[str, object], name: str) -> None:
    with few_candidates(LOOK_ALIKES):
        diagnosis = diagnose_runs(driven(twin(plans(14, 4), seed=4, **planted)), BASE, hold_out=[])  # type: ignore[arg-type]
    assert [effect.name for effect in diagnosis.effects] == [name]


@pytest.mark.slow
def test_spins_alone_are_a_tie_and_the_advice_is_each_thruster_alone() -> None:
    with few_candidates(LOOK_ALIKES):
        diagnosis = diagnose_runs(driven(twin(spins(14, 5), gains_of(0.1, -0.06, 0.05), seed=5)), BASE, hold_out=[])
    (effect,) = diagnosis.effects
    (rival,) = effect.rivals
    assert {effect.name, rival.name} == {NAME, "thrust-asymmetry"}
    assert "thruster alone" in rival.split_by


def test_without_single_thrusters_it_is_no_candidate() -> None:
    runs = driven(twin(plans(5, 1)))
    study = study_of([replace(run, extras={}) for run in runs], BASE)
    assert study.signals == () and NAME not in search.candidates(study, BASE)
    assert NAME in search.candidates(study_of(runs, BASE), BASE)


# What the commands have to do with it


def files(folder: Path, runs: list[Run]) -> Path:
    folder.mkdir()
    for run in runs:
        table = {"time_s": run.time, "heading_deg": np.rad2deg(run.position) % 360, **run.extras}
        table |= {} if run.moment is None else {"tau_Nm": run.moment}
        pd.DataFrame(table).to_csv(folder / run.source, index=False)
    return folder


def test_commands_use_a_stored_imbalance_or_say_what_they_lack(tmp_path: Path, run: Callable[..., Result]) -> None:
    model, thrusters = tmp_path / "model.json", tmp_path / "map.json"
    effect = {"name": NAME, "parameters": dict(zip(NAMES, (0.1, -0.06, 0.05)))}
    model.write_text(json.dumps({
        "schema": "automarine/yaw-model/1", "moment_unit": "N m", "preferred": "3",
        "models": {"3": {"k_rr": K_RR, "I_r": INERTIA}}, "effects": [effect],
    }))  # fmt: skip
    thrusters.write_text(json.dumps(MAP.to_json()))
    logs = files(tmp_path / "logs", twin(plans(3, 6), gains_of(0.1, -0.06, 0.05), scatter=0.0))
    validated = run("validate", logs, "--model", model, "--thrusters", thrusters, "--arm", ARM, "--json")
    assert validated.exit_code == 0, validated.stderr
    assert json.loads(validated.stdout)["models"]["3"]["rmse_deg"] < 2.0
    bare = files(tmp_path / "bare", [replace(each, extras={}) for each in driven(twin(plans(2, 6)))])
    refused = run("validate", bare, "--model", model)
    assert refused.exit_code == 1 and "needs the thruster commands n_port and n_stbd; log them" in refused.stderr
    refused = run("export", model, "--to", "python", "-o", tmp_path / "sim.py")
    assert refused.exit_code == 1 and f"{NAME} (it needs the logged n_port, n_stbd)" in refused.stderr
    with pytest.raises(SettingError, match="needs the column 'n_port', which simulated runs lack"):
        pool_specification(effects=[{"name": NAME, **dict(zip(NAMES, (0.1, -0.06, 0.05)))}])


# Moments that thrusters cannot give


def allocated(count: int, seed: int, sign: float = 1.0) -> list[Run]:
    """Runs with a total command of steps, which two thrusters follow as far as their limit goes; way on beside it."""
    random, runs = np.random.default_rng(seed), []
    for number in range(count):
        command = sign * np.repeat(random.uniform(-2.6, 2.6, 10), 20)
        ahead = np.repeat(random.uniform(-1.0, 1.0, 5), 40)
        thrust = [ahead + command / (2 * ARM), ahead - command / (2 * ARM)]
        n = [np.clip(np.sign(f) * np.sqrt(np.abs(f) / np.where(f > 0, 4.0, 2.5)), -LIMIT, LIMIT) for f in thrust]
        extras, name = {"n_port": n[0], "n_stbd": n[1]}, f"run_{number}"
        runs.append(Run(name, f"{name}.csv", 0.1 * np.arange(200), np.zeros(200), command, "N m", extras, dof=YAW))
    return runs


def delivered(run: Run) -> np.ndarray:
    return ARM * (MAP.force(run.extras["n_port"]) - MAP.force(run.extras["n_stbd"]))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_what_thrusters_gave_drives_the_run(sign: float) -> None:
    runs = allocated(6, 1, sign)
    limited, (limit,) = within_limits(runs)
    command, gave = (np.concatenate(parts) for parts in ([r.command for r in runs], [delivered(r) for r in runs]))
    short = np.abs(command - gave) > 0.01 * np.abs(command).max()
    assert limit.share == pytest.approx(short.mean()) and 0.05 < short.mean() < 0.9
    worst = int(np.argmax(np.abs(command - gave)))
    assert (limit.asked, limit.given) == (pytest.approx(command[worst]), pytest.approx(gave[worst]))
    held = {name: np.concatenate([run.extras[name] for run in runs])[worst] for name in ("n_port", "n_stbd")}
    assert dict(limit.thrusters) == {name: n for name, n in held.items() if abs(n) == LIMIT} != {}
    now = np.concatenate([run.command for run in limited])
    np.testing.assert_allclose(now, np.where(short, gave, command), atol=1e-9)
    assert all(limit.sentence.split(" in ")[0] in " ".join(run.reading) for run in limited)
    through = driven(runs)  # a run driven through its map keeps what was commanded
    same, (again,) = within_limits(through)
    assert again == limit
    np.testing.assert_array_equal(same[0].command, through[0].command)
    np.testing.assert_array_equal(same[0].extras[LOGGED_COMMAND], runs[0].command)


def test_thrusters_that_follow_are_left_alone() -> None:
    free = [replace(run, moment=delivered(run)) for run in allocated(6, 2)]
    same, limits = within_limits(free)
    assert limits == () and all(a is b for a, b in zip(same, free))
    measured = [  # speeds that lag behind their command are no allocation
        replace(run, extras={n: np.convolve(c, np.ones(9) / 9, "same") for n, c in run.extras.items()})
        for run in allocated(6, 3)
    ]
    assert within_limits(measured)[1] == ()
    assert within_limits([replace(run, extras={}) for run in free])[1] == ()


def test_check_and_fit_name_moments_that_thrusters_cannot_give(tmp_path: Path, run: Callable[..., Result]) -> None:
    runs, random = [], np.random.default_rng(7)
    for number, size in enumerate((0.4, 0.7, 1.0, 1.2, 1.9, 2.4) * 2):
        side = 1.0 if number < 6 else -1.0
        n_p, n_s = (
            np.clip(s * np.sqrt(size / 2 / ARM / (4.0 if s > 0 else 2.5)), -LIMIT, LIMIT) for s in (side, -side)
        )
        (step,) = twin([np.array([(0.0, 0.0, 2.0), (n_p, n_s, 9.0)])], seed=number, scatter=0.01)
        time = 60.0 * number + step.time + random.uniform(0, 0.01)
        moment, name = np.where(step.extras["n_port"] != 0, side * size, 0.0), f"step_{number:02d}"
        runs.append(replace(step, name=name, source=f"{name}.csv", time=time, moment=moment))
    logs = files(tmp_path / "logs", runs)
    checked = json.loads(run("check", logs, "--json").stdout)["yaw_runs"]
    beyond = {look["run"]: look["allocation_limits"][0] for look in checked if "allocation_limits" in look}
    assert set(beyond) == {f"step_{k:02d}" for k in (4, 5, 10, 11)}
    assert (beyond["step_05"]["asked"], beyond["step_05"]["given"]) == (2.4, pytest.approx(ARM * 6.5))
    assert beyond["step_05"]["thrusters"] == {"n_port": 1.0, "n_stbd": -1.0}
    assert beyond["step_04"]["thrusters"] == {"n_stbd": -1.0}
    result = json.loads(run("fit-yaw", logs, "--json").stdout)
    assert result["warnings"][0].startswith("The thrusters cannot give the yaw moment commanded in ")
    assert result["models"]["3"]["I_r"]["value"] == pytest.approx(INERTIA, rel=0.05)
    assert result["models"]["3"]["k_rr"]["value"] == pytest.approx(K_RR, rel=0.05)


@pytest.mark.real_data(SEA)
def test_a_real_vehicle_at_its_limits_agrees_with_its_own_configuration() -> None:
    """N = 0.4875 F_lateral + 0.764 (F_port - F_stbd), F = 0.00029112 n |n|, is the nominal map of its source."""
    campaign = load_runs([str(SEA / "run_*.csv")], dof=YAW)
    (limit,) = campaign.limits
    assert (limit.asked, dict(limit.thrusters)) == (764.3, {"rpm_stbd": -1500.0})
    for run in campaign.runs:
        lateral, port, stbd = (
            0.00029112 * n * np.abs(n) for n in (run.extras[f"rpm_{one}"] for one in ("lateral", "port", "stbd"))
        )
        apart = np.abs(run.command - 0.4875 * lateral - 0.764 * (port - stbd))
        assert apart.max() < 8.0 and np.median(apart) < 0.2  # N m, of up to 764 asked
