"""Single thrusters in logs: what each gives, imbalances between them, and moments that they cannot give."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import Result
from few_candidates import few_candidates
from made_twin import ARM, INERTIA, K_RR, MAP, NAMES, gains_of, plans, spins, swapped, twin
from repository import DATA

from automarine_cli import effects
from automarine_cli.diagnosis import search
from automarine_cli.diagnosis.diagnose import diagnose_runs, parameter_estimates
from automarine_cli.diagnosis.search import CandidateFit
from automarine_cli.diagnosis.study import study_of
from automarine_cli.dofs import HEAVE, SURGE, YAW
from automarine_cli.effects.thruster_imbalance import PARTS
from automarine_cli.errors import SettingError
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.runs.checks import within_limits
from automarine_cli.runs.load import load_runs
from automarine_cli.runs.run import ASKED, Run
from automarine_cli.simulation.specification import EffectSetting
from automarine_cli.thrusters.map import drive_run_by_thrusters, parts_of

BASE = YawModel.base("3", INERTIA, (K_RR,), "N m", YAW)
NAME = "thruster-imbalance"
LOOK_ALIKES = {NAME, *effects.get(NAME).mistaken_for}
LIMIT = 1.0
SEA = DATA / "yaw" / "heavy_rov_sea"


def driven(runs: list[Run]) -> list[Run]:
    return [drive_run_by_thrusters(run, MAP, ARM) for run in runs]


# What each thruster gives


def test_the_parts_add_up_to_the_moment() -> None:
    (run,) = driven(twin(plans(1, 3)))
    np.testing.assert_allclose(sum(run.extras[part] for part in PARTS), run.command, atol=1e-12)
    assert (run.extras["port_forward"] >= 0).all() and (run.extras["stbd_forward"] <= 0).all()
    port = run.extras["n_port"]
    np.testing.assert_allclose(run.extras["port_backward"], np.where(port < 0, -ARM * 2.5 * port**2, 0.0))


def test_the_parts_of_a_force_push_the_same_way() -> None:
    thrust = [np.array([3.0, -2.0]), np.array([1.0, 4.0])]
    parts = parts_of(thrust, SURGE)
    assert {name: part.tolist() for name, part in parts.items()} == {
        "port_forward": [3, 0], "port_backward": [0, -2], "stbd_forward": [1, 4], "stbd_backward": [0, 0],
    }  # fmt: skip
    assert parts_of(thrust[:1], HEAVE) == {} and not effects.get(NAME).acts_in(HEAVE)


# Which effect it is


@pytest.mark.parametrize(("seed", "truth"), [(1, (0.1, -0.06, 0.05)), (2, (-0.07, -0.07, 0.0)), (3, (0.0, 0.12, -0.1))])
def test_gains_are_recovered_and_their_mirror_is_mirrored(seed: int, truth: tuple[float, float, float]) -> None:
    runs = twin(plans(12, seed), gains_of(*truth), seed=seed)
    for told, signs in ((runs, (1, 1, 1)), ([swapped(run) for run in runs], (-1, -1, 1))):
        study = study_of(driven(told), BASE)
        model = BASE.with_effect(NAME, (0.0, 0.0, 0.0))
        fit = study.fit(model)
        found = parameter_estimates(study, CandidateFit((NAME,), model.with_theta(fit.theta[:-1]), fit, 0.0), NAME)
        for name, sign, value in zip(NAMES, signs, truth):
            assert 0 < found[name].stderr < 0.01
            assert abs(found[name].value - sign * value) < 3.5 * found[name].stderr, f"{name}: {found[name]}"


@pytest.mark.parametrize(("name", "parameter", "truth"), [
    ("thruster-dead-band", "width", 0.03), ("thruster-limit", "limit", 0.5),
])  # fmt: skip
def test_dead_band_and_limit_of_each_are_recovered(name: str, parameter: str, truth: float) -> None:
    study = study_of(driven(twin(plans(12, 6), seed=6, **{parameter: truth})), BASE)
    model = BASE.with_effect(name, (0.8 * truth,))
    fit = study.fit(model)
    found = parameter_estimates(study, CandidateFit((name,), model.with_theta(fit.theta[:-1]), fit, 0.0), name)[
        parameter
    ]
    assert 0 < found.stderr < 0.05 * truth and abs(found.value - truth) < 3.5 * found.stderr


@pytest.mark.slow
@pytest.mark.parametrize(("made", "name"), [
    ({"gains": gains_of(0.1, 0.1, 0.0)}, NAME), ({"bias": 0.05}, "bias-moment"),
    ({"asymmetry": 0.08}, "thrust-asymmetry"),
])  # fmt: skip
def test_each_has_its_own_name(made: dict[str, object], name: str) -> None:
    runs = driven(twin(plans(14, 4), seed=4, **made))  # type: ignore[arg-type]
    with few_candidates(LOOK_ALIKES):
        found = diagnose_runs(runs, BASE, hold_out=[])
    assert [one.name for one in found.effects] == [name]


@pytest.mark.slow
def test_spins_alone_are_a_tie_and_the_advice_is_each_thruster_alone() -> None:
    runs = driven(twin(spins(14, 5), gains_of(0.1, -0.06, 0.05), seed=5))
    with few_candidates(LOOK_ALIKES):
        found = diagnose_runs(runs, BASE, hold_out=[])
    (one,) = found.effects
    (rival,) = one.rivals
    assert {one.name, rival.name} == {NAME, "thrust-asymmetry"}
    assert "thruster alone" in rival.split_by


def test_without_single_thrusters_it_is_no_candidate() -> None:
    bare = [replace(run, extras={}) for run in driven(twin(plans(5, 1)))]
    study = study_of(bare, BASE)
    assert study.signals == () and NAME not in search.candidates(study, BASE)
    assert NAME in search.candidates(study_of(driven(twin(plans(5, 1))), BASE), BASE)


# What the commands have to do with it


def files(folder: Path, runs: list[Run]) -> Path:
    for run in runs:
        table = {"time_s": run.time, "heading_deg": np.rad2deg(run.position) % 360, **run.extras}
        if run.moment is not None:
            table["tau_Nm"] = run.moment
        folder.mkdir(exist_ok=True)
        pd.DataFrame(table).to_csv(folder / run.source, index=False)
    return folder


def stored(folder: Path) -> tuple[Path, Path]:
    """A model with an imbalance, and the thrusters' map."""
    entry = {"k_rr": K_RR, "I_r": INERTIA}
    effect = {"name": NAME, "parameters": dict(zip(NAMES, (0.1, -0.06, 0.05)))}
    model = {
        "schema": "automarine/yaw-model/1", "moment_unit": "N m", "preferred": "3", "models": {"3": entry},
        "effects": [effect],
    }  # fmt: skip
    for name, data in (("model.json", model), ("map.json", MAP.to_json())):
        (folder / name).write_text(json.dumps(data))
    return folder / "model.json", folder / "map.json"


