"""Layout of driven runs, the filter against an independent one, and predictions against sums by hand."""

from dataclasses import replace

import numpy as np
import pytest
from made_driven import Sea, steered, turned
from made_planar import BARE, FULL, campaign
from numpy.typing import NDArray
from scipy.linalg import expm
from stirred import controlled

from automarine_cli.dofs import PLANAR, YAW, alone
from automarine_cli.filters import kalman
from automarine_cli.filters.course import MIN_HOLD_S, make_course
from automarine_cli.filters.kalman import FilterResult, Noises, Step, follow, follow_all, predict, shown_channel
from automarine_cli.filters.readings import MIN_APART_S, Readings, answers_more, averaged_over
from automarine_cli.models.model import Model
from automarine_cli.runs.run import Run

Floats = NDArray[np.float64]
REST = np.array([True])
INERTIA, LINEAR = 1.3, 0.9
MODEL = Model.base("1", INERTIA, [LINEAR], "nu", YAW)


def noises(size: float = 0.1, time: float = 2.0, thrust: float = 0.03, reading: float = 0.02) -> Noises:
    """One parameter set of a run with the gain as logged."""
    each = (np.array([[value]]) for value in (size, time, thrust))
    return Noises(*each, np.zeros(1), np.zeros(1), np.array([[reading]]), {})


def logged(time: Floats, heading: Floats, command: Floats, **extras: Floats) -> Run:
    return Run("run", "run.csv", 40.0 + time, heading, command, "nu", extras, dof=YAW)


def noisy(run: Run, degrees: float = 1.0) -> Run:
    """The same run with white noise on the heading."""
    noise = np.random.default_rng(1).standard_normal(len(run))
    return replace(run, position=run.position + np.deg2rad(degrees) * noise)


def uneven_run() -> Run:
    """Commands at random on a clock that wanders, with a gap of three seconds; a voltage that drifts beside them."""
    rng = np.random.default_rng(0)
    time = np.cumsum(rng.uniform(0.06, 0.4, 90))
    time[50:] += 3.0
    return logged(time, np.sin(time), rng.uniform(-1, 1, 90), voltage=15.0 + np.cumsum(rng.normal(0.0, 0.1, 90)))


def by_hand(run: Run, column: Floats, begin: float, end: float) -> tuple[float, float]:
    """Impulse between two instants, and how far it moves one unit of inertia from rest: each value is held between the
    middles of the intervals on its either side."""
    edges = np.concatenate([run.time[:1], 0.5 * (run.time[1:] + run.time[:-1]), run.time[-1:]])
    first, last = np.clip(edges[:-1], begin, end), np.clip(edges[1:], begin, end)
    pushed = column * (last - first)
    return float(pushed.sum()), float((pushed * (end - 0.5 * (first + last))).sum())


def test_commands_and_signals_are_averaged_exactly_on_uneven_clocks_with_gaps() -> None:
    run = noisy(uneven_run())
    course = make_course([run], REST, ("voltage",))
    force = course.commands[0].force
    (mean, slope), length = (x[0, 0] for x in course.averaged(force)), course.length[0]
    voltage = course.averaged_signals["voltage"][0]
    assert length.max() < 0.4 and length.sum() == pytest.approx(run.time[-1] - run.time[0])
    node = run.time[0] + course.time[0]
    for k in range(len(length)):
        impulse, moved = by_hand(run, run.command, node[k], node[k + 1])
        assert mean[k] * length[k] == pytest.approx(impulse, abs=1e-12)
        straight = 0.5 * mean[k] * length[k] ** 2 - slope[k] * length[k] ** 3 / 12.0
        assert straight == pytest.approx(moved, abs=1e-12)
        assert voltage[k] * length[k] == pytest.approx(by_hand(run, run.extras["voltage"], *node[k : k + 2])[0])


