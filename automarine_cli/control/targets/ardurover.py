"""ArduPilot Rover's steering stack, for boats that turn by their thrusters: angle loop, rate loop with feed-forward.

Fifty loops a second (SCHED_LOOP_RATE). Source: ArduPilot, libraries APM_Control/AR_AttitudeControl.cpp (its defaults of
ATC_STR_ANG_P, RAT_MAX and ACC_MAX are 2.0, 120 and 120; older sources have 2.5, 360 and 180), AC_PID, AP_Scheduler; the
gyro's low-pass, slower than Sub's, in AP_InertialSensor (INS_GYRO_FILTER, 4 Hz). Not flown: the limit by
ATC_TURN_MAX_G, beyond 300 deg/s below 1 m/s.
"""

import numpy as np

from automarine_cli.control.targets.ardupilot_parts import ParameterFile, gyro, gyro_response
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
GYRO_HZ = 4.0


class ArduRover(ParameterFile):
    """See the module's docstring. Feed-forward has an effect here: what the drag takes at a steady rate."""

    name = "ardurover"
    says = "ArduPilot Rover's steering of a boat: a .param file"
    source = "ArduPilot, APM_Control/AR_AttitudeControl"
    file = "ardurover.param"
    firmware = "Rover 4.2 to 4.6"
    of = "Steering"
    numbers = 6
    period = 0.02
    parameters = (
        Parameter("ATC_STR_ANG_P", "turn rate asked for per error of heading", "1/s", 2.0, 1.0, 10.0, True),
        Parameter("ATC_STR_RAT_FF", "output per rate asked for", "1/(rad/s)", 0.2, 0.0, 3.0, True),
        Parameter("ATC_STR_RAT_P", "output per error of the rate", "1/(rad/s)", 0.2, 0.0, 2.0, True),
        Parameter("ATC_STR_RAT_I", "the same, summed up over time", "1/rad", 0.2, 0.0, 2.0, True),
        Parameter("ATC_STR_RAT_D", "output per change of the error of the rate", "1/(rad/s²)", 0.0, 0.0, 0.4, True),
        Parameter("ATC_STR_RAT_IMAX", "most output of the summed-up part", "1", 1.0, 0.0, 1.0),
        Parameter("ATC_STR_RAT_FLTE", "low-pass of the error of the rate", "Hz", 10.0, 0.0, 100.0),
        Parameter("ATC_STR_RAT_MAX", "fastest turn", "deg/s", 120.0, 0.0, 1000.0, True),
        Parameter("ATC_STR_ACC_MAX", "largest acceleration of the turn", "deg/s²", 120.0, 0.0, 1000.0, True),
    )  # fmt: skip

    def propose(self, numbers: Floats, nominal: Nominal) -> dict[str, Floats]:
        """As for Sub; feed-forward is one over the steady rate at the whole output."""
        inner, outer, summed, rate, speed_up, lead = numbers.T
        lag = nominal.lag + self.own_lag({})
        crossover = spread(inner, 0.04, 0.9) / lag
        p = crossover * nominal.inertia
        found = {name: np.full(len(numbers), value) for name, value in self.defaults.items()}
        found |= {
            "ATC_STR_ANG_P": crossover * spread(outer, 0.04, 0.7),
            "ATC_STR_RAT_FF": np.full(len(numbers), 1.0 / nominal.fastest),
            "ATC_STR_RAT_P": p,
            "ATC_STR_RAT_I": p * crossover * spread(summed, 0.01, 0.5),
            "ATC_STR_RAT_D": p * lag * leads(lead),
            "ATC_STR_RAT_MAX": spread(rate, 0.25, 1.0) * nominal.fastest / RAD,
            "ATC_STR_ACC_MAX": spread(speed_up, 0.1, 1.5) / nominal.inertia / RAD,
        }
        return self.clipped(found)

    def own_lag(self, gains: Gains) -> float:
        """The gyro's low-pass, that of the error, and the hold."""
        return 0.5 * self.period + np.sqrt(2.0) / (2.0 * np.pi * GYRO_HZ) + 1.0 / (2.0 * np.pi * 10.0)

    def start(self, gains: Gains, position: Floats, holding: Floats) -> State:
        """At rest."""
        zero = np.zeros_like(position)
        integral = within(holding + zero, gains["ATC_STR_RAT_IMAX"])
        # gyro's filter (two states), rate asked for, filtered error, integral, last output
        return (zero, zero, zero, zero, integral, zero)

    def step(
        self, state: State, gains: Gains, reference: Floats, position: Floats, velocity: Floats
    ) -> tuple[State, Floats]:
        """Angle loop, then rate controller."""
        dt = self.period
        slow, slower, asked, error, integral, last = state
        slow, slower = gyro(slow, slower, velocity, dt, GYRO_HZ)
        left = reference - position
        limit = gains["ATC_STR_ACC_MAX"] * RAD
        wish = within(gains["ATC_STR_ANG_P"] * left, np.where(limit > 0, np.sqrt(2.0 * np.abs(left) * limit), np.inf))
        asked = asked + within(wish - asked, np.where(limit > 0, limit * dt, np.inf))
        most = gains["ATC_STR_RAT_MAX"] * RAD
        asked = within(asked, np.where(most > 0, most, np.inf))
        now = error + share(dt, gains["ATC_STR_RAT_FLTE"]) * (asked - slower - error)
        free = (np.abs(last) < 1.0) | (integral * now < 0)
        grown = integral + np.where(free, gains["ATC_STR_RAT_I"] * dt * now, 0.0)
        integral = within(grown, gains["ATC_STR_RAT_IMAX"])
        change = gains["ATC_STR_RAT_D"] * (now - error) / dt
        wanted = gains["ATC_STR_RAT_FF"] * asked + gains["ATC_STR_RAT_P"] * now + integral + change
        return (slow, slower, asked, now, integral, wanted), within(wanted, 1.0)

    def paths(self, gains: Gains, s: Complexes) -> tuple[Complexes, Complexes]:
        """Loop by loop, in z."""
        dt = self.period
        z = np.exp(s * dt)
        sums = dt / (1.0 - 1.0 / z)
        pid = gains["ATC_STR_RAT_P"] + gains["ATC_STR_RAT_I"] * sums + gains["ATC_STR_RAT_D"] / sums
        rate = pid * low_pass(share(dt, gains["ATC_STR_RAT_FLTE"]), z)
        angle = gains["ATC_STR_ANG_P"] * (rate + gains["ATC_STR_RAT_FF"])
        return angle * hold(s, dt), rate * gyro_response(z, dt, GYRO_HZ) * hold(s, dt)
