"""Precision against minutes in the pool: of the plan run by run, of the paper's grid, and of one run more of each
kind."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from automarine_cli.planning.fitting import Fitting
from automarine_cli.planning.information import relative_directions, stderr_along
from automarine_cli.planning.limits import Limits
from automarine_cli.planning.schedule import Slot
from automarine_cli.planning.selection import Choice

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Curve:
    """Standard errors in percent of each parameter, `percent` (name -> one each minute given), after `minutes` in the
    pool and `motion` seconds of motion."""

    name: str
    minutes: tuple[float, ...]
    motion: tuple[float, ...]
    percent: dict[str, tuple[float, ...]]


def curve_of(
    name: str, fitting: Fitting, slots: Sequence[Slot], per_run: Floats, before: Floats, limits: Limits
) -> Curve:
    """The curve of a campaign whose runs are made in order; `per_run` (R, p, p) is their information."""
    sums = np.cumsum(per_run, axis=0) + before
    rows = [_percent(fitting, one) for one in sums]
    minutes = tuple(slot.ends(limits.runs.rest_before_s) / 60.0 for slot in slots)
    motion = tuple(float(x) for x in np.cumsum([slot.candidate.motion for slot in slots]))
    return Curve(name, minutes, motion, {key: tuple(row[key] for row in rows) for key in rows[0]})


def one_more(
    fitting: Fitting, choice: Choice, slots: Sequence[Slot], per_run: Floats, before: Floats, limits: Limits
) -> tuple[Curve, ...]:
    """After the plan one run more, the best of each kind: a curve of one point a kind."""
    found, each, cost = choice.candidates, choice.each, choice.cost
    whole = per_run.sum(axis=0) + before
    kinds: dict[str, list[int]] = {}
    for place, one in enumerate(found):
        kinds.setdefault(one.kind, []).append(place)
    last = slots[-1].ends(limits.runs.rest_before_s) / 60.0
    motion = float(sum(slot.candidate.motion for slot in slots))
    points = []
    for kind, places in kinds.items():
        gains = [np.linalg.slogdet(whole + each[place])[1] for place in places]
        best = places[int(np.argmax(gains))]
        row = _percent(fitting, whole + each[best])
        points.append(
            Curve(
                kind, (last + float(cost[best, 0]),), (motion + found[best].motion,),
                {key: (value,) for key, value in row.items()},
            )
        )  # fmt: skip
    return tuple(points)


def _percent(fitting: Fitting, information: Floats) -> dict[str, float]:
    """Standard error of each parameter in percent of it."""
    covariance = np.asarray(np.linalg.inv(information))
    wanted = relative_directions(fitting)
    return {name: 100.0 * stderr_along(covariance, direction) for name, direction in wanted.items()}