def test_a_change_of_command_acts_in_the_middle_of_its_interval() -> None:
    time = 0.25 * np.arange(41)
    run = noisy(logged(time, 0.0 * time, np.where(time >= 5.0, 0.8, 0.0)))
    course = make_course([run], REST, step=0.25)
    mean, slope = (x[0, 0] for x in course.averaged(course.commands[0].force))
    np.testing.assert_allclose(mean, np.where(time[:-1] >= 5.0, 0.8, np.where(time[:-1] >= 4.75, 0.4, 0.0)))
    np.testing.assert_allclose(slope, np.where(time[:-1] == 4.75, 1.5 * 0.8 / 0.25, 0.0), atol=1e-9)
    later, _ = course.averaged(course.commands[0].force, np.array([0.125]))
    np.testing.assert_allclose(later[0, 0], np.where(time[:-1] >= 5.0, 0.8, 0.0), atol=1e-12)


def test_no_reading_is_told_by_the_command_that_answers_it() -> None:
    """A compass that the current pulls: a command of the same row is the controller's answer to the reading."""
    time = 0.1 * np.arange(60)
    run = noisy(logged(time, np.sin(time), np.cos(time)))
    model = MODEL.with_effect("current-deviation", (0.3, 0.0, 1.0))
    answered = replace(run, moment=np.append(run.command[:-1], 5.0))
    for late in (-0.04, 0.0, 0.05):
        sizes = replace(noises(), late=np.array([late]))
        (first, second) = (
            follow(model, make_course([one], REST), model.theta[None], sizes).innovation[0, 0, 0]
            for one in (run, answered)
        )
        assert np.abs(first - second).max() < 0.02 < 0.3 * 4.0  # which is what the command of the row would explain


@pytest.mark.parametrize("late", [0.07, 0.13, 0.35])
def test_a_dead_time_is_a_delay_of_all_commands(late: float) -> None:
    """Before a lag, too: it shifts what the lag makes of them."""
    time = 0.1 * np.arange(80)
    course = make_course([noisy(logged(time, np.sin(time), np.sign(np.cos(3.0 * time)) + np.sin(7.0 * time)))], REST)
    for model in (MODEL, MODEL.with_effect("thruster-lag", (0.2, 0.0, 1.0, 1.0))):
        dead = model.with_effect("input-delay", (late, 0.0, 0.1))
        first, second = (
            follow(m, course, m.theta[None], replace(noises(thrust=0.0), late=np.array([by]))).innovation
            for m, by in ((model, late), (dead, 0.0))
        )
        np.testing.assert_allclose(first, second, atol=1e-12)


@pytest.mark.parametrize("period", [0.1, 0.2, 0.5])
def test_what_lags_changes_within_a_sample_of_a_slow_log(period: float) -> None:
    """A step of the command with a sample, by the closed form of the lag."""
    time, lag = period * np.arange(40), 0.6
    run = noisy(logged(time, 0.0 * time, np.where(time >= 10 * period, 1.0, 0.0)))
    course = make_course([run], REST, step=period)
    model = MODEL.with_effect("thruster-lag", (lag, 1.0, 1.0, 1.0))
    thrust = kalman.thrust_of(model, course, model.theta[None], np.array([0.5 * period]))
    mean, slope = (x[:, 0, 0, 0] for x in thrust[:2])
    behind = np.exp(-np.maximum(time - 10 * period, 0.0) / lag)
    delivered = np.where(time >= 10 * period, 1.0 - behind, 0.0)
    exact = np.where(time[:-1] >= 10 * period, 1.0 - lag * (behind[:-1] - behind[1:]) / period, 0.0)
    np.testing.assert_allclose(mean, exact, atol=1e-12)
    lost = (MIN_HOLD_S / period) ** 2  # by what is held over parts of a step
    np.testing.assert_allclose(slope, np.diff(delivered) / period, rtol=lost + 0.05, atol=1e-9)


