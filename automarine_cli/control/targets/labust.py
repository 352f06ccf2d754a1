"""LABUST's controllers: a PI controller of the velocity made of the identified model, and an I-P controller about it.

    tau = K_P (v_ref - v) + K_I sum (v_ref - v) T_s + quadratic |v| v,    K_P = 2 w I - linear, K_I = I w^2
    v_ref = w_h^2 sum (x_ref - x) T_s - 2 w_h (x - x_0)

One design number each: the closed-loop frequencies w of the velocity and w_h of the position. Source: labust-ros-pkg
(labust_control, PIFFController and its gains from the model), University of Zagreb.
"""

import numpy as np

from automarine_cli import __version__
from automarine_cli.control.targets.base import (
    MODEL,
    Design,
    Gains,
    Nominal,
    Parameter,
    State,
    Target,
    hold,
    spread,
    summed,
    within,
)
from automarine_cli.quantities import Complexes, Floats

FIRST = {"yaw": "hdg_controller", "heave": "depth_controller", "surge": "dp_controller", "sway": "dp_controller"}


class Labust(Target):
    """See the module's docstring."""

    name = "labust"
    says = "LABUST's velocity and position controllers: YAML with the model and two frequencies"
    source = "labust-ros-pkg, labust_control"
    file = "labust.yaml"
    motions = ("yaw", "surge", "heave", "sway")
    integrators = 2
    numbers = 2
    period = 0.1
    timed = True
    linear = True
    parameters = (
        Parameter("velocity", "closed-loop frequency of the velocity", "rad/s", None, searched=True),
        Parameter("position", "closed-loop frequency of the position", "rad/s", None, searched=True),
        *MODEL,
        Parameter("rate", "fastest velocity asked for", "{x}/s", None),
    )

    def propose(self, numbers: Floats, nominal: Nominal) -> dict[str, Floats]:
        """Frequencies in shares of what the delays allow; the rest is the model."""
        inner, outer = numbers.T
        w = spread(inner, 0.05, 0.6) / (nominal.lag + self.own_lag({}))
        return {
            "velocity": w,
            "position": w * spread(outer, 0.04, 0.5),
            **nominal.model(len(numbers)),
            "rate": np.full(len(numbers), 0.8 * nominal.fastest),
        }

    def start(self, gains: Gains, position: Floats, holding: Floats) -> State:
        """At rest at the position."""
        zero = np.zeros_like(position)
        return (position, zero, holding + zero)

    def step(
        self, state: State, gains: Gains, reference: Floats, position: Floats, velocity: Floats
    ) -> tuple[State, Floats]:
        """Position, then velocity."""
        dt = self.period
        origin, way, integral = state
        w, outer = gains["velocity"], gains["position"]
        grown_way = way + outer**2 * dt * (reference - position)
        wish = grown_way - 2.0 * outer * (position - origin)
        wanted = within(wish, gains["rate"])
        way = np.where((wish != wanted) & (wish * (reference - position) > 0), way, grown_way)
        error = wanted - velocity
        now = (2.0 * w * gains["inertia"] - gains["drag"]) * error + gains["squared"] * np.abs(velocity) * velocity
        grown = integral + gains["inertia"] * w**2 * dt * error
        integral = summed(integral, grown, now, error)
        return (origin, way, integral), within(now + integral, 1.0)

    def paths(self, gains: Gains, s: Complexes) -> tuple[Complexes, Complexes]:
        """Loop by loop, in z; quadratic drag is nothing about rest."""
        dt = self.period
        z = np.exp(s * dt)
        sums = dt / (1.0 - 1.0 / z)
        w, outer = gains["velocity"], gains["position"]
        rate = 2.0 * w * gains["inertia"] - gains["drag"] + gains["inertia"] * w**2 * sums
        angle = rate * (2.0 * outer + outer**2 * sums)
        return angle * hold(s, dt), rate * hold(s, dt)

    def text(self, design: Design) -> str:
        """Frequencies under the names of its nodes, and the model that its gains are made of."""
        own, model, dof = design.gains, design.nominal, design.nominal.dof
        place = dof.number

        def vector(value: float) -> str:
            return ", ".join(f"{value if i == place else 0.0:.8g}" for i in range(6))

        mass = "inertia" if dof.wraps else "mass"
        head = [f"Written by automarine {__version__}.", *design.notes,
                f"Only the entries of {dof.name} are designed: merge with those of your other motions.",
                f"Gains: K_P = 2 w I - linear, K_I = I w^2; the model is in {model.force_unit}."]  # fmt: skip
        lines = [f"# {line}" for line in head]
        lines += [
            f"velocity_controller/closed_loop_freq: [{vector(own['velocity'])}]",
            f"velocity_controller/Ts: {self.period:g}",
            f"velocity_controller/output_limits: [{vector(model.full)}]",
            f"{FIRST[dof.name]}/closed_loop_freq: {own['position']:.8g}",
            f"{FIRST[dof.name]}/use_ip: true",
            f"{FIRST[dof.name]}/Ts: {self.period:g}",
            f"model/{mass}_with_added: [{vector(own['inertia'] * model.full)}]",
            f"model/linear_damping: [{vector(own['drag'] * model.full)}]",
            f"model/quadratic_damping: [{vector(own['squared'] * model.full)}]",
        ]
        return "\n".join(lines) + "\n"
