"""ArduPilot's stacks: ArduSub's yaw, Rover's steering, and what they share.

Source: ArduPilot, libraries AC_AttitudeControl (AC_AttitudeControl and AC_AttitudeControl_Sub, .cpp and .h),
APM_Control/AR_AttitudeControl.cpp, AC_PID, AP_Math/control.cpp and AP_Scheduler; the gyro's low-pass in
AP_InertialSensor (INS_GYRO_FILTER, 20 Hz in Sub, 4 Hz in Rover), the order of the loop in ArduSub/Sub.cpp; what Rover
does to the output to a rudder in AR_Motors/AP_MotorsUGV.cpp (output_regular)."""

from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar

import numpy as np

from automarine_cli.control.targets import base
from automarine_cli.control.targets.base import Gains, State, Target, Tunable, hold, low_pass, share, spread, within
from automarine_cli.errors import SettingError
from automarine_cli.quantities import Complexes, Floats

RAD = np.pi / 180.0
CDEG = RAD / 100.0
MAX_ERROR = 45.0 * RAD


def gyro(slow: Floats, slower: Floats, velocity: Floats, dt: float, cutoff: float) -> tuple[Floats, Floats]:
    """Advance a second-order low-pass of the rate (Butterworth) by a loop: its slope and its value."""
    w = 2.0 * np.pi * cutoff
    slow = (slow + dt * w * w * (velocity - slower)) / (1.0 + np.sqrt(2.0) * w * dt + (w * dt) ** 2)
    return slow, slower + dt * slow


def gyro_response(z: Complexes, dt: float, cutoff: float) -> Complexes:
    ratio = (1.0 - 1.0 / z) / (2.0 * np.pi * cutoff * dt)
    return np.asarray(1.0 / (1.0 + np.sqrt(2.0) * ratio + ratio * ratio))


def root_law(gain: Floats, limit: Floats, step: float) -> Callable[[Floats], Floats]:
    """Return the velocity towards a target by what is left: in proportion near it, further off that from which `limit`
    can still stop; in proportion everywhere where the limit is 0."""
    gain = np.maximum(gain, 1e-6)
    linear_range, twice = np.where(limit > 0, limit, np.inf) / gain**2, 2.0 * np.maximum(limit, 0.0)

    def velocity(error: Floats) -> Floats:
        size = np.abs(error)
        wish, far = gain * size, size > linear_range
        if far.any():
            wish = np.where(far, np.sqrt(twice * np.maximum(size - 0.5 * linear_range, 0.0)), wish)
        return np.copysign(np.minimum(wish, size / step), error)

    return velocity


def distance_to(velocity: Floats, gain: Floats, limit: Floats) -> Floats:
    """Return what is left where `root_law` asks for a velocity."""
    linear_to = limit / np.maximum(gain, 1e-6)
    far = 0.5 * limit / np.maximum(gain, 1e-6) ** 2 + velocity**2 / (2.0 * limit)
    return np.asarray(np.where(velocity < linear_to, velocity / np.maximum(gain, 1e-6), far))


class ParameterFile(Target):
    """A target whose file is what ground stations read; `of` says whose gains are in it."""

    of: ClassVar[str]
    gyro_hz: ClassVar[float]
    numbers = 6
    rate: ClassVar[str]  # what the parameters of the rate loop begin with

    def crossover(self, nominal: base.NominalPlant) -> float:
        return min(super().crossover(nominal), self.range_of(f"{self.rate}_P")[1] / nominal.inertia)

    def cascade(self, numbers: Floats, nominal: base.NominalPlant, angle: str, least: float) -> dict[str, Floats]:
        """Defaults, but a rate loop with a crossover in shares of what delays and range allow, and in shares of that
        the gain of the `angle` loop and of the sum, which is `least` of it or more."""
        inner, outer, summed, _, _, lead = numbers.T
        lag = nominal.lag + self.own_lag
        crossover = spread(inner, 0.06, 1.0) * self.crossover(nominal)
        p = crossover * nominal.inertia
        return {name: np.full(len(numbers), value) for name, value in self.defaults.items()} | {
            angle: crossover * spread(outer, 0.08, 1.5),
            f"{self.rate}_P": p,
            f"{self.rate}_I": p * crossover * spread(summed, least, 0.5),
            f"{self.rate}_D": p * lag * base.leads(lead),
        }

    def text(self, gains: Mapping[str, float], nominal: base.NominalPlant, notes: Sequence[str]) -> str:
        head = f"{self.of} gains for {self.firmware}; names and units may differ in other versions."
        lines = [f"# {line}" for line in (head, *notes)]
        return "\n".join([*lines, *(f"{name},{gains[name]:.6g}" for name in self.searched)]) + "\n"