@pytest.mark.parametrize("late", [-0.1, 0.0, 0.1])  # half samples: what is late falls together with the grid
def test_signals_that_are_commanded_come_as_late_as_the_command(late: float) -> None:
    """A rudder in the race of a thrust that is logged, beside the command of both together."""
    time = 0.2 * np.arange(60)
    angle, thrust = np.sign(np.sin(0.9 * time)) * (0.3 + 0.1 * np.sin(time)), np.where(np.sin(0.4 * time) > 0, 3.0, 1.0)
    apart = replace(noisy(logged(time, np.sin(time), angle, rudder=-angle, force_X=thrust)), moment_unit="rad")
    together = replace(apart, moment=angle * (1.0 + 0.5 * thrust))
    model, sizes = Model.base("1", INERTIA, [LINEAR], "rad", YAW), replace(noises(thrust=0.0), late=np.array([late]))
    raced = model.with_effect("rudder-race", (0.5,))
    courses = make_course([apart], REST, raced.signals), make_course([together], REST)
    first, second = (follow(m, c, m.theta[None], sizes).innovation for m, c in zip((raced, model), courses))
    np.testing.assert_allclose(first, second, atol=1e-12)


def test_only_intervals_in_which_a_command_jumps_are_divided() -> None:
    """At 5 Hz; a rudder's, too, and the drift of a thrust does not."""
    time = 0.2 * np.arange(60)
    held, rudder = np.where(time > 5.0, 2.0, -1.0), np.where(time > 8.0, 0.3, 0.1)
    alone = noisy(logged(time, np.sin(time), held))
    zero = 0.0 * time
    plane = replace(alone, extras={"force_X": 5.0 + 0.1 * time, "force_Y": zero, "rudder": rudder}, moment_unit="N m")
    course = make_course([plane], REST, ("rudder",), motion=PLANAR, channels=("heading",))
    shorter = course.time[0, 1:][np.isclose(course.length[0], 0.1)]
    np.testing.assert_allclose(shorter, [5.1, 5.2, 8.1, 8.2], atol=1e-9)
    course = make_course([alone], REST)
    np.testing.assert_allclose(course.time[0, 1:][np.isclose(course.length[0], 0.1)], [5.1, 5.2], atol=1e-9)


