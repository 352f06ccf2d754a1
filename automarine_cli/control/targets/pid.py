"""One PID controller from the error of position to the output, for whoever writes it.

    u = K_p (b r - y) + K_i sum (r - y) T_s - K_d y',    y' by differences through a low-pass of time T_f

Source: Astrom and Hagglund (2006), Advanced PID Control, chapters 3 and 13 (weight b of the set point, derivative of
the measurement alone, integration that stops at the limits).
"""

import json
from collections.abc import Mapping, Sequence

import numpy as np

from automarine_cli.control.targets import base
from automarine_cli.control.targets.base import Controller, Gains, NominalPlant, State, Target, Tunable, spread, within
from automarine_cli.quantities import Complexes, Floats

DERIVATIVE_FILTER_RATIO = 10.0  # how many times shorter than the derivative's time its low-pass is: chapter 3


class Pid(Target):
    name = "pid"
    file = "pid.json"
    motions = ("yaw", "surge", "heave", "sway")
    numbers = 4
    period = 0.05
    rudder = timed = True
    parameters = (
        Tunable("K_p", "output per position error", "1/{x}", None, searched=True),
        Tunable("K_i", "output per integral of the position error", "1/({x} s)", None, searched=True),
        Tunable("K_d", "output per velocity", "s/{x}", None, searched=True),
        Tunable("b", "weight of the reference in the proportional part", "1", None, 0.0, 1.0, searched=True),
        Tunable("T_f", "time constant of the low-pass of the derivative", "s", None, searched=True),
    )

    def propose(self, numbers: Floats, nominal: NominalPlant) -> dict[str, Floats]:
        """Crossover in shares of what the delays allow; damping, sum and set-point weight beside it."""
        speed, damping, summed, weight = numbers.T
        w = spread(speed, 0.03, 0.8) / (nominal.lag + self.own_lag)
        d = nominal.inertia * w * spread(damping, 0.7, 2.5)
        p = nominal.inertia * w**2 * spread(damping, 0.5, 1.0)
        filtered = np.maximum(0.5 * self.period, d / (DERIVATIVE_FILTER_RATIO * p))
        return {"K_p": p, "K_i": p * w * spread(summed, 0.01, 0.4), "K_d": d, "b": weight, "T_f": filtered}

    def start(self, gains: Gains, position: Floats, holding: Floats) -> State:
        zero = np.zeros_like(position)
        return (position, zero, holding + gains["K_p"] * (1.0 - gains["b"]) * position)

    def controller(self, gains: Gains) -> Controller:
        dt = self.period

        def step(state: State, reference: Floats, position: Floats, velocity: Floats) -> tuple[State, Floats]:
            before, slope, integral = state
            slope = slope + dt / (dt + gains["T_f"]) * ((position - before) / dt - slope)
            error = reference - position
            now = gains["K_p"] * (gains["b"] * reference - position) - gains["K_d"] * slope
            integral = base.summed(integral, integral + gains["K_i"] * dt * error, now, error)
            return (position, slope, integral), within(now + integral, 1.0)

        return step

    def paths(self, gains: Gains, s: Complexes) -> tuple[Complexes, Complexes]:
        dt = self.period
        z = np.exp(s * dt)
        weight = dt / (dt + gains["T_f"])
        slope = weight / (1.0 - (1.0 - weight) / z) * (1.0 - 1.0 / z) / dt
        controller = gains["K_p"] + gains["K_i"] * dt / (1.0 - 1.0 / z) + gains["K_d"] * slope
        return controller * base.hold(s, dt), np.zeros_like(controller)

    def text(self, gains: Mapping[str, float], nominal: NominalPlant, notes: Sequence[str]) -> str:
        units = {p.name: p.unit.replace("{x}", nominal.dof.units.base) for p in self.parameters}
        numbers = {name: {"value": gains[name], "unit": units[name]} for name in gains}
        content = {
            "schema": "automarine/pid/1", "motion": nominal.dof.name,
            "law": "u = K_p (b r - y) + K_i sum (r - y) T_s - K_d y', u from -1 to 1; y' = differences of y through a "
            "first-order low-pass T_f; the sum rests while u is at its limit and the error would carry it further",
            "sample_time_s": self.period, "parallel": numbers, "notes": [*notes],
        }  # fmt: skip
        if nominal.steered:  # an output of 1 turns to starboard
            content["rudder_deg_at_full_output"] = float(np.rad2deg(nominal.full)) * (nominal.side or 1)
        return json.dumps(content, indent=1, ensure_ascii=False) + "\n"
