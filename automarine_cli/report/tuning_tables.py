"""What `tune` found, as tables and sentences."""

import math

import numpy as np

from automarine_cli.control.design import Designed, Outcome
from automarine_cli.quantities import Floats
from automarine_cli.report.tables import MISSING, Table, number
from automarine_cli.results.estimate import Estimate

BAND = (0.025, 0.975)


def banded(values: Floats, unit: str) -> Estimate | None:
    """Median and the band of 95 % of a crowd's values, one end open where they are infinite; None without any."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return None
    low, middle, high = (float(np.quantile(values, q, method="inverted_cdf")) for q in (BAND[0], 0.5, BAND[1]))
    return Estimate(middle, float(np.std(finite)), (low, high), unit)


def promises(found: Outcome, made: Designed) -> dict[str, Estimate | None]:
    """What a set of gains comes to, by key of the result file."""
    dof = made.nominal.dof
    one, key, unit = found.scores, dof.units.key, dof.units.shown
    return {
        "overshoot_percent": banded(100.0 * one.overshoot, "%"),
        "settling_s": banded(one.settling, "s"),
        f"rms_after_{key}": banded(dof.shown(one.rms), unit),
        f"load_error_{key}": banded(dof.shown(one.error), unit),
    }


def margins_of(found: Outcome) -> dict[str, Estimate | None]:
    """Margins of a set of gains, by key."""
    one = found.margins
    return {
        "disk_margin": banded(one.disk, "1"),
        "gain_margin_dB": banded(one.gain, "dB"),
        "phase_margin_deg": banded(one.phase, "deg"),
        "delay_margin_s": banded(one.delay, "s"),
    }


WORDS = {
    "overshoot_percent": "overshoot [%]",
    "settling_s": "settles after [s]",
    "disk_margin": "disk margin",
    "gain_margin_dB": "gain margin [dB]",
    "phase_margin_deg": "phase margin [deg]",
    "delay_margin_s": "delay margin [s]",
}


def gains_table(made: Designed) -> Table:
    """Old and new values in the target's own names."""
    rows = []
    changed = {} if made.new is None else made.new.gains
    before = {} if made.old is None else made.old.gains
    for one in made.target.parameters:
        new, old = changed.get(one.name), before.get(one.name)
        if not one.searched and new == old and new is not None:
            continue
        if new is None and not one.searched:
            continue
        unit = one.unit.replace("{x}", made.nominal.dof.units.base)
        limits = f"{one.low:g} to {one.high:g}" if math.isfinite(one.high) else MISSING
        rows.append((one.name, number(old), number(new), unit, limits, one.meaning))
    return Table("Gains", ("parameter", "present", "new", "unit", "documented", "what it is"), tuple(rows))


def promised_table(made: Designed) -> Table:
    """What to expect of the present and of the new gains: medians and bands of 95 %."""
    dof, task = made.nominal.dof, made.task
    sets = [(name, one) for name, one in (("present", made.old), ("new", made.new)) if one is not None]
    lines: dict[str, list[str]] = {}
    for _, one in sets:
        for key, value in {**margins_of(one), **promises(one, made)}.items():
            lines.setdefault(key, []).append(shown_band(value))
        lines.setdefault("settles", []).append(f"{np.mean(one.scores.settles):.0%}")
        lines.setdefault("keeps", []).append(f"{one.share_with(task.margin):.0%}")
    words = WORDS | {
        f"rms_after_{dof.units.key}": f"error from then on, rms [{dof.units.shown}]",
        f"load_error_{dof.units.key}": f"largest error under {100 * task.load:g} % load [{dof.units.shown}]",
        "settles": "share that settles", "keeps": f"share with a disk margin of {task.margin:g}",
    }  # fmt: skip
    rows = tuple((words[key], *cells) for key, cells in lines.items())
    step = f"{dof.logged(task.step):g} {dof.units.log}"
    within = f"{dof.shown(task.band):g} {dof.units.shown}"
    count = sum(len(one.vehicles) for one in made.crowds)
    note = f"Median and the band of 95 % of {count} vehicles that the model allows; a step of {step}, settled within"
    note = f"{note} {within}, flights of {task.seconds:.0f} s."
    return Table("What to expect", ("", *(name for name, _ in sets)), rows, notes=(note,))


