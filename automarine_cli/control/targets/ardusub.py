"""ArduSub's yaw stack: reference shaping, angle loop, rate loop.

In each of its 400 loops a second the rate controller and the motors come first, the angle loop after them: what that
asks for acts one loop later. The integrator rests while the last output was at its limit, unless it would come back.
Source: ArduPilot, libraries AC_AttitudeControl (AC_AttitudeControl and AC_AttitudeControl_Sub, .cpp and .h), AC_PID and
AP_Math/control.cpp; the gyro's low-pass in AP_InertialSensor (INS_GYRO_FILTER, 20 Hz), the order of the loop in
ArduSub/Sub.cpp. Defaults are also those of a BlueROV2's log (4.1), but for SCHED_LOOP_RATE, 200 there and 400 in the
source. The default of ATC_ACCEL_Y_MAX lies outside its documented range; later sources hold it in deg/s² (1100).
"""

import numpy as np

from automarine_cli.control.targets.ardupilot_parts import ParameterFile, RootLaw, distance_to, gyro, gyro_response
from automarine_cli.control.targets.base import (
    Gains,
    Nominal,
    Parameter,
    State,
    hold,
    leads,
    low_pass,
    share,
    spread,
    within,
)
from automarine_cli.quantities import Complexes, Floats

RAD = np.pi / 180.0
CDEG = RAD / 100.0
MOST_ERROR = 45.0 * RAD
GYRO_HZ = 20.0


class Prepared(dict[str, Floats]):
    """Gains with the limits of the angle loop [rad, s]."""

    def __init__(
        self,
        gains: Gains,
        *,
        speed_up: Floats,
        slew: Floats,
        furthest: Floats,
        to_reference: RootLaw,
        to_target: RootLaw,
    ) -> None:
        super().__init__(gains)
        self.speed_up, self.slew, self.furthest = speed_up, slew, furthest
        self.to_reference, self.to_target = to_reference, to_target