def test_a_stored_imbalance_is_validated(tmp_path: Path, run: Callable[..., Result]) -> None:
    logs = files(tmp_path / "logs", twin(plans(3, 6), gains_of(0.1, -0.06, 0.05), scatter=0.0))
    model, thrusters = stored(tmp_path)
    found = run("validate", logs, "--model", model, "--thrusters", thrusters, "--arm", ARM, "--json")
    assert found.exit_code == 0, found.stderr
    assert json.loads(found.stdout)["models"]["3"]["rmse_deg"] < 2.0


def test_without_thruster_commands_it_is_refused(tmp_path: Path, run: Callable[..., Result]) -> None:
    bare = [replace(one, extras={}) for one in driven(twin(plans(2, 6)))]
    model, _ = stored(tmp_path)
    found = run("validate", files(tmp_path / "logs", bare), "--model", model)
    assert found.exit_code == 1 and "Traceback" not in found.stderr
    assert "needs the thruster commands n_port and n_stbd; log them, and give --thrusters MAP.json" in found.stderr


def test_exports_have_it_or_say_why_not(tmp_path: Path, run: Callable[..., Result]) -> None:
    model, _ = stored(tmp_path)
    card = run("export", model, "--to", "card", "-o", tmp_path / "card.md")
    assert card.exit_code == 0 and NAME in (tmp_path / "card.md").read_text()
    refused = run("export", model, "--to", "python", "-o", tmp_path / "sim.py")
    assert refused.exit_code == 1 and f"{NAME} (it needs the logged n_port, n_stbd)" in refused.stderr


def test_simulate_says_that_it_has_no_thrusters() -> None:
    with pytest.raises(SettingError, match="needs the column 'n_port', which simulated runs lack"):
        EffectSetting(NAME, {}, dof=YAW)


# Moments that thrusters cannot give


