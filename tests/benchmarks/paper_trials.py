"""One simulated campaign of the source paper, put through the paper's own method: every number of Tables 1 and 2."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from specified import make_runs

from automarine_cli.dofs import YAW
from automarine_cli.fits.half_turns import half_turn_data
from automarine_cli.fits.paper import fit_drag, fit_velocity_error
from automarine_cli.models.yaw_model import inertia_from_velocity_error
from automarine_cli.runs.half_turn import half_turns
from automarine_cli.simulation.specification import Specification

Floats = NDArray[np.float64]

CONSTANT = 0.0275
"""c of tau = k_r|r| |r| r + c that the printed numbers ask for. The vehicle obeys I r' = tau + b - k_r|r| |r| r, in
steady state tau = k_r|r| |r| r - b: so the hidden bias moment is b = -c."""

LARGE_MOMENT = 0.5  # Table 2's inertia of model 1 follows from model 3's for a mean over moments from here on
TURNED_HARDLY = 0.75  # as `moment_most` of the specification


@dataclass(frozen=True)
class Printed:
    """One number of the paper: where it stands, and what `run_trial` calls it."""

    table: str
    model: str
    symbol: str
    key: str
    value: float


PRINTED = (
    Printed("1", "1", "k_r", "k_r of model 1", 0.9961),
    Printed("1", "1", "SSE", "SSE of model 1", 1.8908),
    Printed("1", "2", "k_r|r|", "k_rr of model 2", 1.259),
    Printed("1", "2", "k_r", "k_r of model 2", 0.02753),
    Printed("1", "2", "SSE", "SSE of model 2", 0.8019),
    Printed("1", "3", "k_r|r|", "k_rr of model 3", 1.257),
    Printed("1", "3", "SSE", "SSE of model 3", 0.8353),
    Printed("1", "1 less 3", "SSE", "SSE of model 1 less model 3", 1.0555),
    Printed("1", "3 less 2", "SSE", "SSE of model 3 less model 2", 0.0334),
    Printed("1", "3 less 2", "k_r|r|", "k_rr of model 3 less model 2", -0.002),
    Printed("1", "2 as 3+c", "k_r|r|", "k_rr of model 3+c", 1.259),
    Printed("1", "2 as 3+c", "c", "c of model 3+c", 0.02753),
    Printed("1", "2 as 3+c", "SSE", "SSE of model 3+c", 0.8019),
    Printed("1", "3 less 3+c", "SSE", "SSE of model 3 less model 3+c", 0.0334),
    Printed("2", "1", "I_r, all moments", "I_r of model 1", 0.7058),
    Printed("2", "1", "I_r, |τ| ≥ 0.5", "I_r of model 1, large moments", 0.7058),
    Printed("2", "3", "I_r", "I_r of model 3", 1.018),
)
"""Every printed number of Tables 1 and 2, and what follows from them. Model "3+c" is tau = k_r|r| |r| r + c: the
reading under which the numbers printed for model 2 are those of a constant moment."""


@dataclass(frozen=True)
class Setting:
    """What the simulated campaigns hide: a constant moment `bias`; with `recorded`, the scatter of the moments is
    in what the log says of them and not in what acts."""

    name: str
    bias: float = 0.0
    recorded: bool = False

    def apply(self, specification: Specification) -> Specification:
        """The campaign of the specification with this hidden in it."""
        if self.bias:
            specification = specification.with_effect("bias-moment", b=self.bias)
        if self.recorded:
            specification = replace(specification, scatter=replace(specification.scatter, force=0.0))
        return specification


SETTINGS = (
    Setting("nothing hidden"),
    Setting(f"constant moment {CONSTANT}", bias=-CONSTANT),
    Setting(f"constant moment {CONSTANT}, scatter in the recorded moment", bias=-CONSTANT, recorded=True),
)


def run_trial(item: tuple[Specification, Setting, int]) -> dict[str, float]:
    """Simulate the campaign with that seed and find every number of `PRINTED`, and what judges them.

    By the plain least squares that the paper had: what the noise of the rates dilutes is not taken off.
    """
    specification, setting, seed = item
    turns, _ = half_turns(make_runs(setting.apply(specification), seed))
    data = half_turn_data(turns)
    fit = fit_velocity_error(data, np.zeros(len(turns)))
    # the same tails, where the scatter is in the record against moments that were written down wrong
    moment = _misread(data.moment, specification.scatter.force, seed) if setting.recorded else data.moment
    drags = {number: fit_drag(moment, fit.tails.rate, number, "nu", YAW) for number in fit.drag}
    inertia = {
        number: inertia_from_velocity_error(fit.tails.error, moment, *drags[number].drag) for number in fit.inertia
    }
    values = {
        f"{name} of model {number}": estimate.value
        for number, drag in drags.items()
        for name, estimate in drag.estimates.items()
    }
    values |= {f"SSE of model {number}": drag.sse for number, drag in drags.items()}
    values |= {f"I_r of model {number}": float(per_run.mean()) for number, per_run in inertia.items()}
    for name, large, small in (("SSE", "1", "3"), ("SSE", "3", "2"), ("SSE", "3", "3+c"), ("k_rr", "3", "2")):
        values[f"{name} of model {large} less model {small}"] = (
            values[f"{name} of model {large}"] - values[f"{name} of model {small}"]
        )
    fast = np.abs(data.moment) >= LARGE_MOMENT - 1e-9  # by the moment that was meant
    k3, k2, k_r = (values[f"{name} of model {n}"] for name, n in (("k_rr", "3"), ("k_rr", "2"), ("k_r", "2")))
    rate = np.abs(fit.tails.rate)
    return values | {
        "I_r of model 1, large moments": float(inertia["1"][fast].mean()),
        "half-turns": float(len(turns)),
        "tail from": float(np.degrees(fit.tail_from)),
        "steady": float(fit.steady),
        "identity gap": float(k3 - k2 - k_r * np.sum(rate**3) / np.sum(rate**4)),
        "sum ratio": float(np.sum(rate**3) / np.sum(rate**4)),
        "corrected k_r": fit.drag["2"].drag[0],
        "corrected k_rr": fit.drag["3"].drag[1],
        "residual": float(np.sqrt(values["SSE of model 3"] / len(turns))),
    }


def _misread(moment: Floats, sd: float, seed: int) -> Floats:
    """The moments with the specification's scatter, redrawn by the same rule, in the record of them."""
    random = np.random.default_rng([5, seed])
    error = sd * random.standard_normal(len(moment))
    while np.any(wide := np.abs(error) > TURNED_HARDLY * np.abs(moment)):
        error[wide] = sd * random.standard_normal(int(wide.sum()))
    return moment + error
