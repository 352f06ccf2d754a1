"""The stacks by their parts against closed forms, to both sides, and the file that is flown against the stack."""

import json
import struct
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import tuning_stack
from made_vehicles import gains_of, vehicle
from repository import DATA

from automarine_cli.control.design import ClosedLoopRun, fly, nominal_of, scores, step_and_load
from automarine_cli.control.knowledge import turning
from automarine_cli.control.targets import TARGETS, get
from automarine_cli.control.targets.base import Gains, Target
from automarine_cli.control.vehicles import Vehicles
from automarine_cli.errors import SettingError
from automarine_cli.thrusters.curves import PowerCurve
from automarine_cli.thrusters.map import ThrusterMap, TwinThrusters

BLUEROV = DATA / "ardusub" / "small.BIN"
AT_REST = np.zeros((1, 1))


def halfway(target: Target, plant: Vehicles) -> Gains:
    proposed = target.propose(np.full((1, target.numbers), 0.5), nominal_of(plant, 1.0))
    return {key: value[:, None] for key, value in proposed.items()}


@pytest.mark.parametrize("name", TARGETS)
def test_a_mirrored_step_is_a_mirrored_flight(name: str) -> None:
    target, plant = get(name, beyond=True), vehicle(delay=0.04)
    there = np.full(round(10.0 / target.period), 1.0)
    flight = fly(target, halfway(target, plant), plant, np.stack([there, -there])[None], np.zeros((1, 2)))
    assert np.allclose(flight.position[0, 0], -flight.position[0, 1], atol=1e-9)
    assert 0.1 < flight.position[0, 0, -1] < 1.5


def test_an_unknown_target_is_answered_with_the_names() -> None:
    with pytest.raises(SettingError, match="no target is called 'px4'; give one of ardurover, ardusub, pid"):
        get("px4")


CAREFUL = {"ATC_ANG_YAW_P": 0.5, "ATC_RAT_YAW_P": 0.1, "ATC_RAT_YAW_D": 0.01, "ATC_RAT_YAW_FLTD": 20.0}


@pytest.mark.parametrize(
    ("inertia", "drag", "full", "lag", "delay", "changed"),
    [
        (0.59, 1.5, 30.0, 0.03, 0.02, {}), pytest.param(1.018, 1.257, 1.2, 0.15, 0.3, {}, marks=pytest.mark.slow),
        pytest.param(29.0, 30.0, 40.0, 0.2, 0.5, {}, marks=pytest.mark.slow),
        (0.59, 1.5, 30.0, 0.1, 0.05, CAREFUL),
    ],
)  # fmt: skip
def test_ardusub_s_stack_agrees_with_one_written_apart_to_half_a_degree(
    inertia: float, drag: float, full: float, lag: float, delay: float, changed: dict[str, float]
) -> None:
    """A step of 90 degrees and a load, also where the loop swings on and on; controller and vehicle are both apart."""
    target, plant = get("ardusub"), vehicle(inertia, drag, full, lag, delay)
    ours = step_and_load(target, gains_of(target, **changed), plant, np.pi / 2, 0.1, 10.0).position[0]
    fleet = tuning_stack.Fleet(np.ones(1), np.array([delay]), inertia / full, drag / full, lag=lag)
    theirs = tuning_stack.fly({name: np.array([value]) for name, value in changed.items()}, fleet, 10.0)[0, 0]
    assert np.rad2deg(np.abs(ours - theirs)).max() < 0.5


def test_rover_s_feed_forward_alone_holds_the_steady_rate() -> None:
    """FF = 1/(rate at the whole output): with linear drag the rate asked for is the rate that comes."""
    target, plant = get("ardurover"), vehicle(inertia=1.0, drag=0.0, linear=2.0, full=4.0, lag=0.0, delay=0.0)
    gains = gains_of(target, ATC_STR_RAT_FF=0.5, ATC_STR_RAT_P=0.0, ATC_STR_RAT_I=0.0)
    flight = fly(target, gains, plant, np.full((1, 1, 500), 1e3), AT_REST)
    assert np.diff(flight.position[0, 0])[-1] / 0.1 == pytest.approx(2.0, rel=1e-3)