class ArduSub(ParameterFile):
    """Reference shaping, angle loop, rate loop. ATC_RAT_YAW_FF has no effect in Sub and is no parameter here.

    In each of its 400 loops a second the rate controller and the motors come first: what the angle loop asks for acts
    one loop later. The integrator rests while the last output was at its limit, unless it would come back. Defaults are
    those of a BlueROV2's log (4.1), but for SCHED_LOOP_RATE, 200 there. That of ATC_ACCEL_Y_MAX lies outside its
    documented range."""

    name = "ardusub"
    file = "ardusub.param"
    firmware = "ArduSub 4.1 to 4.5"
    of = "Heading"
    rate = "ATC_RAT_YAW"
    gyro_hz = 20.0
    period = 1.0 / 400.0
    parameters = (
        Tunable("ATC_ANG_YAW_P", "requested turn rate per heading error", "1/s", 6.0, 0.0, 6.0, True),
        Tunable("ATC_RAT_YAW_P", "output per rate error", "1/(rad/s)", 0.180, 0.0, 0.50, True),
        Tunable("ATC_RAT_YAW_I", "output per integral of the rate error", "1/rad", 0.018, 0.0, 0.05, True),
        Tunable("ATC_RAT_YAW_D", "output per change of the rate error", "1/(rad/s²)", 0.0, 0.0, 0.02, True),
        Tunable("ATC_RAT_YAW_IMAX", "limit of the integral term", "1", 0.222, 0.0, 1.0, True),
        Tunable("ATC_RAT_YAW_FLTT", "low-pass of the requested rate", "Hz", 5.0, 0.0, 100.0),
        Tunable("ATC_RAT_YAW_FLTE", "low-pass of the rate error", "Hz", 0.0, 0.0, 100.0),
        Tunable("ATC_RAT_YAW_FLTD", "low-pass of the change of the rate error", "Hz", 5.0, 0.0, 100.0, True),
        Tunable("ATC_SLEW_YAW", "fastest turn of the target heading", "cdeg/s", 6000.0, 500.0, 18000.0, True),
        Tunable("ATC_ACCEL_Y_MAX", "largest acceleration of the target heading", "cdeg/s²", 1.1e5, 0.0, 7.2e4, True),
        Tunable("ATC_INPUT_TC", "time over which a step of the target heading is smoothed", "s", 0.15, 0.0, 1.0),
    )  # fmt: skip

    def propose(self, numbers: Floats, nominal: base.NominalPlant) -> dict[str, Floats]:
        """Loops as in `cascade`, and a reference in shares of what the thrusters can follow."""
        *_, rate, speed_up, _ = numbers.T
        reach = 1.0 / nominal.inertia
        fastest = spread(rate, 0.1, 2.5) * min(nominal.fastest, 20.0 * nominal.step)
        gains = self.cascade(numbers, nominal, "ATC_ANG_YAW_P", 0.002) | {
            "ATC_RAT_YAW_FLTD": np.full(len(numbers), self.gyro_hz),
            "ATC_RAT_YAW_IMAX": np.full(len(numbers), 0.5),
            "ATC_SLEW_YAW": fastest / CDEG,
            "ATC_ACCEL_Y_MAX": spread(speed_up, 0.05, 4.0) * reach / CDEG,
        }
        return self.clipped(gains)

    @property
    def own_lag(self) -> float:
        return 1.5 * self.period + np.sqrt(2.0) / (2.0 * np.pi * self.gyro_hz) + 0.5 / (2.0 * np.pi * 5.0)

    def start(self, gains: Gains, position: Floats, holding: Floats) -> State:
        zero = np.zeros_like(position)
        # gyro's filter (two states), target heading, its rate, rate asked for, filtered rate, filtered error,
        # filtered change, integral, last output
        integral = within(holding + zero, gains["ATC_RAT_YAW_IMAX"])
        return (zero, zero, position, zero, zero, zero, zero, zero, integral, zero)

    def controller(self, gains: Gains) -> base.Controller:
        dt, limit = self.period, gains["ATC_ACCEL_Y_MAX"] * CDEG
        p, i, d, imax = (gains[f"ATC_RAT_YAW_{name}"] for name in ("P", "I", "D", "IMAX"))
        of_demand, of_error, of_change = (share(dt, gains[f"ATC_RAT_YAW_FLT{letter}"]) for letter in "TED")
        speed_up, slew = np.where(limit > 0, limit * dt, np.inf), gains["ATC_SLEW_YAW"] * CDEG
        pull = np.clip(0.5 * limit, 10.0 * RAD, 120.0 * RAD)
        furthest = np.minimum(MAX_ERROR, distance_to(1.0 / np.maximum(p, 1e-6), gains["ATC_ANG_YAW_P"], pull))
        to_reference = root_law(1.0 / np.maximum(gains["ATC_INPUT_TC"], 0.01), limit, dt)
        to_target = root_law(gains["ATC_ANG_YAW_P"], pull, dt)

        def step(state: State, reference: Floats, position: Floats, velocity: Floats) -> tuple[State, Floats]:
            slow, slower, target, turn, rate, demand, error, change, integral, last = state
            slow, slower = gyro(slow, slower, velocity, dt, self.gyro_hz)
            demand = demand + of_demand * (rate - demand)
            now = error + of_error * (demand - slower - error)
            change = change + of_change * ((now - error) / dt - change)
            free = (np.abs(last) < 1.0) | (integral * now < 0)
            integral = within(integral + i * dt * np.where(free, now, 0.0), imax)
            output = p * now + integral + d * change
            # the angle loop: target heading and its rate on the way to the reference, and the rate asked for
            turn = turn + within(within(to_reference(reference - target), slew) - turn, speed_up)
            to_go = within(target + turn * dt - position, furthest)
            rate = to_target(to_go) + turn
            after = slow, slower, position + to_go, turn, rate, demand, now, change, integral, output
            return after, within(output, 1.0)

        return step

    def paths(self, gains: Gains, s: Complexes) -> tuple[Complexes, Complexes]:
        dt = self.period
        z = np.exp(s * dt)
        weight = {name: share(dt, gains[name]) for name in gains if "FLT" in name}
        sums = dt / (1.0 - 1.0 / z)
        changes = low_pass(weight["ATC_RAT_YAW_FLTD"], z) / sums
        pid = gains["ATC_RAT_YAW_P"] + gains["ATC_RAT_YAW_I"] * sums + gains["ATC_RAT_YAW_D"] * changes
        rate = pid * low_pass(weight["ATC_RAT_YAW_FLTE"], z) * hold(s, dt)
        angle = rate * low_pass(weight["ATC_RAT_YAW_FLTT"], z) * gains["ATC_ANG_YAW_P"] / z
        return angle, rate * gyro_response(z, dt, self.gyro_hz)


