"""predict: paths of validate, closed forms, bands that hold the truth of independent integrators, starts, refusals."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from made_driven import Sea, steered
from made_planar import HIDDEN as CRAFTS
from made_planar import campaign, driven, quadratic_drags
from made_runs import INERTIA, K_RR, solved, step_heading
from repository import SAMPLE_RUNS

import automarine_cli as am
from automarine_cli.commands import automarine
from automarine_cli.comparison.prediction import Doubt, Prediction, _pushes
from automarine_cli.comparison.simulated_runs import planar_free_runs
from automarine_cli.dofs import YAW
from automarine_cli.models.model import Model, response
from automarine_cli.models.store import model_head, planar_json
from automarine_cli.quantities import Floats
from automarine_cli.simulation.batch import WINDOW_S, make_batch

ESTIMATE = {"I_r": INERTIA, "k_rr": K_RR}
NU = {"I_r": "nu s²", "k_rr": "nu s²"}


def written(path: Path, scatter: float = 0.0, errors: float = 0.0, **more: Any) -> Path:
    """A file of the paper's model 3, with relative `errors` of its parameters and `scatter` of the thrust."""
    entry = {
        name: {"value": value, "stderr": errors * value, "ci95": [value, value], "unit": NU[name]}
        for name, value in ESTIMATE.items()
    }
    data = {**model_head(YAW, "nu"), "models": {"3": entry}, "preferred": "3", "gain_scatter": scatter, **more}
    path.write_text(json.dumps(data), encoding="utf-8")
    return path


def ends(prediction: Prediction, column: str = "heading_deg") -> Floats:
    """Prediction, low and high end of a column at the end of each run, (R, 3)."""
    frame = prediction.to_frame()
    by_run = frame.groupby("run", sort=False) if "run" in frame else frame.groupby(np.zeros(len(frame)))
    return by_run.last()[[column, f"{column}_low", f"{column}_high"]].to_numpy()


def held_out(rng: np.random.Generator, period: float, scatter: float) -> tuple[dict[str, Floats], Floats]:
    """A manoeuvre sampled every `period` [s], whose moment changes at any instant, and its true heading [deg]."""
    switches = np.cumsum([rng.uniform(2.0, 2.0 + period), *rng.uniform(2.0, 10.0, rng.integers(2, 8))])
    levels, time = rng.uniform(-1.1, 1.1, len(switches)), np.arange(0.0, switches[-1] + 6.0, period)
    gain = np.exp(scatter * rng.standard_normal())
    heading = np.rad2deg(solved(switches, gain * levels, time, 0.0, K_RR, 0.0))
    logged = np.append(0.0, levels)[np.searchsorted(switches, time, side="right")]
    return {"time_s": time, "heading_deg": heading + rng.standard_normal(len(time)), "tau": logged}, heading


def inside(prediction: Prediction, truth: Floats) -> Floats:
    _, low, high = ends(prediction).T
    return (low <= truth) & (truth <= high)


@pytest.mark.parametrize(
    ("motion", "logs"),
    [
        ("yaw", "validation"),
        pytest.param("surge", "surge_validation", marks=pytest.mark.slow),
        pytest.param("roll", "roll_validation", marks=pytest.mark.slow),
    ],
)
def test_a_prediction_is_the_free_run_of_validate(motion: str, logs: str) -> None:
    """The same start, the same path."""
    steps = {"yaw": "steps", "surge": "surge", "roll": "roll_validation"}[motion]
    fit = getattr(am, f"fit_{motion}")(SAMPLE_RUNS / steps)
    validation = am.validate(SAMPLE_RUNS / logs, model=fit).models[fit.preference.number]
    predicted = fit.predict(SAMPLE_RUNS / logs)
    assert [of.run.name for of in predicted.predicted] == [free.run.name for free in validation.free]
    for of, free in zip(predicted.predicted, validation.free):
        position, _, _ = of.bands[of.run.dof.position]
        assert np.abs(of.run.dof.shown(position - free.position)).max() < 0.05
    value, low, high = ends(predicted, predicted.shown[fit.dof.position].name).T
    assert np.all((low < value) & (value < high))


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_commands_alone_start_at_zero_or_as_given_and_follow_the_closed_form(tmp_path: Path, side: float) -> None:
    """Dense rows, and two rows: a command holds until the next one."""
    model, dense = written(tmp_path / "yaw_model.json"), np.arange(0.0, 20.05, 0.1)
    exact = np.rad2deg(response(np.array([20.0]), np.array([0.6]), INERTIA, 0.0, K_RR)[0][0])
    for time in (dense, np.array([0.0, 20.0])):
        table = pd.DataFrame({"time_s": time, "tau": side * 0.6})
        assert ends(am.predict(model, commands=table))[0, 0] == pytest.approx(side * exact, abs=0.02)
        given = am.predict(model, commands=table, start=side * 90.0)
        assert ends(given)[0, 0] == pytest.approx(side * (exact + 90.0), abs=0.02)
    coasting = am.predict(model, commands={"time_s": [0.0, 10.0], "tau": [0.0, 0.0]}, start_rate=side * 30.0)
    rate = np.deg2rad(30.0)
    slower = np.rad2deg(rate / (1.0 + K_RR / INERTIA * rate * 10.0))  # r' = -k/I r²
    assert ends(coasting, "yaw_rate_deg_s")[0, 0] == pytest.approx(side * slower, abs=1e-3)
    steps = {"time_s": [0.0, 2.0, 9.0, 20.0], "tau": side * np.array([0.0, 0.6, -0.6, 0.0])}
    turn, back = (solved((2.0, 9.0), (0.6, level), np.array([20.0]), 0.0, K_RR, 0.0)[0] for level in (-0.6, 0.6))
    found = ends(am.predict(model, commands=steps))[0, 0]
    assert found == pytest.approx(side * np.rad2deg(turn), abs=0.1) and abs(found - side * np.rad2deg(back)) > 100.0


