"""Each effect as lines of Python, for the file that `python` writes.

In the lines stand s for the rate through the water, t and time for the times, and in braces {F} for moment or force,
{v} for the rate, {x} for the position, {force} and {position} for their words, and the names of the effect's constants.
What is not here needs a logged column or differs from run to run.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from automarine_cli.effects.coulomb_drag import CREEP
from automarine_cli.effects.dead_band import EDGE
from automarine_cli.effects.history_force import SHARES, TIMES, HistoryForce
from automarine_cli.effects.learned import DRAG, FIRST, GAIN, MOMENT, Variable, basis, kind_of, scale_of

CURVE_POINTS = 101


class Lines(NamedTuple):
    """`command`: lines that change the moment {F}, in the model's order; `moment`: a term of the sum of moments;
    `state`: slopes of states of its own; `reading`: lines that change the positions {x} of shape (N,)."""

    command: tuple[str, ...] = ()
    moment: str = ""
    state: tuple[str, ...] = ()
    reading: tuple[str, ...] = ()

    def filled(self, names: Mapping[str, str]) -> "Lines":
        """The same with what stands for the names in braces."""
        command, state, reading = (
            tuple(line.format(**names) for line in lines) for lines in (self.command, self.state, self.reading)
        )
        return Lines(command, self.moment.format(**names), state, reading)


LINES: Mapping[str, Lines] = {
    "linear-drag": Lines(moment="- {linear} * s"),
    "quadratic-drag": Lines(moment="- {quadratic} * abs(s) * s"),
    "cubic-drag": Lines(moment="- {cubic} * s**3"),
    "bias-moment": Lines(moment="+ {b}"),
    "coulomb-drag": Lines(moment=f"- {{c}} * np.tanh({{v}} / {CREEP})"),
    "drag-asymmetry": Lines(moment="- {e} * s**2"),
    "linear-drag-asymmetry": Lines(moment="- {e} * abs(s)"),
    "tether-spring": Lines(moment="- {kappa} * ({x} - {x}0)"),
    "heading-moment": Lines(moment="+ {b} * np.sin({x}) + {c} * np.cos({x})"),
    "thrust-loss": Lines(moment="- {b} * abs({F}) ** 0.5 * {v}"),
    "periodic-disturbance": Lines(
        command=("phase = 2 * np.pi * (t - time[0]) / {T}",), moment="+ {A} * np.sin(phase) + {B} * np.cos(phase)"
    ),
    "wall": Lines(moment="- ({p} * np.cos(2 * {x}) + {q} * np.sin(2 * {x})) * abs(s) * s"),
    "history-force": Lines(moment="- {h} * (s - past)", state=("past_dot = (s - past) / {T}",)),
    "water-swirl": Lines(state=("water_dot = ({chi} * s - (1.0 - {chi}) * water) / {T_w}",)),
    "input-delay": Lines(),  # a matter of which command holds
    "thruster-lag": Lines(command=("n_dot = (np.sign({F}) * abs({F}) ** 0.5 - n) / {T}", "{F} = n * abs(n)")),
    "dead-band": Lines(command=("{F} = np.sign({F}) * max(abs({F}) - {width}, 0.0)",)),
    "saturation": Lines(command=("{F} = np.sign({F}) * min(abs({F}), {tau_max})",)),
    "thrust-asymmetry": Lines(command=("{F} = (1.0 + {a} * np.sign({F})) * {F}",)),
    "thrust-exponent": Lines(command=("{F} = np.sign({F}) * {tau_ref} * (abs({F}) / {tau_ref}) ** {p}",)),
    "battery-sag": Lines(
        command=(
            "fresh = np.exp(-{discharge} * (t - {t_ref}) / 3600)",
            "{F} = {F} * fresh * (1.0 - {load} * abs({F}) / {tau_ref})",
        )
    ),
    "compass-deviation": Lines(
        reading=(
            "read = {x} + {B} * np.sin({x}) + {C} * np.cos({x})",
            "{x} = read + {D} * np.sin(2 * {x}) + {E} * np.cos(2 * {x})",
        )
    ),
    "gyro-drift": Lines(reading=("{x} = {x} + {g} * (time - time[0])",)),
    "sensor-lag": Lines(
        reading=(
            "read = {x}.copy()  # of a {position} that is straight between two samples",
            "for i, h in enumerate(np.diff(time), 1):",
            "    late = {T_s} * ({x}[i] - {x}[i - 1]) / h",
            "    read[i] = {x}[i] - late + (read[i - 1] - {x}[i - 1] + late) * np.exp(-h / {T_s})",
            "{x} = read",
        )
    ),
}
WANTED = "n_c = np.sign({F}) * abs({F}) ** 0.5"
FRESH = "fresh = np.exp(-{discharge} * (t - {t_ref}) / 3600)"
BASSET = tuple(zip(HistoryForce.states, TIMES, SHARES))
SETTLE = 0.02  # s in which a speed under a slew limit settles on the one that is wanted

LAWS: Mapping[tuple[str, int], Lines] = {
    ("battery-sag", 1): Lines(
        command=(FRESH, "load_dot = (abs({F}) / {tau_ref} - load) / {T_V}", "{F} = {F} * fresh * (1.0 - {load} * load)")
    ),
    ("battery-sag", 2): Lines(
        command=(
            FRESH,
            "charge_dot = (abs({F}) / {tau_ref}) ** 1.5 / 60",
            "{F} = {F} * fresh * np.exp(-{load} * charge)",
        )
    ),
    ("compass-deviation", 1): Lines(reading=("{x} = {x} + {B} * np.sin({x}) + {C} * np.cos({x})",)),
    ("compass-deviation", 2): Lines(reading=("{x} = {x} + {D} * np.sin(2 * {x}) + {E} * np.cos(2 * {x})",)),
    ("coulomb-drag", 1): Lines(
        moment=f"- ({{c}} + {{c_s}} * np.exp(-(({{v}} / {{v_s}}) ** 2))) * np.tanh({{v}} / {CREEP})"
    ),
    ("dead-band", 1): Lines(
        command=(f"{{F}} = {{F}} * min(max((abs({{F}}) - {{width}}) / ({2 * EDGE:g} * {{width}}) + 0.5, 0.0), 1.0)",)
    ),
    ("history-force", 1): Lines(
        moment="- {h} * (" + " + ".join(f"{share:.6g} * (s - {past})" for past, _, share in BASSET) + ")",
        state=tuple(f"{past}_dot = (s - {past}) / {time}" for past, time, _ in BASSET),
    ),
    ("saturation", 1): Lines(command=("{F} = {tau_max} * np.tanh({F} / {tau_max})",)),
    ("tether-spring", 1): Lines(moment="- {kappa} * ({x} - {x}0 - np.clip({x} - {x}0, -{slack}, {slack}))"),
    ("tether-spring", 2): Lines(moment="- ({kappa} + {kappa_3} * ({x} - {x}0) ** 2) * ({x} - {x}0)"),
    ("thrust-loss", 1): Lines(moment="- {b} * abs({F}) ** 0.5 * {v} * ({F} * {v} > 0)"),
    ("thruster-lag", 1): Lines(command=("n_dot = ({F} - n) / {T}  # n is the thrust", "{F} = n")),
    ("thruster-lag", 2): Lines(
        command=("n_dot = ({F} - n * abs(n)) / (2 * {T} * {tau_ref} ** 0.5)", "{F} = n * abs(n)")
    ),
    ("thruster-lag", 3): Lines(
        command=(
            WANTED,
            "pace = {tau_ref} ** 0.5 / {T}",
            f"n_dot = min(max((n_c - n) / {SETTLE}, -pace), pace)",
            "{F} = n * abs(n)",
        )
    ),
    ("thruster-lag", 4): Lines(
        command=(
            WANTED,
            "falls = n_c * n < 0 or abs(n_c) < abs(n)",
            "n_dot = (n_c - n) / ({T} * ({fall} if falls else 1.0))",
            "{F} = n * abs(n)",
        )
    ),
    ("wall", 1): Lines(moment="- ({p_f} * np.cos(2 * {x}) + {q_f} * np.sin(2 * {x})) * {F}"),
    ("water-swirl", 1): Lines(state=("water_dot = ({chi} * abs(s) * s - (1.0 - {chi}) * water) / {T_w}",)),
    ("water-swirl", 2): Lines(state=("water_dot = ({chi} * abs({v}) * s - (1.0 - {chi}) * water) / {T_w}",)),
    ("water-swirl", 3): Lines(state=("water_dot = ({chi} * {F} / {tau_ref} - (1.0 - {chi}) * water) / {T_w}",)),
    ("water-swirl", 4): Lines(state=("water_dot = ({chi} * abs(s) * s - (1.0 - {chi}) * abs(water) * water) / {T_w}",)),
    ("water-swirl", 6): Lines(
        state=("calms = (1.0 - {chi}) * abs(water) * water", "water_dot = ({chi} * {F} / {tau_ref} - calms) / {T_w}")
    ),
    ("water-swirl", 5): Lines(
        state=(
            "pull = {chi} * s - (1.0 - {chi}) * water",
            "water_dot = pull / ({T_w} * ({calm} if pull * water < 0 else 1.0))",
        )
    ),
}
"""Laws beside an effect's first one; those of which the file would have to remember commands are not here."""