SCALING = "MOT_SPD_SCA_BASE"


def scaling_base(usual: float) -> float:
    """Return the speed [m/s] above which Rover turns a rudder less: its default, or a fifth below the `usual` one."""
    return min(1.0, round(0.8 * usual, 3))


class ArduRover(ParameterFile):
    """Angle loop, rate loop with feed-forward of what the drag takes at a steady rate, fifty loops a second
    (SCHED_LOOP_RATE), for boats that turn by thrusters or a rudder. Older sources have defaults of 2.5, 360 and 180 for
    ATC_STR_ANG_P, RAT_MAX and ACC_MAX. Not flown: the limit by ATC_TURN_MAX_G, beyond 300 deg/s below 1 m/s.

    Above MOT_SPD_SCA_BASE the angle of a rudder is the output by that speed over the own one; below it the integrator
    rests. So the file sets it below the speed of the logs where its default of 1 m/s is above."""

    name = "ardurover"
    file = "ardurover.param"
    firmware = "Rover 4.2 to 4.6"
    of = "Steering"
    rate = "ATC_STR_RAT"
    gyro_hz = 4.0
    rudder = True
    period = 0.02
    parameters = (
        Tunable("ATC_STR_ANG_P", "requested turn rate per heading error", "1/s", 2.0, 1.0, 10.0, True),
        Tunable("ATC_STR_RAT_FF", "output per requested rate", "1/(rad/s)", 0.2, 0.0, 3.0, True),
        Tunable("ATC_STR_RAT_P", "output per rate error", "1/(rad/s)", 0.2, 0.0, 2.0, True),
        Tunable("ATC_STR_RAT_I", "output per integral of the rate error", "1/rad", 0.2, 0.0, 2.0, True),
        Tunable("ATC_STR_RAT_D", "output per change of the rate error", "1/(rad/s²)", 0.0, 0.0, 0.4, True),
        Tunable("ATC_STR_RAT_IMAX", "limit of the integral term", "1", 1.0, 0.0, 1.0),
        Tunable("ATC_STR_RAT_FLTE", "low-pass of the rate error", "Hz", 10.0, 0.0, 100.0),
        Tunable("ATC_STR_RAT_MAX", "fastest turn", "deg/s", 120.0, 0.0, 1000.0, True),
        Tunable("ATC_STR_ACC_MAX", "largest acceleration of the turn", "deg/s²", 120.0, 0.0, 1000.0, True),
    )  # fmt: skip

    def propose(self, numbers: Floats, nominal: base.NominalPlant) -> dict[str, Floats]:
        """As for Sub; feed-forward is one over the steady rate at the whole output."""
        *_, rate, speed_up, _ = numbers.T
        gains = self.cascade(numbers, nominal, "ATC_STR_ANG_P", 0.01) | {
            "ATC_STR_RAT_FF": np.full(len(numbers), 1.0 / nominal.fastest),
            "ATC_STR_RAT_MAX": spread(rate, 0.25, 1.0) * nominal.fastest / RAD,
            "ATC_STR_ACC_MAX": spread(speed_up, 0.1, 1.5) / nominal.inertia / RAD,
        }
        return self.clipped(gains)

    @property
    def own_lag(self) -> float:
        return 0.5 * self.period + np.sqrt(2.0) / (2.0 * np.pi * self.gyro_hz) + 1.0 / (2.0 * np.pi * 10.0)

    def steering(self, speed: float | None, usual: float | None) -> float:
        if speed is None or usual is None:
            raise SettingError(
                "ArduPilot Rover turns a rudder less the faster it goes, and the model's logs have no speed; log "
                "surge_m_s and fit again, or tune --for pid"
            )
        return min(scaling_base(usual) / speed, 1.0)

    def text(self, gains: Mapping[str, float], nominal: base.NominalPlant, notes: Sequence[str]) -> str:
        text = super().text(gains, nominal, notes)
        return f"{text}{SCALING},{scaling_base(nominal.speed):.6g}\n" if nominal.steered and nominal.speed else text

    def start(self, gains: Gains, position: Floats, holding: Floats) -> State:
        zero = np.zeros_like(position)
        integral = within(holding + zero, gains["ATC_STR_RAT_IMAX"])
        # gyro's filter (two states), rate asked for, filtered error, integral, last output
        return (zero, zero, zero, zero, integral, zero)

    def controller(self, gains: Gains) -> base.Controller:
        dt, limit, most = self.period, gains["ATC_STR_ACC_MAX"] * RAD, gains["ATC_STR_RAT_MAX"] * RAD
        speed_up, most = np.where(limit > 0, limit * dt, np.inf), np.where(most > 0, most, np.inf)
        of_error = share(dt, gains["ATC_STR_RAT_FLTE"])

        def step(state: State, reference: Floats, position: Floats, velocity: Floats) -> tuple[State, Floats]:
            slow, slower, rate, error, integral, last = state
            slow, slower = gyro(slow, slower, velocity, dt, self.gyro_hz)
            to_go = reference - position
            stops = np.where(limit > 0, np.sqrt(2.0 * np.abs(to_go) * limit), np.inf)
            wish = within(gains["ATC_STR_ANG_P"] * to_go, stops)
            rate = within(rate + within(wish - rate, speed_up), most)
            now = error + of_error * (rate - slower - error)
            free = (np.abs(last) < 1.0) | (integral * now < 0)
            grown = integral + np.where(free, gains["ATC_STR_RAT_I"] * dt * now, 0.0)
            integral = within(grown, gains["ATC_STR_RAT_IMAX"])
            change = gains["ATC_STR_RAT_D"] * (now - error) / dt
            output = gains["ATC_STR_RAT_FF"] * rate + gains["ATC_STR_RAT_P"] * now + integral + change
            return (slow, slower, rate, now, integral, output), within(output, 1.0)

        return step

    def paths(self, gains: Gains, s: Complexes) -> tuple[Complexes, Complexes]:
        dt = self.period
        z = np.exp(s * dt)
        sums = dt / (1.0 - 1.0 / z)
        pid = gains["ATC_STR_RAT_P"] + gains["ATC_STR_RAT_I"] * sums + gains["ATC_STR_RAT_D"] / sums
        rate = pid * low_pass(share(dt, gains["ATC_STR_RAT_FLTE"]), z)
        angle = gains["ATC_STR_ANG_P"] * (rate + gains["ATC_STR_RAT_FF"])
        return angle * hold(s, dt), rate * gyro_response(z, dt, self.gyro_hz) * hold(s, dt)