def shown_band(one: Estimate | None) -> str:
    """`12 [11, 14]`, with "never" for what never happens."""
    if one is None:
        return "never"
    low, high = one.ci95
    cells = [number(x, 3) if math.isfinite(x) else "never" for x in (one.value, low, high)]
    return f"{cells[0]} [{cells[1]}, {cells[2]}]"


VERDICTS: dict[str, str] = {
    "gains": "New gains.", "leave": "Leave the gains as they are.", "cannot-promise": "No promise can be made.",
}  # fmt: skip


def sentences(made: Designed) -> list[str]:
    """The verdict, and the run that would change it."""
    words = {
        "gains": "New gains.",
        "leave": "Leave the gains as they are.",
        "cannot-promise": "No promise can be made.",
    }
    found = [f"{words[made.verdict]} {made.why}"]
    if made.run:
        found.append(f"What would settle it: {made.run}.")
    ends = at_their_ends(made)
    if ends:
        found.append(ends)
    return found


def at_their_ends(made: Designed) -> str:
    """Gains that the documented range holds back, in a sentence."""
    if made.new is None or made.target.beyond:
        return ""
    held = [
        one.name for one in made.target.parameters
        if one.searched and math.isfinite(one.high) and "MAX" not in one.name and made.new.gains[one.name] >= one.high
    ]  # fmt: skip
    return (
        f"At the end of the documented range: {', '.join(held)}; with --beyond-range stiffer gains may be found."
        if held
        else ""
    )


def tables(made: Designed) -> list[Table | str]:
    """What the terminal shows."""
    shown: list[Table | str] = [*sentences(made), *made.notes]
    if made.new is not None or made.old is not None:
        shown += [gains_table(made), promised_table(made)]
    return shown


def page(made: Designed, source: str, files: tuple[str, ...], plan: str = "") -> str:
    """`tuning.md`; `plan` is the page of the runs that settle what is open."""
    parts = [f"# A controller for {made.target.name}, from {source}", *sentences(made)]
    if made.new is not None:
        parts += [f"The file to load: `{made.target.file}`. {FIRST_FLIGHT}"]
    if plan:
        parts += [f"Runs that settle it, with their command files: [{plan}]({plan})."]
    for one in tables(made):
        parts += [one.to_markdown().rstrip()] if isinstance(one, Table) else []
    if "tuning.png" in files:
        parts += ["![Step, load and margins of present and new gains](tuning.png)"]
    parts += ["## What it rests on", "\n".join(f"- {line}" for line in (*made.notes, *rests_on(made)))]
    return "\n\n".join(parts) + "\n"


FIRST_FLIGHT = (
    "Load it, hold a heading in open water with a hand on the switch to manual, make one step, and let "
    "`automarine tune tuning.json --check LOG` say whether the loop does what is promised."
)


def rests_on(made: Designed) -> list[str]:
    """What was simulated and what was not."""
    dof = made.nominal.dof
    names, noise = ", ".join(one.name for one in made.crowds), made.crowds[0].vehicles.noise[0]
    found = [
        f"Explanations flown: {names}.",
        f"The whole output gives {made.nominal.full:.4g} {made.nominal.force_unit}.",
        f"Only {dof.name} is designed; roll, pitch, and what the motions do to each other are not.",
        f"Readings are off as those of the logs are, by {dof.shown(noise):.2g} {dof.words.units} (standard deviation); "
        "waves and the pilot are not simulated.",
    ]
    if made.target.firmware:
        found.append(f"Names, units and ranges are those of {made.target.firmware}.")
    return found