def test_the_band_of_scatter_is_that_of_the_closed_form(tmp_path: Path) -> None:
    table = {"time_s": [0.0, 30.0], "tau": [0.8, 0.8]}
    _, low, high = ends(am.predict(written(tmp_path / "m.json", scatter=0.05), commands=table))[0]
    gains = 0.8 * np.exp(1.96 * 0.05 * np.array([-1.0, 1.0]))
    exact = np.rad2deg(response(np.full(2, 30.0), gains, INERTIA, 0.0, K_RR)[0])
    assert np.abs(np.array([low, high]) - exact).max() < 0.15 * np.ptp(exact) / 2
    _, low, high = ends(am.predict(written(tmp_path / "n.json"), commands=table))[0]
    assert high - low == 0.0


@pytest.mark.parametrize("period", [0.1, 0.2])
@pytest.mark.parametrize("instant", [2.0, 2.2, 3.0, 3.8])
def test_the_band_of_a_sampled_step_is_that_of_its_instant(tmp_path: Path, instant: float, period: float) -> None:
    """A step of a log happened anywhere in one interval: its steady rate times 95 % of that, wherever it stands."""
    time = np.round(np.arange(0.0, 12.0, period), 3)
    noise = 1e-3 * np.random.default_rng(0).standard_normal(len(time))
    log = {"time_s": time, "heading_deg": noise, "tau": np.where(time > instant - 1e-6, 0.8, 0.0)}
    _, low, high = ends(am.predict(written(tmp_path / "m.json"), commands=log))[0]
    assert high - low == pytest.approx(0.95 * period * np.rad2deg(np.sqrt(0.8 / K_RR)), rel=0.04)


def test_the_band_of_parameters_is_that_of_their_slopes(tmp_path: Path) -> None:
    """Parameters with independent errors: the errors propagated by differences of the closed form."""
    table, errors = {"time_s": [0.0, 12.0], "tau": [0.8, 0.8]}, 0.02
    _, low, high = ends(am.predict(written(tmp_path / "m.json", errors=errors), commands=table))[0]

    def heading(inertia: float, k_rr: float) -> float:
        return float(np.rad2deg(response(np.array([12.0]), np.array([0.8]), inertia, 0.0, k_rr)[0][0]))

    slopes = [
        heading(INERTIA * 1.01, K_RR) - heading(INERTIA, K_RR),
        heading(INERTIA, K_RR * 1.01) - heading(INERTIA, K_RR),
    ]
    sd = 100.0 * errors * float(np.hypot(*slopes))
    assert (high - low) / 2 == pytest.approx(1.96 * sd, rel=0.12)


def test_pushes_are_the_means_of_the_process_over_windows() -> None:
    """Variance and covariance of neighbouring means of an Ornstein-Uhlenbeck process, in closed form."""
    model, size, lasting = Model.base("3", INERTIA, [K_RR], "nu", YAW), 0.2, 3.0
    doubt = Doubt(np.zeros((2, 2)), size=np.array([size]), time=np.array([lasting]), thrust=np.array([0.1]))
    run = driven(0, 41.0)
    run = type(run)("r", "r.csv", run.time, run.position, np.full(len(run), 0.5), "nu", dof=YAW)
    batch = make_batch([run], 0.1)
    theta = np.tile(model.theta, (20_000, 1))
    (pushes,) = _pushes(model, doubt, batch, theta, np.random.default_rng(3))
    span, thrust = WINDOW_S / lasting, 0.1**2 / WINDOW_S * 0.5**2
    fade = np.exp(-span)
    variance = INERTIA**2 * size**2 * 2.0 / span**2 * (span - 1.0 + fade)
    beside = INERTIA**2 * size**2 * (1.0 - fade) ** 2 / span**2
    inner = pushes[1:, 2:-2]
    assert np.all(pushes[0] == 0.0)
    assert inner.var() == pytest.approx(variance + thrust, rel=0.02)
    assert np.mean(inner[:, 1:] * inner[:, :-1]) == pytest.approx(beside, rel=0.02)


