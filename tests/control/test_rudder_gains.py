"""Gains for a rudder: true boats flown by an integrator of scipy, their margins from the sampled loop."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_rudder import SPEED, Boat, estimate
from numpy.typing import NDArray
from scipy import integrate, signal
from test_tune_cli import Run, small_crowds, written

import automarine_cli as am
from automarine_cli.control.targets.ardupilot import scaling_base
from automarine_cli.control.tuning import set_up

__all__ = ["small_crowds"]  # a fixture
FULL_DEG = 25.0
Floats = NDArray[np.float64]


class Pid:
    """The law of `pid.json`, as its text says it: a rudder angle as it is logged [rad]."""

    def __init__(self, file: Path) -> None:
        content = json.loads(file.read_text())
        self.k_p, self.k_i, self.k_d, self.b, self.t_f = (entry["value"] for entry in content["parallel"].values())
        self.period, self.full = content["sample_time_s"], np.deg2rad(content["rudder_deg_at_full_output"])
        self.total = self.slope = self.before = 0.0

    def __call__(self, reference: float, heading: float) -> float:
        self.slope += self.period / (self.period + self.t_f) * ((heading - self.before) / self.period - self.slope)
        self.before, error = heading, reference - heading
        now = self.k_p * (self.b * reference - heading) - self.k_d * self.slope
        grown = self.total + self.k_i * self.period * error
        if not (abs(now + grown) > 1.0 and (now + grown) * error > 0):
            self.total = grown
        return float(self.full * np.clip(now + self.total, -1.0, 1.0))

    def response(self, z: NDArray[np.complex128]) -> NDArray[np.complex128]:
        weight = self.period / (self.period + self.t_f)
        slope = weight / (1.0 - (1.0 - weight) / z) * (1.0 - 1.0 / z) / self.period
        return self.full * (self.k_p + self.k_i * self.period / (1.0 - 1.0 / z) + self.k_d * slope)


def flown(boat: Boat, pid: Pid, step: float, seconds: float, load: float = 0.0, speed: float = SPEED) -> Floats:
    """Headings [rad] at each loop, the rudder held between; `load` [rad of rudder] pushes all along."""

    def slope(_: float, state: Floats, rudder: float) -> list[float]:
        moment = boat.effect * (boat.side * rudder - load) * speed**2
        return [state[1], moment - boat.damping * speed * state[1] - boat.quadratic * state[1] * abs(state[1])]

    state, path = np.zeros(2), []
    for _ in range(round(seconds / pid.period)):
        path.append(state[0])
        order = pid(step, state[0])
        state = integrate.solve_ivp(slope, (0.0, pid.period), state, args=(order,), rtol=1e-8, atol=1e-10).y[:, -1]
    return np.array(path)


def true_margin(boat: Boat, pid: Pid, speed: float = SPEED) -> float:
    """Disk margin of the loop as the computer sees it, at rest, where quadratic drag gives no damping."""
    a = np.array([[0.0, 1.0], [0.0, -boat.damping * speed]])
    b = np.array([[0.0], [boat.side * boat.effect * speed**2]])
    a, b, *_ = signal.cont2discrete((a, b, np.array([[1.0, 0.0]]), np.zeros((1, 1))), pid.period)
    z = np.exp(1j * np.geomspace(1e-3, np.pi / pid.period, 4000) * pid.period)
    hull = np.linalg.solve(z[:, None, None] * np.eye(2) - a, b[None])[:, 0, 0]
    loop = hull * pid.response(z)
    return float(2.0 / np.max(np.abs((1.0 - loop) / (1.0 + loop))))


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "side"), [(0, -1), (1, 1)])
def test_a_true_boat_answers_as_promised(seed: int, side: int, tmp_path: Path) -> None:
    boat, out = Boat(effect=0.8, damping=0.9, quadratic=0.4, side=side), tmp_path / "out"
    tuned = am.tune(written(tmp_path, boat.model(seed)), target="pid", full=FULL_DEG, out=out, seed=seed)
    assert tuned.verdict == "gains"
    result, pid = json.loads((out / "tuning.json").read_text()), Pid(out / "pid.json")
    assert np.rad2deg(pid.full) == pytest.approx(side * FULL_DEG)
    path = flown(boat, pid, np.pi / 2, 20.0)
    outside = np.flatnonzero(np.abs(path - np.pi / 2) > np.deg2rad(2.0))
    low, high = result["promised"]["settling_s"]["ci95"]
    assert low - 0.2 <= (outside[-1] + 1) * pid.period <= high + 0.2
    margins = result["margins"]["new"]
    for key, speed in (
        ("disk_margin", 1.0),
        *((f"disk_margin_at_{x}_times_the_speed", float(x)) for x in ("0.5", "2")),
    ):
        low, high = margins[key]["ci95"]
        assert 0.95 * low <= true_margin(boat, Pid(out / "pid.json"), speed * SPEED) <= 1.05 * high, key
    recovery, load = result["load_recovery_s"], 0.1 * np.deg2rad(FULL_DEG)
    pushed = np.rad2deg(np.abs(flown(boat, Pid(out / "pid.json"), 0.0, recovery, load)))
    assert pushed[-1] <= result["promised"]["load_left_deg"]["ci95"][1] + 0.2 <= 2.2
    low, high = result["promised"]["load_error_deg"]["ci95"]
    assert 0.9 * low <= pushed.max() <= 1.1 * high


@pytest.mark.slow
def test_a_mirrored_boat_gets_the_same_gains(tmp_path: Path) -> None:
    gains = []
    for side in (1, -1):
        path = written(tmp_path, Boat(side=side).model(3))
        gains.append(am.tune(path, target="pid", full=FULL_DEG).new.gains)
    assert gains[0] == gains[1]


def test_rover_turns_a_rudder_less_at_speed_and_its_file_says_from_where(tmp_path: Path) -> None:
    """The share is the one by which the model's own crowd answers."""
    problem = set_up(Path(written(tmp_path, Boat().model())), target="ardurover", full=FULL_DEG)
    gains = dict.fromkeys(problem.target.searched, 0.1)
    lines = problem.target.text(gains, problem.nominal, []).splitlines()
    assert lines[-1] == f"MOT_SPD_SCA_BASE,{0.8 * SPEED:g}" and scaling_base(3.0) == 1.0
    assert problem.target.steering(SPEED, SPEED) == pytest.approx(0.8)
    assert problem.target.steering(2.0 * SPEED, SPEED) == pytest.approx(0.4)
    assert problem.target.steering(0.5 * SPEED, SPEED) == 1.0
    np.testing.assert_allclose(problem.crowds[0].gain[0], 0.8)
    sentence = "The promise is for 1.2 m/s, the logs' mean; an output of 1 turns to starboard, positive rudder turns to"
    assert any(note.startswith(sentence) for note in problem.knowledge.notes)