class ArduSub(ParameterFile):
    """See the module's docstring. ATC_RAT_YAW_FF has no effect in Sub and is no parameter here."""

    name = "ardusub"
    says = "ArduSub's heading hold: a .param file"
    source = "ArduPilot, AC_AttitudeControl"
    file = "ardusub.param"
    firmware = "ArduSub 4.1 to 4.5"
    of = "Heading"
    numbers = 6
    period = 1.0 / 400.0
    parameters = (
        Parameter("ATC_ANG_YAW_P", "turn rate asked for per error of heading", "1/s", 6.0, 0.0, 6.0, True),
        Parameter("ATC_RAT_YAW_P", "output per error of the rate", "1/(rad/s)", 0.180, 0.0, 0.50, True),
        Parameter("ATC_RAT_YAW_I", "the same, summed up over time", "1/rad", 0.018, 0.0, 0.05, True),
        Parameter("ATC_RAT_YAW_D", "output per change of the error of the rate", "1/(rad/s²)", 0.0, 0.0, 0.02, True),
        Parameter("ATC_RAT_YAW_IMAX", "most output of the summed-up part", "1", 0.222, 0.0, 1.0, True),
        Parameter("ATC_RAT_YAW_FLTT", "low-pass of the rate asked for", "Hz", 5.0, 0.0, 100.0),
        Parameter("ATC_RAT_YAW_FLTE", "low-pass of the error of the rate", "Hz", 0.0, 0.0, 100.0),
        Parameter("ATC_RAT_YAW_FLTD", "low-pass of its change", "Hz", 5.0, 0.0, 100.0, True),
        Parameter("ATC_SLEW_YAW", "fastest turn of the target heading", "cdeg/s", 6000.0, 500.0, 18000.0, True),
        Parameter("ATC_ACCEL_Y_MAX", "its largest acceleration", "cdeg/s²", 110000.0, 0.0, 72000.0, True),
        Parameter("ATC_INPUT_TC", "time in which a step of it is smoothed", "s", 0.15, 0.0, 1.0),
    )  # fmt: skip

    def propose(self, numbers: Floats, nominal: Nominal) -> dict[str, Floats]:
        """A crossover of the rate loop in shares of what the delays allow, the other loops in shares of it, and a
        reference in shares of what the thrusters can follow."""
        inner, outer, summed, rate, speed_up, lead = numbers.T
        lag = nominal.lag + self.own_lag({})
        crossover = spread(inner, 0.04, 0.9) / lag
        p = crossover * nominal.inertia
        reach = 1.0 / nominal.inertia
        fastest = spread(rate, 0.25, 2.5) * min(nominal.fastest, 20.0 * nominal.step)
        found = {name: np.full(len(numbers), value) for name, value in self.defaults.items()}
        found |= {
            "ATC_ANG_YAW_P": crossover * spread(outer, 0.04, 0.7),
            "ATC_RAT_YAW_P": p,
            "ATC_RAT_YAW_I": p * crossover * spread(summed, 0.002, 0.5),
            "ATC_RAT_YAW_D": p * lag * leads(lead),
            "ATC_RAT_YAW_FLTD": np.full(len(numbers), GYRO_HZ),
            "ATC_RAT_YAW_IMAX": np.full(len(numbers), 0.5),
            "ATC_SLEW_YAW": fastest / CDEG,
            "ATC_ACCEL_Y_MAX": spread(speed_up, 0.1, 4.0) * reach / CDEG,
        }
        return self.clipped(found)

    def own_lag(self, gains: Gains) -> float:
        """The gyro's low-pass, that of the rate asked for, the hold and the later loop."""
        return 1.5 * self.period + np.sqrt(2.0) / (2.0 * np.pi * GYRO_HZ) + 0.5 / (2.0 * np.pi * 5.0)

    def start(self, gains: Gains, position: Floats, holding: Floats) -> State:
        """At rest, with the target heading where the vehicle points."""
        zero = np.zeros_like(position)
        # gyro's filter (two states), target heading, its rate, rate asked for, filtered rate, filtered error,
        # filtered change, integral, last output
        integral = within(holding + zero, gains["ATC_RAT_YAW_IMAX"])
        return (zero, zero, position, zero, zero, zero, zero, zero, integral, zero)

    def prepared(self, gains: Gains) -> Gains:
        """Weights of the filters per loop, and limits in radians."""
        dt, limit = self.period, gains["ATC_ACCEL_Y_MAX"] * CDEG
        pull = np.clip(0.5 * limit, 10.0 * RAD, 120.0 * RAD)
        gain, p = gains["ATC_ANG_YAW_P"], np.maximum(gains["ATC_RAT_YAW_P"], 1e-6)
        return Prepared(
            {**gains, **{name[-4:]: share(dt, gains[name]) for name in gains if "FLT" in name}},
            speed_up=np.where(limit > 0, limit * dt, np.inf),
            slew=gains["ATC_SLEW_YAW"] * CDEG,
            furthest=np.minimum(MOST_ERROR, distance_to(1.0 / p, gain, pull)),
            to_reference=RootLaw.of(1.0 / np.maximum(gains["ATC_INPUT_TC"], 0.01), limit, dt),
            to_target=RootLaw.of(gain, pull, dt),
        )

    def step(
        self, state: State, gains: Gains, reference: Floats, position: Floats, velocity: Floats
    ) -> tuple[State, Floats]:
        """Rate controller, motors, then the angle loop."""
        own = gains if isinstance(gains, Prepared) else self.prepared(gains)
        assert isinstance(own, Prepared)
        dt = self.period
        slow, slower, target, turn, asked, demand, error, change, integral, last = state
        slow, slower = gyro(slow, slower, velocity, dt, GYRO_HZ)
        demand = demand + own["FLTT"] * (asked - demand)
        now = error + own["FLTE"] * (demand - slower - error)
        change = change + own["FLTD"] * ((now - error) / dt - change)
        free = (np.abs(last) < 1.0) | (integral * now < 0)
        grown = integral + own["ATC_RAT_YAW_I"] * dt * np.where(free, now, 0.0)
        integral = within(grown, own["ATC_RAT_YAW_IMAX"])
        wanted = own["ATC_RAT_YAW_P"] * now + integral + own["ATC_RAT_YAW_D"] * change
        # the angle loop: target heading and its rate on the way to the reference, and the rate asked for
        turn = turn + within(within(own.to_reference(reference - target), own.slew) - turn, own.speed_up)
        left = within(target + turn * dt - position, own.furthest)
        asked = own.to_target(left) + turn
        return (slow, slower, position + left, turn, asked, demand, now, change, integral, wanted), within(wanted, 1.0)

    def paths(self, gains: Gains, s: Complexes) -> tuple[Complexes, Complexes]:
        """Loop by loop, in z."""
        dt = self.period
        z = np.exp(s * dt)
        weight = {name: share(dt, gains[name]) for name in gains if "FLT" in name}
        sums = dt / (1.0 - 1.0 / z)
        changes = low_pass(weight["ATC_RAT_YAW_FLTD"], z) / sums
        pid = gains["ATC_RAT_YAW_P"] + gains["ATC_RAT_YAW_I"] * sums + gains["ATC_RAT_YAW_D"] * changes
        rate = pid * low_pass(weight["ATC_RAT_YAW_FLTE"], z) * hold(s, dt)
        angle = rate * low_pass(weight["ATC_RAT_YAW_FLTT"], z) * gains["ATC_ANG_YAW_P"] / z
        return angle, rate * gyro_response(z, dt, GYRO_HZ)
