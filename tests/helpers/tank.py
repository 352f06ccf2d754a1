"""A tank with known truth: pool campaigns of the paper's vehicle for tests, made by `automarine simulate`'s core."""

from collections.abc import Mapping
from typing import Any

from specified import make_runs

from automarine_cli.runs.run import Run
from automarine_cli.simulation.specification import SIMULATION_SCHEMA, Specification, specification_from

INERTIA, K_RR = 1.018, 1.257  # the source paper's Tables 1 and 2
MOMENTS = {"from": -1.2, "to": 1.2, "step": 0.1}


def pool_specification(
    *,
    moments: object = MOMENTS,
    repeats: int = 2,
    turn_deg: float = 220.0,
    noise_deg: float = 1.0,
    gain: float = 0.03,
    vehicle: Mapping[str, object] | None = None,
    logger: Mapping[str, object] | None = None,
    scatter: Mapping[str, object] | None = None,
    campaign: Mapping[str, object] | None = None,
    runs: list[dict[str, object]] | None = None,
    **top: Any,
) -> Specification:
    """The sample campaign's steps, changed where the test says so; `top` are other keys of the specification."""
    steps = {"kind": "step", "moments": moments, "repeats": repeats, "turn_deg": turn_deg}
    table = {
        "schema": SIMULATION_SCHEMA,
        "vehicle": {"I_r": INERTIA, "k_rr": K_RR} if vehicle is None else vehicle,
        "logger": {"noise_deg": noise_deg} | dict(logger or {}),
        "scatter": {"gain": gain} | dict(scatter or {}),
        "campaign": {"order": "random", "rest_after_s": 1.0} | dict(campaign or {}),
        "runs": [steps] if runs is None else runs,
    }
    return specification_from(table | top)


def pool_campaign(seed: int = 0, **settings: Any) -> list[Run]:
    """The runs of `pool_specification(**settings)` in the order of the campaign, cleaned."""
    return make_runs(pool_specification(**settings), seed)