@pytest.mark.slow
def test_a_disturbed_vehicle_ends_inside_its_band(tmp_path: Path) -> None:
    """Runs of an independent integrator under moments that answer nothing, every other one mirrored; sizes of what is
    random as they are."""
    sea = Sea(INERTIA, 0.0, K_RR, noise_deg=0.2)
    random = {"yaw.disturbance": sea.size, "yaw.disturbance-time": sea.lasting, "yaw.thrust-noise": sea.thrust}
    model = written(tmp_path / "m.json", random=random, driven=True, scatter=sea.scatter)
    runs, sides = steered(150, 5, sea, length=30.0, free=True), np.tile([1.0, -1.0], 75)
    logs = {
        f"{i:03d}": {"time_s": run.time, "heading_deg": side * np.rad2deg(run.position), "tau": side * run.command}
        for i, (side, run) in enumerate(zip(sides, runs, strict=True))
    }  # fmt: skip
    truth = sides * np.rad2deg([run.position[-1] for run in runs])
    share = inside(am.predict(model, commands=logs), truth).mean()
    assert 0.90 <= share <= 0.98


@pytest.mark.slow
@pytest.mark.parametrize("scatter", [0.0, 0.03])
def test_bands_of_fits_hold_runs_held_out(scatter: float) -> None:
    """Campaigns of 24 steps at 5 to 10 Hz, fitted; 24 runs each by scipy's integrator, commands changed at any instant.
    Of a run the band holds all or little, since its thrust is drawn once: so the shares are means."""
    during, ended = [], []
    for seed, period in enumerate((0.1, 0.2, 0.15, 0.1, 0.2, 0.15, 0.1, 0.2)):
        rng, logs = np.random.default_rng(seed), {}
        for i, level in enumerate(np.round(np.linspace(-1.2, 1.2, 24), 3)):
            time = np.arange(-2.0, 15.0, period) + rng.uniform(0.0, period)
            heading = np.rad2deg(step_heading(time, level * np.exp(scatter * rng.standard_normal())))
            heading += rng.standard_normal(len(time))
            logs[f"step_{i:02d}"] = {"time_s": 100.0 + time, "heading_deg": heading, "tau": level * (time > 0)}
        runs = [held_out(rng, period, scatter) for _ in range(24)]
        prediction = am.fit_yaw(logs).predict([log for log, _ in runs])
        for of, (_, truth) in zip(prediction.predicted, runs, strict=True):
            _, low, high = np.rad2deg(of.bands["heading"])
            held = (low <= truth) & (truth <= high)
            during.append(held.mean())
            ended.append(held[-1])
    assert len(ended) == 192
    assert 0.90 <= np.mean(during) <= 0.98 and 0.90 <= np.mean(ended) <= 0.98, (np.mean(during), np.mean(ended))


@pytest.mark.slow
def test_the_band_of_a_real_boat_contains_what_was_measured() -> None:
    """The run that is left out of the walk: for 94 % of it, as the page says."""
    prediction = am.fit_yaw(SAMPLE_RUNS / "real_boat").predict(SAMPLE_RUNS / "real_boat_validation")
    (predicted,) = prediction.predicted
    _, low, high = predicted.bands["heading"]
    share = np.mean((low <= predicted.run.position) & (predicted.run.position <= high))
    assert share == pytest.approx(0.94, abs=0.01)


def planar_file(path: Path, craft: str = "munk-moment") -> Path:
    model = quadratic_drags(20.0, 32.0, 2.6, drags=(18.0, 60.0, 4.0))
    random = {"gain-scatter": 0.02}
    path.write_text(json.dumps({**planar_json(model), "random": random}), encoding="utf-8")
    return path