@pytest.mark.slow
def test_rover_gets_gains_for_a_rudder(tmp_path: Path) -> None:
    tuned = am.tune(written(tmp_path, Boat().model()), target="ardurover", full=FULL_DEG, out=tmp_path / "out")
    assert tuned.verdict == "gains" and (tmp_path / "out" / "ardurover.param").is_file()


@pytest.mark.parametrize(
    ("target", "options", "change", "refusal"),
    [
        (
            "ardurover",
            {},
            {},
            "--full is not given; give the rudder angle of the whole output in degrees, from the 20.1",
        ),
        ("ardurover", {"full": 0.4}, {}, "--full is 0.4; give the rudder angle of the whole output in degrees"),
        ("ardusub", {"full": 30.0}, {}, "is a model of a rudder, and ardusub is for thrusters"),
        ("ardurover", {"full": 30.0}, {"nomoto": {}, "effects": []}, "and the model's logs have no speed"),
    ],
)
def test_refusals(
    target: str, options: dict[str, Any], change: dict[str, Any], refusal: str, run: Run, tmp_path: Path
) -> None:
    path = written(tmp_path, Boat().model() | change)
    given = [word for name, value in options.items() for word in (f"--{name}", value)]
    printed = run("tune", path, "--for", target, *given)
    assert printed.exit_code == 1 and refusal in " ".join(printed.stderr.split()), printed.stderr


@pytest.mark.slow
def test_without_a_logged_speed_drag_and_moment_go_as_in_the_prime_system(tmp_path: Path) -> None:
    """Then the margins at half the speed are those of a boat that slows down so."""
    content = Boat().model() | {"effects": [], "nomoto": {"positive_rudder_turns_to": "starboard"}, "preferred": "1"}
    size = 1.0 / (0.8 * SPEED**2)
    content["models"] = {"1": {"I_r": estimate(size, "rad s²"), "k_r": estimate(0.9 * SPEED * size, "rad s")}}
    out = tmp_path / "out"
    tuned = am.tune(written(tmp_path, content), target="pid", full=FULL_DEG, out=out)
    margins = json.loads((out / "tuning.json").read_text())["margins"]["new"]
    low, high = margins["disk_margin_at_0.5_times_the_speed"]["ci95"]
    assert 0.95 * low <= true_margin(Boat(), Pid(out / "pid.json"), 0.5 * SPEED) <= 1.05 * high
    assert "a constant speed, that of the logs" in " ".join(tuned.knowledge.notes)