def test_repeats_are_no_readings_and_smooth_ones_are_thinned() -> None:
    time = 0.1 * np.arange(301)
    heading = np.deg2rad(np.random.default_rng(2).standard_normal(301)) + np.sin(time)
    slow = logged(time, heading[5 * (np.arange(301) // 5)], np.cos(time))
    read = make_course([slow], REST)
    np.testing.assert_allclose(read.time[0][read.channels[0].seen[0]], time[::5], atol=1e-9)
    quiet, loud = (make_course([noisy(logged(time, np.sin(time), np.cos(time)), d)], REST) for d in (0.02, 1.0))
    assert quiet.noise[0] < YAW.limits.least_noise < loud.noise[0]
    for course, apart in ((quiet, MIN_APART_S), (loud, 0.1)):
        here = course.time[0][course.channels[0].seen[0]]
        assert apart - 1e-6 < np.diff(here).min() < apart + 0.101 and len(here) > 0.9 * 30.0 / (apart + 0.1)
        np.testing.assert_allclose(np.round(10 * here), 10 * here, atol=1e-6)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_quiet_readings_that_a_controller_answers_all_count(way: float) -> None:
    """Left out, they would make the commands know more than the filter; of others thinned ones are safer."""
    time, rng = 0.1 * np.arange(301), np.random.default_rng(3)
    run = noisy(logged(time, way * np.sin(time), np.cos(time)), 0.1)
    late = np.append(run.position[:1], run.position[:-1])
    answered, unlogged = (
        run.with_moment(-2.0 * np.asarray(acted_on), "nu") for acted_on in (late, late[::-1] + 0.01 * rng.random(301))
    )
    for each, every in ((answered, True), (unlogged, False), (run, False)):
        course = make_course([each], REST)
        pace = np.median(np.diff(course.time[0][course.channels[0].seen[0]]))
        assert pace == pytest.approx(0.1) if every else pace > MIN_APART_S - 1e-6
        assert (course.sensors[0].floor < course.noise[0]) == every


@pytest.mark.parametrize("seed", [1, 2])
def test_what_a_controller_reads_and_a_log_lacks_is_told(seed: int) -> None:
    """By commands that answer the headings and change more than these explain; an open loop answers nothing."""
    by_gyro, by_heading = controlled(seed=seed), controlled(seed=seed, gyro=False)
    open_loop = [replace(run, position=run.position[::-1]) for run in by_heading]
    motion = alone(YAW)

    def more(runs: list[Run], *quantities: str) -> bool:
        return answers_more(runs, [Readings.of(runs, quantity, 0, motion) for quantity in quantities])

    assert more(by_gyro, "heading") and not more(by_gyro, "heading", "yaw_rate")
    assert not more(by_heading, "heading") and not more(open_loop, "heading")


@pytest.mark.parametrize("rate", [5, 10, 20, 25, 30, 40, 50, 100])
def test_no_noisy_reading_is_left_out(rate: int) -> None:
    """A controller has answered every reading: what a filter leaves out looks to it like a command without a cause."""
    jitter = np.random.default_rng(rate).uniform(-0.1, 0.1, 30 * rate)
    time = (np.arange(30 * rate) + jitter) / rate
    course = make_course([noisy(logged(time, np.sin(time), np.cos(time)), 1.0)], REST)
    readings = course.channels[0].seen[0].sum() * averaged_over(1.0 / rate)
    assert readings == pytest.approx(len(time), abs=averaged_over(1.0 / rate) + 1)


def test_filtered_readings_tell_little_new_at_their_full_pace() -> None:
    time = 0.05 * np.arange(600)
    run = noisy(logged(time, np.sin(time), np.cos(time)), 4.0)
    filtered = replace(run, position=np.convolve(np.pad(run.position, 5, "edge"), np.full(11, 1 / 11), "valid"))
    paces = [np.median(np.diff(make_course([one], REST).time[0])) for one in (run, filtered)]
    np.testing.assert_allclose(paces, [0.05, 0.1], atol=1e-9)


@pytest.mark.parametrize(("period", "pace"), [(4.0, 0.25), (40.0, 0.5)])
def test_a_quiet_log_of_a_vehicle_that_answers_slowly_has_longer_steps(period: float, pace: float) -> None:
    """A swing takes its period over 2 pi to change its rate by half of its range; noise says nothing of the vehicle."""
    time, turn = np.arange(0.0, 120.0, 0.05), 2.0 * np.pi / period
    run = logged(time, np.sin(turn * time), np.cos(turn * time), yaw_rate=turn * np.cos(turn * time))
    for channels in (("heading",), ("heading", "yaw_rate")):
        gaps = np.diff(make_course([run], REST, channels=channels).time[0])
        assert np.median(gaps) <= pace + 1e-9 and (np.median(gaps) == pytest.approx(pace)) == (
            len(channels) == 1 or pace == 0.5
        )
    assert np.median(np.diff(make_course([noisy(run)], REST).time[0])) == pytest.approx(0.05)


def textbook(run: Run, of: Noises, swift: float) -> tuple[Floats, Floats]:
    """Innovations and variances at the samples, by a Kalman filter of (heading, rate, disturbance) whose transition and
    noise over each half of an interval are exact (Van Loan 1978)."""
    size, time, thrust, reading = (float(x.flat[0]) for x in (of.size, of.time, of.thrust, of.reading))
    system = np.array([[0, 1, 0], [0, -LINEAR / INERTIA, 1], [0, 0, -1 / time]])
    mean = np.array([run.position[0], 0.0, 0.0])
    covariance = np.diag([0.5**2, swift**2, size**2])
    error, variance = np.zeros(len(run)), np.zeros(len(run))
    for i, seen in enumerate(run.position):
        error[i], variance[i] = seen - mean[0], covariance[0, 0] + reading**2
        gain = covariance[:, 0] / variance[i]
        mean, covariance = mean + gain * error[i], covariance - np.outer(gain, covariance[0])
        if i == len(run) - 1:
            break
        half = 0.5 * (run.time[i + 1] - run.time[i])
        for push in run.command[i : i + 2] / INERTIA:
            noise = np.diag([0.0, (thrust * push) ** 2, 2.0 * size**2 / time])
            twice = expm(half * np.block([[-system, noise], [np.zeros((3, 3)), system.T]]))
            move = twice[3:, 3:].T
            forced = expm(half * np.block([[system, np.array([[0], [push], [0]])], [np.zeros((1, 4))]]))[:3, 3]
            mean, covariance = move @ mean + forced, move @ covariance @ move.T + move @ twice[:3, 3:]
    return error, variance


def test_the_filter_of_a_linear_model_is_kalmans() -> None:
    """Innovations and density, up to what finite steps cost: half the step, less than two thirds of the difference."""
    sea = Sea(inertia=INERTIA, k_r=LINEAR, k_rr=0.0, scatter=0.0)
    (run,) = steered(1, 5, sea, length=30.0, period=0.5)
    swift = float(make_course([run], ~REST).fastest[0])
    error, variance = textbook(run, noises(), swift)
    density = -0.5 * (error**2 / variance + np.log(2 * np.pi * variance)).sum()
    off = []
    for step in (0.25, 0.125, 0.05, 0.025):
        course = make_course([run], ~REST, step=step)
        found = follow(MODEL, course, MODEL.theta[None], noises())
        read = course.channels[0].seen[0]
        assert read.sum() == len(run)
        wrong = np.abs(found.innovation[0, 0, 0, read] - error) / np.sqrt(variance)
        spread = np.abs(found.variance[0, 0, 0, read] / variance - 1.0)
        off.append((wrong.max(), spread.max(), abs(float(found.log_density[0, 0]) - density)))
    sizes = np.array(off)
    assert np.all(sizes[0] < (0.1, 0.05, 0.3)), sizes
    assert np.all(sizes[-1] < (0.01, 0.01, 0.05)), sizes
    assert np.all(sizes[2] < 0.67 * sizes[1]) and np.all(sizes[3] < 0.67 * sizes[2]), sizes


def test_a_covariance_stays_symmetric_where_a_craft_turns_away_by_itself() -> None:
    """For a minute: errors of rounding would grow with the motion, 1e50 times here."""
    time = np.arange(0.0, 60.0, 0.1)
    course = make_course([logged(time, np.sin(time), 0.0 * time)], ~REST)
    theta, trace = np.array([[INERTIA, -2.0 * INERTIA]]), list[tuple[Floats, ...]]()
    assert np.isfinite(follow(MODEL, course, theta, replace(noises(), gain=np.full(1, 0.1)), trace=trace).log_density)
    covariance = trace[-1][1][..., 0, 0]
    deviations = np.sqrt(np.diagonal(covariance))
    np.testing.assert_allclose((covariance - covariance.T) / np.outer(deviations, deviations), 0.0, atol=1e-12)


@pytest.mark.parametrize("lag", [0.05, 0.4, 2.0])
def test_a_slow_sensor_is_no_evidence_of_a_vehicle_that_coasts(lag: float) -> None:
    """It is behind by the same angle throughout, whatever the speed that the run began with."""
    time, noise = np.arange(0.0, 5.0, 0.1), np.random.default_rng(4).standard_normal(50)
    free, calm = Model.base("1", INERTIA, [0.0], "nu", YAW), noises(size=1e-9, thrust=0.0)
    for rate in (0.0, 0.3):
        course = make_course([logged(time, 0.5 + rate * time + 0.02 * noise, 0.0 * time)], ~REST)
        prompt, slow = (
            follow(model, course, model.theta[None], calm) for model in (free, free.with_effect("sensor-lag", [lag]))
        )
        np.testing.assert_allclose(slow.innovation, prompt.innovation, atol=1e-5)
        np.testing.assert_allclose(slow.variance, prompt.variance, rtol=1e-5)


def jumped(degrees: float) -> tuple[FilterResult, int]:
    """A run with one reading that is off by so much, and the node of that reading."""
    (run,) = steered(1, 2, Sea(inertia=INERTIA, k_r=LINEAR, k_rr=0.0, scatter=0.0), length=30.0)
    heading = run.position.copy()
    heading[60] += np.deg2rad(degrees)
    course = make_course([replace(run, position=heading)], REST, step=0.25)
    return follow(MODEL, course, MODEL.theta[None], noises(), keep=True), 60


def test_one_jump_costs_linearly_and_is_forgotten() -> None:
    (clean, at), (jump, _), (twice, _) = jumped(0.0), jumped(60.0), jumped(120.0)
    assert np.rad2deg(jump.innovation[0, 0, 0, at]) == pytest.approx(60.0, abs=5.0)
    cost = [float(clean.log_density[0, 0] - one.log_density[0, 0]) for one in (jump, twice)]
    expected = 5.0 * np.deg2rad(60.0) / np.sqrt(clean.variance[0, 0, 0, at])
    assert cost[1] - cost[0] == pytest.approx(expected, rel=0.05)
    assert clean.states is not None and jump.states is not None
    moved = np.abs(jump.states[0, 0, 0] - clean.states[0, 0, 0])
    assert np.rad2deg(moved[at]) < 5.0 and np.rad2deg(moved[at + 12 :]).max() < 1.0


def test_the_filter_is_the_same_to_both_sides() -> None:
    (run,) = steered(1, 3)
    found = [follow(MODEL, make_course([one], REST), MODEL.theta[None], noises()) for one in (run, turned(run))]
    np.testing.assert_allclose(found[0].innovation, -found[1].innovation, atol=1e-12)


def exact_run() -> Run:
    """A run of MODEL without any noise, with its rate."""
    time = 0.5 * np.arange(81)
    command = np.where((time // 8.0) % 2 == 0, 0.6, -0.3) * (time >= 1.0)
    a, b = LINEAR / INERTIA, 1.0 / INERTIA
    heading, rate, x, r = np.zeros(81), np.zeros(81), 0.0, 0.0
    for i in range(80):
        for u in command[i : i + 2] * b:
            steady, fade = u / a, np.exp(-0.25 * a)
            x, r = x + 0.25 * steady + (r - steady) * (1.0 - fade) / a, steady + (r - steady) * fade
        heading[i + 1], rate[i + 1] = x, r
    return logged(time, heading, command, yaw_rate=rate)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_predictions_of_a_sum_of_velocities_begin_where_the_sum_is(side: float) -> None:
    """No filter is tied to such positions: what they are off by is no error of the model."""
    run = exact_run()
    run = replace(run, position=run.position + side * 7.0, summed_up=True)
    summed = make_course([run], REST, channels=("yaw_rate",))
    assert summed.channels[0].velocity and not shown_channel(summed).counts
    headings = make_course([replace(run, extras={}, summed_up=False)], REST)
    for course, most in ((summed, 2.0), (headings, 0.01)):  # the sum by trapezoids is off by as much
        for ahead in predict(MODEL, course, MODEL.theta, noises(1e-6, thrust=0.0, reading=1e-5))[0]:
            assert np.rad2deg(np.abs(ahead.error).max()) < most, ahead.horizon
            assert np.rad2deg(ahead.rmse(ahead.constant)) > 5.0


def test_no_prediction_is_shorter_than_it_says() -> None:
    """A run that ends before a horizon has none: what is predicted over less would be counted as if it were as far."""
    course = make_course([exact_run()], REST)
    for ahead in predict(MODEL, course, MODEL.theta, noises())[0]:
        far = course.time[ahead.run, ahead.target] - course.time[ahead.run, ahead.origin]
        np.testing.assert_allclose(far, ahead.horizon, atol=0.25)
        assert course.time[0, ahead.origin].max() == pytest.approx(40.0 - ahead.horizon, abs=0.25)


def test_constants_by_hand() -> None:
    """Of x = 0.02 t² at 2 Hz the line over the last half second is best: it misses 0.02 (h² + h/2)."""
    time = 0.5 * np.arange(61)
    course = make_course([logged(time, 0.02 * time**2, 0.0 * time)], REST)
    for one in predict(MODEL, course, MODEL.theta, noises())[0]:
        start = course.time[0, one.origin]
        h = course.time[0, one.target] - start
        np.testing.assert_allclose(one.constant_rate, 0.02 * (h**2 + 0.5 * h), atol=1e-9)
        np.testing.assert_allclose(one.constant, 0.02 * (2.0 * start * h + h**2), atol=1e-9)
        assert one.rmse(one.constant_rate) == pytest.approx(np.sqrt(np.mean((0.02 * (h**2 + 0.5 * h)) ** 2)))


def test_derivatives_of_a_step_are_those_by_small_differences() -> None:
    """In the plane with a current: by states about their errors, by a heading and by what pushes."""
    runs = campaign(BARE, 0, 2, 6.0, ("heading", "north", "east"))
    course = make_course(runs, np.ones(2, dtype=bool), motion=PLANAR, channels=("heading", "north", "east"))
    model = replace(FULL, water=(0.2, -0.1))
    theta = np.stack([model.theta, 1.1 * model.theta])
    step = Step(model, course, theta, np.zeros(2))
    count, random = step.places.count, np.random.default_rng(0)
    mean = 0.3 * random.standard_normal((count, 2, 2))
    covariance = 1e-6 * np.tile(np.eye(count)[..., None, None], (1, 1, 2, 2))
    ramp, little = np.full((3, 2, 2), 0.9), 1e-5
    _, slopes = step.advance(5, mean, covariance, ramp)
    for column, place in enumerate(range(count)[step.columns]):
        moved = little * (np.arange(count) == place)[:, None, None]
        ahead, behind = (step.advance(5, mean + side * moved, covariance, ramp)[0] for side in (1, -1))
        share = 0.9 if place in step.places.pushed else 1.0  # those by a push are by its mean over the step
        by_hand = (ahead - behind)[: step.places.dynamic] / (2.0 * little)
        np.testing.assert_allclose(share * slopes[:, column], by_hand, atol=2e-5)


def test_models_alike_but_for_actuators_and_drag_go_through_one_filter_as_each_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Also beside others: a delay, a dead band, a sensor that lags, another drag, and what varies from run to run."""
    runs = [steered(seed, 1, Sea(), length=12.0)[0] for seed in (1, 2)]
    course = make_course(runs, np.zeros(2, dtype=bool))
    added = {
        "input-delay": (0.3, 0.0, 0.1), "dead-band": (0.1, 0.0, 0.5), "sensor-lag": (0.2,), "cubic-drag": (0.4,),
        "thruster-lag": (0.4, 1.0, 1.0, 1.0), "periodic-disturbance": (0.1, 0.0, 3.0, 0.0),
    }  # fmt: skip
    models = [MODEL, *(MODEL.with_effect(name, values) for name, values in added.items())]
    sizes = range(1, 1 + len(models))
    thetas = [np.linspace(1.0, 1.1, size)[:, None] * model.theta for size, model in zip(sizes, models)]
    several = [Noises.of_all([noises()] * size) for size in sizes]
    assert kalman.alike(models, sizes) == [[0, 1, 2, 4, 5], [3], [6]]
    monkeypatch.setattr(kalman, "MAX_SETS_TIMES_RUNS", 5)
    assert kalman.alike(models, sizes) == [[0, 1], [2], [4], [5], [3], [6]]
    monkeypatch.setattr(kalman, "MAX_SETS_TIMES_RUNS", 1000)
    for model, theta, of_each, together in zip(models, thetas, several, follow_all(models, course, thetas, several)):
        alone = follow(model, course, theta, of_each)
        np.testing.assert_allclose(together.innovation, alone.innovation, atol=1e-9)
        np.testing.assert_allclose(together.variance, alone.variance, atol=1e-9)
        np.testing.assert_allclose(together.gain, alone.gain, atol=1e-9)
