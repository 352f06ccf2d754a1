"""The plan as a specification for `automarine simulate`: the campaign can be rehearsed before anybody gets wet."""

from typing import Any

import numpy as np

from automarine_cli import effects
from automarine_cli.planning.campaign import Campaign
from automarine_cli.simulation.specification import SCHEMA


def specification(campaign: Campaign, seed: int) -> tuple[dict[str, Any], str]:
    """Plain data of the specification, and a sentence on what it leaves out; no data where it cannot be simulated."""
    fitting, limits = campaign.fitting, campaign.limits
    k_r, k_rr = fitting.model.drag()
    if k_r < 0 or k_rr < 0:
        return {}, "No plan.toml: a vehicle with negative drag cannot be simulated."
    own = fitting.model.terms[len(fitting.base.terms) :]
    can = [term for term in own if not effects.get(term.name).needs]
    left = [term.name for term in own if term not in can]
    rate = fitting.rate
    return {
        "schema": SCHEMA,
        "seed": seed,
        "vehicle": {
            "I_r": fitting.model.inertia, "k_rr": k_rr, "k_r": k_r, "moment_unit": fitting.model.moment_unit,
        },
        "effects": [
            {"name": term.name} | {p.name: v for p, v in zip(effects.get(term.name).parameters, term.values)}
            for term in can
        ],
        "logger": {"rate_hz": rate, "noise_deg": round(float(np.rad2deg(fitting.noise)), 6)},
        "scatter": {
            "gain": fitting.scatter,
            "start_heading_deg": [slot.candidate.start_heading for slot in campaign.slots],
        },
        "campaign": {
            "order": "listed", "rest_before_s": limits.runs.rest_before_s, "wait_between_s": limits.pool.wait_s,
        },
        "runs": [
            {
                "kind": "sequence", "name": slot.name, "wait_after_s": slot.wait,
                "commands": [[moment, seconds] for moment, seconds in slot.candidate.commands],
            }
            for slot in campaign.slots
        ],
    }, f"Simulated runs lack what {', '.join(left)} needs." if left else ""  # fmt: skip
