"""A bollard test with known thrusters."""

import numpy as np
from numpy.typing import NDArray

from automarine_cli.models.thruster_forms import Curve
from automarine_cli.models.thruster_map import ThrusterMap
from automarine_cli.simulation.run_groups import levels_of
from automarine_cli.simulation.settings import Bollard
from automarine_cli.simulation.streams import normal, uniform

Floats = NDArray[np.float64]

FORCE_DECIMALS = 3


def bollard_columns(bollard: Bollard, seed: int) -> dict[str, Floats]:
    """`n` and `force_N` of all thrusters of a test together, shape (levels x repeats,), in random order."""
    levels = np.repeat(np.array(levels_of(bollard.levels)), bollard.repeats)
    order = np.argsort(uniform(len(levels), seed, bollard.file, "order"), kind="stable")
    thrusters = ThrusterMap("square", Curve(bollard.a_f), Curve(bollard.a_b))
    pull = bollard.thrusters_per_test * thrusters.force(levels)
    measured = pull + bollard.noise_N * normal(len(levels), seed, bollard.file, "noise")
    return {"n": levels[order], "force_N": (np.round(measured, FORCE_DECIMALS) + 0.0)[order]}
