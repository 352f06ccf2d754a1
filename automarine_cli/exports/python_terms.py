"""Each effect as lines of Python, for the file that `python` writes.

In the lines stand N the moment, s the rate through the water, r the rate, psi the heading, t and time the times, and
in braces the names of the effect's constants. What is not here needs a logged column or differs from run to run.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from automarine_cli.effects.coulomb_drag import CREEP
from automarine_cli.effects.dead_band import EDGE


@dataclass(frozen=True)
class Lines:
    """`command`: lines that change the moment N, in the model's order; `moment`: a term of the sum of moments; `state`:
    slopes of states of its own; `reading`: lines that change the headings psi of shape (N,)."""

    command: tuple[str, ...] = ()
    moment: str = ""
    state: tuple[str, ...] = ()
    reading: tuple[str, ...] = ()

    def named(self, names: Mapping[str, str]) -> "Lines":
        """The same with the names of constants for those in braces."""
        return Lines(
            tuple(line.format(**names) for line in self.command),
            self.moment.format(**names),
            tuple(line.format(**names) for line in self.state),
            tuple(line.format(**names) for line in self.reading),
        )


LINES: Mapping[str, Lines] = {
    "linear-drag": Lines(moment="- {linear} * s"),
    "quadratic-drag": Lines(moment="- {quadratic} * abs(s) * s"),
    "cubic-drag": Lines(moment="- {cubic} * s**3"),
    "bias-moment": Lines(moment="+ {b}"),
    "coulomb-drag": Lines(moment=f"- {{c}} * np.tanh(r / {CREEP})"),
    "drag-asymmetry": Lines(moment="- {e} * s**2"),
    "linear-drag-asymmetry": Lines(moment="- {e} * abs(s)"),
    "tether-spring": Lines(moment="- {kappa} * (psi - psi0)"),
    "heading-moment": Lines(moment="+ {b} * np.sin(psi) + {c} * np.cos(psi)"),
    "thrust-loss": Lines(moment="- {b} * abs(N) ** 0.5 * r"),
    "periodic-disturbance": Lines(
        command=("turn = 2 * np.pi * (t - time[0]) / {T}",),
        moment="+ {A} * np.sin(turn) + {B} * np.cos(turn)",
    ),
    "water-swirl": Lines(),  # see SWIRL
    "input-delay": Lines(),  # a matter of which command holds
    "thruster-lag": Lines(command=("n_dot = (np.sign(N) * abs(N) ** 0.5 - n) / {T}", "N = n * abs(n)")),
    "dead-band": Lines(command=("N = np.sign(N) * max(abs(N) - {width}, 0.0)",)),
    "saturation": Lines(command=("N = np.sign(N) * min(abs(N), {tau_max})",)),
    "thrust-asymmetry": Lines(command=("N = (1.0 + {a} * np.sign(N)) * N",)),
    "thrust-exponent": Lines(command=("N = np.sign(N) * {tau_ref} * (abs(N) / {tau_ref}) ** {p}",)),
    "battery-sag": Lines(
        command=(
            "fresh = np.exp(-{discharge} * (t - {t_ref}) / 3600)",
            "N = N * fresh * (1.0 - {load} * abs(N) / {tau_ref})",
        )
    ),
    "compass-deviation": Lines(
        reading=(
            "read = psi + {B} * np.sin(psi) + {C} * np.cos(psi)",
            "psi = read + {D} * np.sin(2 * psi) + {E} * np.cos(2 * psi)",
        )
    ),
    "gyro-drift": Lines(reading=("psi = psi + {g} * (time - time[0])",)),
    "sensor-lag": Lines(
        reading=(
            "read = psi.copy()  # of a heading that is straight between two samples",
            "for i, h in enumerate(np.diff(time), 1):",
            "    late = {T_s} * (psi[i] - psi[i - 1]) / h",
            "    read[i] = psi[i] - late + (read[i - 1] - psi[i - 1] + late) * np.exp(-h / {T_s})",
            "psi = read",
        )
    ),
}
CUT = Lines(command=(f"N = N * min(max((abs(N) - {{width}}) / ({2 * EDGE:g} * {{width}}) + 0.5, 0.0), 1.0)",))
"""A dead-band of which all is left above the width."""

SWIRL = (
    Lines(state=("water_dot = ({chi} * s - (1.0 - {chi}) * water) / {T_w}",)),
    Lines(state=("water_dot = ({chi} * s * abs(s) - (1.0 - {chi}) * water) / {T_w}",)),
)
"""Water that is stirred by the slip, or by its square."""
