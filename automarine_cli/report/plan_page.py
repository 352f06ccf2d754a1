"""`plan.md`: the campaign for the people who will run it, and what to expect of it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from automarine_cli.planning.campaign import Campaign
from automarine_cli.report import plan_tables

FIT = {
    "whole-runs": "automarine fit-yaw LOGS --fit-to whole-runs -o out/yaw",
    "half-turns": "automarine fit-yaw LOGS --fit-to half-turns -o out/yaw",
    "diagnosis": "automarine diagnose LOGS --model {model} -o out/diagnosis",
}
"""What the runs are for, by fit."""


EARLIER = (
    "The earlier runs count by the intervals in the model's file, which holds no correlations but that of inertia and "
    "quadratic drag."
)
HOLDS_OUT = (
    "`automarine diagnose` holds a quarter of the runs out to judge by, and that is counted; with other logs for "
    "`--hold-out` all runs are fitted, and the intervals come out a seventh narrower."
)


def fit_command(campaign: Campaign, model: str) -> str:
    """The command that the runs are planned for."""
    return FIT[campaign.fitting.fit].format(model=model)


def page(campaign: Campaign, model: str, source: str, rehearsal: str) -> str:
    """The page; `model` is the file's name, `source` a sentence on the current drawn, `rehearsal` one on plan.toml."""
    parts = [f"# The next campaign, planned from {model}", " ".join(plan_tables.total_sentences(campaign))]
    parts += [
        "## Run sheet",
        _before(campaign),
        replace(plan_tables.sheet_table(campaign), title="").to_markdown().rstrip(),
    ]
    parts += [
        "Play `commands/NAME.csv` for each run, or command it by hand, and log time, heading and command of the "
        "whole run, "
        "rest included. Repeat a failed run at once; keep the order, which is random on purpose."
    ]
    parts += ["## Expected precision", _fitted(campaign, model)]
    parts += [table.to_markdown().rstrip() for table in plan_tables.tables(campaign)[1:]]
    parts += ["![Precision against minutes in the pool](plan.png)"]
    parts += ["## Assumptions", *_assumptions(campaign, source, rehearsal)]
    return "\n\n".join(parts) + "\n"


def _before(campaign: Campaign) -> str:
    pool = campaign.limits.pool
    headings = ", ".join(f"{heading:g}" for heading in pool.start_headings_deg)
    return (
        f"Before each run bring the vehicle back and let the water settle: {pool.wait_s:g} s, after long turns "
        f"{pool.wait_after_long_turn_s:g} s. Start headings in turn: {headings} degrees; a few degrees do not matter. "
        "Turn there by as much as the sheet says, clockwise where it is positive: so the tether never holds more than "
        "half a turn at the start of a run."
    )


def _fitted(campaign: Campaign, model: str) -> str:
    command = fit_command(campaign, model)
    return f"Fit the runs with\n\n```\n{command}\n```\n\nThe intervals below are those that it should report."


def _assumptions(campaign: Campaign, source: str, rehearsal: str) -> Sequence[str]:
    fitting = campaign.fitting
    effects = [term.name for term in fitting.model.terms[len(fitting.base.terms) :]]
    held = f" with {', '.join(effects)}" if effects else ""
    read = fitting.rate_noise
    gyro = "" if read is None else f"and yaw rate noise {np.rad2deg(read):.3g} degrees/s "
    lines = [
        f"The model{held} is taken to be right: runs are chosen for what it says, and a campaign of few kinds "
        "shows little of "
        "what it lacks. After a surprise, run `automarine diagnose` and plan again with `--diagnosis`.",
        f"Heading noise {np.rad2deg(fitting.noise):.3g} degrees {gyro}at {fitting.rate:g} Hz, thrust scatter "
        f"{100 * fitting.scatter:.3g} % "
        "from run to run; start heading, gain of the run and the instant of every change are fitted for each run.",
        source,
        *([EARLIER] if campaign.together else []),
        *([HOLDS_OUT] if fitting.fit == "diagnosis" else []),
        *([rehearsal] if rehearsal else []),
        *campaign.notes,
    ]
    return ["\n".join(f"- {line}" for line in lines)]