def allocated(count: int, seed: int, sign: float = 1.0) -> list[Run]:
    """Runs with a total command of steps, which two thrusters follow as far as their limit goes; way on beside it."""
    random, found = np.random.default_rng(seed), []
    for number in range(count):
        time = 0.1 * np.arange(200)
        asked = sign * np.repeat(random.uniform(-2.6, 2.6, 10), 20)
        ahead = np.repeat(random.uniform(-1.0, 1.0, 5), 40)
        thrust = [ahead + asked / (2 * ARM), ahead - asked / (2 * ARM)]
        n = [np.clip(np.sign(f) * np.sqrt(np.abs(f) / np.where(f > 0, 4.0, 2.5)), -LIMIT, LIMIT) for f in thrust]
        extras = {"n_port": n[0], "n_stbd": n[1]}
        name = f"run_{number}"
        found.append(Run(name, f"{name}.csv", time, np.zeros(200), asked, "N m", extras, dof=YAW))
    return found


def given(run: Run) -> np.ndarray:
    return ARM * (MAP.force(run.extras["n_port"]) - MAP.force(run.extras["n_stbd"]))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_what_was_given_is_told_from_the_log_and_drives_the_run(sign: float) -> None:
    runs = allocated(6, 1, sign)
    limited, (limit,) = within_limits(runs)
    asked, gave = (np.concatenate(one) for one in ([r.command for r in runs], [given(r) for r in runs]))
    short = np.abs(asked - gave) > 0.01 * np.abs(asked).max()
    assert limit.share == pytest.approx(short.mean()) and 0.05 < short.mean() < 0.9
    worst = int(np.argmax(np.abs(asked - gave)))
    assert (limit.asked, limit.given) == (pytest.approx(asked[worst]), pytest.approx(gave[worst]))
    held = {name: np.concatenate([run.extras[name] for run in runs])[worst] for name in ("n_port", "n_stbd")}
    assert dict(limit.thrusters) == {name: n for name, n in held.items() if abs(n) == LIMIT} != {}
    now = np.concatenate([run.command for run in limited])
    np.testing.assert_allclose(now, np.where(short, gave, asked), atol=1e-9)
    assert all(limit.sentence.split(" in ")[0] in " ".join(run.reading) for run in limited)


def test_thrusters_that_follow_are_left_alone() -> None:
    free = [replace(run, moment=given(run)) for run in allocated(6, 2)]
    same, limits = within_limits(free)
    assert limits == () and all(a is b for a, b in zip(same, free))
    measured = [  # speeds that lag behind their command are no allocation
        replace(run, extras={n: np.convolve(c, np.ones(9) / 9, "same") for n, c in run.extras.items()})
        for run in allocated(6, 3)
    ]
    assert within_limits(measured)[1] == ()
    assert within_limits([replace(run, extras={}) for run in free])[1] == ()


def test_a_run_driven_through_its_map_keeps_what_was_asked() -> None:
    runs = allocated(6, 1)
    through = [drive_run_by_thrusters(run, MAP, ARM) for run in runs]
    same, (limit,) = within_limits(through)
    assert limit == within_limits(runs)[1][0]
    np.testing.assert_array_equal(same[0].command, through[0].command)
    np.testing.assert_array_equal(same[0].extras[ASKED], runs[0].command)


def test_check_and_fit_say_so(tmp_path: Path, run: Callable[..., Result]) -> None:
    runs = []
    random = np.random.default_rng(7)
    for number, size in enumerate((0.4, 0.7, 1.0, 1.2, 1.9, 2.4) * 2):
        tau = size if number < 6 else -size
        n_p, n_s = (np.clip(s * np.sqrt(size / 2 / ARM / a), -LIMIT, LIMIT) for s, a in (
            (np.sign(tau), 4.0 if tau > 0 else 2.5), (-np.sign(tau), 2.5 if tau > 0 else 4.0),
        ))  # fmt: skip
        (made,) = twin([[(0.0, 0.0, 2.0), (n_p, n_s, 9.0)]], seed=number, scatter=0.01)
        on = made.extras["n_port"] != 0
        name = f"step_{number:02d}"
        late = 60.0 * number + made.time + random.uniform(0, 0.01)
        runs.append(replace(made, name=name, source=f"{name}.csv", time=late, moment=np.where(on, tau, 0.0)))
    logs = files(tmp_path / "logs", runs)
    seen = json.loads(run("check", logs, "--json").stdout)["yaw_runs"]
    beyond = {one["run"]: one["allocation_limits"] for one in seen if "allocation_limits" in one}
    assert set(beyond) == {f"step_{k:02d}" for k in (4, 5, 10, 11)}
    assert (beyond["step_05"][0]["asked"], beyond["step_05"][0]["given"]) == (2.4, pytest.approx(ARM * 6.5))
    assert beyond["step_05"][0]["thrusters"] == {"n_port": 1.0, "n_stbd": -1.0}
    assert beyond["step_04"][0]["thrusters"] == {"n_stbd": -1.0}
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
