"""The paper's method: steady rate and velocity error of each half-turn's tail, drag from the rates, inertia
from the errors.

Tail: the straight end of a half-turn. Its line has the steady rate as slope; its intercept at the instant of
the step, less the start heading, is the velocity error (equation 5). Inertia follows by equation 7 (model
1), 9 (model 3) or their common generalisation (model 2) with the drag of Table 1. All tails start at one angle, where
drag and inertia are expected to be off least (tail_choice.py). What is known to bias them is taken off: the closed form
of a rough model says by how much a line through this tail misses the steady one, the noise of the rates what it
dilutes (drag.py).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from automarine_cli.dofs import Dof
from automarine_cli.errors import FitError
from automarine_cli.fits.drag import DragFit, fit_drag_by_way
from automarine_cli.fits.inertia_table import InertiaTable, inertia_table
from automarine_cli.fits.step_response import StepData
from automarine_cli.fits.tail_choice import BIAS_LIMIT, Expected, Reference, expected, rate_variance, reference, starts
from automarine_cli.fits.tail_feedback import feedback
from automarine_cli.fits.tails import TailLines, checked_tail, first_past, last_share, noise_about_lines, tail_lines
from automarine_cli.quantities import Floats

MODELS: tuple[str, ...] = ("1", "2", "3")

ROUNDS = 8
PLACED = 2
"""Rounds in which the tails may still move; then only their correction does."""

SETTLED = 1e-6
"""Relative change of the correcting model below which it has settled."""


@dataclass(frozen=True)
class VelocityErrorFit:
    """Tables 1 and 2 by the paper's method.

    `tail_from` [rad] turned angle at which the tail starts, `given` whether it was asked for; `expected` what bias and
    noise were expected of it, `steady` whether any tail has a bias within BIAS_LIMIT. `tails` have the bias
    taken off; `variance` (R,) [rad²/s²] is that of their rates, which scatter by `thrust` (relative, of the
    moment) beside the heading's noise. `inertia["2"]` or
    `drag["2"]` is absent where the moments cannot carry model 2, `inertia["2"]` also where its drag has no steady rate.
    """

    tail_from: float
    given: bool
    expected: Expected
    steady: bool
    tails: TailLines
    variance: Floats
    thrust: float
    drag: Mapping[str, DragFit]
    inertia: Mapping[str, InertiaTable]

    @property
    def bias(self) -> tuple[float, float]:
        """Relative bias of inertia and drag that the tail has by itself, and that was taken off."""
        return float(self.expected.bias[0]), float(self.expected.bias[1])

    def tail_because(self, dof: Dof) -> str:
        """Where the tails start and why, in a sentence or two."""
        return self.expected.told(dof, self.given)


def fit_velocity_error(
    data: StepData,
    start_heading: Floats,
    offset: float = 0.0,
    moment_unit: str = "nu",
    models: Sequence[str] = ("1", "2", "3", "3+c"),
    tail: float | None = None,
) -> VelocityErrorFit:
    """Run the paper's method on half-turns, for some of the readings of Table 1 (see drag.py).

    `start_heading` (R,) [rad] on the scale of `data.heading`; `offset` moves every instant of a step by that
    share of its switch interval (the logger's convention); `tail` [rad or m] is where the tails start, None: where
    they are best. Raises FitError where too few runs or samples are left.
    """
    time, words = data.time - offset * data.interval[:, None], data.dof.words
    if len(data.moment) < 3 or len(np.unique(np.abs(data.moment))) < 2:
        raise FitError(
            f"{len(data.moment)} {words.step}s at {len(np.unique(np.abs(data.moment)))} sizes of {words.force} are "
            "too few for Table 1; "
            f"run at least 3 steps at 2 {words.force}s"
        )
    found = _settled(time, data, start_heading, tail)
    variance = rate_variance(time, found.tails, found.noise)
    variance = variance + found.model.thrust_variance(found.thrust)
    more = feedback(found.model, found.raw, time)
    drag, inertia = {}, {}
    for name, fit in _drag(data, found.tails.rate, variance, moment_unit, models).items():
        drag[name] = more.on_drag(data.moment, fit)
        table = inertia_table(data.moment, found.tails, fit, moment_unit, data.dof) if name != "3+c" else None
        if table is not None:
            inertia[name] = more.on_inertia(data.moment, fit, table)
    i = found.place
    return VelocityErrorFit(
        float(found.expected.start[i]),
        tail is not None,
        found.expected.at(i),
        bool(np.abs(found.expected.bias).max(axis=0).min() <= BIAS_LIMIT),
        found.tails,
        variance,
        found.thrust,
        drag,
        inertia,
    )


@dataclass(frozen=True)
class _Settled:
    """Tails, `raw` and with the bias taken off, and the model by which, which follows from them; noise [rad] of the
    headings, relative scatter of the thrust, what was expected of each place and which was taken."""

    raw: TailLines
    tails: TailLines
    model: Reference
    noise: float
    thrust: float
    expected: Expected
    place: int


def _settled(time: Floats, data: StepData, start_heading: Floats, tail: float | None) -> _Settled:
    """Tails placed and corrected by a model that is found from them: a few rounds settle both."""
    dof, seen = data.dof, data.seen
    tails = tail_lines(time, data.heading, start_heading, last_share(time, seen, 0.3), dof)
    model = reference(data.moment, tails, 0.0, dof)
    places, kinds = starts(data), MODELS
    if tail is not None:
        checked_tail(tail, data.names, data.heading, seen, dof)
        places = np.append(places, tail)
    for turn in range(ROUNDS):
        exact = model.answer(time)
        noise = noise_about_lines(time, data.heading - exact, tails.used, dof)
        thrust = model.thrust_scatter(tails.rate, rate_variance(time, tails, noise))
        if turn < PLACED:
            grid = expected(time, data, model, noise, thrust, places)
            place = grid.best() if tail is None else len(places) - 1
        else:
            kinds = (model.fit.model,)
        first = first_past(exact, time, seen, places[place : place + 1])
        used = seen & (np.arange(time.shape[1]) >= first) & (time > 0)
        raw = tail_lines(time, data.heading, start_heading, used, dof)
        tails = model.steady(raw, time)
        variance = rate_variance(time, tails, noise) + model.thrust_variance(thrust)
        before, model = model, reference(data.moment, tails, variance, dof, kinds)
        if turn >= PLACED and model.like(before, SETTLED):
            break
    return _Settled(raw, tails, model, noise, thrust, grid, place)


def _drag(
    data: StepData, rate: Floats, variance: Floats, moment_unit: str, models: Sequence[str]
) -> dict[str, DragFit]:
    """Table 1 by the models that the moments can carry, in their order; model 2, whose terms are hardest to tell
    apart, says how much noise all of them take off."""
    fits = {}
    for model in sorted(models, key=lambda name: name != "2"):
        if model in ("2", "3+c") and (len(data.moment) < 4 or len(np.unique(np.abs(data.moment))) < 2):
            continue
        if model == "3+c" and data.dof.has_constant:  # its constant is part of every model there
            continue
        fits[model] = fit_drag_by_way(data.moment, rate, model, moment_unit, data.dof, variance)
        variance = fits[model].variance
    return {model: fits[model] for model in models if model in fits}
