"""The plan as a specification for `automarine simulate`: the campaign can be rehearsed before anybody gets wet."""

from typing import Any

import numpy as np

from automarine_cli import effects
from automarine_cli.planning.campaign import Campaign
from automarine_cli.simulation.specification import SCHEMA


def specification(campaign: Campaign, seed: int) -> tuple[dict[str, Any], str]:
    """Plain data of the specification, and a sentence on what it leaves out; no data where it cannot be simulated."""
    fitting, limits = campaign.fitting, campaign.limits
    dof, (linear, quadratic) = fitting.model.dof, fitting.model.drag()
    own = dof.symbols
    if linear < 0 or quadratic < 0:
        return {}, "No plan.toml: a vehicle with negative drag cannot be simulated."
    added = fitting.model.terms[len(fitting.base.terms) :]
    can = [term for term in added if not effects.get(term.name).needs]
    left = [term.name for term in added if term not in can]
    rate = fitting.rate
    read = fitting.rate_noise
    gyro = {} if read is None else {"rate_noise_deg_s": round(float(np.rad2deg(read)), 6)}
    return {
        "schema": SCHEMA,
        "seed": seed,
        "vehicle": {
            own.inertia: fitting.model.inertia, own.quadratic: quadratic, own.linear: linear,
            f"{dof.words.force}_unit": fitting.model.moment_unit,
        },
        "effects": [
            {"name": term.name} | dict(zip(effects.get(term.name).names_in(dof), term.values))
            for term in can
        ],
        "logger": {"rate_hz": rate, "noise_deg": round(float(np.rad2deg(fitting.noise)), 6)} | gyro,
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