def test_a_planar_prediction_has_the_track_and_holds_its_ends(tmp_path: Path) -> None:
    """Runs of an integrator by momentum whose thrust scatters by 2 %."""
    model = quadratic_drags(20.0, 32.0, 2.6, drags=(18.0, 60.0, 4.0))
    path = planar_file(tmp_path / "planar_model.json")
    runs = campaign(CRAFTS["munk-moment"], 3, 7, 12.0)
    logs = {}
    for i, run in enumerate(runs):
        columns = {"time_s": run.time, "heading_deg": np.rad2deg(run.position), "tau_Nm": run.command}
        columns |= {f"{name}_m": run.extras[name] for name in ("north", "east")}
        columns |= {f"{name}_m_s": run.extras[name] for name in ("surge", "sway")}
        logs[f"{i:02d}"] = columns | {"force_X_N": run.extras["force_X"], "force_Y_N": run.extras["force_Y"]}
    prediction = am.predict(path, commands=logs)
    (free,) = planar_free_runs(model, runs[:1])
    first = prediction.predicted[0]
    assert np.abs(first.bands["east"][0] - free.simulated["east"]).max() < 1e-3
    frame = prediction.to_frame()
    assert {"north_m", "east_m_low", "surge_m_s", "sway_m_s_high", "yaw_rate_deg_s", "force_X_N"} <= {*frame.columns}
    for name, column in (("north", "north_m"), ("heading", "heading_deg"), ("surge", "surge_m_s")):
        noise = {"north": 0.02, "heading": np.rad2deg(0.01), "surge": 0.01}[name]
        measured = np.array([
            np.rad2deg(run.position[-1]) if name == "heading" else run.extras[name][-1] for run in runs
        ])  # fmt: skip
        _, low, high = ends(prediction, column).T
        spread = np.hypot((high - low) / 2, 1.96 * noise)
        share = np.mean(np.abs(measured - (low + high) / 2) <= spread)
        assert share >= 0.85, name


def test_files_are_read_back_as_logs(tmp_path: Path) -> None:
    model, table = written(tmp_path / "yaw_model.json", scatter=0.03), {"time_s": [0.0, 20.0], "tau": [0.5, 0.5]}
    for parquet in (False, True):
        out = tmp_path / f"out_{parquet}"
        prediction = am.predict(model, commands=table, out=out, parquet=parquet)
        name = "prediction.parquet" if parquet else "prediction.csv"
        assert {path.name for path in out.iterdir()} == {"prediction.json", name, "prediction.png", "manifest.json"}
        again = am.check(out / name)
        assert len(again.runs) == 1 and again.runs[0].samples == len(prediction.to_frame())
    data = json.loads((out / "prediction.json").read_text())
    (run,) = data["predicted"].values()
    assert data["schema"] == "automarine/prediction/1" and data["band"]["gain_scatter"] == 0.03
    low, high = run["end"]["heading_deg"]["ci95"]
    assert low < run["end"]["heading_deg"]["value"] < high
    assert am.predict(model, commands=table).to_json() == data | {"model": data["model"]}


def refused(tmp_path: Path, text: str, *options: str, **more: Any) -> str:
    """The sentence with which commands in a file are refused."""
    log, model = tmp_path / "c.csv", written(tmp_path / "yaw_model.json", **more)
    log.write_text(text, encoding="utf-8")
    result = CliRunner().invoke(automarine, ["predict", str(model), str(log), *options])
    assert result.exit_code == 1 and "Traceback" not in result.output
    return " ".join(result.output.split())


def test_what_cannot_be_predicted_is_refused_in_a_sentence(tmp_path: Path) -> None:
    assert "found 1 row with time and command" in refused(tmp_path, "time_s,tau\n0,1\n")
    back = refused(tmp_path, "time_s,tau\n0,1\n5,1\n3,1\n")
    assert "row 4" in back and "the clock steps back from 5 s to 3 s" in back
    assert "at most a day" in refused(tmp_path, "time_s,tau\n0,1\n900000,1\n")
    assert "no yaw moment; found the columns time_s, x;" in refused(tmp_path, "time_s,x\n0,1\n5,1\n")
    assert "no time" in refused(tmp_path, "t,tau\n0,1\n5,1\n")
    sag = [{"name": "voltage-exponent", "parameters": {"p": 1.2, "V_ref": 15.0}}]
    lacks = refused(tmp_path, "time_s,tau\n0,1\n5,1\n", effects=sag)
    assert "voltage_V" in lacks
    assert "was fitted to moments in nu" in refused(tmp_path, "time_s,tau_Nm\n0,1\n5,1\n")


def test_a_result_that_is_no_model_predicts_nothing() -> None:
    with pytest.raises(TypeError, match="is no model"):
        am.check(SAMPLE_RUNS / "surge_validation").predict(SAMPLE_RUNS / "surge_validation")


def test_commands_beyond_those_of_the_fit_are_warned_of(tmp_path: Path) -> None:
    model = written(tmp_path / "yaw_model.json", valid_range={"moment": [-1.0, 1.0]})
    assert "Warning: The moments reach 2.00 nu" in repr(
        am.predict(model, commands={"time_s": [0.0, 5.0], "tau": [2.0, 2.0]})
    )
    assert "Warning" not in repr(am.predict(model, commands={"time_s": [0.0, 5.0], "tau": [-1.0, -1.0]}))
