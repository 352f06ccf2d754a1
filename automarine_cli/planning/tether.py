"""How far each planned run turns the vehicle, and the way back that leaves the tether twisted least."""

from collections.abc import Sequence

import numpy as np

from automarine_cli.comparison.rollouts import roll
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.planning.candidates import Candidate
from automarine_cli.planning.fitting import Logger, alike
from automarine_cli.quantities import Floats


def turns(model: YawModel, logger: Logger, candidates: Sequence[Candidate]) -> Floats:
    """How far [degrees] the model turns in each run, from the rest to the end of the log, (R,)."""
    found = np.zeros(len(candidates))
    for places in alike(candidates).values():
        runs = [logger.run(candidates[place]) for place in places]
        heading = roll(model, runs, np.zeros(len(runs)), np.zeros(len(runs))).position[0]
        found[places] = [row[len(run.time) - 1] - row[0] for row, run in zip(heading, runs)]
    return np.rad2deg(found)


def ways_back(turned: Floats, start_headings: Sequence[float]) -> Floats:
    """How far [degrees] to turn to each run's start heading after the run before it, (R,), nothing before the first.

    Of all ways there, with whole turns or without, the one after which the tether is twisted by half a turn at most;
    of two such ways the shorter.
    """
    back, twist = [0.0], 0.0
    for turn, heading in zip(turned[:-1], start_headings[1:]):
        twist += turn
        wanted = (heading - start_headings[0] + 180.0) % 360.0 - 180.0
        ways = [wanted - twist, *([360.0 + wanted - twist] if wanted == -180.0 else [])]
        back.append(min(ways, key=abs))
        twist += back[-1]
    return np.array(back)