STATES: Mapping[tuple[str, int], tuple[str, ...]] = {
    ("battery-sag", 1): ("load",),
    ("battery-sag", 2): ("charge",),
    ("history-force", 0): ("past",),
    ("history-force", 1): tuple(past for past, *_ in BASSET),
}
"""Names of states, beside those of every law of an effect."""


def curve_lines(values: Sequence[float], variable: Variable) -> Lines:
    """A learned curve over its variable, as a table between whose points straight lines go."""
    own = {
        "state.relative": "s",
        "state.delivered": "{F}",
        "state.travelled": "({x} - {x}0)",
        "state.time": "(t - time[0])",
    }
    column = repr(variable.name).replace("{", "{{").replace("}", "}}")
    elsewhere = f"{{x}} % {variable.turn!r}" if variable.turn else f"columns[{column}][i]"
    read = own.get(variable.code, elsewhere)
    size = f"abs({read})" if variable.sized else read
    found = f"np.interp({size}, CURVE_X, CURVE_Y)"
    if (kind := kind_of(values)) != MOMENT:
        return Lines(moment=f"+ {{F}} * {found}" if kind == GAIN else f"- s * {found}")
    return Lines(moment=f"+ np.sign({read}) * {found}" if variable.sized else f"+ {found}")


def curve_constants(values: Sequence[float], variable: Variable) -> str:
    """The table of a learned curve: its variable, and the moment or the share of the thrust."""
    low, high = values[:2]
    closed, kind = bool(variable.turn), kind_of(values)
    x = np.linspace(low, high, CURVE_POINTS)
    y = basis(x, low, high, closed=closed) @ np.array(values[FIRST:-1]) * scale_of(values)
    rows = {
        "CURVE_X": (x, variable.name),
        "CURVE_Y": (y, {GAIN: "share of the thrust", DRAG: "linear drag"}.get(kind, "what it adds")),
    }
    text = ""
    for name, (column, says) in rows.items():
        numbers = [f"{number:.6g}" for number in column]
        lines = [", ".join(numbers[i : i + 10]) for i in range(0, len(numbers), 10)]
        said = " ".join(says.split())
        text += f"{name} = np.array([  # {said}\n" + "".join(f"    {line},\n" for line in lines) + "])\n"
    return text
