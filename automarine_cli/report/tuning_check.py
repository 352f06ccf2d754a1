"""What `tune --check` found: each step as flown, beside the band that was promised."""

import math
from collections.abc import Sequence
from typing import Any

from automarine_cli.control.flown import Compared, FlownStep
from automarine_cli.dofs import Dof
from automarine_cli.report.tables import Table, number

KEYS = {"overshoot": "overshoot_percent", "settling": "settling_s"}
ERRORS = {
    "rms": ("rms_after", "error from then on, rms"),
    "distance": ("rms_error", "distance from the reference, rms"),
    "largest": ("largest_error", "the same at most"),
}
"""Figures in units of the position: key of the result file, words."""


def verdict(steps: Sequence[FlownStep]) -> str:
    """Whether the promise was kept, in a sentence."""
    kept = sum(one.held for one in steps)
    if kept == len(steps):
        return (
            f"As promised: all {kept} steps are within the bands."
            if kept > 1
            else "As promised: all is within the bands."
        )
    return f"Not as promised: {len(steps) - kept} of {len(steps)} steps leave the bands of 95 %."


def tables(steps: Sequence[FlownStep], dof: Dof, changed: str) -> list[Table | str]:
    """Verdict, what changed, and a row for each figure of each step."""
    rows = []
    for step in steps:
        size = "no step" if step.size is None else f"{dof.logged(step.size):+.3g} {dof.units.log}"
        where = f"{step.run}, {step.begins:.1f} s, {size}"
        for name, one in step.figures.items():
            value, low, high = (_shown(name, x, dof) for x in (one.value, *one.band))
            rows.append((where, _word(name, dof), value, f"{low} to {high}", "yes" if one.held else "no"))
    head = ("step", "", "flown", "promised", "held")
    found: list[Table | str] = [verdict(steps), *([changed] if changed else [])]
    return [*found, Table("Flown and promised", head, tuple(rows))]


def page(steps: Sequence[FlownStep], dof: Dof, changed: str) -> str:
    """`tuning_check.md`."""
    parts = ["# A log beside what was promised"]
    parts += [one if isinstance(one, str) else one.to_markdown().rstrip() for one in tables(steps, dof, changed)]
    return "\n\n".join([*parts, "![Steps as flown, and the bands that were promised](tuning_check.png)"]) + "\n"


def to_json(step: FlownStep, dof: Dof) -> dict[str, Any]:
    """One step of the result file."""
    figures = {_key(name, dof): _figure(name, one, dof) for name, one in step.figures.items()}
    size = {f"step_{dof.units.log}": None if step.size is None else dof.logged(step.size)}
    return {"run": step.run, "begins_s": step.begins, **size, "held": step.held, "figures": figures}


def _figure(name: str, one: Compared, dof: Dof) -> dict[str, Any]:
    value, low, high = (_scaled(name, x, dof) for x in (one.value, *one.band))
    ends = [low if math.isfinite(low) else None, high if math.isfinite(high) else None]
    return {"flown": value if math.isfinite(value) else None, "promised": ends, "held": one.held}


def _scaled(name: str, value: float, dof: Dof) -> float:
    return 100.0 * value if name == "overshoot" else float(dof.shown(value)) if name in ERRORS else value


def _shown(name: str, value: float, dof: Dof) -> str:
    return number(_scaled(name, value, dof), 3) if math.isfinite(value) else "never"


def _key(name: str, dof: Dof) -> str:
    return f"{ERRORS[name][0]}_{dof.units.key}" if name in ERRORS else KEYS[name]


def _word(name: str, dof: Dof) -> str:
    words = {"overshoot": "overshoot [%]", "settling": "settles after [s]"}
    return f"{ERRORS[name][1]} [{dof.units.shown}]" if name in ERRORS else words[name]
