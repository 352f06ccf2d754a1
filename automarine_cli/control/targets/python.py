"""One readable Python file: reference model, feedback linearisation of the identified drag, PI, anti-windup, map.

    reference:  x_m'' = w_m^2 (x_ref - x_m) - 2 w_m x_m',  x_m' and x_m'' within what the thrusters can follow
    velocity:   v_ref = x_m' + w_h (x_m - x)
    moment:     tau = I (x_m'' + 2 w (v_ref - v)) + I w^2 sum (v_ref - v) T_s + linear v + quadratic |v| v

Source: Fossen (2021), Handbook of Marine Craft Hydrodynamics and Motion Control, chapters 12, 15 and 16 (reference
models, PID with acceleration feedforward, feedback linearisation).
"""

from collections.abc import Mapping, Sequence
from importlib.resources import files

import numpy as np

from automarine_cli import __version__
from automarine_cli.control.targets.base import Controller, Gains, NominalPlant, Parameter, State, Target
from automarine_cli.control.targets.loops import hold, spread, summed, within
from automarine_cli.quantities import Complexes, Floats

WRAPPED = """        # the heading counts on over north, as the model does
        position += 2.0 * pi * round((self.model - position) / (2.0 * pi))
        reference += 2.0 * pi * round((self.model - reference) / (2.0 * pi))
"""


class Python(Target):
    name = "python"
    file = "controller.py"
    motions = ("yaw", "surge", "heave", "sway")
    numbers = 5
    period = 0.05
    timed = True
    linear = True
    parameters = (
        Parameter("velocity", "closed-loop frequency of the velocity", "rad/s", None, searched=True),
        Parameter("position", "velocity asked for per error of position", "1/s", None, searched=True),
        Parameter("reference", "frequency of the reference model", "rad/s", None, searched=True),
        Parameter("rate", "fastest velocity of the reference", "{x}/s", None, searched=True),
        Parameter("acceleration", "its largest acceleration", "{x}/s²", None, searched=True),
        Parameter("inertia", "inertia per moment of the whole output", "s²/{x}", None),
        Parameter("drag", "its linear drag", "s/{x}", None),
        Parameter("squared", "its quadratic drag", "s²/{x}²", None),
    )

    def propose(self, numbers: Floats, nominal: NominalPlant) -> dict[str, Floats]:
        """Frequencies in shares of what the delays allow, the reference in shares of what the thrusters can follow."""
        inner, outer, ahead, rate, speed_up = numbers.T
        w = spread(inner, 0.04, 0.6) / (nominal.lag + self.own_lag)
        return {
            "velocity": w,
            "position": w * spread(outer, 0.05, 0.8),
            "reference": w * spread(ahead, 0.1, 1.5),
            "rate": spread(rate, 0.3, 0.9) * min(nominal.fastest, 20.0 * nominal.step),
            "acceleration": spread(speed_up, 0.1, 0.8) / nominal.inertia,
            "inertia": np.full(len(numbers), nominal.inertia),
            "drag": np.full(len(numbers), nominal.linear),
            "squared": np.full(len(numbers), nominal.quadratic),
        }

    def start(self, gains: Gains, position: Floats, holding: Floats) -> State:
        zero = np.zeros_like(position)
        return (position, zero, holding + zero)

    def controller(self, gains: Gains) -> Controller:
        dt, w, ahead = self.period, gains["velocity"], gains["reference"]

        def step(state: State, reference: Floats, position: Floats, velocity: Floats) -> tuple[State, Floats]:
            model, slope, integral = state
            pull = within(ahead**2 * (reference - model) - 2.0 * ahead * slope, gains["acceleration"])
            after = within(slope + pull * dt, gains["rate"])
            pull, slope = (after - slope) / dt, after
            model = model + slope * dt
            error = slope + gains["position"] * (model - position) - velocity
            drag = gains["drag"] * velocity + gains["squared"] * np.abs(velocity) * velocity
            now = gains["inertia"] * (pull + 2.0 * w * error) + drag
            integral = summed(integral, integral + gains["inertia"] * w**2 * dt * error, now, error)
            return (model, slope, integral), within(now + integral, 1.0)

        return step

    def paths(self, gains: Gains, s: Complexes) -> tuple[Complexes, Complexes]:
        dt = self.period
        sums = dt / (1.0 - np.exp(-s * dt))
        w = gains["velocity"]
        rate = gains["inertia"] * (2.0 * w + w**2 * sums)
        return rate * gains["position"] * hold(s, dt), (rate - gains["drag"]) * hold(s, dt)

    def text(self, gains: Mapping[str, float], nominal: NominalPlant, notes: Sequence[str]) -> str:
        """Write the same law as `controller` for one vehicle, without libraries; numbers to eight digits."""
        bend, dof = nominal.bend, nominal.dof
        if bend is None:
            outputs, shares = [0.0, 1.0], [0.0, 1.0]
        else:
            first = int((bend.share <= 0.0).sum()) - 1
            outputs, shares = bend.output[first:].tolist(), bend.share[first:].tolist()
        lines = [f"Written by automarine {__version__}.", *notes]
        scaled = {name: f"{gains[name] * nominal.full:.8g}" for name in ("inertia", "drag", "squared")}
        plain = {name: f"{gains[name]:.8g}" for name in ("velocity", "position", "reference", "rate", "acceleration")}
        template = files("automarine_cli.control.targets").joinpath("controller.txt").read_text(encoding="utf-8")
        return template.format(
            motion=dof.name, period=f"{self.period:g}", notes="\n".join(lines), pi=", pi" if dof.wraps else "",
            **scaled, **plain, full=f"{nominal.full:.8g}", force_unit=nominal.force_unit, x=dof.units.base,
            force=dof.words.force, inertia_unit=dof.unit_of("inertia", nominal.force_unit),
            linear_unit=dof.unit_of("linear", nominal.force_unit),
            quadratic_unit=dof.unit_of("quadratic", nominal.force_unit),
            outputs="[" + ", ".join(f"{x:.6g}" for x in outputs) + "]",
            shares="[" + ", ".join(f"{x:.6g}" for x in shares) + "]",
            angles=f"Reference and {dof.words.position} [{dof.units.base}], ", wrapped=WRAPPED if dof.wraps else "",
        )  # fmt: skip