def test_readings_have_the_noise_of_the_logs_and_flights_the_motion_that_it_makes() -> None:
    target, quiet = get("pid"), vehicle(count=3)
    gains, still = halfway(target, vehicle()), np.zeros((1, 1, round(30.0 / target.period)))

    def moved(noise: float) -> np.ndarray[Any, Any]:
        return fly(target, gains, replace(quiet, noise=(noise, 0.0)), still, AT_REST).position

    noisy = moved(0.02)
    assert np.all(fly(target, gains, quiet, still, AT_REST).position == 0.0) and np.array_equal(noisy, moved(0.02))
    assert 0.0 < noisy.std() < 0.02 and abs(noisy.mean()) < 0.01 and moved(0.04).std() > 1.5 * noisy.std()


TWINS = ThrusterMap("dead-band", PowerCurve(40.0, 2.0, 0.06, 1.0), PowerCurve(30.0, 2.0, 0.06, 1.0), "")


def test_the_map_inverted_gives_back_the_share_across_its_dead_band() -> None:
    bend = turning(TWINS, 0.25)
    assert bend.largest == pytest.approx(0.25 * 70.0 * 0.94**2)
    moments = bend.largest * np.array([-1.0, -0.3, -0.01, 0.0, 0.01, 0.3, 1.0])
    assert np.allclose(bend.moment(np.array([bend.output(moment) for moment in moments])), moments, atol=1e-9)
    assert bend.output(1e-6) > 0.05
    assert np.all(bend.moment(np.array([-0.05, 0.05])) == 0.0)
    straight = TwinThrusters(PowerCurve(0.5, 1.0, 0.1), PowerCurve(0.5, 1.0, 0.1), 1.0, 1.0).scaled_to(1.0)
    assert straight.moment(np.array([0.05, 0.55, -1.0])) == pytest.approx([0.0, 0.5, -1.0])
    assert straight.slope(np.array([0.05, 0.5, 1.0])) == pytest.approx([0.0, 1.0 / 0.9, 1.0 / 0.9])


def test_files_of_gains() -> None:
    """A sub's never names the feed-forward; that for a PID holds units."""
    nominal = nominal_of(vehicle(), 1.0)

    def text(name: str, gains: dict[str, float] | None = None) -> str:
        target = get(name)
        return target.text(gains or target.defaults, nominal, ())

    assert "ATC_RAT_YAW_FF" not in text("ardusub") and "ATC_RAT_YAW_P,0.18" in text("ardusub")
    assert "ATC_STR_RAT_FF,0.2" in text("ardurover")
    pid = json.loads(text("pid", {"K_p": 2.0, "K_i": 0.3, "K_d": 1.0, "b": 0.5, "T_f": 0.02}))
    assert pid["parallel"]["K_d"] == {"value": 1.0, "unit": "s/rad"}
    assert pid["sample_time_s"] == 0.05


def test_scores_of_a_known_response() -> None:
    time = np.arange(0.0, 20.0, 0.1)
    step = 1.0 - np.exp(-time) * np.cos(2.0 * time)
    load = -0.2 * (1.0 - np.exp(-time))
    both = np.stack([step, load])
    good = scores(ClosedLoopRun(time, both[None]), 1.0, 0.02)
    assert good.overshoot[0] == pytest.approx(step.max() - 1.0)
    assert good.error[0] == pytest.approx(0.2, rel=1e-6)
    assert good.settling[0] == pytest.approx(time[np.flatnonzero(np.abs(step - 1.0) > 0.02)[-1] + 1])
    assert not scores(ClosedLoopRun(time, both[None] * [[[0.5], [1.0]]]), 1.0, 0.02).settles[0]


@pytest.mark.skipif(not BLUEROV.is_file(), reason="needs the real logs beside the checkout")
def test_the_defaults_are_those_of_a_real_vehicle() -> None:
    """A BlueROV2 Heavy with ArduSub 4.1 that nobody tuned: every parameter of the stack stands in its log."""
    log = BLUEROV.read_bytes()
    for parameter in get("ardusub").parameters:
        place = log.find(parameter.name.encode().ljust(16, b"\0"))
        assert place > 0, parameter.name
        assert struct.unpack("<f", log[place + 16 : place + 20])[0] == pytest.approx(parameter.default)
