"""Sensors that agree count, those that contradict the heading are named with the remedy and left out."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from made_campaigns import both_ways, campaign
from made_rudder import quick_zigzag
from scipy.signal import savgol_filter

from automarine_cli.dofs import HEAVE, SURGE, YAW, Dof
from automarine_cli.errors import SettingError
from automarine_cli.quantities import Floats
from automarine_cli.runs.channels import Agreement, advanced, agreement, choose_channels, trouble_of
from automarine_cli.runs.load import standstill
from automarine_cli.runs.run import Run

SIZES = (0.2, 0.4, 0.6, 0.8, 1.0, 1.2)


@pytest.fixture(scope="module")
def honest() -> list[Run]:
    return campaign(both_ways(SIZES), seed=3, gyro_deg_s=0.3)


def changed(runs: Sequence[Run], make: Callable[[Run, Floats], Floats]) -> list[Run]:
    return [replace(run, extras={"yaw_rate": make(run, run.extras["yaw_rate"])}) for run in runs]


def mirrored(runs: Sequence[Run]) -> list[Run]:
    return [
        replace(run, position=-run.position, moment=-run.command, extras={"yaw_rate": -run.extras["yaw_rate"]})
        for run in runs
    ]


def later(seconds: float) -> Callable[[Run, Floats], Floats]:
    return lambda run, rate: np.interp(run.time - seconds, run.time, rate)


def low_pass(run: Run, seconds: float) -> Floats:
    slope, period = np.gradient(run.position, run.time), run.sample_period
    for i in range(1, len(slope)):
        slope[i] = slope[i - 1] + period / (period + seconds) * (slope[i] - slope[i - 1])
    return slope


FAULTS: dict[str, tuple[Callable[[Run, Floats], Floats], tuple[str, ...]]] = {  # and what names it, with its remedy
    "sign": (lambda run, rate: -rate, ("wrong sign", "sign = -1")),
    "radians": (lambda run, rate: np.deg2rad(rate), ("is in rad/s, not in deg/s", 'unit = "rad/s"')),
    "degrees": (lambda run, rate: np.rad2deg(rate), ("is in deg/s, not in rad/s", 'unit = "deg/s"')),
    "both": (lambda run, rate: -np.deg2rad(rate), ("wrong sign", "is in rad/s", 'sign = -1 and unit = "rad/s"')),
    "scale": (lambda run, rate: 1.1 * rate, ("% more than the heading moves", "map it with scale = 0.9")),
    "late": (later(0.4), ("0.4 s late against the heading", "shift its column")),
    "ahead": (later(-0.4), ("0.4 s ahead of the heading", "shift its column")),
    "stuck": (lambda run, rate: np.full(len(rate), 0.01), ("stuck at 0.573 deg/s in every run", "cable")),
    "another": (
        lambda run, rate: 0.3 * np.sin(3.0 * run.time + len(run)),
        ("does not follow the heading", "yaw_rate_deg_s"),
    ),
    "gradient": (lambda run, rate: np.gradient(run.position, run.time), ("computed from the heading",)),
    "parabolas": (
        lambda run, rate: savgol_filter(run.position, 7, 2, deriv=1, delta=0.1), ("computed from the heading",),
    ),
    "low-pass": (lambda run, rate: low_pass(run, 0.3), ("computed from the heading", "no information")),
}  # fmt: skip


def test_a_gyro_that_agrees_counts(honest: list[Run]) -> None:
    channels = choose_channels(honest, YAW)
    assert channels.names == ("heading", "yaw_rate")
    assert [(verdict.used, verdict.why) for verdict in channels.verdicts] == [(True, "")] * 2
    assert choose_channels(honest, YAW, "yaw_rate").names == ("yaw_rate",)


@pytest.mark.parametrize("mirror", [False, True])
@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_named_with_its_remedy_and_left_out(fault: str, mirror: bool, honest: list[Run]) -> None:
    make, parts = FAULTS[fault]
    runs = changed(honest, make)
    channels = choose_channels(mirrored(runs) if mirror and fault != "stuck" else runs, YAW)
    assert channels.names == ("heading",)
    heading, rate = channels.verdicts
    assert heading.used and not heading.why and not rate.used
    assert all(part in rate.why for part in ("The yaw rate ", *parts)), rate.why


def test_who_asks_for_all_gets_all_and_is_told(honest: list[Run]) -> None:
    runs = changed(honest, FAULTS["sign"][0])
    for choice in ("all", "heading, yaw_rate"):
        channels = choose_channels(runs, YAW, choice)
        assert channels.names == ("heading", "yaw_rate") and "wrong sign" in channels.verdicts[1].why
    assert choose_channels(runs, YAW, "position").names == ("heading",)


def test_a_heading_that_is_read_late_may_be_what_is_looked_for(honest: list[Run]) -> None:
    ahead, late = (changed(honest, FAULTS[name][0]) for name in ("ahead", "late"))
    assert choose_channels(ahead, YAW, late_position=True).names == ("heading", "yaw_rate")
    assert choose_channels(late, YAW, late_position=True).names == ("heading",)


@pytest.mark.parametrize("mirror", [False, True])
@pytest.mark.parametrize(("scale", "late"), [(1.0, 0.03), (1.0, -0.03), (0.985, 0.0), (1.02, 0.03)])
def test_what_is_too_small_for_a_fault_is_put_right(scale: float, late: float, mirror: bool, honest: list[Run]) -> None:
    runs = changed(honest, lambda run, rate: scale * later(late)(run, rate))
    channels = choose_channels(mirrored(runs) if mirror else runs, YAW)
    assert channels.names == ("heading", "yaw_rate") and channels.verdicts[1].why.endswith("it is put right.")
    assert channels.scale == pytest.approx(1 / scale, abs=0.004) and channels.late == pytest.approx(late, abs=0.008)
    assert (channels.scale == 1.0) == (scale == 1.0) and (channels.late == 0.0) == (late == 0.0)

    mended = agreement([channels.cleaned(run) for run in runs])
    assert abs(mended.late) < 0.004 and mended.scale == pytest.approx(1.0, abs=0.004)
    stays = [np.array_equal(channels.cleaned(run).extras["yaw_rate"], run.extras["yaw_rate"]) for run in runs]
    assert all(stays) == (late < 0.0)  # commands come before both: the later of two is put right
    gap = np.arange(len(runs[0])) // 3 == 9
    holed, whole = (channels.cleaned(run).extras["yaw_rate"] for run in (
        changed(runs[:1], lambda run, rate: np.where(gap, np.nan, rate))[0], runs[0]
    ))  # fmt: skip
    assert np.array_equal(np.isnan(holed), gap) and holed[40:] == pytest.approx(whole[40:], abs=0.01)
    assert choose_channels(runs, YAW, "yaw_rate").late == 0.0  # with nothing to compare it with
    asked = choose_channels(runs, YAW, "position").cleaned(runs[0])
    assert asked is runs[0]


@pytest.mark.parametrize("late", [0.0, 0.02, -0.02])
def test_jumps_of_the_acceleration_are_no_delay(late: float) -> None:
    """Sums of readings 0.2 s apart made 6 ms of them, which got a false sensor-lag and a history-force."""
    sensors = agreement([quick_zigzag(seed, (-1.0) ** seed, late) for seed in range(12)])
    assert abs(sensors.late - late) < 3.0 * sensors.late_error < 0.003
    assert abs(sensors.scale - 1.0) < 0.005


@pytest.mark.parametrize(("late", "first"), [(-0.06, "heading"), (0.02, "yaw rate"), (0.06, "yaw rate")])
def test_the_later_of_two_sensors_is_put_where_it_was(late: float, first: str) -> None:
    """Where the rudder goes over the rate has a kink, at which a shift by the spectrum rings."""

    def readings(run: Run) -> Floats:
        return run.position if late < 0 else run.extras["yaw_rate"]

    on_time, runs = ([quick_zigzag(seed, (-1.0) ** seed, by) for seed in range(12)] for by in (0.0, late))
    channels = choose_channels(runs, YAW)
    assert channels.scale == 1.0 and channels.verdicts[1].why.startswith(f"The {first} is {abs(late)} s late")
    off, before = (
        np.concatenate([readings(run) - readings(true) for run, true in zip(some, on_time)]).std()
        for some in ([channels.cleaned(run) for run in runs], runs)
    )
    assert off < 0.22 * before


def test_readings_of_another_time_keep_their_noise() -> None:
    time, random = np.arange(400), np.random.default_rng(2)
    slow = 0.3 + 0.01 * time + np.sin(time / 20.0)
    inner = slice(20, -20)
    assert advanced(slow, 0.4)[inner] == pytest.approx(
        (0.304 + 0.01 * time + np.sin((time + 0.4) / 20.0))[inner], abs=2e-3
    )
    noise = random.standard_normal((50, 400))
    moved = np.array([advanced(row, 0.5) for row in noise])
    assert moved[:, inner].std() == pytest.approx(noise[:, inner].std(), rel=0.02)
    assert abs(np.mean(moved[:, 20:-20] * moved[:, 21:-19])) < 0.02  # nor do neighbours share any


def test_stuck_in_one_run_is_left_out_of_that_run(honest: list[Run]) -> None:
    runs = [*changed(honest[:1], FAULTS["stuck"][0]), *honest[1:]]
    channels = choose_channels(runs, YAW)
    assert channels.names == ("heading", "yaw_rate") and channels.stuck == {"run_00"}
    assert "stuck at 0.573 deg/s in run_00" in channels.verdicts[1].why
    assert "yaw_rate" not in channels.cleaned(runs[0]).extras and channels.cleaned(runs[1]) is runs[1]


def test_without_a_velocity_there_is_nothing_to_choose() -> None:
    runs = campaign([0.5, -0.5])
    assert choose_channels(runs, YAW).names is None and choose_channels(runs, YAW).verdicts == ()
    with pytest.raises(SettingError, match="no log holds yaw rate; name its column yaw_rate_deg_s"):
        choose_channels(runs, YAW, "yaw_rate")
    with pytest.raises(SettingError, match="'compass'; expected auto, position, all, or some of heading, yaw_rate"):
        choose_channels(runs, YAW, "compass")


@pytest.mark.parametrize(
    ("scale", "dof", "parts"),
    [
        (0.01, SURGE, ("surge speed is in cm/s", 'unit = "cm/s"', "distance")),
        (0.001, SURGE, ("surge speed is in mm/s", "scale = 0.001")),
        (1 / 3.6, SURGE, ("surge speed is in km/h", "scale = 0.2778")),
        (1852 / 3600, SURGE, ("surge speed is in knots", 'unit = "kn"')),
        (-1.0, HEAVE, ("heave speed", "depth")),
        (1.005, SURGE, ()),
    ],
)
def test_units_of_a_speed_are_named(scale: float, dof: Dof, parts: tuple[str, ...]) -> None:
    trouble = trouble_of(Agreement(9, 1.0, scale, 1e-3, 0.0, 0.01, False, 0.1, 0.0), dof)
    assert [part for part in parts if part not in trouble] == [] and bool(trouble) is bool(parts)


def test_velocities_are_summed_up_less_what_stands_still() -> None:
    time = np.arange(0.0, 6.0, 0.1)
    rate, command = np.where(time > 2.0, 0.5, 0.0), np.where(time > 2.0, 1.0, 0.0)
    biased = rate + 0.05
    assert standstill(time, biased, command, YAW) == pytest.approx(0.05)
    assert standstill(time, rate, command, YAW) == 0.0
    coasting = np.exp(-time) * 0.5
    assert standstill(time, coasting, command, YAW) == 0.0
    assert standstill(time, biased, np.ones(len(time)), YAW) == 0.0  # the moment is on from the start
